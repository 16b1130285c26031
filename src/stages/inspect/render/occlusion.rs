//! Darker where a surface lies in a hollow, from depths alone: a hint of the light that does not
//! get in there.
//!
//! For two points at the same distance on opposite sides it asks whether they are, on average,
//! nearer than the middle. On planes they are not, however those are tilted.

/// Depth of each pixel, row by row, infinite where nothing is.
pub(super) struct Depths {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) by_pixel: Vec<f32>,
}

/// Directions to look in, each with its opposite, on circles of these radii; the share of each.
const DIRECTIONS: [[f32; 2]; 6] = [
    [1.0, 0.0],
    [0.866_025_4, 0.5],
    [0.5, 0.866_025_4],
    [0.0, 1.0],
    [-0.5, 0.866_025_4],
    [-0.866_025_4, 0.5],
];
/// Radii relative to the greatest, with the weights of what is found there.
const RINGS: [(f32, f32); 4] = [(0.08, 0.2), (0.2, 0.25), (0.48, 0.3), (1.0, 0.25)];
/// How dark what is found makes it.
const STRENGTH: f32 = 1.5;
/// Something so many times farther in front than to the side is not a wall of the hollow.
const DETACHED: f32 = 4.0;
/// Never darker than this.
const LEAST: f32 = 0.3;

/// Points to compare with, the same for each pixel of a picture.
pub(super) struct Kernel {
    /// Offset in pixels, what a depth is divided by, weight.
    pairs: Vec<([isize; 2], f32, f32)>,
}

impl Kernel {
    /// A kernel for hollows up to `radius` pixels wide, in a frame of so many depth units a pixel.
    pub(super) fn new(radius: f32, depth_per_pixel: f32) -> Self {
        let mut pairs = Vec::new();
        for (ring, weight) in RINGS {
            let radius = (radius * ring).max(1.0);
            for [x, y] in DIRECTIONS {
                let offset = [x, y].map(|part| (part * radius).round() as isize);
                let [x, y] = offset.map(|part| part as f32);
                let length = x.hypot(y);
                let weight = weight / DIRECTIONS.len() as f32;
                pairs.push((offset, (length * depth_per_pixel).recip(), weight));
            }
        }
        Self { pairs }
    }

    /// The share of light that gets to a pixel, at most 1.
    pub(super) fn openness(&self, depths: &Depths, row: usize, column: usize) -> f32 {
        let here = depths.by_pixel[row * depths.width + column];
        let mut hidden = 0.0;
        for &([x, y], per_depth, weight) in &self.pairs {
            let rise = |x, y| {
                let there = depths.at(row, y, column, x);
                let rise = (here - there) * per_depth;
                // Never so for what lies behind: beside a rim it makes up for the near side.
                if rise < 0.0 {
                    return rise.max(-1.0);
                }
                (rise / (1.0 + (rise / DETACHED).powi(2))).min(1.0)
            };
            hidden += weight * (rise(x, y) + rise(-x, -y)).max(0.0);
        }
        (1.0 - STRENGTH * 0.5 * hidden).max(LEAST)
    }
}

impl Depths {
    /// The depth at an offset; infinite outside.
    #[inline]
    fn at(&self, row: usize, down: isize, column: usize, right: isize) -> f32 {
        let (row, column) = (row.wrapping_add_signed(down), column.wrapping_add_signed(right));
        if row < self.height && column < self.width {
            self.by_pixel[row * self.width + column]
        } else {
            f32::INFINITY
        }
    }
}
