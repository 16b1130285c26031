//! The heap of the process.
#![expect(unsafe_code, reason = "the C library's allocator has no safe interface to its settings")]

/// Has all threads of this process take their memory from one heap. For a program's `main`.
///
/// The allocator of glibc gives threads heaps of their own, and what one thread has freed is of no
/// use to the others: decimating on eight threads took twice the memory that the meshes were. What
/// a job allocates is large and seldom, so that threads do not wait for each other. Elsewhere this
/// does nothing.
pub fn share_heap() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: `mallopt` takes two numbers and may be called at any time. What it returns is whether
    // the setting exists; without it, memory is only used less well.
    unsafe {
        libc::mallopt(libc::M_ARENA_MAX, 1);
    }
}
