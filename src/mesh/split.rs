//! Vertices at which several sheets of a surface touch, taken apart into one for each sheet: they
//! can then be decimated like any other surface `[CKS98 §5]`.
//!
//! No edge is opened: around a vertex, faces are taken for one sheet from edge to edge, and at an
//! edge with more than two faces they are paired alike from both its ends. Where they cannot be
//! paired, vertices stay as they are.

use std::collections::VecDeque;

use glam::Vec3;
use hashbrown::HashMap;

use super::{State, Threads, classify::classify, ring::Rings};

/// Vertices with more faces are left as they are. Chosen by hand: the time goes with the square.
const RING_FACES_MAX: usize = 512;

type Face = [u32; 3];

/// Which vertices have faces that are no fan.
pub(super) fn complex(vertices: usize, faces: &[Face]) -> Vec<bool> {
    let (rings, _) = Rings::of_faces(vertices, faces, Threads::This);
    (0..vertices as u32).map(|vertex| classify(rings.of(vertex)) == State::COMPLEX).collect()
}

/// Takes apart those of some vertices that have several fans of faces: one fan stays with each,
/// every other one gets a vertex of its own. Returns for each of those the vertex it was part of;
/// their numbers follow on those of `positions`, parts of one vertex on each other.
pub(super) fn split_fans(
    positions: &[Vec3],
    faces: &mut Vec<Face>,
    is_complex: &[bool],
) -> Vec<u32> {
    let mut around: Vec<(u32, u32)> = Vec::new();
    for (face, corners) in (0..).zip(&*faces) {
        let complex = corners.iter().filter(|vertex| is_complex[**vertex as usize]);
        around.extend(complex.map(|vertex| (*vertex, face)));
    }
    around.sort_unstable();
    let mut added = Vec::new();
    let mut split = faces.clone();
    for group in around.chunk_by(|a, b| a.0 == b.0) {
        let vertex = group[0].0;
        let ring: Vec<u32> = group.iter().map(|(_, face)| *face).collect();
        if ring.len() > RING_FACES_MAX {
            continue;
        }
        let Some(fans) = fans(positions, faces, vertex, &ring) else { continue };
        // The first fan stays.
        let mut known = vec![(fans[0], vertex)];
        for (face, fan) in ring.iter().zip(fans) {
            let of_fan = known.iter().find(|(number, _)| *number == fan).map(|(_, own)| *own);
            let own = of_fan.unwrap_or_else(|| {
                let new = (positions.len() + added.len()) as u32;
                added.push(vertex);
                known.push((fan, new));
                new
            });
            let corners = faces[*face as usize].iter().zip(&mut split[*face as usize]);
            corners.filter(|(corner, _)| **corner == vertex).for_each(|(_, corner)| *corner = own);
        }
    }
    *faces = split;
    added
}

/// Faces at an edge, by the direction in which they go along it.
#[derive(Default)]
struct Sides {
    /// From the lower vertex to the higher, and back.
    counts: [u32; 2],
    /// All of them, but for copies.
    faces: Vec<u32>,
}

/// Clustering keeps one of the faces between the same three cells, so that an edge can have more
/// faces on one side than on the other. Puts copies back where that brings more edges into balance
/// than out of it.
pub(super) fn restore_copies(is_complex: &[bool], faces: &mut Vec<Face>) {
    let mut sides = HashMap::<[u32; 2], Sides>::new();
    for (face, corners) in (0..).zip(&*faces) {
        for [from, to] in edges(corners) {
            if is_complex[from as usize] && is_complex[to as usize] {
                let (edge, side) = edge(from, to);
                let known = sides.entry(edge).or_default();
                known.counts[side] += 1;
                known.faces.push(face);
            }
        }
    }
    let is_lacking = |sides: &HashMap<[u32; 2], Sides>, [from, to]: [u32; 2]| {
        let (edge, side) = edge(from, to);
        sides.get(&edge).is_some_and(|known| known.counts[side] < known.counts[1 - side])
    };
    let mut queue: VecDeque<u32> = (0..faces.len() as u32).collect();
    while let Some(face) = queue.pop_front() {
        let corners = faces[face as usize];
        if edges(&corners).into_iter().filter(|way| is_lacking(&sides, *way)).count() < 2 {
            continue;
        }
        faces.push(corners);
        for [from, to] in edges(&corners) {
            let (edge, side) = edge(from, to);
            let known = sides.entry(edge).or_default();
            known.counts[side] += 1;
            queue.extend(&known.faces);
        }
    }
}

