//! The three out-of-core primitives: [`sort`] by key, [`reduce`] (combine by key), and [`join`]
//! (resolve a reference by key), with [`distribute`], which all of them rest on.
//!
//! Each works within the bytes it is given, on the threads of the current `rayon` pool, and
//! gives the same records in the same order for any number of either.

pub mod distribute;
pub mod join;
pub mod reduce;
pub mod sort;
pub mod waves;

// How records compare.
mod keys;
mod splitters;

// In memory.
mod in_memory;
mod partition;
mod turns;

// On disk: the two engines of `sort`, and the merge under one of them and under `reduce`.
mod join_place;
mod join_resolve;
mod merge;
mod sort_distribution;
mod sort_journal;
mod sort_merge;

#[cfg(test)]
mod testing;

pub use keys::{Keyed, SortKey};
