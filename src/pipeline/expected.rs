//! What a job will take, about: time and memory, from its plan and the speed of the machine.
//!
//! The figures are from a 2-core Xeon: nanoseconds of processor time by stage, on one thread and on
//! two, of a gyroid of 10 M triangles (`--report` has what each run took). They are good for plans,
//! not for promises; how far off they were is in the report of each run.

use super::{
    Job, Method, Metric, Plan, Simplify, Task, decimation, hybrid,
    machine::Machine,
    plan::{CLUSTER_BYTES_PER_CELL, Sizes},
    progressive,
    streaming::WINDOW_TRIANGLES,
};
use crate::progress::StageId;

/// Seconds more where the triangles turn out to be scattered.
pub(super) fn unsorted_seconds(job: &Job, plan: &Plan, machine: Machine) -> f64 {
    let triangles = plan.records.filter(|_| plan.unsorted_bytes > 0);
    time((triangles.unwrap_or(0), SORT), 0, (job.threads, machine))
}

/// Nanoseconds a record takes in a stage: on any number of threads, and besides, shared by them.
#[derive(Clone, Copy)]
struct Cost {
    serial: f64,
    shared: f64,
}

const fn cost(serial: f64, shared: f64) -> Cost {
    Cost { serial, shared }
}

/// A vertex of an indexed mesh read into memory.
const READ_VERTEX: Cost = cost(45.0, 0.0);
/// A triangle of a soup measured, or set aside.
const READ_TRIANGLE: Cost = cost(10.0, 80.0);
/// A face looked at for its order.
const MEASURE: Cost = cost(24.0, 25.0);
/// A triangle sorted on disk: written, read, and sorted in between.
const SORT: Cost = cost(160.0, 120.0);
/// A triangle decimated in slabs, by quadrics and by volumes.
const QUADRIC: Cost = cost(30.0, 560.0);
const VOLUME: Cost = cost(60.0, 940.0);
/// The same under an error bound: a gyroid of 1 M triangles within 0.02 to 0.5 % took 2.1 to 2.9 s on one
/// thread; more by angles, and where much is refused.
const BOUNDED: Cost = cost(30.0, 2500.0);
/// A triangle passed through the window of multiple choice.
const WINDOW: Cost = cost(1250.0, 250.0);
/// A triangle of the result, for the last mesh, by quadrics and by volumes.
const FINISH: Cost = cost(950.0, 0.0);
const FINISH_VOLUME: Cost = cost(1500.0, 0.0);
/// A triangle that clustering left, for the exact count.
const FINISH_CLUSTERED: Cost = cost(650.0, 0.0);
/// A triangle summed into its cells, and one of the result made of them.
const CLUSTER: Cost = cost(20.0, 70.0);
const ASSEMBLE: Cost = cost(60.0, 0.0);
/// A triangle that becomes progressive: recorded, and turned round, measured and packed.
const RECORD: Cost = cost(2200.0, 1600.0);
const ENCODE: Cost = cost(700.0, 1300.0);
/// A triangle welded in memory and on disk.
const WELD: Cost = cost(200.0, 100.0);
const WELD_ON_DISK: Cost = cost(800.0, 50.0);
/// A triangle of the input measured against the result, with its samples.
const COMPARE: Cost = cost(200.0, 1600.0);
/// A triangle written as it is, and one of an indexed mesh with its share of the vertices.
const WRITE_SOUP: Cost = cost(90.0, 0.0);
const WRITE_INDEXED: Cost = cost(35.0, 0.0);

/// Seconds by stage, in the order of the plan; empty when nobody knows how much there is to do.
pub(super) fn seconds(
    job: &Job,
    plan: &Plan,
    input_bytes: Option<u64>,
    machine: Machine,
) -> Vec<(StageId, f64)> {
    let Some(triangles) = plan.records.or(plan.vertices.map(|count| 2 * count)) else {
        return Vec::new();
    };
    let wanted = match &job.task {
        Task::Simplify(simplify) => simplify.goal.triangles_wanted(triangles).unwrap_or(triangles),
        Task::Soup | Task::Sort(_) | Task::Weld => triangles,
    };
    let vertices = plan.vertices.unwrap_or(0);
    let costs = plan.stages.iter().map(|planned| {
        let work = match planned.stage {
            StageId::Import if vertices > 0 => (vertices, READ_VERTEX),
            StageId::Import => (triangles, READ_TRIANGLE),
            StageId::Measure => (triangles, MEASURE),
            // In passing, or not known to be needed.
            StageId::Sort if plan.temporary_bytes.is_some_and(|b| b <= plan.unsorted_bytes) => {
                (0, SORT)
            }
            StageId::Sort => (triangles, SORT),
            StageId::Compare => (triangles, COMPARE),
            StageId::Decimate => (triangles, decimate(&job.task)),
            StageId::Finish => finish(&job.task, wanted),
            StageId::Cluster => (triangles, CLUSTER),
            StageId::Assemble => (wanted, ASSEMBLE),
            StageId::Record => (wanted, RECORD),
            StageId::Encode => (wanted, ENCODE),
            StageId::Weld if plan.temporary_bytes == Some(0) => (triangles, WELD),
            StageId::Weld => (triangles, WELD_ON_DISK),
            StageId::Export if job.output_format.is_indexed() => (wanted, WRITE_INDEXED),
            StageId::Export => (wanted, WRITE_SOUP),
            _ => (0, cost(0.0, 0.0)),
        };
        let reads = matches!(
            planned.stage,
            StageId::Import | StageId::Measure | StageId::Decimate | StageId::Cluster
        );
        let bytes = input_bytes.filter(|_| reads).unwrap_or(0);
        (planned.stage, time(work, bytes, (job.threads, machine)))
    });
    costs.collect()
}

