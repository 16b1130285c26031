//! Half-edge collapses under a bound: no vertex of the original surface is farther from the mesh
//! than a tolerance `[CKS98 §6]`.
//!
//! A vertex that is removed is not forgotten: it hangs at a face near it, and no collapse may take
//! that away from it without another one near enough. Which of the allowed collapses comes first is
//! the matter of a [`Fairing`].

mod attributes;
mod fairing;
mod fan;
mod hanging;
mod queue;
mod settle;

pub use attributes::Limits;
pub use fairing::{Fairing, Shape, Smooth};
pub use hanging::ByDeviation;
pub use queue::{Bound, Sides, Update, decimate_bounded, decimate_to_count};
pub use settle::Settled;
