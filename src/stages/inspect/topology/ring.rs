//! What the faces around one vertex say of it and of its edges.
//!
//! A ring is given as the two other corners of each face, in winding order: for the face (v, n, p)
//! around v, n is its *next* and p its *previous* corner. The order of the faces is any.

/// What rings have said so far. Each edge has two ends and so is seen by two rings, each face by
/// three: sums are of ends and corners, and need no order in which vertices come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Tally {
    pub(super) vertices: u64,
    pub(super) edge_ends: u64,
    /// Of edges with one face.
    pub(super) boundary_ends: u64,
    /// Of edges with three faces or more.
    pub(super) non_manifold_ends: u64,
    /// Of edges with two faces that run along them in the same direction.
    pub(super) inconsistent_ends: u64,
    pub(super) boundary_vertices: u64,
    pub(super) non_manifold_vertices: u64,
    /// Of faces that have the corners of another one, the first of each set apart.
    pub(super) duplicate_corners: u64,
}

/// What is needed to look at a ring, kept from one to the next.
#[derive(Default)]
pub(super) struct Workbench {
    /// See [`end`].
    ends: Vec<u64>,
    parents: Vec<u32>,
    pairs: Vec<u64>,
}

/// Rings of more faces are sorted before they are walked: a walk looks at all faces for each.
const WALK_FACES_MAX: usize = 32;

impl Tally {
    /// Adds a vertex with its ring, which is complete and not empty.
    pub(super) fn add_ring(&mut self, nexts: &[u32], prevs: &[u32], bench: &mut Workbench) {
        self.vertices += 1;
        let faces = nexts.len();
        if faces <= WALK_FACES_MAX && is_closed_fan(nexts, prevs) {
            self.edge_ends += faces as u64;
        } else if faces == 1 {
            self.edge_ends += 2;
            self.boundary_ends += 2;
            self.boundary_vertices += 1;
        } else {
            self.add_any_ring(nexts, prevs, bench);
        }
    }

    fn add_any_ring(&mut self, nexts: &[u32], prevs: &[u32], bench: &mut Workbench) {
        let Workbench { ends, parents, pairs } = bench;
        let outward = nexts.iter().zip(0..).map(|(vertex, face)| end(*vertex, face, 0));
        let inward = prevs.iter().zip(0..).map(|(vertex, face)| end(*vertex, face, 1));
        ends.clear();
        ends.extend(outward.chain(inward));
        ends.sort_unstable();
        parents.clear();
        parents.extend(0..nexts.len() as u32);
        let (mut fans, mut has_boundary, mut is_fan) = (nexts.len(), false, true);
        for edge in ends.chunk_by(|a, b| a >> 32 == b >> 32) {
            self.edge_ends += 1;
            match *edge {
                [_] => {
                    self.boundary_ends += 1;
                    has_boundary = true;
                }
                [one, other] => {
                    self.inconsistent_ends += u64::from((one ^ other) & 1 == 0);
                    fans -= usize::from(unite(parents, face_of(one), face_of(other)));
                }
                _ => {
                    self.non_manifold_ends += 1;
                    is_fan = false;
                }
            }
        }
        self.boundary_vertices += u64::from(has_boundary);
        self.non_manifold_vertices += u64::from(!is_fan || fans > 1);
        pairs.clear();
        pairs.extend(
            nexts.iter().zip(prevs).map(|(n, p)| end(*n.min(p), 0, 0) | u64::from(*n.max(p))),
        );
        pairs.sort_unstable();
        self.duplicate_corners += pairs.windows(2).filter(|two| two[0] == two[1]).count() as u64;
    }

    /// Adds what other rings have said.
    pub(super) fn add(&mut self, other: &Self) {
        self.vertices += other.vertices;
        self.edge_ends += other.edge_ends;
        self.boundary_ends += other.boundary_ends;
        self.non_manifold_ends += other.non_manifold_ends;
        self.inconsistent_ends += other.inconsistent_ends;
        self.boundary_vertices += other.boundary_vertices;
        self.non_manifold_vertices += other.non_manifold_vertices;
        self.duplicate_corners += other.duplicate_corners;
    }
}

/// Whether the faces, walked from one to the next, come round to the first after all of them: as
/// those of nearly every vertex do. Every edge then has two faces that agree, and no two faces have
/// the same corners.
///
/// A walk that comes round only at its end has seen each face once, and each by a vertex of its
/// own: had two faces one `next`, the walk would have run into a circle without the first face.
#[inline]
fn is_closed_fan(nexts: &[u32], prevs: &[u32]) -> bool {
    let mut at = prevs[0];
    for _ in 1..nexts.len() {
        match nexts.iter().position(|next| *next == at) {
            None | Some(0) => return false,
            Some(face) => at = prevs[face],
        }
    }
    nexts.len() >= 3 && at == nexts[0]
}

