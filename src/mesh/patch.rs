//! Pieces of surface on their way between meshes, and joining them.

use glam::Vec3;
use hashbrown::HashMap;

use super::{
    Color,
    metric::Memory,
    split::{complex, split_fans},
};
use crate::soup::{Triangle, Vertex};

/// A piece of surface on its way between meshes: what of it is decided, and what is not.
#[derive(Clone, Debug)]
pub struct Patch<M: Memory> {
    /// Positions by vertex.
    pub positions: Vec<Vec3>,
    /// What the metric remembers, by vertex; empty until it is scanned.
    pub carried: Vec<M::Carried>,
    /// Colours by vertex; empty without colours.
    pub colors: Vec<Color>,
    /// Sums of the normals of the faces around vertices, each as long as twice its face's area; empty
    /// where nobody asks.
    pub normals: Vec<Vec3>,
    /// Vertices that other patches have too, increasing.
    pub shared: Vec<u32>,
    /// Vertices that were shared until the patches were joined: nobody has seen yet whether they
    /// are on a boundary.
    pub joined: Vec<u32>,
    /// Vertices that no collapse may remove any more: faces of theirs are finished, and elsewhere.
    /// Increasing; none of them is shared.
    pub settled: Vec<u32>,
    /// Faces; every vertex has one, or is hung at one.
    pub faces: Vec<[u32; 3]>,
    /// Of the last vertices, which have been removed and are not forgotten, the faces that are near
    /// them, counter-clockwise from any corner.
    pub hung: Vec<[u32; 3]>,
    /// A power of two that makes edges about one long: what costs are in units of. The same for
    /// all patches of a surface.
    pub unit: f32,
}

impl<M: Memory> Default for Patch<M> {
    fn default() -> Self {
        Self {
            positions: Vec::new(),
            carried: Vec::new(),
            colors: Vec::new(),
            normals: Vec::new(),
            shared: Vec::new(),
            joined: Vec::new(),
            settled: Vec::new(),
            faces: Vec::new(),
            hung: Vec::new(),
            unit: 1.0,
        }
    }
}

/// [`Patch::unit`] by the edges of some triangles.
#[must_use]
pub fn unit_of<V: Vertex>(triangles: &[Triangle<V>]) -> f32 {
    let edge = |triangle: &Triangle<V>| {
        let [a, b, _] = triangle.0.map(|v| Vec3::from_array(v.position()).as_dvec3());
        a.distance(b)
    };
    unit_of_lengths(triangles.iter().map(edge))
}

/// [`Patch::unit`] by some lengths of edges.
pub(super) fn unit_of_lengths(edges: impl ExactSizeIterator<Item = f64>) -> f32 {
    let count = edges.len() as f64;
    let mean = edges.sum::<f64>() / count;
    let unit = (-mean.log2().round()).exp2() as f32;
    if unit.is_normal() { unit } else { 1.0 }
}

impl<M: Memory> Patch<M> {
    /// Joins patches to one: vertices that several share, found by their exact positions, become
    /// one with the sum of what they carry and of their colours. Those that `is_shared` holds for by
    /// position have faces in still other patches, and stay shared.
    #[must_use]
    pub fn join(patches: Vec<Self>, is_shared: impl Fn([f32; 3]) -> bool) -> Self {
        let mut whole = Self::with_room_for(&patches);
        let mut seams = HashMap::<[u32; 3], u32>::new();
        let mut old_to_new = Vec::new();
        // What hangs comes after all that has faces.
        let mut tail = Self::default();
        for patch in patches {
            old_to_new.clear();
            let mut shared = patch.shared.iter().peekable();
            let mut settled = patch.settled.iter().peekable();
            let with_faces = patch.with_faces();
            for (index, position) in patch.positions[..with_faces].iter().enumerate() {
                let new = whole.positions.len() as u32;
                if shared.next_if(|vertex| **vertex == index as u32).is_some() {
                    let bits = position.to_array().map(|c| (c + 0.0).to_bits());
                    let known = *seams.entry(bits).or_insert(new);
                    if known != new {
                        old_to_new.push(known);
                        whole.merge(known, &patch, index);
                        continue;
                    }
                    let is_shared = is_shared(position.to_array());
                    if is_shared { &mut whole.shared } else { &mut whole.joined }.push(new);
                }
                if settled.next_if(|vertex| **vertex == index as u32).is_some() {
                    whole.settled.push(new);
                }
                old_to_new.push(new);
                whole.positions.push(*position);
                whole.carried.push(patch.carried[index]);
                whole.colors.extend(patch.colors.get(index));
                whole.normals.extend(patch.normals.get(index));
            }
            let renumber = |face: &[u32; 3]| face.map(|v| old_to_new[v as usize]);
            whole.faces.extend(patch.faces.iter().map(renumber));
            whole.hung.extend(patch.hung.iter().map(renumber));
            tail.positions.extend_from_slice(&patch.positions[with_faces..]);
            tail.carried.extend_from_slice(&patch.carried[with_faces..]);
            tail.colors.extend(patch.colors.iter().skip(with_faces));
            tail.normals.extend(patch.normals.iter().skip(with_faces));
        }
        whole.positions.append(&mut tail.positions);
        whole.carried.append(&mut tail.carried);
        whole.colors.append(&mut tail.colors);
        whole.normals.append(&mut tail.normals);
        whole
    }

    /// How many vertices, the first ones, have not been removed.
    #[must_use]
    pub fn with_faces(&self) -> usize {
        self.positions.len() - self.hung.len()
    }

