//! Work on items by all threads of the pool, each from fetching to writing, with one step in
//! between that is taken in the order of the items.
//!
//! No thread waits for a wave to end, and none reads or writes on behalf of the others.

use std::sync::{Condvar, Mutex, MutexGuard};

use crate::error::{Error, Result};

/// The four steps of an item. `S` is what a thread keeps from one item to the next.
pub(super) struct Steps<N, W, T, A> {
    /// Fetches an item, by one thread at a time.
    pub(super) next: N,
    /// Works on it, at the same time as other threads do.
    pub(super) work: W,
    /// Is done with one item after the other, in order. Short, as other threads wait.
    pub(super) turn: T,
    /// Ends it, at the same time as other threads work.
    pub(super) after: A,
}

/// What threads kept when they were done, to be used again: fresh memory costs a fault a page.
pub(super) type Spare<S> = Mutex<Vec<S>>;

/// Takes every item through its steps on `width` threads of the current pool, or as many as it
/// has. What they keep comes from `spare`, or is made by `new`, and ends up in `spare` again. The
/// first failure, in order of the items but for those of the last step, ends it.
pub(super) fn in_turns<I: Send, S: Send, N, W, T, A>(
    width: usize,
    spare: &Spare<S>,
    new: impl Fn() -> S + Sync,
    steps: Steps<N, W, T, A>,
) -> Result<()>
where
    N: FnMut() -> Result<Option<I>> + Send,
    W: Fn(I, &mut S) -> Result<()> + Sync,
    T: FnMut(&mut S) -> Result<()> + Send,
    A: Fn(&mut S) -> Result<()> + Sync,
{
    let Steps { next, work, turn, after } = steps;
    let queue = Mutex::new(Queue { fetched: 0, next });
    let turn = Mutex::new(Turn { number: 0, ended: None, panicked: false, step: turn });
    let order = Order { turn, came: Condvar::new() };
    let run = || {
        let _wakes_others = Guard(&order);
        let kept = spare.lock().expect(WHOLE).pop();
        let mut state = kept.unwrap_or_else(&new);
        while let Some((number, item)) = fetch(&queue) {
            let worked = item.and_then(|item| work(item, &mut state));
            let Some(mut turn) = order.wait_for(number) else { return };
            let taken = worked.and_then(|()| (turn.step)(&mut state));
            turn.number += 1;
            if let Err(error) = taken {
                turn.ended = Some(error);
            }
            let ended = turn.ended.is_some();
            drop(turn);
            order.came.notify_all();
            if ended {
                return;
            }
            if let Err(error) = after(&mut state) {
                order.end(error);
                return;
            }
        }
        spare.lock().expect(WHOLE).push(state);
    };
    let width = width.clamp(1, rayon::current_num_threads());
    rayon::scope(|scope| (0..width).for_each(|_| scope.spawn(|_| run())));
    let turn = order.turn.into_inner().expect(WHOLE);
    turn.ended.map_or(Ok(()), Err)
}

const WHOLE: &str = "a panic of one thread ends all";

struct Queue<N> {
    fetched: u64,
    next: N,
}

/// The next item and its number, `None` after the last.
fn fetch<I, N: FnMut() -> Result<Option<I>>>(queue: &Mutex<Queue<N>>) -> Option<(u64, Result<I>)> {
    let mut queue = queue.lock().expect(WHOLE);
    let item = (queue.next)().transpose()?;
    let number = queue.fetched;
    queue.fetched += 1;
    Some((number, item))
}

struct Order<T> {
    turn: Mutex<Turn<T>>,
    came: Condvar,
}

struct Turn<T> {
    /// Whose turn it is. That item is with some thread already, so waiting comes to an end.
    number: u64,
    ended: Option<Error>,
    /// Some thread's turn will never come.
    panicked: bool,
    step: T,
}

/// Wakes the threads that wait for one that panicked.
struct Guard<'a, T>(&'a Order<T>);

impl<T> Drop for Guard<'_, T> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            if let Ok(mut turn) = self.0.turn.lock() {
                turn.panicked = true;
            }
            self.0.came.notify_all();
        }
    }
}

impl<T> Order<T> {
    /// `None` when there is nothing left to wait for.
    fn wait_for(&self, number: u64) -> Option<MutexGuard<'_, Turn<T>>> {
        let mut turn = self.turn.lock().expect(WHOLE);
        while turn.number != number && turn.ended.is_none() && !turn.panicked {
            turn = self.came.wait(turn).expect(WHOLE);
        }
        (turn.ended.is_none() && !turn.panicked).then_some(turn)
    }

    fn end(&self, error: Error) {
        self.turn.lock().expect(WHOLE).ended.get_or_insert(error);
        self.came.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn squares_until(failing: u64, width: usize) -> (Vec<u64>, Result<()>) {
        let mut items = 0..200;
        let (mut seen, written) = (Vec::new(), Mutex::new(Vec::new()));
        let steps = Steps {
            next: || Ok(items.next()),
            work: |n: u64, square: &mut u64| {
                *square = n * n;
                if n == failing { Err(Error::Request(n.to_string())) } else { Ok(()) }
            },
            turn: |square: &mut u64| {
                seen.push(*square);
                Ok(())
            },
            after: |square: &mut u64| {
                written.lock().unwrap().push(*square);
                Ok(())
            },
        };
        let outcome = in_turns(width, &Spare::default(), || 0, steps);
        let mut written = written.into_inner().unwrap();
        written.sort_unstable();
        assert!(seen.starts_with(&written));
        assert!(outcome.is_err() || seen == written);
        (seen, outcome)
    }

    #[test]
    fn turns_come_in_order_and_the_first_failure_ends_them() {
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            for width in [1, 3, 8] {
                let (seen, outcome) = pool.install(|| squares_until(111, width));
                assert_eq!(outcome.unwrap_err().to_string(), "111");
                assert!(seen.into_iter().eq((0..111).map(|n| n * n)));
                let (seen, outcome) = pool.install(|| squares_until(200, width));
                assert!(outcome.is_ok() && seen.len() == 200);
            }
        }
    }

    #[test]
    #[should_panic(expected = "a bug")]
    fn a_panic_does_not_leave_the_others_waiting() {
        let mut items = 0..200;
        let steps = Steps {
            next: || Ok(items.next()),
            work: |n: u64, (): &mut ()| {
                assert_ne!(n, 50, "a bug");
                Ok(())
            },
            turn: |(): &mut ()| Ok(()),
            after: |(): &mut ()| Ok(()),
        };
        let _ = in_turns(4, &Spare::default(), || (), steps);
    }
}
