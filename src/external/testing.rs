//! A record whose payload tells equal keys apart, and what every test of this folder asks.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use super::Keyed;
use crate::storage::{Record, RecordFile, RecordWriter, Workspace};

/// A key, and the place of the record in the input.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
pub(super) struct Item {
    pub(super) key: u64,
    pub(super) place: u64,
    pub(super) weight: u64,
}

impl Record for Item {
    const KIND: [u8; 4] = *b"ITEM";
}

impl Keyed for Item {
    type Key = u64;

    fn key(&self) -> u64 {
        self.key
    }
}

pub(super) fn items(keys: impl IntoIterator<Item = u64>) -> Vec<Item> {
    (0..).zip(keys).map(|(place, key)| Item { key, place, weight: place % 7 }).collect()
}

pub(super) fn file_of<R: Record>(workspace: &Workspace, records: &[R]) -> RecordFile<R> {
    let mut writer = RecordWriter::create(workspace, "input", None).unwrap();
    writer.extend(records).unwrap();
    writer.finish().unwrap()
}

/// Files in the workspace beside its lock.
pub(super) fn files_left(workspace: &Workspace) -> usize {
    std::fs::read_dir(workspace.path()).unwrap().count() - 1
}
