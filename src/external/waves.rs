//! Work on several threads whose results are handed over in order, by the calling thread.
//!
//! While one wave of results is handed over, the next one is worked on and the one after that is
//! fetched: reading, computing and writing overlap, and no more than three waves exist at once.

use crate::error::Result;

/// Fetches items with `next` until it gives `None`, turns `width` of them at a time into results
/// on the current pool, and passes the results to `emit` in order. The first failure, in order
/// of the items, ends it.
///
/// # Errors
/// What `next`, `work` and `emit` return.
pub fn in_order<I: Send, O: Send>(
    width: usize,
    mut next: impl FnMut() -> Result<Option<I>>,
    work: impl Fn(I) -> Result<O> + Sync,
    mut emit: impl FnMut(O) -> Result<()>,
) -> Result<()> {
    let mut results: Vec<Option<Result<O>>> = Vec::new();
    let mut wave = fetch(width, &mut next)?;
    while !wave.is_empty() || !results.is_empty() {
        let ready = std::mem::take(&mut results);
        results.resize_with(wave.len(), || None);
        let items = std::mem::take(&mut wave);
        // The scope's own body stays on this thread, so `next` and `emit` need not be `Send`.
        wave = rayon::in_place_scope(|scope| {
            for (item, result) in items.into_iter().zip(&mut results) {
                let work = &work;
                scope.spawn(move |_| *result = Some(work(item)));
            }
            for result in ready.into_iter().flatten() {
                emit(result?)?;
            }
            fetch(width, &mut next)
        })?;
    }
    Ok(())
}

fn fetch<I>(width: usize, next: &mut impl FnMut() -> Result<Option<I>>) -> Result<Vec<I>> {
    let mut wave = Vec::with_capacity(width);
    while wave.len() < width {
        match next()? {
            Some(item) => wave.push(item),
            None => break,
        }
    }
    Ok(wave)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    #[test]
    fn results_come_in_order_and_the_first_failure_ends_it() {
        for width in [1, 3, 8] {
            let mut items = 0..20;
            let mut seen = Vec::new();
            let outcome = in_order(
                width,
                || Ok(items.next()),
                |n| if n == 11 { Err(Error::Request(n.to_string())) } else { Ok(n * n) },
                |square| {
                    seen.push(square);
                    Ok(())
                },
            );
            assert_eq!(outcome.unwrap_err().to_string(), "11");
            assert!(seen.iter().copied().eq((0..11).map(|n| n * n)));
        }
    }
}
