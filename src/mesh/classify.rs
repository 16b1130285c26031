//! What a vertex is, from the faces around it.

use super::{State, ring::Wing};

/// Rings of up to this many faces are looked at pair by pair; larger ones are complex. Chosen by
/// hand: a vertex in the middle of so many faces carries detail from all sides.
const RING_FACES_MAX: usize = 60;

/// Whether the faces of a ring are a closed fan, an open one, or none.
pub(super) fn classify(ring: &[Wing]) -> State {
    if ring.is_empty() || ring.len() > RING_FACES_MAX {
        return State::COMPLEX;
    }
    if is_closed(ring) {
        return State::INNER;
    }
    // An open fan is walked from its beginning: the face that none precedes.
    let begins = |wing: &&Wing| !ring.iter().any(|other| other.prev == wing.next);
    let first = ring.iter().find(begins);
    let Some(&first) = first else { return State::COMPLEX };
    let (mut at, mut walked) = (first, 1);
    loop {
        let mut following = ring.iter().filter(|other| other.next == at.prev);
        match (following.next(), following.next()) {
            (None, _) => break,
            (Some(next), None) if *next != first && walked < ring.len() => at = *next,
            (Some(next), None) if *next == first => break,
            _ => return State::COMPLEX,
        }
        walked += 1;
    }
    let is_fan = walked == ring.len() && at.prev != first.next;
    if is_fan { State::BOUNDARY } else { State::COMPLEX }
}

/// Whether the faces, walked from one to the next, come round to the first after all of them: as
/// those of nearly every vertex do.
#[inline]
fn is_closed(ring: &[Wing]) -> bool {
    let mut at = ring[0];
    for _ in 1..ring.len() {
        match ring.iter().find(|other| other.next == at.prev) {
            Some(next) if *next != ring[0] => at = *next,
            _ => return false,
        }
    }
    ring.len() >= 3 && at.prev == ring[0].next
}

/// Whether the edge from a ring's centre to `vertex` has one face only.
#[inline]
pub(super) fn is_end(ring: &[Wing], vertex: u32) -> bool {
    ring.iter().fold(0, |faces, wing| faces + usize::from(wing.has(vertex))) == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(pairs: &[(u32, u32)]) -> Vec<Wing> {
        pairs.iter().map(|&(next, prev)| Wing { next, prev }).collect()
    }

    #[test]
    fn fans_are_told_from_what_is_none() {
        let state = |pairs: &[(u32, u32)]| classify(&ring(pairs));
        assert_eq!(state(&[(1, 2), (3, 1), (2, 3)]), State::INNER);
        assert_eq!(state(&[(2, 3), (1, 2)]), State::BOUNDARY);
        assert_eq!(state(&[(1, 2)]), State::BOUNDARY);
        // Two fans that touch; an edge with three faces; a face turned over; the same face twice.
        assert_eq!(state(&[(1, 2), (3, 4)]), State::COMPLEX);
        assert_eq!(state(&[(1, 2), (2, 3), (2, 4)]), State::COMPLEX);
        assert_eq!(state(&[(1, 2), (3, 2)]), State::COMPLEX);
        assert_eq!(state(&[(1, 2), (1, 2)]), State::COMPLEX);
        assert_eq!(state(&[(1, 2), (2, 1)]), State::COMPLEX);
        // Two closed fans; a closed one beside an open one.
        assert_eq!(state(&[(1, 2), (2, 3), (3, 1), (4, 5), (5, 6), (6, 4)]), State::COMPLEX);
        assert_eq!(state(&[(1, 2), (2, 3), (3, 1), (4, 5)]), State::COMPLEX);
        assert_eq!(state(&[]), State::COMPLEX);
    }

    #[test]
    fn the_ends_of_an_open_fan_are_its_boundary() {
        let open = ring(&[(2, 3), (1, 2)]);
        assert_eq!([1, 2, 3, 4].map(|vertex| is_end(&open, vertex)), [true, false, true, false]);
    }
}
