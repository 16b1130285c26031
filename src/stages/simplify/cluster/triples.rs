//! Triangles as three numbers: one rotation for each, sorted, duplicates removed.
//!
//! Orientation is kept: (0 1 2) and (1 2 0) are one triangle, (0 2 1) is another, the other side
//! of a sheet thinner than a cell.

/// Rotates the smallest number to the front.
pub(super) fn rotate<T: Copy + Ord>([a, b, c]: [T; 3]) -> [T; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// Sorts rotated triangles whose numbers are below `count` and removes duplicates: a counting
/// sort by the first number, then the few triangles of each by the others.
pub(super) fn sort_and_dedup(triangles: Vec<[u32; 3]>, count: usize) -> Vec<[u32; 3]> {
    let mut ends = vec![0_u32; count + 1];
    for triangle in &triangles {
        ends[triangle[0] as usize + 1] += 1;
    }
    for first in 1..=count {
        ends[first] += ends[first - 1];
    }
    // From here on ends[a] is where the next triangle that starts with a goes.
    let mut others = vec![[0_u32; 2]; triangles.len()];
    for [a, b, c] in &triangles {
        let place = &mut ends[*a as usize];
        others[*place as usize] = [*b, *c];
        *place += 1;
    }
    let mut sorted = triangles;
    sorted.clear();
    let mut start = 0;
    for (first, end) in ends[..count].iter().enumerate() {
        let group = &mut others[start..*end as usize];
        start = *end as usize;
        group.sort_unstable();
        let mut last = None;
        for &[b, c] in group.iter() {
            if last != Some([b, c]) {
                sorted.push([first as u32, b, c]);
                last = Some([b, c]);
            }
        }
    }
    sorted
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn rotation_keeps_orientation() {
        for [a, b, c] in [[1, 2, 3], [2, 3, 1], [3, 1, 2]] {
            assert_eq!(rotate([a, b, c]), [1, 2, 3]);
            assert_eq!(rotate([c, b, a]), [1, 3, 2]);
        }
    }

    proptest! {
        #[test]
        fn counting_sort_equals_sort_and_dedup(
            mut triangles in prop::collection::vec(prop::array::uniform3(0_u32..9), 0..80),
        ) {
            let sorted = sort_and_dedup(triangles.clone(), 9);
            triangles.sort_unstable();
            triangles.dedup();
            prop_assert_eq!(sorted, triangles);
        }
    }
}
