//! The half-edges of docs/FORMATS.md: where faces meet, and how a split changes that. Both sides of a
//! progressive mesh keep the same ones.

use crate::{
    error::Fault,
    formats::progressive::{Kind, Split},
};

/// No half-edge: no twin, or no fan.
const NONE: u32 = u32::MAX;

/// Most faces of a fan that is split: walking round a larger one would take more time than the bytes
/// of a split pay for.
pub const FAN_FACES_MAX: usize = 1024;

/// Half-edges by number: three to a face.
#[derive(Clone, Debug, Default)]
pub struct HalfEdges {
    /// The vertices they go out of: the corners of the faces.
    origins: Vec<u32>,
    /// The one that goes the other way; [`NONE`] where the edge is not one of two faces.
    twins: Vec<u32>,
    /// By vertex, the half-edge its fan begins with; [`NONE`] where its faces are not one fan.
    first: Vec<u32>,
    /// The half-edges of the fan that is looked at.
    fan: Vec<u32>,
}

/// The half-edge after `h` in its face.
#[inline]
fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

/// The half-edge before `h` in its face.
#[inline]
fn prev(h: u32) -> u32 {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

/// What a fan is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fan {
    /// Its last face meets its first one.
    Closed,
    /// It begins and ends at the surface's boundary.
    Open,
}

impl HalfEdges {
    /// Bytes of memory of a face, with its share of the vertices.
    pub const FACE_BYTES: u64 = 3 * (4 + 4) + 2;

    /// The half-edges of faces over `vertices` vertices; no face has a vertex twice.
    #[must_use]
    pub fn of_faces(vertices: usize, faces: &[[u32; 3]]) -> Self {
        let origins = faces.as_flattened().to_vec();
        let twins = twins(&origins);
        let mut first = vec![NONE; vertices];
        let mut counts = vec![0_u32; vertices];
        for (h, origin) in (0_u32..).zip(&origins) {
            counts[*origin as usize] += 1;
            let first = &mut first[*origin as usize];
            let is_boundary = |h: u32| twins[h as usize] == NONE;
            if *first == NONE || (is_boundary(h) && !is_boundary(*first)) {
                *first = h;
            }
        }
        let mut half_edges = Self { origins, twins, first, fan: Vec::new() };
        for (vertex, count) in counts.into_iter().enumerate() {
            if count > 0 && half_edges.fan_faces(vertex as u32) != count {
                half_edges.first[vertex] = NONE;
            }
        }
        half_edges
    }

    /// Makes room for so many vertices and faces in all.
    pub fn make_room(&mut self, vertices: usize, faces: usize) {
        self.origins.reserve_exact(3 * faces.saturating_sub(self.faces().len()));
        self.twins.reserve_exact(3 * faces.saturating_sub(self.faces().len()));
        self.first.reserve_exact(vertices.saturating_sub(self.first.len()));
    }

    /// Corners by face.
    #[must_use]
    pub fn faces(&self) -> &[[u32; 3]] {
        self.origins.as_chunks::<3>().0
    }

    /// How many vertices there are.
    #[must_use]
    pub fn vertices(&self) -> usize {
        self.first.len()
    }

    /// Faces in the fan of a vertex, as far as it can be walked.
    fn fan_faces(&self, vertex: u32) -> u32 {
        let first = self.first[vertex as usize];
        let (mut h, mut count) = (first, 0);
        while h != NONE && (h != first || count == 0) {
            count += 1;
            h = self.twins[prev(h) as usize];
        }
        count
    }

    /// Lists the half-edges that go out of a vertex, in the order of its fan; `None` where its faces
    /// are not one fan, or too many.
    #[inline]
    pub(super) fn walk(&self, vertex: u32, fan: &mut Vec<u32>) -> Option<Fan> {
        fan.clear();
        let first = self.first[vertex as usize];
        let mut h = first;
        while h != NONE {
            if fan.len() == FAN_FACES_MAX {
                return None;
            }
            fan.push(h);
            h = self.twins[prev(h) as usize];
            if h == first {
                return Some(Fan::Closed);
            }
        }
        (!fan.is_empty()).then_some(Fan::Open)
    }

