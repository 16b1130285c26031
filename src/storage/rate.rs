//! How fast a file can be read, from a few looks at it.

use std::{os::unix::fs::FileExt as _, path::Path, time::Instant};

use super::open_input;
use crate::error::{IoContext as _, Result};

/// Places looked at, evenly spread over the file, and bytes read at each.
const PLACES: u64 = 4;
const PLACE_BYTES: u64 = 4 << 20;

/// Bytes per second at which `path` can be read now: from the disk, or from the system's cache where
/// that holds it; `None` for files that are too small to tell. Reads 16 MiB.
///
/// # Errors
/// [`crate::Error::Io`] when it cannot be opened or read.
pub fn read_rate(path: &Path) -> Result<Option<f64>> {
    let file = open_input(path)?;
    let size_bytes = file.metadata().at("look at", path)?.len();
    if size_bytes < 4 * PLACES * PLACE_BYTES {
        return Ok(None);
    }
    let mut block = vec![0; PLACE_BYTES as usize];
    let started = Instant::now();
    for place in 0..PLACES {
        file.read_exact_at(&mut block, place * (size_bytes / PLACES)).at("read", path)?;
    }
    let seconds = started.elapsed().as_secs_f64();
    Ok((seconds > 0.0).then(|| (PLACES * PLACE_BYTES) as f64 / seconds))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_files_have_a_rate_and_small_ones_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        for (bytes, has_rate) in [(1 << 20, false), (65 << 20, true)] {
            std::fs::write(&path, vec![1; bytes]).unwrap();
            let rate = read_rate(&path).unwrap();
            assert_eq!(rate.is_some(), has_rate);
            assert!(rate.is_none_or(|rate| rate > 0.0));
        }
        assert!(read_rate(&folder.path().join("nothing")).is_err());
    }
}
