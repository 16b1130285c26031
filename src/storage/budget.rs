//! How much memory a job may hold, and who holds it.

use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

/// See [`Budget::threads`].
const THREAD_BYTES: u64 = 8 << 20;
const THREADS_SHARE: u64 = 4;

/// The memory of one job. Large structures reserve their bytes before they allocate them; small
/// ones (a batch, a buffer) live in the constant that the promise leaves beside the budget.
#[derive(Clone, Debug)]
pub struct Budget {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    limit_bytes: u64,
    used_bytes: AtomicU64,
}

/// Bytes taken from a [`Budget`], given back on drop. By default none, of no budget.
#[derive(Debug, Default)]
pub struct Reservation {
    shared: Option<Arc<Shared>>,
    bytes: u64,
}

impl Budget {
    /// A budget of `limit_bytes`.
    #[must_use]
    pub fn new(limit_bytes: u64) -> Self {
        Self { shared: Arc::new(Shared { limit_bytes, used_bytes: AtomicU64::new(0) }) }
    }

    /// The whole of it.
    #[must_use]
    pub fn limit_bytes(&self) -> u64 {
        self.shared.limit_bytes
    }

    /// What is not reserved.
    #[must_use]
    pub fn available_bytes(&self) -> u64 {
        self.shared.limit_bytes.saturating_sub(self.shared.used_bytes.load(Ordering::Relaxed))
    }

    /// Threads of the current pool that may pass over a source at a time. What they hold of it,
    /// batches and small tables, is not reserved: a thread takes up to 8 MiB, and all together no
    /// more than a quarter of the budget, but for the first two.
    #[must_use]
    pub fn threads(&self) -> usize {
        let within = usize::try_from(self.shared.limit_bytes / THREADS_SHARE / THREAD_BYTES);
        rayon::current_num_threads().min(within.map_or(usize::MAX, |within| within.max(2)))
    }

    /// Takes `bytes`, or `None` when that much is not left.
    #[must_use]
    pub fn reserve(&self, bytes: u64) -> Option<Reservation> {
        let mut empty = Reservation { shared: Some(Arc::clone(&self.shared)), bytes: 0 };
        empty.grow(bytes).then_some(empty)
    }

    /// Takes `share` of what is left, but at least `bytes_min`, even if that is more than is
    /// left: no stage can work with nothing.
    #[must_use]
    pub fn reserve_share(&self, share: f64, bytes_min: u64) -> Reservation {
        let bytes = ((self.available_bytes() as f64 * share) as u64).max(bytes_min);
        self.shared.used_bytes.fetch_add(bytes, Ordering::Relaxed);
        Reservation { shared: Some(Arc::clone(&self.shared)), bytes }
    }
}

impl Reservation {
    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Takes `bytes` more, or changes nothing and returns false.
    #[must_use]
    pub fn grow(&mut self, bytes: u64) -> bool {
        let Some(shared) = &self.shared else { return bytes == 0 };
        let limit = shared.limit_bytes;
        let taken = shared.used_bytes.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |used| {
            used.checked_add(bytes).filter(|total| *total <= limit)
        });
        if taken.is_ok() {
            self.bytes += bytes;
        }
        taken.is_ok()
    }

    /// Gives back all but `bytes`.
    pub fn shrink_to(&mut self, bytes: u64) {
        let given_back = self.bytes.saturating_sub(bytes);
        self.bytes -= given_back;
        if let Some(shared) = &self.shared {
            shared.used_bytes.fetch_sub(given_back, Ordering::Relaxed);
        }
    }

    /// Takes over what another one of the same budget holds.
    pub fn absorb(&mut self, mut other: Self) {
        self.bytes += std::mem::take(&mut other.bytes);
        self.shared = self.shared.take().or(other.shared.take());
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.shrink_to(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reservations_add_up_and_are_given_back() {
        let budget = Budget::new(100);
        let mut first = budget.reserve(60).unwrap();
        assert!(budget.reserve(41).is_none());
        assert!(first.grow(40) && !first.grow(1));
        first.shrink_to(70);
        assert_eq!((first.bytes(), budget.available_bytes()), (70, 30));
        let mut both = Reservation::default();
        both.absorb(first);
        both.absorb(budget.reserve(20).unwrap());
        assert_eq!((both.bytes(), budget.available_bytes()), (90, 10));
        drop(both);
        assert_eq!(budget.available_bytes(), 100);
        assert_eq!(budget.reserve_share(0.5, 80).bytes(), 80);
    }
}
