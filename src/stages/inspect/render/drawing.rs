//! A mesh that has been drawn and not yet lit: for pictures, and for questions about what is seen.

use super::{
    frame::Frame,
    picture::{Color, Picture},
    scene::Scene,
    shade::{self, of_pixel},
};
use crate::formats::Findings;

/// What is seen of a mesh.
pub struct Drawing {
    pub(super) frame: Frame,
    pub(super) scene: Scene,
    /// Triangles drawn, seen or not.
    pub triangles: u64,
    /// What the pass found.
    pub findings: Findings,
}

/// What surfaces are painted with.
#[derive(Clone, Copy, Debug)]
pub enum Paint<'a> {
    /// Grey, as plaster.
    Plaster,
    /// The colours of the mesh, which was drawn with a payload that has them.
    Vertices,
    /// A colour for each pixel of the picture, row by row, of a mesh drawn without colours.
    Pixels(&'a [Color]),
}

/// A point of the surface that is seen at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visible {
    /// Index of the pixel, row by row.
    pub pixel: u32,
    /// The point, relative to the origin of the mesh. It is exact to some 10⁻⁶ of the mesh.
    pub position: [f64; 3],
}

impl Drawing {
    /// The picture, lit.
    #[must_use]
    pub fn picture(&self, paint: &Paint) -> Picture {
        shade::shade(&self.frame, &self.scene, paint)
    }

    /// For each pixel at which something is seen a point of it, in the order of the pixels.
    #[must_use]
    pub fn visible(&self) -> Vec<Visible> {
        let mut visible = Vec::new();
        let width = self.scene.size.width;
        for pixel in 0..width * self.scene.size.height {
            let at = [pixel % width, pixel / width];
            let panels = &self.scene.panels;
            let sample = |(row, column)| {
                let (depth, _) = self.frame.sample(row, column)?;
                let panel = panels.iter().find(|panel| panel.area.contains([column, row]))?;
                Some(panel.position([column, row], depth))
            };
            let position = of_pixel(at, self.scene.samples).find_map(sample);
            let pixel = pixel as u32;
            visible.extend(position.map(|position| Visible { pixel, position }));
        }
        visible
    }
}