/// The end of an edge as it is sorted: the vertex at the other end, the face, and whether the face
/// runs towards there (0) or comes from there (1).
fn end(vertex: u32, face: u32, inward: u64) -> u64 {
    u64::from(vertex) << 32 | u64::from(face) << 1 | inward
}

fn face_of(end: u64) -> u32 {
    end as u32 >> 1
}

/// Makes one set of two, if they are not.
fn unite(parents: &mut [u32], one: u32, other: u32) -> bool {
    let mut root = |mut at: u32| {
        while parents[at as usize] != at {
            parents[at as usize] = parents[parents[at as usize] as usize];
            at = parents[at as usize];
        }
        at
    };
    let (one, other) = (root(one), root(other));
    parents[one.max(other) as usize] = one.min(other);
    one != other
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(ring: &[[u32; 2]]) -> Tally {
        let (nexts, prevs): (Vec<u32>, Vec<u32>) =
            ring.iter().map(|pair| (pair[0], pair[1])).unzip();
        let mut tally = Tally::default();
        tally.add_ring(&nexts, &prevs, &mut Workbench::default());
        tally
    }

    const ONE: Tally = Tally {
        vertices: 1,
        edge_ends: 0,
        boundary_ends: 0,
        non_manifold_ends: 0,
        inconsistent_ends: 0,
        boundary_vertices: 0,
        non_manifold_vertices: 0,
        duplicate_corners: 0,
    };

    #[test]
    fn fans_are_manifold() {
        assert_eq!(tally(&[[1, 2], [3, 1], [2, 3]]), Tally { edge_ends: 3, ..ONE });
        let open =
            |edges| Tally { edge_ends: edges, boundary_ends: 2, boundary_vertices: 1, ..ONE };
        assert_eq!(tally(&[[2, 3], [1, 2]]), open(3));
        assert_eq!(tally(&[[1, 2]]), open(2));
        // A pillow: two triangles, sewn together along all their sides.
        assert_eq!(tally(&[[1, 2], [2, 1]]), Tally { edge_ends: 2, duplicate_corners: 1, ..ONE });
        let wheel: Vec<[u32; 2]> = (0..100).map(|i| [i, (i + 1) % 100]).collect();
        assert_eq!(tally(&wheel), Tally { edge_ends: 100, ..ONE });
    }

    #[test]
    fn what_is_no_fan_is_not() {
        let odd = Tally { non_manifold_vertices: 1, ..ONE };
        // Two closed fans; two open ones; a closed one beside an open one.
        let two = [[1, 2], [2, 3], [3, 1], [4, 5], [5, 6], [6, 4]];
        assert_eq!(tally(&two), Tally { edge_ends: 6, ..odd });
        let open = Tally { boundary_ends: 4, boundary_vertices: 1, edge_ends: 4, ..odd };
        assert_eq!(tally(&[[1, 2], [3, 4]]), open);
        let mixed = Tally { edge_ends: 5, boundary_ends: 2, boundary_vertices: 1, ..odd };
        assert_eq!(tally(&[[1, 2], [2, 3], [3, 1], [4, 5]]), mixed);
        // Three faces at an edge; a walk that comes round, but passes one edge twice.
        let edge = Tally { edge_ends: 4, boundary_ends: 3, boundary_vertices: 1, ..odd };
        assert_eq!(tally(&[[1, 2], [2, 3], [2, 4]]), Tally { non_manifold_ends: 1, ..edge });
        let eight = [[1, 9], [9, 2], [2, 3], [3, 9], [9, 4], [4, 1]];
        assert_eq!(tally(&eight), Tally { edge_ends: 5, non_manifold_ends: 1, ..odd });
    }

    #[test]
    fn a_face_turned_over_disagrees_with_both_neighbours() {
        let turned = Tally { edge_ends: 3, inconsistent_ends: 2, ..ONE };
        assert_eq!(tally(&[[1, 2], [1, 3], [2, 3]]), turned);
        let twice = Tally { edge_ends: 2, inconsistent_ends: 2, duplicate_corners: 1, ..ONE };
        assert_eq!(tally(&[[1, 2], [1, 2]]), twice);
    }
}
