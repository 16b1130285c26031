//! The one integration test binary: it links once.
//!
//! `cfg(test)` is always true here; it tells clippy that these modules are tests throughout.

#[cfg(test)]
mod bounded;
#[cfg(test)]
mod cli;
#[cfg(test)]
mod cluster;
#[cfg(test)]
mod command;
#[cfg(test)]
mod compare;
#[cfg(test)]
mod convert;
#[cfg(test)]
mod decimate;
#[cfg(test)]
mod faults;
#[cfg(test)]
mod golden;
#[cfg(test)]
mod hybrid;
#[cfg(test)]
mod info;
#[cfg(test)]
mod limits;
#[cfg(test)]
mod meshes;
#[cfg(test)]
mod oracles;
#[cfg(test)]
mod prefixes;
#[cfg(test)]
mod progressive;
#[cfg(test)]
mod render;
#[cfg(test)]
mod resume;
#[cfg(test)]
mod sort;
#[cfg(test)]
mod stream;
#[cfg(test)]
mod tidy;
#[cfg(test)]
mod topology;
#[cfg(test)]
mod torture;
