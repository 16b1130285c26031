//! From samples to pixels: light, hollows, and the colour of each kind of surface.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    camera::{Area, STEPS_PER_SAMPLE},
    drawing::Paint,
    frame::{Frame, Seen},
    light,
    occlusion::{Depths, Kernel},
    picture::{Color, Picture},
    scene::Scene,
};

/// Behind everything.
pub const BACKGROUND: Color = [244, 245, 247];
/// The front of a plain surface.
const FRONT: Color = [224, 219, 209];
/// The back of one: seen through holes, or where triangles are the wrong way round.
const BACK: Color = [128, 158, 200];
/// The back of a coloured one is darker by this.
const BACK_SHADE: f32 = 0.6;
/// Edges of a wireframe.
const EDGE: Color = [34, 40, 52];

/// Width of hollows that are darkened, relative to the shorter side of a panel.
const HOLLOW: f32 = 0.03;

/// Makes the picture of what was drawn.
pub(super) fn shade(frame: &Frame, scene: &Scene, paint: &Paint) -> Picture {
    let depths = depths(frame, scene.samples);
    let mut picture = Picture::new(depths.width, depths.height, BACKGROUND);
    let width = depths.width;
    let light = Light::new(scene, &depths);
    picture.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
        for (column, pixel) in pixels.iter_mut().enumerate() {
            if depths.by_pixel[row * width + column] < f32::INFINITY {
                *pixel = light.pixel(frame, [column, row], paint);
            }
        }
    });
    picture
}

/// The nearest depth in each pixel.
fn depths(frame: &Frame, samples: usize) -> Depths {
    let (width, height) = (frame.width / samples, frame.height / samples);
    let mut depths = vec![f32::INFINITY; width * height];
    depths.par_chunks_mut(width).enumerate().for_each(|(row, depths)| {
        for (column, depth) in depths.iter_mut().enumerate() {
            for (row, column) in of_pixel([column, row], samples) {
                let there = frame.sample(row, column).map_or(f32::INFINITY, |(depth, _)| depth);
                *depth = depth.min(there);
            }
        }
    });
    Depths { width, height, by_pixel: depths }
}

/// Rows and columns of the samples of a pixel.
pub(super) fn of_pixel(
    [column, row]: [usize; 2],
    samples: usize,
) -> impl Iterator<Item = (usize, usize)> {
    let rows = row * samples..(row + 1) * samples;
    rows.flat_map(move |row| (column * samples..(column + 1) * samples).map(move |c| (row, c)))
}

/// All that lights a pixel.
struct Light<'a> {
    scene: &'a Scene,
    depths: &'a Depths,
    kernel: Kernel,
    /// Linear light.
    background: Vec3,
    front: Vec3,
    back: Vec3,
    edge: Vec3,
}

impl<'a> Light<'a> {
    fn new(scene: &'a Scene, depths: &'a Depths) -> Self {
        let side = |area: &Area| area.width.min(area.height) / scene.samples;
        let side = scene.panels.iter().map(|panel| side(&panel.area)).min().unwrap_or(1);
        let radius = side as f32 * HOLLOW;
        let depth_per_pixel = (STEPS_PER_SAMPLE * scene.samples as i32) as f32;
        let [background, front, back, edge] = [BACKGROUND, FRONT, BACK, EDGE].map(light::decode);
        let kernel = Kernel::new(radius, depth_per_pixel);
        Self { scene, depths, kernel, background, front, back, edge }
    }

    /// The colour of a pixel in which something is seen.
    fn pixel(&self, frame: &Frame, at: [usize; 2], paint: &Paint) -> Color {
        let openness = self.kernel.openness(self.depths, at[1], at[0]);
        let samples = self.scene.samples;
        let mut sum = Vec3::ZERO;
        let painted = match paint {
            Paint::Pixels(colors) => light::decode(colors[at[1] * self.depths.width + at[0]]),
            Paint::Plaster | Paint::Vertices => Vec3::ONE,
        };
        for (row, column) in of_pixel(at, samples) {
            sum += match frame.sample(row, column) {
                None => self.background,
                Some((_, seen)) if seen.is_edge() => self.edge,
                Some((_, seen)) => openness * self.surface(seen, paint, painted),
            };
        }
        light::encode(sum / (samples * samples) as f32)
    }

    fn surface(&self, seen: Seen, paint: &Paint, painted: Vec3) -> Vec3 {
        match paint {
            Paint::Vertices => {
                let (light, color) = seen.light_and_color();
                let color = color.map(light::decode_share);
                color * light * if seen.is_back() { BACK_SHADE } else { 1.0 }
            }
            Paint::Plaster => {
                let normal = seen.normal();
                let color = if seen.is_back() { self.back } else { self.front };
                color * light::of_normal(normal) + light::gloss(normal)
            }
            Paint::Pixels(_) => painted * light::of_normal(seen.normal()),
        }
    }
}
