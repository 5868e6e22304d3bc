//! A refit's iterations allocate nothing, whichever the method.

#![allow(unsafe_code, clippy::unwrap_used)]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use pursuit_learning::{Method, RefitJob, Settings, refit};
use support::job_after;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: everything is the system's allocator; the counter is a thread's own and allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: as this function's caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as this function's caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn iterations_allocate_nothing() {
    let full = job_after(8, 1, &Settings::recommended());
    for method in [Method::ConjugateGradient, Method::ScaledConjugateGradient, Method::LevenbergMarquardt] {
        let allocations = |iterations: u32| {
            let job = RefitJob { method, iterations, ..full.clone() };
            let before = ALLOCATIONS.with(Cell::get);
            assert_eq!(refit(&job, || true).iterations, iterations, "{method:?}");
            ALLOCATIONS.with(Cell::get) - before
        };
        assert_eq!(allocations(0), allocations(6), "{method:?}");
    }
}
