//! Decimation under an error bound: what it is asked for, how its plan reads, and the doing.

use super::{
    BoundedReport, Goal, Job, Method, Plan, Report, Simplify,
    decimation::FED,
    plan::Sizes,
    run::{Run, report_input},
    streaming::{count_unknown, sort_config},
};
use crate::{
    error::{Error, Result},
    formats::Format,
    mesh::{Bound, Fairing, Limits, Sides, Update},
    progress::StageId,
    soup::{ColoredPoint, OpenInput, Source, SweepAxis, Vertex},
    stages::{
        convert::{import, presort},
        simplify::bounded,
    },
};

/// How far a result may be from its input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MaxError {
    /// In model units, not negative.
    Length(f64),
    /// As a share of the diagonal of the input's bounding box, not negative.
    Share(f64),
}

/// What decimation under an error bound keeps to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keep {
    /// No vertex of the input is farther from the result; `None` for as little as a count takes.
    pub max_error: Option<MaxError>,
    /// Which of the allowed collapses comes first.
    pub fairing: Fairing,
    /// What is measured.
    pub sides: Sides,
    /// How costs are brought up to date.
    pub update: Update,
    /// Bounds on colours and normals.
    pub limits: Limits,
}

impl Default for Keep {
    fn default() -> Self {
        let (fairing, sides, update) = (Fairing::Error, Sides::One, Update::Best);
        Self { max_error: None, fairing, sides, update, limits: Limits::default() }
    }
}

impl Keep {
    /// Name of the fairing, as on the command line.
    fn fairing_name(&self) -> &'static str {
        match self.fairing {
            Fairing::Error => "error",
            Fairing::Shape(_) => "shape",
            Fairing::Smooth(_) => "smooth",
        }
    }
}

/// Share of the budget that putting triangles in order in passing may take, and sorting them.
const ORDER_SHARE: u64 = 4;
const SORT_SHARE: u64 = 2;

/// Refuses what is wrong whatever the inputs are.
pub(super) fn check_request(simplify: &Simplify) -> Result<()> {
    let refuse = |text: &str| Err(Error::Request(text.to_owned()));
    if !simplify.is_bounded() {
        return match (simplify.keep.max_error, simplify.goal) {
            (None, Goal::Tolerance) => refuse("no goal is given"),
            (None, _) if simplify.keep.limits != Limits::default() => {
                refuse("bounds on colours and normals go with an error bound (--max-error)")
            }
            (None, _) => Ok(()),
            (Some(_), _) => refuse("only --method bounded keeps to an error bound (--max-error)"),
        };
    }
    match simplify.keep.max_error {
        Some(MaxError::Length(length)) if !(length >= 0.0 && length.is_finite()) => {
            return refuse("an error bound is a length, 0 or above");
        }
        Some(MaxError::Share(share)) if !(share >= 0.0 && share.is_finite()) => {
            return refuse("an error bound is a share of the diagonal, 0 or above");
        }
        Some(MaxError::Share(_)) if simplify.assume_sorted.is_some() => {
            return refuse(
                "how large the mesh is shows at the end of a single pass: give the error bound in \
                 model units",
            );
        }
        None if simplify.goal == Goal::Tolerance => {
            return refuse("an error bound (--max-error), a count or a ratio is needed");
        }
        _ => {}
    }
    if matches!(simplify.goal, Goal::Cells(_) | Goal::CellSize(_)) {
        return refuse("cells are a goal for clustering only");
    }
    let limits = [simplify.keep.limits.color, simplify.keep.limits.normal];
    if limits.iter().flatten().any(|limit| limit.is_nan() || *limit < 0.0) {
        return refuse("a bound on colours or normals is 0 or above");
    }
    if simplify.selection == super::Selection::MultipleChoice {
        return refuse("multiple choice in one pass keeps to no error bound");
    }
    Ok(())
}

/// Refuses what cannot fit.
pub(super) fn check_memory(
    simplify: &Simplify,
    triangles: u64,
    available_bytes: u64,
) -> Result<()> {
    let config = config(simplify, Some(triangles), SweepAxis::X, 0.0);
    let needed_bytes = config.memory_bytes::<ColoredPoint>();
    if needed_bytes <= available_bytes {
        return Ok(());
    }
    let what = if config.is_counted { bounded::WHOLE } else { bounded::SLAB };
    Err(Error::Resource { what, needed_bytes, available_bytes })
}

fn config(
    simplify: &Simplify,
    triangles: Option<u64>,
    axis: SweepAxis,
    tolerance: f64,
) -> bounded::Config {
    let Keep { fairing, update, sides, limits, .. } = simplify.keep;
    let wanted = triangles.and_then(|triangles| simplify.goal.triangles_wanted(triangles));
    let faces = wanted.map_or(0, |wanted| usize::try_from(wanted.max(1)).unwrap_or(usize::MAX));
    bounded::Config {
        axis,
        triangles,
        triangles_exact: None,
        bound: Bound { tolerance, fairing, update, sides, limits, faces },
        is_counted: simplify.goal != Goal::Tolerance,
        slab_triangles_min: bounded::SLAB_TRIANGLES_MIN,
    }
}

