//! Each trap of the `extsort` crate, shown in the crate itself, and that our guard holds.

use std::{fs, os::unix::fs::FileExt as _, path::Path};

use super::*;
use crate::{
    external::testing::{Item, files_left, items},
    progress::StageId,
};

/// The crate as it is: single records of eight bytes, no guard.
fn plain(folder: &Path, segment_size: usize, keys: impl Iterator<Item = u64>) -> Vec<u64> {
    values(plain_sorter(folder, segment_size, keys))
}

fn plain_sorter(
    folder: &Path,
    segment_size: usize,
    keys: impl Iterator<Item = u64>,
) -> PlainSorter {
    let mut sorter = ExternalSorter::new()
        .with_segment_size(segment_size)
        .with_sort_dir(folder.to_owned())
        // Only the upper half is the key; the lower half tells equal keys apart.
        .pushed_by((|a, b| (a.0 >> 32).cmp(&(b.0 >> 32))) as fn(&Plain, &Plain) -> Ordering);
    sorter.push_iter(keys.map(Plain)).unwrap();
    sorter
}

type PlainSorter = PushExternalSorter<Plain, fn(&Plain, &Plain) -> Ordering>;

fn values(sorter: PlainSorter) -> Vec<u64> {
    sorter.done().unwrap().map(|plain| plain.unwrap().0).collect()
}

/// A record of the crate without any guard.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Plain(u64);

impl Sortable for Plain {
    fn encode<W: Write>(&self, writer: &mut W) -> io::Result<()> {
        writer.write_all(self.0.as_bytes())
    }

    fn decode<Source: Read>(reader: &mut Source) -> io::Result<Self> {
        let mut value = 0;
        reader.read_exact(value.as_mut_bytes())?;
        Ok(Self(value))
    }
}

const BLOCK_RECORDS: usize = 10;

fn group(workspace: &Workspace, runs: &[Vec<Item>]) -> Group<Item> {
    let blocks = runs[0].len().div_ceil(BLOCK_RECORDS);
    let mut group = Group::new(workspace, blocks).unwrap();
    for run in runs {
        group.push_run(run.clone(), BLOCK_RECORDS).unwrap();
    }
    group
}

fn merged(group: Group<Item>) -> Result<Vec<Item>> {
    let mut found = Vec::new();
    let shape = Shape::within::<Item>(100_000);
    let monitor = Monitor::silent();
    let meter = monitor.meter(StageId::Sort, Some(group.records));
    group.merge_into(&shape, meter, |records| {
        found.extend_from_slice(records);
        Ok(())
    })?;
    Ok(found)
}

/// `count` runs of `blocks` full blocks each, which overlap.
fn runs(count: u64, blocks: u64) -> Vec<Vec<Item>> {
    let n = blocks * BLOCK_RECORDS as u64;
    (0..count).map(|run| items((0..n).map(|i| (i * count + run) / 3))).collect()
}

fn oracle(runs: &[Vec<Item>]) -> Vec<Item> {
    let mut all = runs.concat();
    all.sort_by_key(Keyed::key);
    all
}

fn is_damaged<T>(outcome: &Result<T>) -> bool {
    matches!(outcome, Err(Error::Damaged { .. }))
}

#[test]
fn trap_a_last_push_that_writes_a_segment_loses_everything() {
    let workspace = Workspace::for_test();
    let folder = ForeignFolder::create(&workspace, "plain-").unwrap();
    assert!(plain(folder.path(), 9, 0..20).is_empty(), "20 records in, none out");
    assert_eq!(plain(folder.path(), 9, 0..21).len(), 21);

    for count in [1, 2, 5] {
        let runs = runs(count, 4);
        let mut group = group(&workspace, &runs);
        assert_eq!(group.blocks % group.blocks_per_segment, 0);
        group.push_sentinel_if_needed().unwrap();
        assert_eq!(group.blocks, count * 4 + 1, "exactly one");
        group.push_sentinel_if_needed().unwrap();
        assert_eq!(group.blocks, count * 4 + 1, "not needed any more");
        assert!(merged(group).unwrap() == oracle(&runs));
    }
}

#[test]
fn trap_segments_of_one_item_always_lose_everything() {
    let workspace = Workspace::for_test();
    let folder = ForeignFolder::create(&workspace, "plain-").unwrap();
    for count in 1..5 {
        assert!(plain(folder.path(), 0, 0..count).is_empty());
        let runs = vec![items([3]); count as usize];
        assert!(merged(group(&workspace, &runs)).unwrap() == oracle(&runs));
    }
}

#[test]
fn trap_two_sorters_in_one_folder_overwrite_each_other() {
    let workspace = Workspace::for_test();
    let folder = ForeignFolder::create(&workspace, "plain-").unwrap();
    let first = plain_sorter(folder.path(), 9, (0..25).map(|i| i << 32));
    let second = plain_sorter(folder.path(), 9, (1000..1025).map(|i| i << 32));
    let found = values(first);
    assert_ne!(
        found,
        (0..25).map(|i| i << 32).collect::<Vec<_>>(),
        "these are partly the second one's"
    );
    drop(second);

    let (a, b) = (runs(3, 4), runs(5, 3));
    let (first, second) = (group(&workspace, &a), group(&workspace, &b));
    assert_ne!(first.folder.path(), second.folder.path());
    assert!(merged(first).unwrap() == oracle(&a));
    assert!(merged(second).unwrap() == oracle(&b));
}