fn edges(&[a, b, c]: &Face) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// An edge by its lower vertex and its higher one, and the side of a face that goes this way.
fn edge(from: u32, to: u32) -> ([u32; 2], usize) {
    if from < to { ([from, to], 0) } else { ([to, from], 1) }
}

/// An edge at a vertex as one of its faces has it. In order: by edge, side by side.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Spoke {
    /// The edge's other end.
    other: u32,
    /// As of [`edge`].
    side: usize,
    /// The face's third vertex.
    apex: u32,
    /// The face's place in the ring.
    place: usize,
}

/// For each face around a vertex a number of its fan; `None` where fans cannot be told apart.
fn fans(positions: &[Vec3], faces: &[Face], vertex: u32, ring: &[u32]) -> Option<Vec<usize>> {
    let mut spokes = Vec::with_capacity(2 * ring.len());
    for (place, face) in ring.iter().enumerate() {
        let [a, b, c] = faces[*face as usize];
        let (next, prev) = match vertex {
            v if v == a => (b, c),
            v if v == b => (c, a),
            _ => (a, b),
        };
        spokes.push(Spoke { other: next, side: edge(vertex, next).1, apex: prev, place });
        spokes.push(Spoke { other: prev, side: edge(prev, vertex).1, apex: next, place });
    }
    spokes.sort_unstable();
    let mut fans: Vec<usize> = (0..ring.len()).collect();
    for all in spokes.chunk_by(|a, b| a.other == b.other) {
        if all.len() == 1 {
            continue;
        }
        let (forth, back) = all.split_at(all.partition_point(|spoke| spoke.side == 0));
        if forth.len() != back.len() {
            return None;
        }
        for (one, two) in paired(positions, [vertex, all[0].other], forth, back) {
            let (kept, gone) = (fans[one], fans[two]);
            fans.iter_mut().filter(|fan| **fan == gone).for_each(|fan| *fan = kept);
        }
    }
    Some(fans)
}

/// Pairs the faces on one side of an edge with those on the other, by their places: the flattest
/// pair first. From either end of the edge the pairs are the same, as places rise with the faces'
/// numbers at both.
fn paired(
    positions: &[Vec3],
    ends: [u32; 2],
    forth: &[Spoke],
    back: &[Spoke],
) -> Vec<(usize, usize)> {
    if let ([one], [two]) = (forth, back) {
        return vec![(one.place, two.place)];
    }
    let [low, high] = edge(ends[0], ends[1]).0.map(|v| positions[v as usize]);
    let normal = |spoke: &Spoke| {
        (high - low).cross(positions[spoke.apex as usize] - low).normalize_or_zero()
    };
    let mut pairs = Vec::with_capacity(forth.len() * back.len());
    for (one, a) in forth.iter().enumerate() {
        for (two, b) in back.iter().enumerate() {
            pairs.push((normal(a).dot(normal(b)), one, two));
        }
    }
    // Flat is where the apexes lie on opposite sides.
    pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then_with(|| (a.1, a.2).cmp(&(b.1, b.2))));
    let (mut ones, mut twos) = (vec![false; forth.len()], vec![false; back.len()]);
    let mut found = Vec::with_capacity(forth.len());
    for (_, one, two) in pairs {
        if !ones[one] && !twos[two] {
            (ones[one], twos[two]) = (true, true);
            found.push((forth[one].place, back[two].place));
        }
    }
    found
}

