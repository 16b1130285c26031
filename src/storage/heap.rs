//! The heap of the process: settings of its allocator, and huge pages for what is large.
#![expect(unsafe_code, reason = "allocators have no safe interface")]

use std::alloc::{GlobalAlloc, Layout, System};

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

/// The system's allocator, whose large allocations ask for huge pages: tables of millions of cells
/// are looked up all over, and each first touch of a small page costs a fault, which virtual machines
/// pay dearly for. For a program's `#[global_allocator]`.
#[derive(Clone, Copy, Debug)]
pub struct HugePages;

/// Bytes from which on an allocation asks for huge pages: tables, not batches, which come and go and
/// would leave holes as large as a page (with 4 MiB `soup` took 30 MiB more).
const LARGE_BYTES: usize = 8 * HUGE_PAGE_BYTES;
/// Bytes of a huge page, as most 64-bit processors have them.
const HUGE_PAGE_BYTES: usize = 2 << 20;
/// Bytes of a page; where pages are larger the advice is refused.
const PAGE_BYTES: usize = 4096;

// SAFETY: all memory is that of `System`, with the layouts it was asked for.
unsafe impl GlobalAlloc for HugePages {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: what the caller promises is passed on.
        let start = unsafe { System.alloc(layout) };
        ask_for_huge_pages(start, layout.size());
        start
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: what the caller promises is passed on.
        let start = unsafe { System.alloc_zeroed(layout) };
        ask_for_huge_pages(start, layout.size());
        start
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        // SAFETY: what the caller promises is passed on.
        let start = unsafe { System.realloc(old, layout, bytes) };
        ask_for_huge_pages(start, bytes);
        start
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        // SAFETY: what the caller promises is passed on.
        unsafe { System.dealloc(start, layout) }
    }
}

/// Asks for huge pages for an allocation, if it is large. Whether there are any is up to the system.
fn ask_for_huge_pages(start: *mut u8, bytes: usize) {
    if bytes < LARGE_BYTES || start.is_null() {
        return;
    }
    #[cfg(target_os = "linux")]
    {
        // Whole pages, the ends included: a mapping of which a part is advised is two mappings, and
        // can grow by copying only.
        let before = start.addr() % PAGE_BYTES;
        let range = (before + bytes).next_multiple_of(PAGE_BYTES);
        // SAFETY: a page of which the allocation has a part is mapped, and the advice leaves what is
        // in it as it is.
        unsafe {
            libc::madvise(start.sub(before).cast(), range, libc::MADV_HUGEPAGE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_any_size_keeps_what_is_in_it() {
        for bytes in [1, 5000, HUGE_PAGE_BYTES, LARGE_BYTES, 19_000_001] {
            let layout = Layout::from_size_align(bytes, 8).unwrap();
            // SAFETY: the sizes are not zero, and each block is used within the size it has.
            unsafe {
                let start = HugePages.alloc_zeroed(layout);
                let all = std::slice::from_raw_parts_mut(start, bytes);
                assert!(all.iter().all(|byte| *byte == 0));
                all.fill(7);
                let start = HugePages.realloc(start, layout, 2 * bytes);
                assert!(std::slice::from_raw_parts(start, bytes).iter().all(|byte| *byte == 7));
                let layout = Layout::from_size_align(2 * bytes, 8).unwrap();
                HugePages.dealloc(start, layout);
                let start = HugePages.alloc(layout);
                start.add(2 * bytes - 1).write(1);
                HugePages.dealloc(start, layout);
            }
        }
    }
}
