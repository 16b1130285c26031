//! From a job to a finished output: what will be done, and the doing; and what a mesh is like,
//! alone or beside another one.

mod attempts;
mod bounded;
mod compare;
mod compare_picture;
mod decimation;
mod document;
mod expected;
mod fingerprint;
mod hybrid;
mod info;
mod job;
mod machine;
mod method;
mod plan;
mod plan_words;
mod progressive;
mod refine;
mod render;
mod report;
mod resume;
mod run;
mod sort;
mod streaming;
mod topology;

pub use crate::mesh::{Fairing, Limits, Shape, Sides, Smooth, Update};
pub use crate::stages::simplify::decimate::Metric;
pub use bounded::{Keep, MaxError};
pub use compare::{
    BothTopologies, Compare, CompareInput, CompareReport, ComparedReport, ConfidenceReport,
    DeviationReport, RelativeReport, SamplesReport, compare,
};
pub use compare_picture::ComparePicture;
pub use document::{
    DataPlacement, Document, DocumentReport, check_document, document, path_beside,
};
pub use info::{DefectInfo, Detail, Info, InfoReport, OrderReport, TopologyFacts, info};
pub use job::{End, Goal, Job, Keeping, Method, Selection, Simplify, Sort, Start, Task};
pub use method::Choice;
pub use plan::{InputFacts, Plan, PlannedStage, plan};
pub use progressive::Progressive;
pub use refine::{Detail as RefineDetail, Refine, refine};
pub use render::{Colors, Render, RenderReport, render};
pub use report::{
    BoundedReport, BoundsReport, ClusterReport, DecimateReport, DefectReport, EstimatedReport,
    EstimatesReport, HybridReport, InputReport, OutputReport, ProgressiveReport, RefineReport,
    Report, SortReport, StageReport, StreamReport,
};
pub use run::{Prepared, prepare};
pub use topology::{TopologyReport, topology};
