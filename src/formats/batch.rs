//! The interchange between parsers, writers and the rest: arrays of plain numbers.

/// Some records of one kind, in file order. Reused from call to call.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Batch {
    /// What the arrays hold.
    pub content: Content,
    /// [`Content::Vertices`]: one position each. [`Content::Soup`]: three per triangle.
    /// In model units, relative to the reader's origin. Always finite or NaN-marked, see
    /// [`crate::formats::OnDefect`].
    pub positions: Vec<[f32; 3]>,
    /// RGBA, parallel to `positions`, or empty when the mesh has no vertex colours.
    pub colors: Vec<[u8; 4]>,
    /// [`Content::Faces`] only.
    pub faces: Faces,
}

/// Kind of record in a [`Batch`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Content {
    /// Vertices of an indexed mesh.
    #[default]
    Vertices,
    /// Faces of an indexed mesh.
    Faces,
    /// Triangles with their own three positions.
    Soup,
}

/// Faces as 0-based vertex indices, in file order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Faces {
    /// Corners of all faces, one face after the other.
    pub corners: Vec<u64>,
    /// End of each face in `corners`; empty when every face is a triangle.
    pub ends: Vec<u64>,
}

impl Faces {
    /// Number of faces.
    #[must_use]
    pub fn count(&self) -> usize {
        if self.ends.is_empty() { self.corners.len() / 3 } else { self.ends.len() }
    }

    /// Appends one face of three or more corners.
    pub fn push(&mut self, corners: &[u64]) {
        if corners.len() != 3 && self.ends.is_empty() {
            self.ends.extend((1..=self.corners.len() as u64 / 3).map(|face| face * 3));
            // An empty list means "triangles only": from here on the ends are explicit.
            self.corners.extend_from_slice(corners);
            self.ends.push(self.corners.len() as u64);
            return;
        }
        self.corners.extend_from_slice(corners);
        if !self.ends.is_empty() {
            self.ends.push(self.corners.len() as u64);
        }
    }

    /// Removes the first `faces`.
    fn drop_front(&mut self, faces: usize) {
        let cut = match faces.checked_sub(1) {
            None => 0,
            Some(last) if self.ends.is_empty() => 3 * (last + 1),
            Some(last) => self.ends[last] as usize,
        };
        self.corners.drain(..cut);
        self.ends.drain(..faces.min(self.ends.len()));
        self.ends.iter_mut().for_each(|end| *end -= cut as u64);
    }

    /// Removes all faces, keeps the memory.
    pub fn clear(&mut self) {
        self.corners.clear();
        self.ends.clear();
    }

    /// Each face's corners, in order.
    pub fn iter(&self) -> impl Iterator<Item = &[u64]> {
        let mut start = 0;
        (0..self.count()).map(move |face| {
            let end = if self.ends.is_empty() { 3 * (face + 1) } else { self.ends[face] as usize };
            &self.corners[std::mem::replace(&mut start, end)..end]
        })
    }
}

impl Batch {
    /// Empties the batch for records of kind `content`, keeps the memory.
    pub fn reset(&mut self, content: Content) {
        self.content = content;
        self.positions.clear();
        self.colors.clear();
        self.faces.clear();
    }

    /// Removes the first `records`.
    pub fn drop_front(&mut self, records: usize) {
        let corners = if self.content == Content::Soup { 3 * records } else { records };
        self.positions.drain(..corners.min(self.positions.len()));
        self.colors.drain(..corners.min(self.colors.len()));
        if self.content == Content::Faces {
            self.faces.drop_front(records);
        }
    }

    /// Records held: vertices, faces or soup triangles.
    #[must_use]
    pub fn count(&self) -> usize {
        match self.content {
            Content::Vertices => self.positions.len(),
            Content::Faces => self.faces.count(),
            Content::Soup => self.positions.len() / 3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_need_no_ends_and_polygons_bring_them() {
        let mut faces = Faces::default();
        faces.push(&[0, 1, 2]);
        faces.push(&[2, 1, 3]);
        assert!(faces.ends.is_empty());
        faces.push(&[4, 5, 6, 7]);
        faces.push(&[7, 8, 9]);
        let listed: Vec<_> = faces.iter().map(<[u64]>::to_vec).collect();
        assert_eq!(listed, [vec![0, 1, 2], vec![2, 1, 3], vec![4, 5, 6, 7], vec![7, 8, 9]]);
    }

    #[test]
    fn what_is_behind_the_first_records_stays() {
        let mut batch = Batch { content: Content::Faces, ..Batch::default() };
        for face in [&[0, 1, 2][..], &[2, 1, 3], &[4, 5, 6, 7], &[7, 8, 9]] {
            batch.faces.push(face);
        }
        batch.drop_front(2);
        let listed: Vec<_> = batch.faces.iter().map(<[u64]>::to_vec).collect();
        assert_eq!(listed, [vec![4, 5, 6, 7], vec![7, 8, 9]]);
        batch.drop_front(0);
        assert_eq!(batch.count(), 2);
        batch.faces = Faces { corners: (0..9).collect(), ends: Vec::new() };
        batch.drop_front(2);
        assert_eq!(batch.faces.corners, [6, 7, 8]);
        let positions = (0..9_u8).map(|i| [f32::from(i); 3]).collect();
        let mut soup = Batch { content: Content::Soup, positions, ..Batch::default() };
        soup.drop_front(1);
        assert_eq!((soup.count(), soup.positions[0]), (2, [3.0; 3]));
    }
}
