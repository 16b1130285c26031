//! Fractal value noise from an integer hash: the same bits on every platform.
//!
//! Only integer arithmetic and `+ - *` on floats are used, in a fixed order, and nothing of libm:
//! no platform rounds those differently, and Rust never contracts them to fused operations.
//! An octave is a lattice of pseudo-random values in [-1, 1), blended by a quintic fade whose
//! first two derivatives vanish at the lattice points.

use std::ops::Range;

/// Which lattices, and how high their values are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spectrum {
    /// Lattice spacing of the coarsest octave, in model units; it halves from octave to octave.
    pub(super) wavelength: f64,
    /// Bound on the sum of all octaves' amplitudes, in model units.
    pub(super) amplitude: f64,
    /// Octaves below this wavelength are left out, but for the first [`OCTAVES_MIN`].
    pub(super) wavelength_min: f64,
    /// Stream of the hash.
    pub(super) seed: u64,
}

/// Octaves even of a surface too coarse to show them. Chosen by hand: so that no size is smooth.
const OCTAVES_MIN: usize = 2;

/// Octaves over a grid of samples. The value at a place does not depend on the grid.
pub(super) struct Noise {
    octaves: Vec<Octave>,
}

struct Octave {
    key: u64,
    amplitude: f32,
    axes: [Axis; 3],
}

/// Where the samples of one axis lie in the lattice of one octave.
struct Axis {
    /// Lattice coordinate that node 0 stands for.
    first: i64,
    /// Node at or below each sample, ascending.
    cells: Vec<u32>,
    /// Faded position of each sample between its node and the next.
    weights: Vec<f32>,
    /// First sample at or above each node, and the sample count at the end.
    starts: Vec<u32>,
}

impl Noise {
    /// Noise at the samples whose coordinates `axes` lists in ascending order.
    pub(super) fn new(spectrum: &Spectrum, axes: [&[f64]; 3]) -> Self {
        let mut octaves = Vec::new();
        let mut wavelength = spectrum.wavelength;
        let mut amplitude = 0.5 * spectrum.amplitude;
        let mut key = mix(spectrum.seed);
        let shown = |wavelength: f64, octaves: usize| {
            octaves < OCTAVES_MIN || wavelength >= spectrum.wavelength_min
        };
        while spectrum.amplitude > 0.0 && shown(wavelength, octaves.len()) {
            octaves.push(Octave {
                key,
                amplitude: amplitude as f32,
                axes: axes.map(|coordinates| Axis::new(coordinates, wavelength)),
            });
            // Slopes stay equal from octave to octave: rough at every scale, as scans are.
            wavelength *= 0.5;
            amplitude *= 0.5;
            key = mix(key);
        }
        Self { octaves }
    }
}

impl Axis {
    fn new(coordinates: &[f64], wavelength: f64) -> Self {
        let lattice = |coordinate: f64| (coordinate / wavelength).floor() as i64;
        let first = coordinates.first().map_or(0, |&c| lattice(c));
        let cells: Vec<u32> = coordinates.iter().map(|&c| (lattice(c) - first) as u32).collect();
        let weights = coordinates
            .iter()
            .map(|&c| fade(c / wavelength - (c / wavelength).floor()) as f32)
            .collect();
        let last = cells.last().copied().unwrap_or_default();
        let starts =
            (0..=last + 1).map(|node| cells.partition_point(|&cell| cell < node) as u32).collect();
        Self { first, cells, weights, starts }
    }

    fn nodes(&self) -> usize {
        self.starts.len()
    }
}

/// The lattice values around a window of rows, hashed once and used by every row of it.
#[derive(Default)]
pub(super) struct NoiseWindow {
    /// Per octave, rows of nodes along x: y fastest, then z.
    lines: Vec<Vec<f32>>,
    /// Per octave, the window's first node and number of nodes along y, then along z.
    spans: Vec<[(usize, usize); 2]>,
    /// Nodes along x of the row at hand.
    blended: Vec<f32>,
}

impl NoiseWindow {
    /// Moves the window to rows `ys` × `zs`, of which samples `xs` will be asked.
    pub(super) fn place(
        &mut self,
        noise: &Noise,
        xs: &Range<usize>,
        ys: &Range<usize>,
        zs: &Range<usize>,
    ) {
        self.lines.resize_with(noise.octaves.len(), Vec::new);
        self.spans.clear();
        for (octave, lines) in noise.octaves.iter().zip(&mut self.lines) {
            let [x, y, z] = &octave.axes;
            let spans = [span(y, ys), span(z, zs)];
            let nodes = x.nodes();
            lines.resize(nodes * spans[0].1 * spans[1].1, 0.0);
            let wanted = x.cells[xs.start] as usize..x.cells[xs.end - 1] as usize + 2;
            for (row, line) in lines.chunks_exact_mut(nodes).enumerate() {
                let at_y = y.first + (spans[0].0 + row % spans[0].1) as i64;
                let at_z = z.first + (spans[1].0 + row / spans[0].1) as i64;
                let key = mix(octave.key ^ mix(at_y as u64) ^ mix(mix(at_z as u64)));
                let first = x.first + wanted.start as i64;
                fill_nodes(key, first, octave.amplitude, &mut line[wanted.clone()]);
            }
            self.spans.push(spans);
        }
    }

