//! Fields whose zero level is the surface: negative inside, positive outside.
//!
//! A field is sampled at the points of a cubic grid centred on the origin. It is a base shape, for
//! which a bound on the slope is known, plus noise, for which a bound on the value is known: so
//! bricks of cells which the surface cannot reach are told from one value, and never evaluated.
//! Sines and cosines come from a polynomial of our own, since those of libm differ between
//! platforms; there are only as many as samples along one axis.

use std::ops::Range;

use super::{
    Config, Kind,
    noise::{Noise, NoiseWindow, Spectrum},
};

/// Cells of a brick along x, and of a tile along y and z. Chosen by hand: one word of signs is
/// four bricks, and a tile's values of two slices stay in the second-level cache.
pub(super) const BRICK: [usize; 3] = [16, 8, 8];

/// Period of the gyroid, in radii of its ball: four across.
const PERIOD: f64 = 0.5;

/// Width of the rounded seam between gyroid and ball, in radii of the ball. Chosen by hand.
const SEAM: f32 = 0.03;

/// Wavelength of the coarsest noise, in radii.
const SPHERE_WAVELENGTH: f64 = 0.5;

/// Wavelength of the finest noise, in cells, at least: finer, it would be seen as steps.
const WAVELENGTH_MIN_CELLS: f64 = 4.0;

/// Rounding of single precision can move a value by much less than this, in radii.
const ROUNDING: f32 = 1e-5;

/// A field on its grid.
pub(super) struct Field {
    shape: Shape,
    /// Distance of two samples along an axis.
    spacing: f64,
    /// Coordinate of each sample along an axis; the same for all three.
    coordinates: Vec<f32>,
    /// Half the square of each coordinate.
    half_squares: Vec<f32>,
    /// [`Shape::Gyroid`] only: sine of each coordinate's phase, scaled to model units, and cosine.
    sines: Vec<f32>,
    cosines: Vec<f32>,
    noise: Noise,
    /// The noise is never larger, in model units.
    noise_max: f32,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Shape {
    Sphere,
    Gyroid,
}

impl Field {
    /// The field of `config` at samples `spacing` apart, in radii. The grid ends at least one
    /// empty cell beyond the surface; its cells per axis are a multiple of [`BRICK`], so that
    /// tiles are never cut.
    pub(super) fn new(config: &Config, spacing: f64) -> Self {
        let shape = if config.kind == Kind::Gyroid { Shape::Gyroid } else { Shape::Sphere };
        let (feature, wavelength) = match shape {
            Shape::Sphere => (1.0, SPHERE_WAVELENGTH),
            Shape::Gyroid => (PERIOD / 2.0, PERIOD / 2.0),
        };
        let amplitude = config.noise * feature;
        // Beyond it (r² - 1)/2 exceeds the noise: nothing is left inside.
        let reach = (1.0 + 2.0 * amplitude).sqrt();
        let cells = ((2.0 * (reach / spacing + 1.0)) as usize + 1).next_multiple_of(BRICK[0]);
        let axis: Vec<f64> =
            (0..=cells).map(|i| (i as f64 - (cells / 2) as f64) * spacing).collect();
        let spectrum = Spectrum {
            wavelength,
            amplitude,
            wavelength_min: WAVELENGTH_MIN_CELLS * spacing,
            seed: config.seed,
        };
        // The slope of the bare sum of sines is at most √3 per radian, and about 3/2 where it
        // vanishes: divided by that, values near the surface are distances.
        let scale = PERIOD / (std::f64::consts::TAU * 1.5);
        // An eighth of a period on every axis brings the middle of the grid well inside.
        let turns = |c: &f64| c / PERIOD - 0.125;
        Self {
            shape,
            spacing,
            coordinates: axis.iter().map(|&c| c as f32).collect(),
            half_squares: axis.iter().map(|c| (0.5 * c * c) as f32).collect(),
            sines: axis.iter().map(|c| (scale * sine(turns(c))) as f32).collect(),
            cosines: axis.iter().map(|c| sine(turns(c) + 0.25) as f32).collect(),
            noise: Noise::new(&spectrum, [&axis, &axis, &axis]),
            noise_max: amplitude as f32,
        }
    }

    /// Cells along each axis.
    pub(super) fn cells(&self) -> usize {
        self.coordinates.len() - 1
    }

    /// Coordinate of each sample along an axis.
    pub(super) fn coordinates(&self) -> &[f32] {
        &self.coordinates
    }

    /// Distance of two samples along an axis.
    pub(super) fn spacing(&self) -> f32 {
        self.spacing as f32
    }

    /// The noise around a window of rows.
    pub(super) fn place_noise(
        &self,
        window: &mut NoiseWindow,
        xs: &Range<usize>,
        ys: &Range<usize>,
        zs: &Range<usize>,
    ) {
        window.place(&self.noise, xs, ys, zs);
    }

    /// Writes the field at samples `run` of row (`y`, `z`) into the same places of `row`.
    pub(super) fn evaluate(
        &self,
        window: &mut NoiseWindow,
        (y, z): (usize, usize),
        run: &Range<usize>,
        row: &mut [f32],
    ) {
        self.evaluate_base((y, z), run, &mut row[run.clone()]);
        window.add_row(&self.noise, (y, z), run, row);
    }

