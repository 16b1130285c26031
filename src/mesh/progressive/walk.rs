//! The order in which the faces of a base are stored: each beside the last one where there is one, so
//! that the numbers of its corners are mostly near those before.

/// Orders faces by a walk over their edges, and turns each so that it begins with the edge it was
/// reached by, or with corners that were there before. Takes some 90 bytes a face besides.
pub(super) fn walk(faces: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let edges = Edges::of(faces);
    let (mut is_done, mut is_pushed) = (vec![false; faces.len()], vec![false; edges.sides.len()]);
    let mut is_seen = vec![false; faces.as_flattened().iter().max().map_or(0, |v| *v as usize + 1)];
    let mut walked = Vec::with_capacity(faces.len());
    let mut pushed = Vec::new();
    for start in 0..faces.len() as u32 {
        pushed.push((start, None));
        while let Some((face, by)) = pushed.pop() {
            if std::mem::replace(&mut is_done[face as usize], true) {
                continue;
            }
            let corners = faces[face as usize];
            let first = by.unwrap_or_else(|| {
                let seen = corners.map(|vertex| is_seen[vertex as usize]);
                let both = (0..3).find(|side| seen[*side] && seen[(side + 1) % 3]);
                both.or_else(|| (0..3).find(|side| seen[*side])).unwrap_or(0)
            });
            let side = |number: usize| (first + number) % 3;
            walked.push([0, 1, 2].map(|number| corners[side(number)]));
            for vertex in corners {
                is_seen[vertex as usize] = true;
            }
            // The last one pushed is the next: on from the edge behind the one it was reached by.
            for number in [0, 2, 1] {
                let group = edges.group(faces, face, side(number));
                if !std::mem::replace(&mut is_pushed[group.start], true) {
                    let others = edges.sides[group].iter().map(|(_, code)| (code / 3, code % 3));
                    let others = others.filter(|(other, _)| !is_done[*other as usize]);
                    pushed.extend(others.map(|(other, side)| (other, Some(side as usize))));
                }
            }
        }
    }
    walked
}

/// The sides of all faces by their edges.
struct Edges {
    /// Both ends, the lower one first, and three times the face plus the side.
    sides: Vec<(u64, u32)>,
}

impl Edges {
    fn of(faces: &[[u32; 3]]) -> Self {
        let mut sides: Vec<_> = (0..3 * faces.len() as u32)
            .map(|code| (ends(faces[code as usize / 3], code as usize % 3), code))
            .collect();
        sides.sort_unstable();
        Self { sides }
    }

    /// Where the sides are that have the edge of this one.
    fn group(&self, faces: &[[u32; 3]], face: u32, side: usize) -> std::ops::Range<usize> {
        let ends = ends(faces[face as usize], side);
        let start = self.sides.partition_point(|(other, _)| *other < ends);
        start..start + self.sides[start..].partition_point(|(other, _)| *other == ends)
    }
}

/// The ends of a side of a face, the lower one first.
fn ends(corners: [u32; 3], side: usize) -> u64 {
    let [a, b] = [corners[side], corners[(side + 1) % 3]].map(u64::from);
    a.min(b) << 32 | a.max(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_face_is_walked_once_and_turned_the_same_way() {
        // A strip, a face that hangs on its edge as a third one, and one alone.
        let faces = [[0, 1, 2], [7, 8, 9], [3, 2, 1], [2, 3, 4], [1, 2, 6], [5, 3, 1]];
        let walked = walk(&faces);
        let turned = |corners: &[u32; 3]| {
            let least = (0..3).min_by_key(|side| corners[*side]).unwrap();
            [0, 1, 2].map(|number| corners[(least + number) % 3])
        };
        let sorted = |faces: &[[u32; 3]]| {
            let mut faces: Vec<_> = faces.iter().map(turned).collect();
            faces.sort_unstable();
            faces
        };
        assert_eq!(sorted(&walked), sorted(&faces));
        for pair in walked[..5].windows(2) {
            let shared = pair[1].iter().filter(|vertex| pair[0].contains(vertex)).count();
            assert!(shared >= 1, "{pair:?} touch");
        }
        assert_eq!(walked[5], [7, 8, 9], "alone, and so last but in its turn");
    }
}