#[test]
fn trap_a_torn_segment_is_merely_shorter() {
    let workspace = Workspace::for_test();
    let folder = ForeignFolder::create(&workspace, "plain-").unwrap();
    let sorter = plain_sorter(folder.path(), 9, (0..25).map(|i| i << 32));
    truncate(&folder.path().join("0"), 43);
    let found = values(sorter);
    assert_eq!(found.len(), 20, "five of the first segment's ten are left, and no error");

    let block_bytes = size_of::<StoredHeader>() + BLOCK_RECORDS * size_of::<Item>();
    // Inside records, between blocks, inside a header, everything.
    for bytes in [block_bytes + 99, 2 * block_bytes, 3 * block_bytes + 5, 0] {
        let torn = group(&workspace, &runs(3, 4));
        truncate(&torn.folder.path().join("1"), bytes as u64);
        let outcome = merged(torn);
        assert!(is_damaged(&outcome), "{bytes}");
    }
    assert_eq!(files_left(&workspace), 1, "the plain one's folder");
}

fn truncate(path: &Path, bytes: u64) {
    fs::OpenOptions::new().write(true).open(path).unwrap().set_len(bytes).unwrap();
}

#[test]
fn trap_a_changed_byte_goes_unnoticed() {
    let workspace = Workspace::for_test();
    let folder = ForeignFolder::create(&workspace, "plain-").unwrap();
    let sorter = plain_sorter(folder.path(), 9, (0..25).map(|i| i << 32));
    change(&folder.path().join("0"), 8);
    assert_eq!(values(sorter).iter().filter(|key| **key & 255 == 255).count(), 1, "no error");

    let block_bytes = size_of::<StoredHeader>() + BLOCK_RECORDS * size_of::<Item>();
    for at in [0, 8, 11, 12, 40, block_bytes + 3, 4 * block_bytes - 1] {
        let changed = group(&workspace, &runs(3, 4));
        change(&changed.folder.path().join("1"), at as u64);
        assert!(is_damaged(&merged(changed)), "{at}");
    }
}

fn change(path: &Path, at: u64) {
    let file = fs::OpenOptions::new().read(true).write(true).open(path).unwrap();
    let mut byte = [0];
    file.read_exact_at(&mut byte, at).unwrap();
    file.write_all_at(&[!byte[0]], at).unwrap();
}

#[test]
fn trap_a_given_folder_is_never_cleaned_up() {
    let workspace = Workspace::for_test();
    let folder = ForeignFolder::create(&workspace, "plain-").unwrap();
    plain(folder.path(), 9, 0..25);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    drop(folder);

    drop(group(&workspace, &runs(3, 4)));
    merged(group(&workspace, &runs(3, 4))).unwrap();
    assert_eq!((files_left(&workspace), workspace.disk_bytes()), (0, 0));
    assert!(workspace.disk_bytes_peak() >= 3 * 40 * size_of::<Item>() as u64);
}

#[test]
fn trap_the_order_of_equal_keys_depends_on_the_segment_size() {
    let workspace = Workspace::for_test();
    let sorted = |segment_size| {
        let folder = ForeignFolder::create(&workspace, "plain-").unwrap();
        plain(folder.path(), segment_size, (0..1000).map(|i| ((i % 3) << 32) | i))
    };
    let stable = |found: &[u64]| found.is_sorted();
    assert!(!(stable(&sorted(99)) && stable(&sorted(700))), "one of them is not in order");

    let keys: Vec<Vec<Item>> = (0..12_u64)
        .map(|run| (0..50).map(|i| Item { key: i / 20, place: run * 50 + i, weight: 0 }).collect())
        .collect();
    let found = merged(group(&workspace, &keys)).unwrap();
    assert!(found.is_sorted_by_key(|item| (item.key, item.place)));
}

#[test]
fn trap_many_segments_are_read_far_ahead() {
    // Through the crate's heap, 20 blocks of each of 20 segments and more would be in memory.
    let workspace = Workspace::for_test();
    let runs = runs(30, 25);
    let group = group(&workspace, &runs);
    let sorted = group.sorter.done().unwrap();
    assert_eq!(sorted.disk_segment_count(), 30);
    let read_ahead = open_segments_position(group.folder.path());
    assert!(read_ahead < 5 * 10_000, "{read_ahead} bytes were read before the first block");
}

/// Bytes this process has read of the files in `folder`, by the positions of its handles.
fn open_segments_position(folder: &Path) -> u64 {
    let handles = fs::read_dir("/proc/self/fd").unwrap().flatten();
    let ours = handles.filter(|handle| {
        fs::read_link(handle.path()).is_ok_and(|target| target.starts_with(folder))
    });
    let positions = ours.map(|handle| {
        let name = handle.file_name().into_string().unwrap();
        let info = fs::read_to_string(format!("/proc/self/fdinfo/{name}")).unwrap();
        let position = info.split_whitespace().nth(1).unwrap();
        position.parse::<u64>().unwrap()
    });
    positions.sum()
}
