//! By what triangles become fewer, where the job leaves that open: from what slabs of the mesh
//! would need, and the memory there is.
//!
//! The choice depends on the inputs, the goal and the memory, never on threads.

use std::fmt;

use super::{Goal, Job, Method, Simplify, Task, decimation, hybrid};
use crate::error::{Error, Result};

/// A method, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The method; [`Method::Auto`] while it is open.
    pub method: Method,
    /// Why; `None` where it was asked for.
    pub reason: Option<String>,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self.method {
            Method::Auto => "stream or hybrid",
            method => method.name(),
        };
        match &self.reason {
            Some(reason) => write!(f, "{name}: {reason}"),
            None => f.write_str(name),
        }
    }
}

/// What [`Error::Resource`] names when nothing fits but clustering.
const DECIMATION: &str = "edge collapse to so many triangles";

/// The job with its method chosen, as far as it can be; `triangles` of the inputs, if known. No
/// choice where nothing is simplified.
///
/// # Errors
/// [`Error::Resource`] when no method suffices.
pub(super) fn choose(job: &Job, triangles: Option<u64>) -> Result<(Job, Option<Choice>)> {
    let Task::Simplify(simplify) = &job.task else { return Ok((job.clone(), None)) };
    let (method, reason) = match simplify.method {
        Method::Auto => chosen(simplify, triangles, job.memory_bytes)?,
        Method::Hybrid => {
            hybrid::check_memory(simplify, triangles, job.memory_bytes)?;
            (Method::Hybrid, None)
        }
        method => (method, None),
    };
    let task = Task::Simplify(Simplify { method, ..simplify.clone() });
    let job = Job { task, ..job.clone() };
    Ok((job, Some(Choice { method, reason })))
}

fn chosen(
    simplify: &Simplify,
    triangles: Option<u64>,
    memory_bytes: u64,
) -> Result<(Method, Option<String>)> {
    let size = |bytes: u64| bytesize::ByteSize(bytes).to_string();
    if matches!(simplify.goal, Goal::Cells(_) | Goal::CellSize(_)) {
        return Ok((Method::Cluster, Some("the goal is given in cells".to_owned())));
    }
    if simplify.keep.max_error.is_some() {
        return Ok((Method::Bounded, Some("there is an error bound to keep to".to_owned())));
    }
    if simplify.is_streaming() {
        return Ok((Method::Stream, Some("a single pass".to_owned())));
    }
    if simplify.assume_sorted.is_some() {
        return Ok((Method::Stream, Some("the order is promised".to_owned())));
    }
    let Some(triangles) = triangles else {
        let reason = format!(
            "clustering first if slabs turn out to need more than {}; how many triangles there are \
             shows on reading",
            size(memory_bytes)
        );
        return Ok((Method::Auto, Some(reason)));
    };
    let slabs_bytes = decimation::memory_bytes(simplify, triangles);
    let needed = format!("slabs of {triangles} triangles need {}", size(slabs_bytes));
    if slabs_bytes <= memory_bytes {
        return Ok((Method::Stream, Some(format!("{needed} of {}", size(memory_bytes)))));
    }
    let needed_bytes = slabs_bytes.min(hybrid::memory_bytes(simplify, triangles));
    if needed_bytes > memory_bytes {
        return Err(Error::Resource {
            what: DECIMATION,
            needed_bytes,
            available_bytes: memory_bytes,
        });
    }
    let reason = format!("{needed}, there are {}: clustering first", size(memory_bytes));
    Ok((Method::Hybrid, Some(reason)))
}
