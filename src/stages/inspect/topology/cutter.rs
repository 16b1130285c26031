//! Cuts a sorted stream into slabs that can be looked at one without the others.
//!
//! A slab begins with the front: the triangles before it that have a vertex which was not final
//! there. So it has all faces of the vertices that become final in it, and says all of those and of
//! nothing else.

use super::config::{self, Config};
use crate::{
    error::{Error, Result},
    soup::{SweepAxis, Triangle, Vertex},
};

/// The positions of a triangle's corners.
pub(super) type Corners = [[f32; 3]; 3];

/// A stretch of the stream, with the front it begins with.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Slab {
    /// Counts the slabs.
    pub(super) index: u64,
    /// Those of the front first, then the new ones; none with two equal corners.
    pub(super) triangles: Vec<Corners>,
    /// Triangles of the front.
    pub(super) front: usize,
    pub(super) span: Span,
}

/// Places in the order of the sweep that belong to a slab.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Span {
    axis: SweepAxis,
    /// From here on; the first slab has no such bound. Coordinates are in the order in which they
    /// are compared.
    from: Option<[f32; 3]>,
    /// Places before this one, which is that of the next triangle; all for the last slab.
    until: Option<[f32; 3]>,
}

impl Span {
    /// Whether a vertex becomes final in this slab.
    #[inline]
    pub(super) fn has(&self, position: [f32; 3]) -> bool {
        let place = self.axis.to_front(position);
        self.from.is_none_or(|from| place >= from) && self.until.is_none_or(|until| place < until)
    }

    /// Whether a triangle has a vertex that is not final after this slab: it is of the front.
    #[inline]
    pub(super) fn leaves_open(&self, triangle: &Corners) -> bool {
        let Some(until) = self.until else { return false };
        triangle.iter().any(|corner| self.axis.to_front(*corner) >= until)
    }
}

/// Takes triangles in the order of their places, and cuts them into slabs.
pub(super) struct Cutter<'a> {
    config: &'a Config,
    triangles: Vec<Corners>,
    front: usize,
    /// Triangles of the slab being filled, with its front.
    slab_triangles: usize,
    slabs: u64,
    from: Option<[f32; 3]>,
    pub(super) counts: Counts,
}

/// What shows while slabs are cut.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    pub(super) triangles: u64,
    /// Those with two equal corners, which are in no slab.
    pub(super) collapsed: u64,
    /// Most triangles of a front.
    pub(super) front_max: u64,
}

impl<'a> Cutter<'a> {
    pub(super) fn new(config: &'a Config) -> Result<Self> {
        Ok(Self {
            config,
            triangles: Vec::new(),
            front: 0,
            slab_triangles: slab_triangles(config, 0)?,
            slabs: 0,
            from: None,
            counts: Counts::default(),
        })
    }

    /// Adds triangles; whole slabs are passed to `start`.
    pub(super) fn push<V: Vertex>(
        &mut self,
        triangles: &[Triangle<V>],
        start: &mut impl FnMut(Slab) -> Result<()>,
    ) -> Result<()> {
        self.counts.triangles += triangles.len() as u64;
        for triangle in triangles {
            let corners = triangle.0.map(|vertex| vertex.position());
            let [a, b, c] = corners;
            if a == b || b == c || c == a {
                self.counts.collapsed += 1;
                continue;
            }
            if self.triangles.len() == self.slab_triangles {
                let slab = self.cut(&corners)?;
                start(slab)?;
            }
            self.triangles.push(corners);
        }
        Ok(())
    }

    /// Ends the slab before a triangle.
    fn cut(&mut self, before: &Corners) -> Result<Slab> {
        let axis = self.config.axis;
        let [a, b, c] = before.map(|corner| axis.to_front(corner));
        let lesser = |a: [f32; 3], b: [f32; 3]| if b < a { b } else { a };
        let floor = lesser(lesser(a, b), c);
        let span = Span { axis, from: self.from.replace(floor), until: Some(floor) };
        let is_front = |triangle: &&Corners| span.leaves_open(triangle);
        let front = self.triangles.iter().filter(is_front).count();
        self.slab_triangles = slab_triangles(self.config, front)?;
        self.counts.front_max = self.counts.front_max.max(front as u64);
        let mut next = Vec::with_capacity(self.slab_triangles);
        next.extend(self.triangles.iter().filter(is_front));
        let triangles = std::mem::replace(&mut self.triangles, next);
        let slab = Slab { index: self.slabs, triangles, front: self.front, span };
        self.front = front;
        self.slabs += 1;
        Ok(slab)
    }

    /// The last slab.
    pub(super) fn finish(self) -> (Slab, Counts) {
        let span = Span { axis: self.config.axis, from: self.from, until: None };
        let slab = Slab { index: self.slabs, triangles: self.triangles, front: self.front, span };
        (slab, self.counts)
    }
}

/// Triangles of a slab that begins with such a front, in all.
fn slab_triangles(config: &Config, front: usize) -> Result<usize> {
    let wanted = front + (config.new_triangles_min).max(front * config::NEW_PER_FRONT);
    let fits = |slabs: u64| {
        let bytes = slabs * config::SLAB_TRIANGLE_BYTES + config::WAITING_TRIANGLE_BYTES;
        (config.memory_bytes / bytes).min(config::SLAB_TRIANGLES_MAX) as usize
    };
    // Small slabs look at each triangle of the front again and again. Rather than that, fewer of
    // them are worked on at a time.
    let is_large = |triangles: &usize| *triangles >= wanted.min(2 * front.max(1));
    let under_way = config::slabs_under_way(rayon::current_num_threads());
    let most = (1..=under_way).rev().map(fits).find(is_large).unwrap_or(fits(1));
    let least = front + front / config::FRONT_PER_NEW_MAX + 1;
    if most < least {
        let bytes = config::SLAB_TRIANGLE_BYTES + config::WAITING_TRIANGLE_BYTES;
        let (needed_bytes, available_bytes) = (least as u64 * bytes, config.memory_bytes);
        return Err(Error::Resource { what: config::FRONT, needed_bytes, available_bytes });
    }
    Ok(wanted.min(most))
}
