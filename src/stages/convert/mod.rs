//! One form of mesh into another: users' files in, soup or indexed mesh between, users' files out.

pub mod dereference;
pub mod export;
pub mod import;
pub mod presort;
pub mod refine;
pub mod reindex;
