//! A pass whose batches are worked on by all threads and handed over in order.

use std::{
    collections::BTreeMap,
    panic::{self, AssertUnwindSafe},
    sync::{Mutex, PoisonError, mpsc},
};

use super::{Pass, Scratch, Source, Taken, Vertex};
use crate::{error::Result, formats::Findings, progress::Meter, storage::Budget};

/// A batch that was worked on.
struct Done<T> {
    made: T,
    /// Its first record and the first one after it; `None` at the end of the pass.
    read: Result<Option<(u64, u64)>>,
}

/// Passes over `source`: `work` makes something of each batch on any thread of the current pool,
/// `take` gets what was made, in order, on the calling thread, while the next batches are worked
/// on. What was made is handed to `work` again for another batch, so that its memory is reused.
///
/// Memory: for each of [`Budget::threads`] two of what is made, and one [`Scratch`]. Returns what
/// the pass found.
///
/// # Errors
/// What reading the source fails with, what `take` returns, cancellation.
pub fn for_each_in_order<V: Vertex, T: Default + Send>(
    source: &Source<V>,
    meter: &Meter<'_>,
    budget: &Budget,
    work: impl Fn(&Taken<'_, V>, &mut T) + Sync,
    mut take: impl FnMut(&mut T) -> Result<()>,
) -> Result<Findings> {
    let pass = source.pass();
    let desk = Desk { pass: &pass, meter, scratches: Mutex::default(), work: &work };
    let (done, received) = mpsc::channel::<Option<Done<T>>>();
    // One is with `take`.
    let others_max = 2 * budget.threads() - 1;
    let mut spare: Vec<T> = Vec::new();
    // What has come before its turn, by its first record, with the first record after it.
    let mut early: BTreeMap<u64, (u64, T)> = BTreeMap::new();
    let (mut turn, mut under_way, mut is_at_end) = (0, 0, false);
    // The scope's own body stays on this thread, so `take` need not be `Send`.
    rayon::in_place_scope(|scope| -> Result<()> {
        loop {
            while !is_at_end && under_way + early.len() < others_max {
                let (made, desk, done) = (spare.pop().unwrap_or_default(), &desk, &done);
                scope.spawn(move |_| {
                    // Nobody receives after a failure.
                    match panic::catch_unwind(AssertUnwindSafe(|| desk.fill(made))) {
                        Ok(filled) => drop(done.send(Some(filled))),
                        Err(panicked) => {
                            drop(done.send(None));
                            panic::resume_unwind(panicked);
                        }
                    }
                });
                under_way += 1;
            }
            if let Some((next, mut made)) = early.remove(&turn) {
                turn = next;
                take(&mut made)?;
                spare.push(made);
                continue;
            }
            if under_way == 0 {
                return Ok(());
            }
            let Some(filled) = receive(&received) else { continue };
            // A batch that panicked: the scope goes on with that when all others have ended.
            let Some(Done { made, read }) = filled else { return Ok(()) };
            under_way -= 1;
            match read? {
                Some((first, next)) => drop(early.insert(first, (next, made))),
                None => is_at_end = true,
            }
        }
    })?;
    drop(desk);
    Ok(pass.finish())
}

/// What has been done; where nothing has, lends a hand, and waits only when there is nothing to do.
fn receive<T>(received: &mpsc::Receiver<T>) -> Option<T> {
    if let Ok(done) = received.try_recv() {
        return Some(done);
    }
    if rayon::yield_now() == Some(rayon::Yield::Executed) {
        return None;
    }
    received.recv().ok()
}

/// Where batches are worked on.
struct Desk<'a, V: Vertex, W> {
    pass: &'a Pass<'a, V>,
    meter: &'a Meter<'a>,
    scratches: Mutex<Vec<Scratch<V>>>,
    work: &'a W,
}

impl<V: Vertex, W> Desk<'_, V, W> {
    /// Reads a batch and works on it.
    fn fill<T>(&self, mut made: T) -> Done<T>
    where
        W: Fn(&Taken<'_, V>, &mut T) + Sync,
    {
        let scratches = || self.scratches.lock().unwrap_or_else(PoisonError::into_inner);
        let scratch = scratches().pop();
        let mut scratch = scratch.unwrap_or_default();
        let read = self.read(&mut scratch, &mut made);
        scratches().push(scratch);
        Done { made, read }
    }

    fn read<T>(&self, scratch: &mut Scratch<V>, made: &mut T) -> Result<Option<(u64, u64)>>
    where
        W: Fn(&Taken<'_, V>, &mut T) + Sync,
    {
        let Some(taken) = self.pass.next(scratch)? else { return Ok(None) };
        (self.work)(&taken, made);
        self.meter.add(taken.records)?;
        Ok(Some((taken.first_record, taken.first_record + taken.records)))
    }
}