    /// Where the fan leads to whose half-edges were listed: one more neighbour than faces if it is
    /// open.
    pub(super) fn neighbours(&self, kind: Fan, fan: &[u32]) -> impl Iterator<Item = u32> {
        let last = fan.last().filter(|_| kind == Fan::Open).map(|h| prev(*h));
        let ends = fan.iter().map(|h| next(*h)).chain(last);
        ends.map(|h| self.origins[h as usize])
    }

    /// Splits a vertex; the new one has the next number, and so have the new faces.
    ///
    /// # Errors
    /// A fault when there is no such vertex, or its fan is not what the split needs; nothing is
    /// changed then.
    pub fn split(&mut self, split: &Split) -> Result<(), Fault> {
        let Split { parent, kind, first, taken, .. } = *split;
        if parent as usize >= self.first.len() {
            let (index, vertices) = (parent.into(), self.first.len() as u64);
            return Err(Fault::IndexOutOfRange { index, vertices });
        }
        let mut walked = std::mem::take(&mut self.fan);
        let fan = self.walk(parent, &mut walked);
        self.fan = walked;
        let Some(fan) = fan else {
            let expected = "a vertex with one fan of faces";
            return Err(Fault::Syntax { expected, found: format!("vertex {parent}") });
        };
        let faces = self.fan.len() as u32;
        if kind != Kind::Between {
            at_most("the first face of a split at an end", first, 0)?;
            at_most("the faces that a split takes", taken, faces)?;
            at_most("the ends of a closed fan", u32::from(fan == Fan::Closed), 0)?;
            return self.split_end(parent, kind, taken as usize);
        }
        if taken == 0 {
            return Err(Fault::Corrupt("the faces that a split takes"));
        }
        match fan {
            Fan::Closed => {
                at_most("the first face of a split", first, faces - 1)?;
                at_most("the faces that a split takes", taken, faces - 1)?;
            }
            Fan::Open => {
                at_most("the first face of a split", first, faces - 1)?;
                at_most("the faces that a split takes", taken, faces - first)?;
            }
        }
        self.split_between(parent, fan, first as usize, taken as usize);
        Ok(())
    }

    /// Whether these are the half-edges of the same faces; closed fans may begin anywhere.
    #[must_use]
    pub fn is_as(&self, other: &Self) -> bool {
        let is_open = |h: u32| h == NONE || self.twins[h as usize] == NONE;
        let mut fans = self.first.iter().zip(&other.first);
        (&self.origins, &self.twins) == (&other.origins, &other.twins)
            && fans.all(|(own, other)| own == other || !(is_open(*own) || is_open(*other)))
    }

    /// Adds a face and returns its half-edges.
    fn add_face(&mut self, corners: [u32; 3]) -> [u32; 3] {
        let h = self.origins.len() as u32;
        self.origins.extend(corners);
        self.twins.extend([NONE; 3]);
        [h, h + 1, h + 2]
    }

    fn marry(&mut self, one: u32, two: u32) {
        self.twins[one as usize] = two;
        if two != NONE {
            self.twins[two as usize] = one;
        }
    }

