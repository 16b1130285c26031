//! What belongs to vertices, cut so that several threads can change it at a time.

/// Vertices of a piece.
const PIECE: usize = 1 << 9;

/// Some vertices, and the values of all from the first to the last of them.
pub(super) struct Piece<'a, T> {
    pub(super) vertices: &'a [u32],
    /// The vertex that the values begin with.
    pub(super) first: u32,
    pub(super) values: &'a mut [T],
}

/// Cuts ascending vertices into pieces, each with its part of what there is one of by vertex.
pub(super) fn pieces<'a, T>(vertices: &'a [u32], values: &'a mut [T]) -> Vec<Piece<'a, T>> {
    let mut pieces = Vec::with_capacity(vertices.len().div_ceil(PIECE));
    let (mut rest, mut begin) = (values, 0);
    for vertices in vertices.chunks(PIECE) {
        let [first, last] = [vertices[0], vertices[vertices.len() - 1]];
        let (_, from_first) = rest.split_at_mut((first - begin) as usize);
        let (values, after) = from_first.split_at_mut((last - first + 1) as usize);
        pieces.push(Piece { vertices, first, values });
        (rest, begin) = (after, last + 1);
    }
    pieces
}
