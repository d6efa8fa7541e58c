//! After warm-up a step allocates nothing: held, sliding, with one thread.

#![allow(unsafe_code)] // a global allocator cannot be written without

#[path = "common/matrices.rs"]
mod matrices;

use quasirigid::body::PoseDrive;
use quasirigid::collider::Friction;
use quasirigid::delassus::ContactStatus;
use quasirigid::math::{Pose, Vec3};
use quasirigid::scenes::{GraspOptions, GraspScene};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static COUNT: Cell<Option<u64>> = const { Cell::new(None) };
}

/// Counts allocations of the thread that asked for it; other tests of the process go uncounted.
struct Counting;

fn count() {
    let _ = COUNT.try_with(|c| c.set(c.get().map(|n| n + 1)));
}

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(work: impl FnOnce()) -> u64 {
    COUNT.with(|c| c.set(Some(0)));
    work();
    COUNT.with(|c| c.take()).unwrap_or(0)
}

fn held(options: &GraspOptions) -> GraspScene {
    let mut scene = GraspScene::new(options).unwrap();
    assert!(scene.close(3.0).unwrap(), "the hand did not close");
    scene.remove_support().unwrap();
    scene.run(0.3).unwrap();
    scene
}

fn options() -> GraspOptions {
    GraspOptions { object_points: (6_000, 800), pad_points: (1_200, 160), ..GraspOptions::default() }
}

#[test]
fn the_counter_counts() {
    assert!(allocations(|| drop(std::hint::black_box(vec![0u8; 64]))) > 0);
}

#[test]
fn a_held_grasp_steps_without_allocating() {
    for half_space in [false, true] {
        let mut options = options();
        if half_space {
            options.pad_material = options.pad_material.with_model(quasirigid::collider::ComplianceModel::HalfSpace).unwrap();
        }
        let mut scene = held(&options);
        let mut contacts = 0;
        let count = allocations(|| (0..500).for_each(|_| contacts = scene.world.step().contacts));
        println!("half-space {half_space}: {count} allocations in 500 steps with {contacts} contacts");
        assert!(contacts > 30, "{contacts} contacts");
        assert_eq!(count, 0, "half-space {half_space}: allocations in 500 steps");
    }
}

#[test]
fn a_sliding_grasp_steps_without_allocating() {
    slide(&options());
}

#[test]
fn an_object_with_a_compliance_matrix_allocates_nothing_either() {
    let mut options = GraspOptions { object_points: (1_600, 200), ..options() };
    let same = GraspScene::new(&options).unwrap();
    options.object_material = options.object_material.with_model(matrices::as_matrix(&same.world, same.object)).unwrap();
    slide(&options);
}

#[test]
fn friction_beyond_coulomb_allocates_nothing_either() {
    let friction = Friction::coulomb(0.8).and_then(|f| f.with_kinetic(0.7, 1e-3)).and_then(|f| f.with_viscous(1e3)).unwrap();
    let mut options = options();
    options.object_material = options.object_material.with_friction(friction.with_anisotropy(Vec3::z(), 0.9).unwrap()).unwrap();
    slide(&options);
}

#[test]
fn a_grasp_that_is_taken_back_steps_without_allocating_once_it_is_warm() {
    let mut scene = held(&options());
    let held = scene.world.snapshot();
    scene.run(0.05).unwrap();
    scene.world.restore(&held);
    scene.run(0.05).unwrap();
    let count = allocations(|| (0..200).for_each(|_| drop(scene.world.step())));
    assert_eq!(count, 0, "allocations in 200 steps");
}

fn slide(options: &GraspOptions) {
    let mut scene = held(options);
    // Pulled up and down between the fingers by a stiff spring: it slides one way, sticks, and slides the other.
    let rest = *scene.world.body(scene.object).unwrap().pose();
    let pull = |scene: &mut GraspScene, k: usize| {
        let target = Pose::translation(0.0, 0.0, 4e-3 * (k as f64 * 0.02).sin()) * rest;
        let drive = PoseDrive::new(target, [2e4, 20.0], [100.0, 0.1]).unwrap();
        scene.world.body_mut(scene.object).unwrap().set_drive(Some(drive)).unwrap();
    };
    let (mut count, mut slipping, mut steps) = (0, 0, 0);
    for k in 0..1000 {
        pull(&mut scene, k);
        let new = allocations(|| drop(scene.world.step()));
        // The first 3 mm and back are the warm-up.
        if k >= 500 {
            count += new;
            steps += 1;
            slipping += usize::from(scene.world.contact_problem().status.contains(&ContactStatus::Slip));
        }
    }
    let height = scene.world.body(scene.object).unwrap().pose().translation.z;
    let contacts = scene.world.contacts().len();
    println!("{count} allocations in {steps} steps, slipping in {slipping}; {contacts} contacts, box at {height} m");
    assert!(slipping > 200, "slipping in {slipping} steps");
    assert!(contacts > 30, "{contacts} contacts");
    assert_eq!(count, 0, "allocations in 500 steps");
}