/// Seconds of a pass: of its work, or of what it reads if that takes longer.
fn time((records, cost): (u64, Cost), bytes: u64, (threads, machine): (usize, Machine)) -> f64 {
    let nanoseconds = cost.serial + cost.shared / threads as f64;
    let work = records as f64 * nanoseconds * 1e-9 * machine.slowness;
    work.max(machine.read_rate.map_or(0.0, |rate| bytes as f64 / rate))
}

fn decimate(task: &Task) -> Cost {
    match task {
        Task::Simplify(simplify) if simplify.is_streaming() => WINDOW,
        Task::Simplify(simplify) if simplify.is_bounded() => BOUNDED,
        Task::Simplify(Simplify { metric: Metric::Volume, .. }) => VOLUME,
        _ => QUADRIC,
    }
}

fn finish(task: &Task, wanted: u64) -> (u64, Cost) {
    match task {
        Task::Simplify(Simplify { method: Method::Hybrid, .. }) => {
            (wanted * hybrid::FACTOR, FINISH_CLUSTERED)
        }
        Task::Simplify(Simplify { metric: Metric::Volume, .. }) => (wanted, FINISH_VOLUME),
        _ => (wanted, FINISH),
    }
}

/// What a process takes before it has anything to do, and its buffers once they are full.
const BASE_BYTES: u64 = 20 << 20;
const BUFFER_BYTES: u64 = 12 << 20;
/// Triangles that fill all buffers.
const FULL_TRIANGLES: u64 = 1 << 20;
/// Bytes a triangle in the window of multiple choice takes, and one that is welded in memory.
const WINDOW_BYTES: u64 = 80;
/// Bytes of what waits to be put in order in passing, for each of the square root of all triangles.
const FRONT_BYTES: u64 = 4000;
const WELD_BYTES: u64 = 24;
/// What structures take is multiplied by this: batches, the allocator's slack, and joins beside slabs.
/// Chosen so that no run of `scripts/bench.py` takes more.
const SLACK: f64 = 1.15;

/// Bytes of memory the job takes at its peak, about; never more than its limit.
pub(super) fn memory_bytes(job: &Job, plan: &Plan, sizes: Sizes) -> u64 {
    let triangles = plan.records.or(plan.vertices.map(|count| 2 * count));
    let limit_bytes = plan.memory_bytes;
    let Some(triangles) = triangles else { return limit_bytes };
    let table_bytes = plan.vertices.unwrap_or(0) * sizes.vertex;
    let share = (job.memory_bytes as f64 * job.table_share()) as u64;
    let table_bytes = if table_bytes <= share { table_bytes } else { 0 };
    let room = job.memory_bytes.saturating_sub(table_bytes);
    let works_in = match &job.task {
        Task::Soup => 0,
        // More is for the report, once it is known that it was needed.
        Task::Sort(_) if plan.unsorted_bytes > 0 => room.min(triangles.isqrt() * FRONT_BYTES),
        Task::Sort(_) => room.min(triangles * 2 * (sizes.triangle + 4)),
        Task::Weld if plan.temporary_bytes == Some(0) => room.min(triangles * WELD_BYTES),
        Task::Weld => room,
        Task::Simplify(simplify) if simplify.is_streaming() => {
            room.min(triangles.min(WINDOW_TRIANGLES as u64) * WINDOW_BYTES)
        }
        Task::Simplify(simplify) if simplify.begins_with_cells() => {
            let factor = if simplify.is_clustering() { 1 } else { hybrid::FACTOR };
            let wanted = simplify.goal.triangles_wanted(triangles).unwrap_or(triangles);
            room.min(wanted.saturating_mul(factor) / 2 * CLUSTER_BYTES_PER_CELL)
        }
        Task::Simplify(simplify) => decimation::expected_bytes(job, simplify, triangles).min(room),
    };
    let works_in = works_in.max(progressive::expected_bytes(job, plan, sizes));
    let structures = ((table_bytes + works_in) as f64 * SLACK) as u64;
    let buffers = if triangles < FULL_TRIANGLES { 0 } else { BUFFER_BYTES };
    (BASE_BYTES + buffers + structures).min(limit_bytes)
}
