//! The machine, as far as a job's defaults depend on it.

use std::{
    fs,
    io::{self, IsTerminal as _},
    path::PathBuf,
    thread,
};

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use super::job::Host;

/// Memory to go by where the system does not say.
const MEMORY_BYTES_UNKNOWN: u64 = 4 << 30;

/// Looks at this machine.
pub(super) fn host() -> Host {
    Host {
        memory_bytes_available: memory_bytes_available().unwrap_or(MEMORY_BYTES_UNKNOWN),
        threads: thread::available_parallelism().map_or(1, usize::from),
        temp_dir: std::env::var_os("TMPDIR").filter(|dir| !dir.is_empty()).map(PathBuf::from),
        stdout_is_terminal: io::stdout().is_terminal(),
    }
}

/// Plans the fault that a test has asked for; builds for people make none.
pub(super) fn plan_fault() {
    if let Some(text) = std::env::var("MESHMILL_FAULT").ok().filter(|_| cfg!(debug_assertions)) {
        assert!(meshmill::storage::plan_fault(&text), "no fault is called {text}");
    }
}

/// Lets this process open as many files as it may: what systems set at first suits programs that
/// expect few, and buckets are files. A system that refuses leaves fewer, which is slower only.
pub(super) fn raise_open_files() {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit {
        current: Some(limit.maximum.map_or(OPEN_FILES, |max| max.min(OPEN_FILES))),
        ..limit
    };
    if limit.current.is_some_and(|current| current < OPEN_FILES) {
        let _ = setrlimit(Resource::Nofile, raised);
    }
}

/// Four times what one step makes use of.
const OPEN_FILES: u64 = 4096;

/// Largest resident set of this process so far.
pub(super) fn peak_memory_bytes() -> Option<u64> {
    kibibytes(&fs::read_to_string("/proc/self/status").ok()?, "VmHWM:")
}

/// The smaller of what the machine and the control group have left.
fn memory_bytes_available() -> Option<u64> {
    let machine = kibibytes(&fs::read_to_string("/proc/meminfo").ok()?, "MemAvailable:")?;
    let group = |name| -> Option<u64> {
        fs::read_to_string(format!("/sys/fs/cgroup/{name}")).ok()?.trim().parse().ok()
    };
    let left =
        group("memory.max").map(|max| max.saturating_sub(group("memory.current").unwrap_or(0)));
    Some(left.map_or(machine, |left| left.min(machine)))
}

/// The value of `key` in a file of `key:  value kB` lines.
fn kibibytes(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|value| value << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_proc_are_understood() {
        let text = "VmPeak:\t   10 kB\nVmHWM:\t    2048 kB\n";
        assert_eq!(kibibytes(text, "VmHWM:"), Some(2 << 20));
        assert_eq!(kibibytes(text, "VmSwap:"), None);
    }
}
