//! An order of points in which neighbours in space are near each other: along a Morton curve.

use glam::Vec3;

use crate::geometry::spread;

/// Bits per axis: cells of one 32nd of the box, each with a handful of vertices of a cache-sized
/// block.
const AXIS_BITS: u32 = 5;

/// For each point its place in the order. Points of one cell keep theirs.
pub(super) fn morton_places(points: &[Vec3]) -> Vec<u32> {
    let low = points.iter().fold(Vec3::INFINITY, |low, point| low.min(*point));
    let high = points.iter().fold(Vec3::NEG_INFINITY, |high, point| high.max(*point));
    // Cubic cells: a flat slab is cut only where it is wide.
    let cells = (1 << AXIS_BITS) as f32;
    let longest = (high - low).max_element();
    let scale = if longest > 0.0 { cells / longest } else { 0.0 };
    let cell = |point: &Vec3| {
        let [x, y, z] = ((*point - low) * scale).min(Vec3::splat(cells - 1.0)).to_array();
        (spread(x as u32) | spread(y as u32) << 1 | spread(z as u32) << 2) as u16
    };
    let cells: Vec<u16> = points.iter().map(cell).collect();
    let mut starts = vec![0_u32; 1 << (3 * AXIS_BITS)];
    for cell in &cells {
        starts[usize::from(*cell)] += 1;
    }
    let mut place = 0;
    for start in &mut starts {
        place += std::mem::replace(start, place);
    }
    let place = |cell: &u16| {
        let start = &mut starts[usize::from(*cell)];
        *start += 1;
        *start - 1
    };
    cells.iter().map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_a_permutation_that_keeps_octants_together() {
        let points: Vec<Vec3> = (0..1000_u32)
            .map(|i| Vec3::new((i * 7 % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32))
            .collect();
        let places = morton_places(&points);
        let mut by_place = vec![None; points.len()];
        for (point, place) in points.iter().zip(&places) {
            assert!(by_place[*place as usize].replace(*point).is_none());
        }
        let octants = by_place.into_iter().map(|p| p.unwrap().cmpge(Vec3::splat(4.6)).bitmask());
        let mut octants: Vec<u32> = octants.collect();
        octants.dedup();
        assert_eq!(octants.len(), 8, "{octants:?}");
    }

    #[test]
    fn points_in_one_place_keep_their_order() {
        assert_eq!(morton_places(&[Vec3::ONE; 3]), [0, 1, 2]);
        assert_eq!(morton_places(&[]), []);
    }
}
