//! `sort`: what it needs to know of its inputs, how its plan reads, and the doing.
//!
//! An input that is nearly sorted is put in order as it passes, and one that fits in memory is
//! sorted there; to know which it is, an input that can be read again is measured first. Only
//! what is neither goes to the disk.

use super::{
    InputFacts, Job, Plan, Report, Sort, SortReport,
    plan::{Sizes, name},
    run::{Run, report_input},
};
use crate::{
    error::Result,
    progress::StageId,
    soup::{ColoredPoint, OpenInput, Point, Source, SweepAxis, Vertex},
    stages::convert::{
        export,
        import::{self, Need, Survey},
        presort::{self, Method},
    },
};

/// Least memory of a sort.
const SORT_BYTES_MIN: u64 = 1 << 20;

/// What import has to find out. Indexed inputs tell their bounds in any case and are measured
/// once they are read; soups need a pass of their own for either.
pub(super) fn need(job: &Job, sort: Sort, inputs: &[InputFacts]) -> Need {
    let has_soup = inputs.iter().any(|facts| !facts.declared.indexed);
    let is_measured = !fits_in_memory(job, inputs) && inputs.iter().all(|facts| facts.repeatable);
    if has_soup && (sort.axis.is_none() || is_measured) { Need::Order } else { Need::Triangles }
}

/// Whether the triangles, as far as the headers tell, are sorted without the disk.
fn fits_in_memory(job: &Job, inputs: &[InputFacts]) -> bool {
    let triangles: Option<u64> = inputs.iter().map(|facts| facts.declared.faces).sum();
    let colored = inputs.iter().any(|facts| facts.declared.colors);
    let bytes =
        if colored { presort::sort_bytes::<ColoredPoint> } else { presort::sort_bytes::<Point> };
    let vertices: Option<u64> = inputs.iter().filter_map(|facts| facts.declared.vertices).max();
    let table = vertices.unwrap_or(0) * size_of::<ColoredPoint>() as u64;
    triangles.is_some_and(|count| bytes(count).saturating_add(table) <= job.memory_bytes)
}

/// Adds the sort to a plan.
pub(super) fn plan(job: &Job, sort: Sort, inputs: &[InputFacts], sizes: Sizes, plan: &mut Plan) {
    let need = need(job, sort, inputs);
    for facts in inputs.iter().filter(|facts| !facts.declared.indexed && need == Need::Order) {
        let path = name(&facts.path);
        if facts.repeatable {
            plan.stage(StageId::Import, format!("measure {path} (one pass)"));
            continue;
        }
        plan.add_temporary(facts.declared.faces.map(|count| count * sizes.triangle));
        plan.stage(StageId::Import, format!("set {path} aside and measure it"));
        plan.notes.push(match sort.axis {
            None => format!(
                "{path} can be read only once and its longest side shows at its end: set aside on \
                 disk, which --axis x, y or z saves"
            ),
            Some(_) => format!("{path} can be read only once and is needed twice: set aside"),
        });
    }
    let fits = fits_in_memory(job, inputs);
    let is_measured = inputs.iter().all(|facts| facts.repeatable);
    if is_measured && !fits && need == Need::Triangles {
        plan.stage(StageId::Measure, "see how far from sorted the triangles are".to_owned());
    }
    let along = sort.axis.map_or("its longest side".to_owned(), |axis| axis.name().to_owned());
    if fits {
        plan.stage(StageId::Sort, format!("sort along {along} in memory"));
        return;
    }
    let bytes = presort::disk_bytes_per_triangle(sizes.is_colored());
    let times = |count: u64| if count * bytes > BUCKETS * job.memory_bytes { 2 } else { 1 };
    let bytes = plan.records.map(|count| count * bytes * times(count));
    if is_measured || need == Need::Order {
        plan.add_unsorted(bytes);
    } else {
        plan.add_temporary(bytes);
    }
    plan.stage(StageId::Sort, format!("sort along {along}, on disk"));
    if is_measured || need == Need::Order {
        let note = "if the triangles turn out to be in order, or late by so few that a window in \
                    memory puts them in order, they are not sorted on disk";
        plan.notes.push(note.to_owned());
    }
}

/// Beyond so many times the memory each triangle is on disk once more: buckets are cut again, or runs
/// merged to fewer. Chosen by hand, well below the least number of buckets.
const BUCKETS: u64 = 64;

impl Run<'_> {
    pub(super) fn sort<V: Vertex>(&self, inputs: Vec<OpenInput>, sort: Sort) -> Result<Report> {
        let facts: Vec<InputFacts> = inputs.iter().map(InputFacts::of).collect();
        let need = need(self.job, sort, &facts);
        let import::Outcome { source, survey } = self.import::<V>(inputs, need)?;
        let longest = SweepAxis::ALL[survey.bounds.longest_axis()];
        let axis = sort.axis.unwrap_or(longest);
        let memory = self.workspace.budget().reserve_share(1.0, SORT_BYTES_MIN);
        let memory_bytes = memory.bytes();
        let repeatable = facts.iter().all(|facts| facts.repeatable);
        let order = self.order(&source, &survey, memory_bytes, repeatable)?;
        let method = match order.map(|displacement_max| displacement_max[axis.index()]) {
            Some(late) if presort::window_bytes::<V>(late) <= memory_bytes => {
                Method::Absorb { displacement_max: late }
            }
            _ => Method::Sort,
        };
        let steps = Some(presort::STEPS);
        let config = presort::Config { axis, method, memory_bytes, steps };
        let export = self.export_config::<V>(survey.origin);
        let (workspace, monitor) = (self.workspace, self.monitor);
        let (sorted, written) =
            export::export_triangles(source.records(), &export, workspace, |send| {
                presort::presort(&source, &config, workspace, monitor, send)
            })?;
        let mut report = report_input(&survey, written.counts.triangles);
        report.sort = Some(SortReport {
            axis: axis.name(),
            displacement_max: order.map(|late| late[axis.index()]),
            on_disk: sorted.on_disk,
        });
        self.report_output(&written, &sorted.findings, &mut report);
        Ok(report)
    }

    /// How far from sorted the triangles are, if that is known or worth a pass.
    fn order<V: Vertex>(
        &self,
        source: &Source<V>,
        survey: &Survey,
        memory_bytes: u64,
        repeatable: bool,
    ) -> Result<Option<[u64; 3]>> {
        let fits = |count| presort::sort_bytes::<V>(count) <= memory_bytes;
        if survey.displacement_max.is_some() || !repeatable || source.records().is_some_and(fits) {
            return Ok(survey.displacement_max);
        }
        Ok(Some(self.measured_order(source)?.displacement_max))
    }
}