    /// Adds the noise at samples `run` of row (`y`, `z`) to the same samples of `row`.
    pub(super) fn add_row(
        &mut self,
        noise: &Noise,
        (y, z): (usize, usize),
        run: &Range<usize>,
        row: &mut [f32],
    ) {
        for ((octave, lines), spans) in noise.octaves.iter().zip(&self.lines).zip(&self.spans) {
            let [axis_x, axis_y, axis_z] = &octave.axes;
            let nodes = axis_x.nodes();
            let wanted = axis_x.cells[run.start] as usize..axis_x.cells[run.end - 1] as usize + 2;
            let line = |up_y: usize, up_z: usize| {
                let at_y = axis_y.cells[y] as usize - spans[0].0 + up_y;
                let at_z = axis_z.cells[z] as usize - spans[1].0 + up_z;
                let start = (at_z * spans[0].1 + at_y) * nodes;
                &lines[start + wanted.start..start + wanted.end]
            };
            let corners = [line(0, 0), line(1, 0), line(0, 1), line(1, 1)];
            self.blended.resize(wanted.len(), 0.0);
            blend(corners, axis_y.weights[y], axis_z.weights[z], &mut self.blended);
            add_faded(axis_x, &self.blended, run, row);
        }
    }
}

/// First node and number of nodes that rows `samples` lie between.
fn span(axis: &Axis, samples: &Range<usize>) -> (usize, usize) {
    let first = axis.cells[samples.start] as usize;
    (first, axis.cells[samples.end - 1] as usize + 2 - first)
}

fn blend(corners: [&[f32]; 4], weight_y: f32, weight_z: f32, blended: &mut [f32]) {
    let count = blended.len();
    let [a, b, c, d] = corners.map(|line| &line[..count]);
    for node in 0..count {
        let low = a[node] + (b[node] - a[node]) * weight_y;
        let high = c[node] + (d[node] - c[node]) * weight_y;
        blended[node] = low + (high - low) * weight_z;
    }
}

/// `blended` starts at the node below sample `run.start`.
fn add_faded(axis: &Axis, blended: &[f32], run: &Range<usize>, row: &mut [f32]) {
    let first = axis.cells[run.start] as usize;
    for (offset, pair) in blended.windows(2).enumerate() {
        let (low, step) = (pair[0], pair[1] - pair[0]);
        let start = (axis.starts[first + offset] as usize).max(run.start);
        let end = (axis.starts[first + offset + 1] as usize).min(run.end);
        for (value, weight) in row[start..end].iter_mut().zip(&axis.weights[start..end]) {
            *value += low + step * weight;
        }
    }
}

fn fill_nodes(key: u64, first: i64, amplitude: f32, nodes: &mut [f32]) {
    let (low, high) = (key as u32, (key >> 32) as u32);
    for (offset, node) in nodes.iter_mut().enumerate() {
        *node = amplitude * unit(hash(low, high, (first as u32).wrapping_add(offset as u32)));
    }
}

/// 32 well-mixed bits for lattice coordinate `x` on the line of `low` and `high`: the finaliser
/// of `MurmurHash3`, with the second half of the key added in the middle.
fn hash(low: u32, high: u32, x: u32) -> u32 {
    let mut h = x.wrapping_mul(0x9E37_79B1) ^ low;
    h = (h ^ (h >> 16)).wrapping_mul(0x85EB_CA6B).wrapping_add(high);
    h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
    h ^ (h >> 16)
}

/// The top 24 bits as a number in [-1, 1); exact.
fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 8_388_608.0) - 1.0
}

/// One step of `SplitMix64`.
fn mix(state: u64) -> u64 {
    let mut z = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// 6t⁵ - 15t⁴ + 10t³.
fn fade(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(coordinates: &[f64], seed: u64) -> Vec<f32> {
        let spectrum = Spectrum { wavelength: 1.0, amplitude: 0.5, wavelength_min: 0.1, seed };
        let noise = Noise::new(&spectrum, [coordinates, &[0.3], &[-0.7]]);
        let all = 0..coordinates.len();
        let mut window = NoiseWindow::default();
        window.place(&noise, &all, &(0..1), &(0..1));
        let mut row = vec![0.0; coordinates.len()];
        window.add_row(&noise, (0, 0), &all, &mut row);
        row
    }

    #[test]
    fn noise_at_a_place_does_not_depend_on_the_grid_it_is_asked_on() {
        let fine: Vec<f64> = (-40..40).map(|i| f64::from(i) * 0.125).collect();
        let coarse: Vec<f64> = fine.iter().copied().skip(24).step_by(4).collect();
        let on_fine: Vec<f32> = row(&fine, 7).into_iter().skip(24).step_by(4).collect();
        assert_eq!(on_fine, row(&coarse, 7));
    }

    #[test]
    fn noise_is_bounded_varied_and_follows_the_seed() {
        let coordinates: Vec<f64> = (0..2000).map(|i| f64::from(i) * 0.01).collect();
        let values = row(&coordinates, 1);
        assert!(values.iter().all(|value| value.abs() <= 0.5));
        let (low, high) = values.iter().fold((0.0f32, 0.0f32), |(l, h), &v| (l.min(v), h.max(v)));
        assert!(low < -0.1 && high > 0.1, "{low} {high}");
        let steps = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.fold(0.0, f32::max) < 0.05, "continuous");
        assert_ne!(values, row(&coordinates, 2));
    }

    #[test]
    fn hashed_values_are_the_documented_ones() {
        assert_eq!(mix(0), 0xE220_A839_7B1D_CDAF);
        assert_eq!(unit(0), -1.0);
        assert_eq!(unit(u32::MAX), 1.0 - 1.0 / 8_388_608.0);
    }
}
