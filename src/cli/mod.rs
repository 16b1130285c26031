//! The command line: what a person sees of a job. It knows the library by its public API only.

mod bars;
mod display;
mod figures;
mod lines;
mod passes;
