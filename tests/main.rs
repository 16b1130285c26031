//! The one integration test binary: it links once.
//!
//! `cfg(test)` is always true here; it tells clippy that these modules are tests throughout.

#[cfg(test)]
mod tidy;
