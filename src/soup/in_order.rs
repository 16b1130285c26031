//! A pass whose batches are worked on by all threads and handed over in order.

use std::sync::{Mutex, PoisonError};

use super::{Pass, Scratch, Source, Taken, Vertex};
use crate::{error::Result, formats::Findings, progress::Meter, storage::Budget};

/// A batch under way.
struct Slot<T> {
    made: T,
    first_record: u64,
    /// What reading came to; `false` at the end of the pass.
    read: Result<bool>,
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
    let width = budget.threads();
    let scratches = Mutex::new(Vec::new());
    let (mut spare, mut ready): (Vec<Slot<T>>, Vec<Slot<T>>) = (Vec::new(), Vec::new());
    loop {
        let empty = || Slot { made: T::default(), first_record: 0, read: Ok(false) };
        let mut wave: Vec<Slot<T>> = std::mem::take(&mut spare);
        wave.resize_with(width, empty);
        // The scope's own body stays on this thread, so `take` need not be `Send`.
        rayon::in_place_scope(|scope| {
            for slot in &mut wave {
                let (pass, scratches, work) = (&pass, &scratches, &work);
                scope.spawn(move |_| slot.fill(pass, meter, scratches, work));
            }
            ready.iter_mut().try_for_each(|slot| take(&mut slot.made))
        })?;
        spare = std::mem::take(&mut ready);
        for slot in wave {
            if slot.read? {
                ready.push(Slot { read: Ok(true), ..slot });
            }
        }
        if ready.is_empty() {
            return Ok(pass.finish());
        }
        // Which thread got which batch is chance.
        ready.sort_by_key(|slot| slot.first_record);
    }
}

impl<T> Slot<T> {
    /// Reads a batch and works on it.
    fn fill<V: Vertex>(
        &mut self,
        pass: &Pass<'_, V>,
        meter: &Meter<'_>,
        scratches: &Mutex<Vec<Scratch<V>>>,
        work: &(impl Fn(&Taken<'_, V>, &mut T) + Sync),
    ) {
        let scratches = || scratches.lock().unwrap_or_else(PoisonError::into_inner);
        let scratch = scratches().pop();
        let mut scratch = scratch.unwrap_or_default();
        self.read = self.read(pass, meter, &mut scratch, work);
        scratches().push(scratch);
    }

    fn read<V: Vertex>(
        &mut self,
        pass: &Pass<'_, V>,
        meter: &Meter<'_>,
        scratch: &mut Scratch<V>,
        work: &(impl Fn(&Taken<'_, V>, &mut T) + Sync),
    ) -> Result<bool> {
        let Some(taken) = pass.next(scratch)? else { return Ok(false) };
        work(&taken, &mut self.made);
        self.first_record = taken.first_record;
        meter.add(taken.records)?;
        Ok(true)
    }
}