/// Adds decimation under a bound to a plan.
pub(super) fn plan(job: &Job, simplify: &Simplify, sizes: Sizes, plan: &mut Plan) -> Result<()> {
    if let Some(triangles) = plan.records {
        check_memory(simplify, triangles, job.memory_bytes)?;
    }
    if simplify.keep.limits.color.is_some() && !sizes.is_colored() {
        let text = "no input has vertex colours that a bound on them could keep to";
        return Err(Error::Request(text.to_owned()));
    }
    if simplify.keep.limits.color.is_some() && job.output_format == Format::Stl {
        let text = "stl has no colours that a bound on them could keep to";
        return Err(Error::Request(text.to_owned()));
    }
    let is_measured = simplify.assume_sorted.is_none();
    if is_measured && plan.vertices.is_some_and(|count| count > 0) {
        plan.stage(StageId::Measure, "measure how far the triangles are from sorted".to_owned());
    }
    plan.stage(StageId::Sort, "put the triangles in the order of a sweep".to_owned());
    let bound = match simplify.keep.max_error {
        None => "as little as the count takes".to_owned(),
        Some(MaxError::Length(length)) => format!("{length}"),
        Some(MaxError::Share(share)) => format!("{} % of the diagonal", 100.0 * share),
    };
    let fairing = simplify.keep.fairing_name();
    plan.stage(
        StageId::Decimate,
        format!("collapse edges by {fairing}, no vertex farther away than {bound}, slab by slab"),
    );
    plan.stage(StageId::Finish, "join the slabs, and finish what is between them".to_owned());
    if is_measured {
        let disk_bytes = presort::disk_bytes_per_triangle(sizes.is_colored());
        plan.add_temporary(plan.records.map(|count| count * disk_bytes));
        plan.notes.push("triangles that are nearly sorted are not sorted on disk".to_owned());
    }
    if simplify.goal != Goal::Tolerance {
        let note = "to stop at a count, all of the mesh is in memory at once, on one thread";
        plan.notes.push(note.to_owned());
    }
    Ok(())
}

impl Run<'_> {
    /// Decimates as far as an error bound allows, or to a count.
    pub(super) fn simplify_by_bound<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        simplify: &Simplify,
    ) -> Result<Report> {
        let import::Outcome { source, survey } = self.import_ordered::<V>(inputs, simplify)?;
        let axis = simplify.assume_sorted.unwrap_or(SweepAxis::ALL[survey.bounds.longest_axis()]);
        let order = match simplify.assume_sorted {
            Some(_) => None,
            None => Some(self.order_of(&source, &survey)?),
        };
        let counted = order.map(|order| order.triangles);
        let triangles = counted.or(source.records());
        let triangles_exact = counted.or(source.triangles());
        if triangles.is_none() && simplify.goal != Goal::Tolerance {
            return Err(count_unknown());
        }
        let diagonal = survey.bounds.diagonal();
        let tolerance = match simplify.keep.max_error {
            None => f64::INFINITY,
            Some(MaxError::Length(length)) => length,
            Some(MaxError::Share(share)) if diagonal.is_finite() => share * diagonal,
            Some(MaxError::Share(_)) => 0.0,
        };
        let config = config(simplify, triangles, axis, tolerance);
        let config = bounded::Config { triangles_exact, ..config };
        let displacement_max = order.map(|order| order.displacement_max[axis.index()]);
        let sort = self.order_config::<V>(axis, displacement_max);
        let mut sorted = None;
        let outcome = bounded::decimate(&config, self.workspace, self.monitor, |sink| {
            // The vertex table goes before the result needs its memory.
            let source: Source<V> = source;
            let _room = self.workspace.budget().reserve(sort.memory_bytes);
            let outcome = presort::presort(&source, &sort, self.workspace, self.monitor, sink)?;
            self.workspace.note(FED, &outcome, Vec::new())?;
            sorted = Some(outcome);
            Ok(())
        })?;
        let noted = || Some(self.workspace.recall(FED)?.figures);
        let sorted: presort::Outcome = sorted.or_else(noted).expect("decimation was fed");
        let mut report = report_input(&survey, sorted.triangles);
        report.method = Some(Method::Bounded.name());
        let wanted = simplify.goal.triangles_wanted(sorted.triangles);
        report.reached_target = wanted.map(|wanted| outcome.mesh.counts().triangles <= wanted);
        report.stopped_by = Some(match (report.reached_target, simplify.keep.max_error) {
            (Some(true), _) => "target",
            (_, Some(_)) => "error",
            (_, None) => "topology",
        });
        let bounded::Figures { degenerate, loose_vertices, split_vertices, complex_vertices } =
            outcome.figures;
        report.bounded = Some(BoundedReport {
            max_error: outcome.tolerance,
            max_error_share: (diagonal > 0.0).then_some(outcome.tolerance / diagonal),
            fairing: simplify.keep.fairing_name(),
            axis: axis.name(),
            displacement_max: displacement_max.or(sorted.displacement_max),
            sorted_on_disk: sorted.on_disk,
            slabs: outcome.slabs,
            degenerate,
            loose_vertices,
            split_vertices,
            complex_vertices,
        });
        self.export_mesh(outcome.mesh, &survey, &sorted.findings, &mut report)?;
        Ok(report)
    }

    /// How the stream is put in order.
    fn order_config<V: Vertex>(
        &self,
        axis: SweepAxis,
        displacement_max: Option<u64>,
    ) -> presort::Config {
        let available = self.workspace.budget().available_bytes();
        let in_passing = sort_config::<V>(axis, displacement_max, available / ORDER_SHARE);
        if in_passing.method != presort::Method::Sort {
            return in_passing;
        }
        sort_config::<V>(axis, displacement_max, available / SORT_SHARE)
    }
}