    /// Kind 0: two new faces. The fan was walked.
    fn split_between(&mut self, p: u32, fan: Fan, first: usize, taken: usize) {
        let (r, faces) = (self.first.len() as u32, self.fan.len());
        let last = self.fan[(first + taken - 1) % faces];
        let (ha, before_b) = (self.fan[first], prev(last));
        let (na, nb) = (self.origins[next(ha) as usize], self.origins[before_b as usize]);
        for place in first..first + taken {
            let h = self.fan[if place < faces { place } else { place - faces }];
            self.origins[h as usize] = r;
        }
        let (to_a, to_b) = (self.twins[ha as usize], self.twins[before_b as usize]);
        let [p_a, a_r, r_p] = self.add_face([p, na, r]);
        let [p_r, r_b, b_p] = self.add_face([p, r, nb]);
        self.marry(p_a, to_a);
        self.marry(a_r, ha);
        self.marry(r_p, p_r);
        self.marry(r_b, before_b);
        self.marry(b_p, to_b);
        if to_b == NONE && self.first[nb as usize] == before_b {
            self.first[nb as usize] = b_p;
        }
        match fan {
            Fan::Closed => self.first[p as usize] = p_r,
            Fan::Open if first == 0 => self.first[p as usize] = p_a,
            Fan::Open => {}
        }
        self.first.push(r_p);
    }

    /// Kinds 1 and 2: one new face at an end of an open fan, which was walked.
    fn split_end(&mut self, p: u32, kind: Kind, taken: usize) -> Result<(), Fault> {
        let (r, faces) = (self.first.len() as u32, self.fan.len());
        if self.origins.len() / 3 + 1 > (NONE / 3) as usize {
            return Err(Fault::Unsupported("so many faces"));
        }
        let (h_first, last) = (self.fan[0], prev(self.fan[faces - 1]));
        if kind == Kind::First {
            // (p, r, n): r has the faces before it, p those after it.
            let at = if taken == 0 { next(h_first) } else { prev(self.fan[taken - 1]) };
            let n = self.origins[at as usize];
            self.fan[..taken].iter().for_each(|h| self.origins[*h as usize] = r);
            let [p_r, r_n, n_p] = self.add_face([p, r, n]);
            self.first[p as usize] = p_r;
            if taken == 0 {
                self.marry(n_p, h_first);
                self.first.push(r_n);
                return Ok(());
            }
            let beyond = self.twins[at as usize];
            self.marry(r_n, at);
            self.marry(n_p, beyond);
            if beyond == NONE && self.first[n as usize] == at {
                self.first[n as usize] = n_p;
            }
            self.first.push(h_first);
            return Ok(());
        }
        // (p, n, r): p has the faces before it, r those after it.
        let place = faces - taken;
        let n = match self.fan.get(place) {
            Some(h) => self.origins[next(*h) as usize],
            None => self.origins[last as usize],
        };
        self.fan[place..].iter().for_each(|h| self.origins[*h as usize] = r);
        let [p_n, n_r, r_p] = self.add_face([p, n, r]);
        if taken == 0 {
            self.marry(p_n, last);
            if self.first[n as usize] == last {
                self.first[n as usize] = n_r;
            }
        } else {
            let h = self.fan[place];
            let beyond = self.twins[h as usize];
            self.marry(n_r, h);
            self.marry(p_n, beyond);
        }
        if taken == faces {
            self.first[p as usize] = p_n;
        }
        self.first.push(r_p);
        Ok(())
    }
}

fn at_most(what: &'static str, count: u32, limit: u32) -> Result<(), Fault> {
    if count <= limit {
        return Ok(());
    }
    Err(Fault::CountImpossible { what, count: count.into(), limit: limit.into() })
}

/// The twin of each half-edge: of edges that exactly two faces have, one in each direction.
fn twins(origins: &[u32]) -> Vec<u32> {
    let mut twins = vec![NONE; origins.len()];
    let edge = |h: u32| {
        let ends = [origins[h as usize], origins[next(h) as usize]].map(u64::from);
        ends[0].min(ends[1]) << 32 | ends[0].max(ends[1])
    };
    let mut edges: Vec<(u64, u32)> = (0..origins.len() as u32).map(|h| (edge(h), h)).collect();
    edges.sort_unstable();
    for group in edges.chunk_by(|one, two| one.0 == two.0) {
        if let [(_, one), (_, two)] = group
            && origins[*one as usize] != origins[*two as usize]
        {
            twins[*one as usize] = *two;
            twins[*two as usize] = *one;
        }
    }
    twins
}
