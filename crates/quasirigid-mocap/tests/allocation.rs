//! A hand tracker allocates nothing after it was made, so it can be asked in the loop of a simulation.

#![allow(unsafe_code)] // a global allocator cannot be written without

use quasirigid_mocap::synthetic::hand_at;
use quasirigid_mocap::{HandTracker, Pose, Side, TrackingOptions};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = COUNT.try_with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn pushing_and_sampling_allocate_nothing() {
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
    let before = COUNT.get();
    for k in 0..5000 {
        let now = f64::from(k) * 1e-3;
        if k % 2 == 0 {
            // 500 Hz, every tenth twice, and a restart in between.
            let mut frame = hand_at(now);
            frame.time += if k > 3000 { 0.0 } else { 5000.0 };
            for _ in 0..1 + usize::from(k % 20 == 0) {
                tracker.push(&frame).unwrap();
            }
        }
        assert!(tracker.sample(now).is_some());
    }
    let allocated = COUNT.get() - before;
    assert_eq!(allocated, 0, "allocations in 5000 steps");
}
