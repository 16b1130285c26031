//! Combines records of equal key from several sorted runs: a merge that sums.
//!
//! The sum must not depend on the order of its terms (integers, not floating point): that is what
//! makes the result the same for any number of runs.

use super::{
    Keyed,
    merge::{FileBlocks, Shape, merge_blocks, narrow_runs},
};
use crate::{
    error::Result,
    progress::{Meter, Monitor, StageId},
    storage::{RecordFile, Workspace},
};

/// What a reduction may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Stage that progress is reported for.
    pub stage: StageId,
    /// Bytes of memory to hold, reserved by the caller.
    pub memory_bytes: u64,
}

/// Merges `runs`, each sorted by key, and passes one record per key to `sink`, in batches, in
/// order of the keys. `combine(sum, record)` adds a record to another of the same key.
///
/// One pass over the records when there are no more runs than memory has blocks for (a quarter
/// of it in blocks of 128 KiB) and the process may open; further passes on disk otherwise. The
/// runs are removed as they are used up.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Damaged`] when a run is not as it was written,
/// [`crate::Error::Cancelled`], and what `sink` returns.
pub fn reduce<R: Keyed>(
    runs: Vec<RecordFile<R>>,
    combine: impl Fn(&mut R, &R) + Sync,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor<'_>,
    mut sink: impl FnMut(&[R]) -> Result<()>,
) -> Result<()> {
    let shape = Shape::within::<R>(config.memory_bytes);
    let meter = |runs: &[RecordFile<R>]| {
        monitor.meter_of::<R>(config.stage, runs.iter().map(RecordFile::count).sum())
    };
    let runs = narrow_runs(runs, &shape, workspace, |group, writer| {
        let meter = meter(&group);
        reduce_once(group, &combine, &shape, meter, |records| writer.extend(records))
    })?;
    let meter = meter(&runs);
    reduce_once(runs, &combine, &shape, meter, &mut sink)
}

fn reduce_once<R: Keyed>(
    runs: Vec<RecordFile<R>>,
    combine: impl Fn(&mut R, &R) + Sync,
    shape: &Shape,
    meter: Meter<'_>,
    mut sink: impl FnMut(&[R]) -> Result<()>,
) -> Result<()> {
    let mut blocks = FileBlocks::open(runs, shape.block_records)?;
    // The last sum of a batch waits: the next batch may begin with its key.
    let mut waiting: Option<R> = None;
    let work = |records: &mut Vec<R>| {
        meter.add(records.len() as u64)?;
        combine_neighbours(records, &combine);
        Ok(())
    };
    merge_blocks(
        shape,
        || blocks.next(),
        work,
        |mut records| {
            if let Some(sum) = &mut waiting {
                if sum.key() == records[0].key() {
                    combine(sum, &records[0]);
                    records = &records[1..];
                }
                if records.is_empty() {
                    return Ok(());
                }
                sink(std::slice::from_ref(sum))?;
            }
            let (last, records) = records.split_last().expect("batches are not empty");
            waiting = Some(*last);
            if records.is_empty() { Ok(()) } else { sink(records) }
        },
    )?;
    if let Some(sum) = waiting {
        sink(&[sum])?;
    }
    meter.finish();
    Ok(())
}

/// Leaves one record for each stretch of equal keys.
fn combine_neighbours<R: Keyed>(records: &mut Vec<R>, combine: impl Fn(&mut R, &R)) {
    let mut sums = 0;
    for i in 1..records.len() {
        let record = records[i];
        if records[sums].key() == record.key() {
            combine(&mut records[sums], &record);
        } else {
            sums += 1;
            records[sums] = record;
        }
    }
    records.truncate(sums + 1);
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;
    use crate::{
        Error,
        external::testing::{Item, file_of, files_left, items},
    };

    const STAGE: StageId = StageId::Cluster;

    fn add(sum: &mut Item, item: &Item) {
        sum.weight += item.weight;
        sum.place = sum.place.min(item.place);
    }

    fn runs_of(workspace: &Workspace, runs: &[Vec<u64>]) -> Vec<RecordFile<Item>> {
        let sorted = runs.iter().map(|keys| {
            let mut items = items(keys.iter().copied());
            items.sort_by_key(Keyed::key);
            file_of(workspace, &items)
        });
        sorted.collect()
    }

    fn oracle(runs: &[Vec<u64>]) -> Vec<Item> {
        let mut sums = BTreeMap::new();
        for item in runs.iter().flat_map(|keys| items(keys.iter().copied())) {
            let zero = Item { weight: 0, ..item };
            add(sums.entry(item.key).or_insert(zero), &item);
        }
        sums.into_values().collect()
    }

    fn reduced(runs: &[Vec<u64>], memory_bytes: u64) -> Vec<Item> {
        let workspace = Workspace::for_test();
        let files = runs_of(&workspace, runs);
        let config = Config { stage: STAGE, memory_bytes };
        let mut found = Vec::new();
        reduce(files, add, &config, &workspace, &Monitor::silent(), |records| {
            assert!(!records.is_empty());
            found.extend_from_slice(records);
            Ok(())
        })
        .unwrap();
        assert_eq!((files_left(&workspace), workspace.disk_bytes()), (0, 0));
        found
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn any_runs_are_summed_as_a_map_would(
            runs in prop::collection::vec(prop::collection::vec(0_u64..300, 0..300), 0..8)
        ) {
            let expected = oracle(&runs);
            for memory_bytes in [0, 3000, 1 << 22] {
                prop_assert_eq!(&reduced(&runs, memory_bytes), &expected);
            }
        }
    }

    #[test]
    fn every_shape_of_runs_is_summed_as_a_map_would() {
        let n = 20_000;
        let shapes: [Vec<Vec<u64>>; 5] = [
            vec![vec![5; 3000]; 9],
            vec![(0..n).collect(), vec![n / 2]],
            (0..20).map(|run| (run * 500..run * 500 + 700).collect()).collect(),
            (0..3).map(|run| (0..n).map(|i| i * 3 + run).collect()).collect(),
            vec![vec![u64::MAX; 10], vec![0, u64::MAX]],
        ];
        for runs in &shapes {
            let expected = oracle(runs);
            for memory_bytes in [0, 20_000, 1 << 24] {
                assert!(reduced(runs, memory_bytes) == expected, "{memory_bytes}");
            }
        }
    }

    #[test]
    fn a_cancelled_reduction_leaves_nothing() {
        for memory_bytes in [1000, 1 << 22] {
            let workspace = Workspace::for_test();
            let files = runs_of(&workspace, &vec![(0..5000).collect(); 6]);
            let config = Config { stage: STAGE, memory_bytes };
            let monitor = Monitor::silent();
            monitor.cancel.raise();
            let outcome = reduce(files, add, &config, &workspace, &monitor, |_| Ok(()));
            assert!(matches!(outcome, Err(Error::Cancelled(_))));
            assert_eq!((files_left(&workspace), workspace.disk_bytes()), (0, 0));
        }
    }
}
