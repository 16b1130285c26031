//! From a job to a finished output: what will be done, and the doing.

mod attempts;
mod job;
mod plan;
mod report;
mod run;

pub use job::{Goal, Job, Simplify, Task};
pub use plan::{InputFacts, Plan, PlannedStage, plan};
pub use report::{
    BoundsReport, ClusterReport, DefectReport, InputReport, OutputReport, Report, StageReport,
};
pub use run::{Prepared, prepare};
