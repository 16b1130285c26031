//! The picture of a comparison: both meshes side by side, and what keeps them apart painted on the
//! first.

use glam::DVec3;

use super::{
    Compare, CompareInput,
    render::{self, check_size},
    run::check_target,
};
use crate::{
    error::{Error, Result},
    progress::Monitor,
    soup::{InputPath, Point},
    stages::{
        convert::export,
        inspect::{
            deviation::{self, Outcome, Surface},
            render::{
                self as stage, Config, Edges, Extents, HeatMap, Paint, Panel, Picture, Scene, Size,
                Up, View,
            },
        },
    },
    storage::Budget,
};

/// The picture of a comparison.
#[derive(Clone, Debug)]
pub struct ComparePicture {
    /// The file, as PNG.
    pub target: export::Target,
    /// From where both meshes are seen.
    pub view: View,
    /// The axis that points up.
    pub up: Up,
}

/// Pixels of each of the three panels.
const PANEL: Size = Size { width: 800, height: 800 };
/// Samples along each side of a pixel.
const SAMPLES: usize = 2;
/// Bytes of a point that is seen, and of its distance.
const BYTES_PER_POINT: u64 = (size_of::<stage::Visible>() + 4 * size_of::<f64>()) as u64;
/// The picture takes at most one of so many parts of the memory: the rest may be held by vertices.
const MEMORY_PARTS: u64 = 3;

impl ComparePicture {
    /// Refuses, before any work is done, what cannot be drawn or written.
    pub(super) fn check(&self, compare: &Compare) -> Result<()> {
        check_target(&[&compare.a.paths[..], &compare.b.paths[..]].concat(), &self.target)?;
        check_size(&self.config())?;
        let (needed_bytes, available_bytes) = (MEMORY_PARTS * memory_bytes(), compare.memory_bytes);
        if needed_bytes > available_bytes {
            return Err(Error::Resource { what: "the picture", needed_bytes, available_bytes });
        }
        Ok(())
    }

    /// Draws and writes the picture of two surfaces whose deviation is known.
    pub(super) fn make(
        &self,
        compare: &Compare,
        [a, b]: [&Surface<Point>; 2],
        outcome: &Outcome,
        (budget, monitor): (&Budget, &Monitor),
    ) -> Result<()> {
        let _room = budget.reserve_share(0.0, memory_bytes());
        let config = self.config();
        let extents = |surface: &Surface<Point>| {
            let extents = Extents::measure(surface.source, &config, budget, monitor)?;
            // Surfaces without an area were refused.
            extents.ok_or_else(|| Error::Request("there is nothing to be seen".to_owned()))
        };
        // Of B relative to the origin of A.
        let shift = DVec3::from_array(b.origin) - DVec3::from_array(a.origin);
        let scene = Scene::new(&extents(a)?.union(&extents(b)?, shift), &config);
        let drawing = stage::draw(a.source, &scene, budget, monitor)?;
        let plain_a = drawing.picture(&Paint::Plaster);
        let seen = drawing.visible();
        let points: Vec<_> =
            seen.iter().map(|seen| (DVec3::from(seen.position) - shift).to_array()).collect();
        let target = deviation::Target::new(b, budget);
        let distances = deviation::distances(&points, &target, 0.0, budget, monitor)?;
        drop((points, target));
        let heat = HeatMap::new(&distances);
        let mut colors = vec![stage::BACKGROUND; PANEL.width * PANEL.height];
        for (seen, distance) in seen.iter().zip(&distances) {
            colors[seen.pixel as usize] = heat.color(*distance);
        }
        let painted = drawing.picture(&Paint::Pixels(&colors));
        drop((drawing, seen, distances, colors));
        let plain_b = stage::draw(b.source, &scene.shifted(shift), budget, monitor)?;
        let plain_b = plain_b.picture(&Paint::Plaster);
        let captions = [mesh(&compare.a, a), mesh(&compare.b, b), deviation(outcome)];
        let pictures: [&Picture; 3] = [&plain_a, &plain_b, &painted];
        let panels = pictures.iter().zip(&captions);
        let panels: Vec<_> = panels.map(|(picture, caption)| Panel { picture, caption }).collect();
        render::write(&stage::side_by_side(&panels, heat), &self.target).map(drop)
    }

    fn config(&self) -> Config {
        let (views, up) = (vec![self.view], self.up);
        Config { views, up, size: PANEL, samples: SAMPLES, edges: Edges::Hidden }
    }
}

fn memory_bytes() -> u64 {
    let points = (PANEL.width * PANEL.height) as u64 * BYTES_PER_POINT;
    stage::memory_bytes(PANEL, SAMPLES) + stage::sheet_bytes(PANEL, 3) + points
}

/// The caption of a mesh: its name and size.
fn mesh(input: &CompareInput, surface: &Surface<Point>) -> Vec<String> {
    let file_name = |path: &InputPath| {
        let path = path.as_path();
        path.file_name().unwrap_or(path.as_os_str()).display().to_string()
    };
    vec![input.name(file_name), format!("{} triangles", grouped(surface.triangles))]
}

fn deviation(outcome: &Outcome) -> Vec<String> {
    let [max, rms] = [outcome.max, outcome.statistics.rms].map(stage::number);
    vec!["distance to the second".to_owned(), format!("max {max}, rms {rms}, in model units")]
}

/// `1234567` → `1,234,567`.
fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let parts = digits.as_bytes().rchunks(3).rev();
    parts.map(String::from_utf8_lossy).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_are_told_apart() {
        assert_eq!([0, 999, 1000, 1_234_567].map(grouped), ["0", "999", "1,000", "1,234,567"]);
    }
}