    /// The sign all samples of the brick that starts at `corner` have, when they must agree.
    pub(super) fn certain_side(&self, corner: [usize; 3]) -> Option<Side> {
        let [x, y, z] = std::array::from_fn(|axis| corner[axis] + BRICK[axis] / 2);
        let mut value = [0.0];
        self.evaluate_base((y, z), &(x..x + 1), &mut value);
        let radius = 0.5
            * self.spacing
            * (BRICK.map(|cells| (cells * cells) as f64).iter().sum::<f64>()).sqrt();
        let to_middle =
            f64::from(2.0 * (self.half_squares[x] + self.half_squares[y] + self.half_squares[z]))
                .sqrt();
        let slope = match self.shape {
            Shape::Sphere => to_middle + radius,
            Shape::Gyroid => (to_middle + radius).max(3f64.sqrt() / 1.5),
        };
        let reach = (slope * radius) as f32 + self.noise_max + ROUNDING;
        if value[0] > reach {
            Some(Side::Outside)
        } else if value[0] < -reach {
            Some(Side::Inside)
        } else {
            None
        }
    }

    /// Field without noise; `values` are the samples `run`.
    fn evaluate_base(&self, (y, z): (usize, usize), run: &Range<usize>, values: &mut [f32]) {
        let ball = self.half_squares[y] + self.half_squares[z] - 0.5;
        let half_squares = &self.half_squares[run.clone()];
        match self.shape {
            Shape::Sphere => {
                for (value, half_square) in values.iter_mut().zip(half_squares) {
                    *value = half_square + ball;
                }
            }
            Shape::Gyroid => {
                let (cosine_y, sine_z) = (self.cosines[y], self.sines[z]);
                let across = self.sines[y] * self.cosines[z];
                let phases = self.sines[run.clone()].iter().zip(&self.cosines[run.clone()]);
                for ((value, half_square), (sine, cosine)) in
                    values.iter_mut().zip(half_squares).zip(phases)
                {
                    let gyroid = sine * cosine_y + across + sine_z * cosine;
                    *value = smooth_max(gyroid, half_square + ball);
                }
            }
        }
    }
}

/// Where samples lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// Negative values.
    Inside,
    /// Positive values and zero.
    Outside,
}

/// The larger value, rounded off where the two are within [`SEAM`]; its slope is a mean of both.
fn smooth_max(a: f32, b: f32) -> f32 {
    let near = SEAM - (a - b).abs();
    let near = if near > 0.0 { near } else { 0.0 };
    (if a > b { a } else { b }) + near * near * (0.25 / SEAM)
}

/// Sine of an angle in turns, by its series after folding to a quarter turn; within 1e-9.
fn sine(turns: f64) -> f64 {
    let turns = turns - (turns + 0.5).floor();
    let folded = if turns > 0.25 {
        0.5 - turns
    } else if turns < -0.25 {
        -0.5 - turns
    } else {
        turns
    };
    let x = folded * std::f64::consts::TAU;
    let square = x * x;
    let mut term = x;
    let mut sum = x;
    for n in 1..8 {
        term *= -square / f64::from(2 * n * (2 * n + 1));
        sum += term;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::generate::Layout;

    fn config(kind: Kind) -> Config {
        Config { kind, triangles: 1, noise: 0.1, seed: 3, layout: Layout::Soup }
    }

    #[test]
    fn our_sine_is_the_sine() {
        for step in -4000..4000 {
            let turns = f64::from(step) / 1234.5;
            assert!((sine(turns) - (turns * std::f64::consts::TAU).sin()).abs() < 1e-9);
        }
    }

    #[test]
    fn bricks_that_are_skipped_hold_no_change_of_sign() {
        for kind in [Kind::Sphere, Kind::Gyroid] {
            let field = Field::new(&config(kind), 0.014);
            let samples = field.cells() + 1;
            let mut window = NoiseWindow::default();
            let mut skipped = 0;
            for z in (0..field.cells()).step_by(3 * BRICK[2]) {
                for y in (0..field.cells()).step_by(BRICK[1]) {
                    let rows = y..y + BRICK[1] + 1;
                    field.place_noise(&mut window, &(0..samples), &rows, &(z..z + BRICK[2] + 1));
                    for (at_y, at_z) in [(y, z), (y + 8, z + 8), (y + 4, z + 4), (y, z + 8)] {
                        let mut row = vec![0.0; samples];
                        field.evaluate(&mut window, (at_y, at_z), &(0..samples), &mut row);
                        for x in (0..field.cells()).step_by(BRICK[0]) {
                            let Some(side) = field.certain_side([x, y, z]) else { continue };
                            skipped += 1;
                            let inside = side == Side::Inside;
                            assert!(row[x..=x + 16].iter().all(|&v| (v < 0.0) == inside));
                        }
                    }
                }
            }
            assert!(skipped > 100, "{skipped}");
        }
    }
}
