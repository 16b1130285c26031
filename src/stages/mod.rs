//! The stages of a job. They never name each other: they meet in the typed files of `soup/`.

pub mod convert;
pub mod generate;
pub mod inspect;
pub mod simplify;
