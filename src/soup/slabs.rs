//! Cuts a sorted stream into slabs, and keeps the front: the vertices between them.

use super::{SweepAxis, SweepPlace, Triangle, Vertex};

/// A stretch of the stream.
pub struct Slab<V> {
    /// Counts the slabs.
    pub index: u64,
    /// In the order of the stream.
    pub triangles: Vec<Triangle<V>>,
    /// Vertices that earlier slabs have and this one may have, in order.
    pub front: Vec<[f32; 3]>,
    /// Place of the first triangle of the next slab: vertices that are not before it may have
    /// faces there. `None` for the last slab.
    pub until: Option<SweepPlace>,
}

/// A slab has so many triangles for each vertex of the front it begins with: few of its vertices
/// are frozen then, however large the surface.
const TRIANGLES_PER_FRONT: usize = 32;

/// Takes triangles in the order of their places, and cuts them into slabs.
pub struct Cutter<V> {
    axis: SweepAxis,
    /// Triangles of a slab, at least.
    slab_triangles_min: usize,
    /// Triangles of the slab being filled.
    slab_triangles: usize,
    slabs: u64,
    triangles: Vec<Triangle<V>>,
    front: Vec<[f32; 3]>,
}

impl<V: Vertex> Cutter<V> {
    /// Cuts a stream along `axis` into slabs of so many triangles at least.
    #[must_use]
    pub fn new(axis: SweepAxis, slab_triangles_min: usize) -> Self {
        assert!(slab_triangles_min > 0, "a slab holds something");
        let slab_triangles = slab_triangles_min;
        Self {
            axis,
            slab_triangles_min,
            slab_triangles,
            slabs: 0,
            triangles: Vec::new(),
            front: Vec::new(),
        }
    }

    /// Adds triangles; whole slabs are passed to `start`.
    ///
    /// # Errors
    /// What `start` returns.
    pub fn push<E>(
        &mut self,
        mut triangles: &[Triangle<V>],
        start: &mut impl FnMut(Slab<V>) -> Result<(), E>,
    ) -> Result<(), E> {
        while let Some(first) = triangles.first() {
            if self.triangles.len() == self.slab_triangles {
                let slab = self.cut(first);
                start(slab)?;
            }
            let room = self.slab_triangles - self.triangles.len();
            let (now, later) = triangles.split_at(room.min(triangles.len()));
            self.triangles.extend_from_slice(now);
            triangles = later;
        }
        Ok(())
    }

    /// Ends the slab before a triangle.
    fn cut(&mut self, before: &Triangle<V>) -> Slab<V> {
        let until = self.place_of(before);
        let is_open = |position: &[f32; 3]| SweepPlace::of(*position, self.axis) >= until;
        let (axis, limit) = (self.axis.index(), self.least(before));
        let corners = self.triangles.iter().flat_map(|triangle| &triangle.0).map(V::position);
        // The first coordinate decides nearly always, and costs next to nothing.
        let mut next: Vec<[f32; 3]> =
            corners.filter(|position| position[axis] >= limit && is_open(position)).collect();
        next.extend(self.front.iter().filter(|position| is_open(position)));
        next.sort_unstable_by_key(|position| SweepPlace::of(*position, self.axis));
        next.dedup_by_key(|position| SweepPlace::of(*position, self.axis));
        self.slab_triangles = self.slab_triangles_min.max(next.len() * TRIANGLES_PER_FRONT);
        let triangles = std::mem::take(&mut self.triangles);
        self.triangles.reserve(self.slab_triangles);
        let front = std::mem::replace(&mut self.front, next);
        let index = self.slabs;
        self.slabs += 1;
        Slab { index, triangles, front, until: Some(until) }
    }

    /// The last slab, if anything is left.
    #[must_use]
    pub fn finish(self) -> Option<Slab<V>> {
        let Self { slabs: index, triangles, front, .. } = self;
        (!triangles.is_empty()).then_some(Slab { index, triangles, front, until: None })
    }

    fn place_of(&self, triangle: &Triangle<V>) -> SweepPlace {
        let places = triangle.0.map(|vertex| SweepPlace::of(vertex.position(), self.axis));
        places[0].min(places[1]).min(places[2])
    }

    fn least(&self, triangle: &Triangle<V>) -> f32 {
        let [a, b, c] = triangle.0.map(|vertex| vertex.position()[self.axis.index()]);
        a.min(b).min(c)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soup::Point;

    /// A strip of triangles along x: (i, i + 1, i + 2), all of them between neighbours.
    fn strip(count: u32) -> Vec<Triangle<Point>> {
        let point = |i: u32| Point([i as f32, (i % 2) as f32, 0.0]);
        (0..count).map(|i| Triangle([point(i), point(i + 1), point(i + 2)])).collect()
    }

    fn slabs_of(batches: &[&[Triangle<Point>]], slab_triangles: usize) -> Vec<Slab<Point>> {
        let mut slabs = Vec::new();
        let mut cutter = Cutter::new(SweepAxis::X, slab_triangles);
        for batch in batches {
            let mut start = |slab| {
                slabs.push(slab);
                Ok::<(), ()>(())
            };
            cutter.push(batch, &mut start).unwrap();
        }
        slabs.extend(cutter.finish());
        slabs
    }

    #[test]
    fn slabs_are_cut_by_count_and_know_their_fronts() {
        let triangles = strip(150);
        let slabs = slabs_of(&[&triangles[..3], &triangles[3..]], 4);
        let counts: Vec<usize> = slabs.iter().map(|slab| slab.triangles.len()).collect();
        // The first knows of no front; a front of two vertices is worth 64 triangles.
        assert_eq!(counts, [4, 64, 64, 18]);
        let first_coordinates = |slab: &Slab<Point>| slab.front.iter().map(|p| p[0]).collect();
        let fronts: Vec<Vec<f32>> = slabs.iter().map(first_coordinates).collect();
        assert_eq!(fronts, [vec![], vec![4.0, 5.0], vec![68.0, 69.0], vec![132.0, 133.0]]);
        assert_eq!(slabs[0].until, Some(SweepPlace::of([4.0, 0.0, 0.0], SweepAxis::X)));
        assert_eq!(slabs[3].until, None);
    }

    #[test]
    fn a_vertex_stays_in_the_front_until_it_is_passed() {
        // One long triangle reaches over all the others.
        let far = Point([1000.0, 0.0, 0.0]);
        let mut triangles = strip(300);
        triangles.insert(0, Triangle([Point([0.0; 3]), Point([0.0, 9.0, 0.0]), far]));
        let slabs = slabs_of(&[&triangles], 3);
        assert!(slabs[1..].iter().all(|slab| slab.front.contains(&far.0)));
        assert!(!slabs[0].front.contains(&far.0));
    }

    #[test]
    fn an_empty_stream_has_no_slab() {
        assert!(slabs_of(&[], 3).is_empty());
        assert_eq!(slabs_of(&[&strip(3)], 3).len(), 1);
    }
}
