//! A pass over a surface before it is measured: how large it is, and a sprinkling of its vertices,
//! so that every point can be told at once about how far it is away.

use glam::DVec3;

use crate::{
    error::Result,
    formats::Findings,
    geometry::Bounds,
    progress::{Monitor, StageId},
    soup::{Source, Taken, Triangle, Vertex, for_each_in_order},
    storage::{Budget, Reservation},
};

/// A surface and what a pass over it has told.
pub struct Surface<'a, V> {
    /// Its triangles.
    pub source: &'a Source<V>,
    /// What their positions are relative to, in model units.
    pub origin: [f64; 3],
    /// How many there are, polygons taken apart.
    pub triangles: u64,
    /// Their area. The same for any number of threads and any memory, to the last bit.
    pub area: f64,
    /// Box around them, relative to the origin.
    pub bounds: Bounds,
    /// What the pass found.
    pub findings: Findings,
    /// Vertices, about as many from each part of the source.
    pub(super) picks: Vec<[f32; 3]>,
    _room: Reservation,
}

/// Triangles of a batch with their areas.
#[derive(Default)]
pub(super) struct Measured {
    pub(super) corners: Vec<[[f32; 3]; 3]>,
    pub(super) areas: Vec<f64>,
    bounds: Bounds,
}

/// Share of the memory that the picks of one surface may take, with the tree that is made of them
/// when points are measured against it.
const PICKS_SHARE: f64 = 0.125;
/// Bytes of a pick and of its place in that tree.
const BYTES_PER_PICK: u64 = 12 + 24 + 48;
/// Bounds of how many picks there are at most. Chosen by hand: their tree is to stay small beside a
/// pass over ten times as many triangles.
const PICKS_MIN: u64 = 1 << 10;
const PICKS_MAX: u64 = 1 << 20;

/// Surveys the triangles of `source`, whose positions are relative to `origin`. One pass, on all
/// threads.
///
/// # Errors
/// What reading the source fails with, or cancellation.
pub fn survey<'a, V: Vertex>(
    source: &'a Source<V>,
    origin: [f64; 3],
    budget: &Budget,
    monitor: &Monitor,
) -> Result<Surface<'a, V>> {
    let share = (budget.limit_bytes() as f64 * PICKS_SHARE) as u64 / BYTES_PER_PICK;
    let picks_max = share.clamp(PICKS_MIN, PICKS_MAX);
    let mut room = budget.reserve_share(0.0, picks_max * size_of::<[f32; 3]>() as u64);
    let mut picker = Picker::new(picks_max as usize);
    let (mut triangles, mut area, mut bounds) = (0, 0.0, Bounds::default());
    let meter = monitor.meter(StageId::Survey, source.amount());
    let findings = for_each_in_order(source, &meter, budget, Measured::fill, |measured| {
        bounds = bounds.union(&measured.bounds);
        // One after the other: a sum of sums would depend on where batches end.
        area = measured.areas.iter().fold(area, |sum, area| sum + area);
        triangles += measured.corners.len() as u64;
        picker.look(&measured.corners);
        Ok(())
    })?;
    meter.finish();
    let mut picks = picker.picks;
    picks.shrink_to_fit();
    room.shrink_to(size_of_val(picks.as_slice()) as u64);
    Ok(Surface { source, origin, triangles, area, bounds, findings, picks, _room: room })
}

impl Measured {
    /// Takes the triangles of a batch in place of those before.
    pub(super) fn fill<V: Vertex>(taken: &Taken<'_, V>, measured: &mut Self) {
        let corners = |triangle: &Triangle<V>| triangle.0.map(|vertex| vertex.position());
        measured.corners.clear();
        measured.corners.extend(taken.triangles.iter().map(corners));
        measured.areas.clear();
        measured.areas.extend(measured.corners.iter().map(|corners| area(*corners)));
        measured.bounds = Bounds::default();
        measured.bounds.add_triangles(measured.corners.iter().copied());
    }
}

fn area(corners: [[f32; 3]; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| DVec3::from_array(corner.map(f64::from)));
    (b - a).cross(c - a).length() / 2.0
}

/// Picks a vertex of one in so many triangles.
struct Picker {
    picks: Vec<[f32; 3]>,
    picks_max: usize,
    /// One of so many triangles is picked from: a power of two.
    stride: u64,
    /// Triangles seen.
    seen: u64,
    /// The next triangle that is picked from.
    next: u64,
}

impl Picker {
    fn new(picks_max: usize) -> Self {
        Self { picks: Vec::new(), picks_max, stride: 1, seen: 0, next: 0 }
    }

    fn look(&mut self, triangles: &[[[f32; 3]; 3]]) {
        let end = self.seen + triangles.len() as u64;
        while self.next < end {
            let corners = triangles[(self.next - self.seen) as usize];
            // Of triangles that follow each other, corners that they do not share.
            self.picks.push(corners[(self.next % 3) as usize]);
            if self.picks.len() > self.picks_max {
                self.thin_out();
            }
            let following = self.next / self.stride + 1;
            self.next = following * self.stride + mixed(following) % self.stride;
        }
        self.seen = end;
    }

    /// Keeps every second one, by chance the first or the second of each two: triangles in rows
    /// are not to be picked from in columns.
    fn thin_out(&mut self) {
        let pairs = self.picks.len() / 2;
        for pair in 0..pairs {
            self.picks[pair] = self.picks[2 * pair + (mixed(pair as u64) & 1) as usize];
        }
        self.picks.truncate(pairs);
        self.stride *= 2;
    }
}

/// The finaliser of splitmix64: bits that look like chance, the same everywhere.
#[inline]
pub(super) fn mixed(number: u64) -> u64 {
    let x = number.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picks_are_spread_over_all_triangles_whatever_the_batches() {
        let triangle = |index: u32| [[index as f32, 0.0, 0.0]; 3];
        let triangles: Vec<_> = (0..10_000).map(triangle).collect();
        let mut whole = Picker::new(300);
        whole.look(&triangles);
        assert!((100..=300).contains(&whole.picks.len()), "{}", whole.picks.len());
        let mut last = 0.0;
        for pick in &whole.picks {
            assert!(pick[0] - last <= 3.0 * whole.stride as f32);
            last = pick[0];
        }
        let mut pieces = Picker::new(300);
        triangles.chunks(7).for_each(|chunk| pieces.look(chunk));
        assert_eq!(pieces.picks, whole.picks);
    }

    #[test]
    fn few_triangles_are_all_picked_from() {
        let mut picker = Picker::new(300);
        picker.look(&[[[1.0; 3]; 3], [[2.0; 3]; 3]]);
        assert_eq!(picker.picks, [[1.0; 3], [2.0; 3]]);
    }
}
