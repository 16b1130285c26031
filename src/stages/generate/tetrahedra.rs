//! Marching tetrahedra: which edges of a cell the surface crosses, and the triangles between them.
//!
//! A cell is a cube split into the six tetrahedra of Kuhn: one for each way to walk from corner 0
//! to corner 7 along the axes. The split of a face is the same from both sides, so the surface of
//! any field is a closed, oriented 2-manifold wherever it stays inside the grid.
//! Corner `c` lies at (`c & 1`, `c >> 1 & 1`, `c >> 2`). Every edge of the split goes from a corner
//! `a` up to `a | d`, with `d` the set of axes along which it moves: an axis, a face diagonal or
//! the body diagonal. There are 19.

/// Edges of the split of one cell.
pub(super) const EDGES: usize = 19;

/// Edges that start in corner 0: the ones a cell owns. They are the first [`EDGES`], by `d - 1`.
pub(super) const OWN_EDGES: usize = 7;

/// Kuhn's walks from corner 0 to corner 7.
const WALKS: [[u8; 4]; 6] =
    [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]];

/// Triangles a cell can have at most: two in each tetrahedron.
const TRIANGLES_MAX: usize = 12;

/// What to do for each of the 256 patterns of corners inside the surface.
pub(super) struct Cases {
    /// Edges crossed, a bit each.
    crossed: [u32; 256],
    /// Three edges a triangle, counter-clockwise seen from outside.
    corners: [[u8; 3 * TRIANGLES_MAX]; 256],
    /// How many of `corners` are used.
    lengths: [u8; 256],
}

/// The one table.
pub(super) static CASES: Cases = Cases::build();

/// Start `a` and direction `d` of each edge.
pub(super) const EDGE_ENDS: [(u8, u8); EDGES] = list_edges();

impl Cases {
    /// Edges crossed when the corners `inside` are inside, a bit each.
    pub(super) fn crossed(&self, inside: u8) -> u32 {
        self.crossed[usize::from(inside)]
    }

    /// The triangles' corners as edges, three each.
    pub(super) fn corners(&self, inside: u8) -> &[u8] {
        &self.corners[usize::from(inside)][..usize::from(self.lengths[usize::from(inside)])]
    }

    const fn build() -> Self {
        let mut cases =
            Self { crossed: [0; 256], corners: [[0; 3 * TRIANGLES_MAX]; 256], lengths: [0; 256] };
        let mut inside = 0;
        while inside < 256 {
            let mut walk = 0;
            while walk < WALKS.len() {
                cases.add_tetrahedron(inside, WALKS[walk]);
                walk += 1;
            }
            inside += 1;
        }
        cases
    }

    const fn add_tetrahedron(&mut self, inside: usize, walk: [u8; 4]) {
        let (mut ins, mut outs) = ([0; 4], [0; 4]);
        let (mut ins_count, mut outs_count) = (0, 0);
        let mut corner = 0;
        while corner < 4 {
            if inside >> walk[corner] & 1 == 1 {
                ins[ins_count] = walk[corner];
                ins_count += 1;
            } else {
                outs[outs_count] = walk[corner];
                outs_count += 1;
            }
            corner += 1;
        }
        let [p, q, r, _] = ins;
        let [u, v, w, _] = outs;
        match ins_count {
            1 => self.add_triangle(inside, [(p, u), (p, v), (p, w)]),
            2 => {
                self.add_triangle(inside, [(p, u), (p, v), (q, v)]);
                self.add_triangle(inside, [(p, u), (q, v), (q, u)]);
            }
            3 => self.add_triangle(inside, [(p, u), (q, u), (r, u)]),
            _ => {}
        }
    }

    /// Adds the triangle through three edges, each given as (inside, outside), facing outside.
    const fn add_triangle(&mut self, inside: usize, edges: [(u8, u8); 3]) {
        let (p, u) = edges[0];
        let turned = faces(edges, [at(u)[0] - at(p)[0], at(u)[1] - at(p)[1], at(u)[2] - at(p)[2]]);
        let order = if turned { [0, 1, 2] } else { [0, 2, 1] };
        let mut corner = 0;
        while corner < 3 {
            let (i, o) = edges[order[corner]];
            let edge = edge_between(i & o, i | o);
            self.crossed[inside] |= 1 << edge;
            self.corners[inside][self.lengths[inside] as usize] = edge;
            self.lengths[inside] += 1;
            corner += 1;
        }
    }
}

/// Whether the triangle through the middles of `edges` faces along `direction`.
const fn faces(edges: [(u8, u8); 3], direction: [i32; 3]) -> bool {
    let (mut e, mut f) = ([0; 3], [0; 3]);
    let mut axis = 0;
    while axis < 3 {
        let origin = at(edges[0].0)[axis] + at(edges[0].1)[axis];
        e[axis] = at(edges[1].0)[axis] + at(edges[1].1)[axis] - origin;
        f[axis] = at(edges[2].0)[axis] + at(edges[2].1)[axis] - origin;
        axis += 1;
    }
    let n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
    n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2] > 0
}

const fn at(corner: u8) -> [i32; 3] {
    [(corner & 1) as i32, (corner >> 1 & 1) as i32, (corner >> 2) as i32]
}

const fn edge_between(a: u8, b: u8) -> u8 {
    let mut edge = 0;
    while EDGE_ENDS[edge].0 != a || EDGE_ENDS[edge].1 != a ^ b {
        edge += 1;
    }
    edge as u8
}

const fn list_edges() -> [(u8, u8); EDGES] {
    let mut edges = [(0, 0); EDGES];
    let mut count = 0;
    let mut a = 0;
    while a < 8 {
        let mut d = 1;
        while d < 8 {
            if a & d == 0 {
                edges[count] = (a, d);
                count += 1;
            }
            d += 1;
        }
        a += 1;
    }
    edges
}

/// The edges from corner 0 that are crossed, a bit each by `d - 1`.
pub(super) fn own_crossed(inside: u8) -> u8 {
    (if inside & 1 == 1 { !inside } else { inside }) >> 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_edges_are_the_ones_from_corner_zero() {
        let own: Vec<_> = EDGE_ENDS[..OWN_EDGES].to_vec();
        assert_eq!(own, (1..8).map(|d| (0, d)).collect::<Vec<_>>());
        assert!(EDGE_ENDS[OWN_EDGES..].iter().all(|&(a, _)| a != 0));
    }

    #[test]
    fn a_cell_without_a_change_of_sign_has_no_triangles() {
        assert!(CASES.corners(0).is_empty() && CASES.corners(255).is_empty());
        assert!((1..255).all(|inside| !CASES.corners(inside).is_empty()));
    }

    #[test]
    fn the_edges_crossed_are_those_whose_ends_differ() {
        for inside in 0..=255u8 {
            for (edge, &(a, d)) in EDGE_ENDS.iter().enumerate() {
                let differ = (inside >> a ^ inside >> (a | d)) & 1 == 1;
                assert_eq!(CASES.crossed(inside) >> edge & 1 == 1, differ, "{inside} {edge}");
            }
            assert_eq!(u32::from(own_crossed(inside)), CASES.crossed(inside) & 0x7F);
        }
    }
}
