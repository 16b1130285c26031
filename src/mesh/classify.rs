//! What a vertex is, from the faces around it.

use super::{
    State,
    ring::{NEAR_FACES, Wing},
    surface::NONE,
};

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
    match ring.len() {
        3..=NEAR_FACES => is_closed_near(ring),
        count => count > NEAR_FACES && is_closed_far(ring),
    }
}

/// [`is_closed`] of a small ring. Every face is compared with all: a processor that guesses where a
/// search will end is mostly wrong.
#[inline]
fn is_closed_near(ring: &[Wing]) -> bool {
    let (mut nexts, mut prevs) = ([NONE; NEAR_FACES], [NONE; NEAR_FACES]);
    for ((next, prev), wing) in nexts.iter_mut().zip(&mut prevs).zip(ring) {
        (*next, *prev) = (wing.next, wing.prev);
    }
    let (mut at, mut is_fan) = (prevs[0], true);
    for _ in 1..ring.len() {
        let (mut following, mut count) = (0, 0);
        for (next, prev) in nexts.iter().zip(&prevs) {
            let is_there = u32::from(*next == at);
            following |= is_there.wrapping_neg() & prev;
            count += is_there;
        }
        is_fan &= count == 1 && at != nexts[0];
        at = following;
    }
    is_fan && at == nexts[0]
}

fn is_closed_far(ring: &[Wing]) -> bool {
    let mut at = ring[0];
    for _ in 1..ring.len() {
        match ring.iter().find(|other| other.next == at.prev) {
            Some(next) if *next != ring[0] => at = *next,
            _ => return false,
        }
    }
    at.prev == ring[0].next
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
    fn small_rings_are_told_as_large_ones_are() {
        // All rings of four faces over four neighbours, and closed fans of up to twelve faces.
        for number in 0..4_u32.pow(8) {
            let digit = |place: u32| number / 4_u32.pow(place) % 4;
            let wings = (0..4).map(|i| Wing { next: digit(2 * i), prev: digit(2 * i + 1) });
            let ring: Vec<Wing> = wings.collect();
            assert_eq!(is_closed_near(&ring), is_closed_far(&ring), "{ring:?}");
        }
        for count in 3..=12 {
            let mut fan: Vec<(u32, u32)> = (0..count).map(|i| (i, (i + 1) % count)).collect();
            fan.reverse();
            fan.swap(0, 1);
            assert_eq!(classify(&ring(&fan)), State::INNER);
            fan[2].1 = count;
            assert_ne!(classify(&ring(&fan)), State::INNER);
        }
    }

    #[test]
    fn the_ends_of_an_open_fan_are_its_boundary() {
        let open = ring(&[(2, 3), (1, 2)]);
        assert_eq!([1, 2, 3, 4].map(|vertex| is_end(&open, vertex)), [true, false, true, false]);
    }
}
