//! One slab looked at: its corners welded, the rings of its vertices built and asked.

use glam::Vec3;

use super::{
    components::{Sets, SlabComponents},
    cutter::{Corners, Slab},
    ring::{Tally, Workbench},
};
use crate::{
    geometry::{has_no_area, is_worse_than},
    mesh::PositionIndex,
};

/// Below this quality, see [`is_worse_than`], a triangle is a sliver. Chosen by hand: a right-angled
/// triangle with legs 1 : 17, or three corners on a line but for a 35th of its length.
pub const SLIVER_QUALITY: f64 = 0.1;

/// What a slab says.
#[derive(Debug, Default)]
pub(super) struct Examined {
    pub(super) tally: Tally,
    /// New triangles with three corners but no area.
    pub(super) flat: u64,
    /// New triangles with area that are slivers.
    pub(super) slivers: u64,
    pub(super) components: SlabComponents,
}

/// Looks at a slab.
pub(super) fn examine(slab: &Slab) -> Examined {
    let mut examined = Examined::default();
    for corners in &slab.triangles[slab.front..] {
        if is_worse_than(corners, SLIVER_QUALITY) {
            let is_flat = has_no_area(corners);
            examined.flat += u64::from(is_flat);
            examined.slivers += u64::from(!is_flat);
        }
    }
    let mut welded = Welded::of(slab);
    examined.components = welded.components(slab);
    examined.tally = welded.into_rings().tally();
    examined
}

/// A slab with its vertices numbered as they come.
struct Welded {
    faces: Vec<[u32; 3]>,
    /// Of each vertex, the faces around it; [`NOT_DUE`] where it becomes final in another slab.
    face_counts: Vec<u32>,
    sets: Sets,
}

const NOT_DUE: u32 = u32::MAX;

impl Welded {
    fn of(slab: &Slab) -> Self {
        let triangles = &slab.triangles;
        // Surfaces have a vertex for every two triangles, and the front some more.
        let vertices = triangles.len() / 2 + slab.front;
        let mut index = PositionIndex::with_room_for(vertices);
        let mut positions: Vec<Vec3> = Vec::with_capacity(vertices);
        let mut welded = Self {
            faces: Vec::with_capacity(triangles.len()),
            face_counts: Vec::with_capacity(vertices),
            sets: Sets::default(),
        };
        for corners in triangles {
            let face = corners.map(|corner| {
                // −0 becomes 0: they are one position, and are looked up by their bits.
                let position = Vec3::from_array(corner) + Vec3::ZERO;
                let new = positions.len() as u32;
                let vertex = index.find_or_add(position, new, |vertex| positions[vertex as usize]);
                if vertex == new {
                    positions.push(position);
                    welded.add_vertex(slab.span.has(corner));
                }
                vertex
            });
            welded.add_face(face);
        }
        welded
    }

    #[inline]
    fn add_vertex(&mut self, is_due: bool) {
        self.face_counts.push(if is_due { 0 } else { NOT_DUE });
        self.sets.add();
    }

    #[inline]
    fn add_face(&mut self, face: [u32; 3]) {
        let [a, b, c] = face;
        self.sets.unite(a, b);
        self.sets.unite(a, c);
        for vertex in face {
            let count = &mut self.face_counts[vertex as usize];
            *count += u32::from(*count != NOT_DUE);
        }
        self.faces.push(face);
    }

    fn components(&mut self, slab: &Slab) -> SlabComponents {
        let mut count = 0;
        let mut of_root = vec![0; self.face_counts.len()];
        for vertex in 0..self.face_counts.len() as u32 {
            // The root is the least of its set, so it has come before.
            let root = self.sets.find(vertex);
            if root == vertex {
                of_root[root as usize] = count;
                count += 1;
            }
        }
        let mut component = |face: &[u32; 3]| of_root[self.sets.find(face[0]) as usize];
        let front_before = self.faces[..slab.front].iter().map(&mut component).collect();
        let is_front = |(corners, _): &(&Corners, _)| slab.span.leaves_open(corners);
        let front_after = slab.triangles.iter().zip(&self.faces).filter(is_front);
        let front_after = front_after.map(|(_, face)| component(face)).collect();
        SlabComponents { count, front_before, front_after }
    }

    fn into_rings(self) -> Rings {
        let mut ends = Vec::with_capacity(self.face_counts.len());
        let mut corners = 0;
        for count in &self.face_counts {
            ends.push(corners);
            corners += if *count == NOT_DUE { 0 } else { *count };
        }
        let mut nexts = vec![0; corners as usize];
        let mut prevs = vec![0; corners as usize];
        for [a, b, c] in &self.faces {
            for [vertex, next, prev] in [[a, b, c], [b, c, a], [c, a, b]] {
                if self.face_counts[*vertex as usize] != NOT_DUE {
                    let end = &mut ends[*vertex as usize];
                    nexts[*end as usize] = *next;
                    prevs[*end as usize] = *prev;
                    *end += 1;
                }
            }
        }
        Rings { ends, nexts, prevs }
    }
}

/// The rings of all vertices, one after the other; those that are not due are empty.
struct Rings {
    ends: Vec<u32>,
    nexts: Vec<u32>,
    prevs: Vec<u32>,
}

impl Rings {
    fn tally(&self) -> Tally {
        let (mut tally, mut bench) = (Tally::default(), Workbench::default());
        let mut start = 0;
        for end in self.ends.iter().map(|end| *end as usize) {
            if start < end {
                tally.add_ring(&self.nexts[start..end], &self.prevs[start..end], &mut bench);
            }
            start = end;
        }
        tally
    }
}
