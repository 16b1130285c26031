//! Faults made on purpose, for tests: any call of [`super::system`] can be made to fail. Only in
//! builds with debug assertions; in others it all folds to nothing.

use std::{
    io,
    sync::{Mutex, PoisonError},
};

/// What is done to which call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Plan {
    /// The n-th call of a kind fails; one that writes writes half before.
    Fail(Call, u64),
    /// The disk is full after so many bytes.
    Full(u64),
    /// The n-th write that may be short is.
    Short(u64),
    /// The n-th write to a temporary file goes wrong by one bit and says nothing.
    Flip(u64),
}

/// A kind of call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Call {
    Create,
    Open,
    Read,
    Write,
    Allocate,
    SetLength,
    Sync,
    Rename,
}

/// What becomes of a call.
#[derive(Debug)]
pub(super) enum Fate {
    /// Nothing special.
    Done,
    /// So many of its bytes are written, and then it fails.
    Fails(usize, io::Error),
    /// So many of its bytes are written, and that is no fault.
    Short(usize),
    /// One bit in the middle of its bytes is not what it should be.
    Flipped,
}

static PLAN: Mutex<Option<(Plan, u64)>> = Mutex::new(None);

/// Plans a fault, by a text: `create:N`, `open:N`, `read:N`, `write:N`, `allocate:N`, `set-length:N`,
/// `sync:N` and `rename:N` have the N-th such call of the process fail, counted from 0; `full:N` the
/// disk be full after N bytes; `short:N` the N-th write to an output be short; `flip:N` the N-th write
/// to a temporary file go wrong by a bit. `false` if the text is none of these, or this build makes no
/// faults.
#[must_use]
pub fn plan_fault(text: &str) -> bool {
    let Some((kind, n)) = text.split_once(':').filter(|_| cfg!(debug_assertions)) else {
        return false;
    };
    let Ok(n) = n.parse() else { return false };
    let plan = match kind {
        "create" => Plan::Fail(Call::Create, n),
        "open" => Plan::Fail(Call::Open, n),
        "read" => Plan::Fail(Call::Read, n),
        "write" => Plan::Fail(Call::Write, n),
        "allocate" => Plan::Fail(Call::Allocate, n),
        "set-length" => Plan::Fail(Call::SetLength, n),
        "sync" => Plan::Fail(Call::Sync, n),
        "rename" => Plan::Fail(Call::Rename, n),
        "full" => Plan::Full(n),
        "short" => Plan::Short(n),
        "flip" => Plan::Flip(n),
        _ => return false,
    };
    *PLAN.lock().unwrap_or_else(PoisonError::into_inner) = Some((plan, 0));
    true
}

/// What becomes of this call, of so many bytes; of one that writes to an output it is said so.
pub(super) fn fate(call: Call, bytes: usize, is_output: bool) -> Fate {
    if !cfg!(debug_assertions) {
        return Fate::Done;
    }
    let mut planned = PLAN.lock().unwrap_or_else(PoisonError::into_inner);
    let Some((plan, seen)) = &mut *planned else { return Fate::Done };
    let mut is_turn = |n: u64| {
        *seen += 1;
        *seen == n + 1
    };
    match *plan {
        Plan::Fail(kind, n) if kind == call && is_turn(n) => {
            let full = io::ErrorKind::StorageFull.into();
            let error =
                if kind == Call::Allocate { full } else { io::Error::from_raw_os_error(EIO) };
            Fate::Fails(bytes / 2, error)
        }
        Plan::Short(n) if call == Call::Write && is_output && bytes > 1 && is_turn(n) => {
            Fate::Short(bytes / 2)
        }
        Plan::Flip(n) if call == Call::Write && !is_output && bytes > 0 && is_turn(n) => {
            Fate::Flipped
        }
        Plan::Full(limit) if matches!(call, Call::Write | Call::Allocate) => {
            let left = limit.saturating_sub(*seen);
            if bytes as u64 > left {
                return Fate::Fails(left as usize, io::ErrorKind::StorageFull.into());
            }
            // What is allocated is counted when it is written.
            *seen += if call == Call::Write { bytes as u64 } else { 0 };
            Fate::Done
        }
        _ => Fate::Done,
    }
}

/// The system's word for a disk that fails.
const EIO: i32 = 5;