    /// Takes apart the vertices at which several sheets touch, but for shared ones, of which some
    /// faces are not here. Each part remembers what the whole did. Returns how many vertices that
    /// adds.
    pub(super) fn split(&mut self) -> usize {
        let with_faces = self.with_faces();
        let mut is_complex = complex(with_faces, &self.faces);
        let elsewhere = self.shared.iter().chain(&self.settled);
        elsewhere.for_each(|vertex| is_complex[*vertex as usize] = false);
        let before = if self.hung.is_empty() { Vec::new() } else { self.faces.clone() };
        let added = split_fans(&self.positions[..with_faces], &mut self.faces, &is_complex);
        self.hang_again(&before);
        insert_copies(&mut self.positions, with_faces, &added);
        insert_copies(&mut self.carried, with_faces, &added);
        insert_copies(&mut self.colors, with_faces, &added);
        insert_copies(&mut self.normals, with_faces, &added);
        added.len()
    }

    /// Hangs vertices at the faces that have become of theirs, given as they were.
    fn hang_again(&mut self, before: &[[u32; 3]]) {
        let changed = before.iter().zip(&self.faces).filter(|(before, after)| before != after);
        let after: HashMap<[u32; 3], [u32; 3]> = changed
            .map(|(before, after)| {
                let turn = turn_of(before);
                let mut after = *after;
                after.rotate_left(turn);
                (turned(before, turn), after)
            })
            .collect();
        if after.is_empty() {
            return;
        }
        for hung in &mut self.hung {
            let face = turned(hung, turn_of(hung));
            *hung = after.get(&face).copied().unwrap_or(*hung);
        }
    }

    /// Fills in [`Self::normals`] of a surface as it was scanned.
    pub fn add_normals(&mut self) {
        self.normals = vec![Vec3::ZERO; self.positions.len()];
        for face in &self.faces {
            let [a, b, c] = face.map(|v| self.positions[v as usize]);
            let normal = (b - a).cross(c - a);
            for vertex in face {
                self.normals[*vertex as usize] += normal;
            }
        }
    }

    /// The places of vertices without any face.
    #[must_use]
    pub fn loose(&self) -> Vec<Vec3> {
        let mut has_face = vec![false; self.positions.len()];
        self.faces.iter().flatten().for_each(|vertex| has_face[*vertex as usize] = true);
        let all = self.positions.iter().zip(has_face);
        all.filter(|(_, has_face)| !has_face).map(|(position, _)| *position).collect()
    }

    /// Bytes of memory it takes.
    #[must_use]
    pub fn size_bytes(&self) -> usize {
        size_of_val(&self.positions[..])
            + size_of_val(&self.carried[..])
            + size_of_val(&self.colors[..])
            + size_of_val(&self.normals[..])
            + size_of_val(&self.faces[..])
            + size_of_val(&self.shared[..])
            + size_of_val(&self.settled[..])
            + size_of_val(&self.hung[..])
    }

    fn with_room_for(patches: &[Self]) -> Self {
        let sum = |count: fn(&Self) -> usize| patches.iter().map(count).sum();
        Self {
            positions: Vec::with_capacity(sum(|patch| patch.positions.len())),
            carried: Vec::with_capacity(sum(|patch| patch.carried.len())),
            colors: Vec::with_capacity(sum(|patch| patch.colors.len())),
            normals: Vec::with_capacity(sum(|patch| patch.normals.len())),
            faces: Vec::with_capacity(sum(|patch| patch.faces.len())),
            hung: Vec::with_capacity(sum(|patch| patch.hung.len())),
            unit: patches.first().map_or(1.0, |patch| patch.unit),
            ..Self::default()
        }
    }

    /// Adds what a vertex of another patch remembers to a vertex of this one.
    fn merge(&mut self, vertex: u32, other: &Self, index: usize) {
        M::join(&mut self.carried[vertex as usize], &other.carried[index]);
        if let Some(color) = other.colors.get(index) {
            self.colors[vertex as usize].add(color);
        }
        if let Some(normal) = other.normals.get(index) {
            self.normals[vertex as usize] += *normal;
        }
    }
}

/// Puts copies of some values before the one at a place, if there are any at all.
fn insert_copies<T: Copy>(values: &mut Vec<T>, at: usize, sources: &[u32]) {
    if !values.is_empty() {
        let copies: Vec<T> = sources.iter().map(|source| values[*source as usize]).collect();
        values.splice(at..at, copies);
    }
}

/// By how many places a face is turned to begin with its lowest corner.
fn turn_of(face: &[u32; 3]) -> usize {
    (0..3).min_by_key(|place| face[*place]).unwrap_or(0)
}

fn turned(face: &[u32; 3], turn: usize) -> [u32; 3] {
    let mut face = *face;
    face.rotate_left(turn);
    face
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{ByQuadric, Quadric};

    /// A face over three vertices, the first two of them shared.
    fn patch(positions: [[f32; 3]; 3]) -> Patch<ByQuadric> {
        Patch {
            positions: positions.map(Vec3::from_array).to_vec(),
            carried: vec![Quadric::default(); 3],
            shared: vec![0, 1],
            faces: vec![[0, 1, 2]],
            ..Patch::default()
        }
    }

    #[test]
    fn shared_vertices_become_one_and_stay_shared_where_they_must() {
        let (a, b, c) = ([0.0; 3], [0.0, 1.0, -0.0], [5.0, 0.0, 0.0]);
        let left = patch([a, b, [-1.0, 0.0, 0.0]]);
        let right = patch([[0.0, 1.0, 0.0], c, a]);
        let whole = Patch::join(vec![left, right], |position| position == c);
        // `a` is shared on the left only, so that it is not the same vertex.
        assert_eq!(whole.positions.len(), 5);
        assert_eq!(whole.faces, [[0, 1, 2], [1, 3, 4]]);
        assert_eq!((whole.shared, whole.joined), (vec![3], vec![0, 1]));
    }
}