/// Leaves out pairs of faces that have only each other: back to back they enclose nothing, and no
/// edge can be collapsed.
pub(super) fn drop_lone_pairs(vertices: usize, faces: &mut Vec<Face>) {
    let mut counts = vec![0_u32; vertices];
    faces.iter().flatten().for_each(|vertex| counts[*vertex as usize] += 1);
    let mut first = HashMap::<Face, u32>::new();
    let mut is_gone = vec![false; faces.len()];
    for (number, face) in faces.iter().enumerate() {
        if !face.iter().all(|vertex| counts[*vertex as usize] == 2) {
            continue;
        }
        let mut sorted = *face;
        sorted.sort_unstable();
        if let Some(other) = first.insert(sorted, number as u32) {
            (is_gone[number], is_gone[other as usize]) = (true, true);
        }
    }
    let mut gone = is_gone.into_iter();
    faces.retain(|_| !gone.next().unwrap_or(false));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The faces of a tetrahedron, outwards.
    fn tetrahedron([a, b, c, d]: [u32; 4]) -> [Face; 4] {
        [[a, c, b], [a, b, d], [b, c, d], [a, d, c]]
    }

    fn positions(places: &[[f32; 3]]) -> Vec<Vec3> {
        places.iter().map(|place| Vec3::from_array(*place)).collect()
    }

    /// Splits, checks that all fans are closed, and returns the vertices that were taken apart.
    fn split_to_closed(positions: &[Vec3], faces: &mut Vec<Face>) -> Vec<u32> {
        let is_complex = complex(positions.len(), faces);
        restore_copies(&is_complex, faces);
        let added = split_fans(positions, faces, &is_complex);
        let vertices = positions.len() + added.len();
        let (rings, _) = Rings::of_faces(vertices, faces, Threads::This);
        for vertex in 0..vertices as u32 {
            assert_eq!(classify(rings.of(vertex)), State::INNER, "{vertex}: {faces:?}");
        }
        added
    }

    /// ```text
    ///   1       4
    ///   | \   / |      two tetrahedra that touch in vertex 0
    ///   |   0   |
    ///   | /   \ |
    ///   2       5
    /// ```
    #[test]
    fn sheets_that_touch_in_a_vertex_are_taken_apart() {
        let places = positions(&[[0.0; 3]; 7]);
        let mut faces = [tetrahedron([0, 1, 2, 3]), tetrahedron([0, 4, 5, 6])].concat();
        assert_eq!(split_to_closed(&places, &mut faces), [0]);
        assert!(faces[..4].iter().flatten().all(|vertex| *vertex < 4));
        assert!(faces[4..].iter().flatten().all(|vertex| *vertex >= 4));
    }

    /// Two tetrahedra that touch along the edge from 0 to 1, one above, one below: at the edge each
    /// has two faces, and a face of the one must not be paired with a face of the other at one end
    /// only.
    #[test]
    fn sheets_that_touch_along_an_edge_are_paired_alike_from_both_ends() {
        let places = positions(&[
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.5, 2.0, 0.3],
            [0.5, -2.0, 0.3],
            [0.5, 2.0, -0.3],
            [0.5, -2.0, -0.3],
        ]);
        let mut faces = [tetrahedron([0, 1, 2, 3]), tetrahedron([1, 0, 4, 5])].concat();
        assert_eq!(split_to_closed(&places, &mut faces), [0, 1]);
    }

    /// Two tetrahedra on one side of a face they have in common, of which clustering kept one copy.
    #[test]
    fn a_face_that_two_sheets_have_in_common_is_put_back() {
        let places = positions(&[
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.2, 0.2, 1.0],
            [0.3, 0.3, 2.0],
        ]);
        let mut faces = tetrahedron([0, 1, 2, 3]).to_vec();
        faces.extend(&tetrahedron([0, 1, 2, 4])[1..]);
        assert_eq!(split_to_closed(&places, &mut faces), [0, 1, 2]);
        assert_eq!(faces.len(), 8);
    }

    #[test]
    fn an_edge_with_three_faces_stays() {
        let places = positions(&[[0.0; 3]; 5]);
        let before = vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]];
        let mut faces = before.clone();
        let is_complex = complex(5, &faces);
        assert!(split_fans(&places, &mut faces, &is_complex).is_empty());
        assert_eq!(faces, before);
    }

    #[test]
    fn a_boundary_is_no_reason_to_split_and_two_fans_are() {
        // Two strips that touch in vertex 2.
        let places = positions(&[[0.0; 3]; 7]);
        let mut faces = vec![[0, 1, 2], [1, 3, 2], [2, 4, 5], [4, 6, 5]];
        let is_complex = complex(7, &faces);
        assert_eq!(split_fans(&places, &mut faces, &is_complex), [2]);
        assert_eq!(faces, [[0, 1, 2], [1, 3, 2], [7, 4, 5], [4, 6, 5]]);
    }

    #[test]
    fn two_faces_back_to_back_vanish_if_they_are_alone() {
        let mut faces = vec![[0, 1, 2], [3, 4, 5], [0, 2, 1], [3, 5, 6]];
        drop_lone_pairs(7, &mut faces);
        assert_eq!(faces, [[3, 4, 5], [3, 5, 6]]);
    }
}
