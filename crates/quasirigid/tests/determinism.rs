//! Same input, same bits: two runs, and any number of threads.

#[path = "common/matrices.rs"]
mod matrices;

use quasirigid::Parameters;
use quasirigid::collider::{ComplianceModel, Friction};
use quasirigid::math::Vec3;
use quasirigid::scenes::{GraspOptions, GraspScene};

/// State hash after every step of a grasp: contact is made (fingers, support), the support vanishes, contact is broken.
fn hashes(threads: usize, half_space: bool, slippery: bool, matrix: bool) -> (Vec<u64>, usize) {
    let mut options = GraspOptions {
        params: Parameters { threads, ..Parameters::default() },
        object_points: (6_000, 800),
        pad_points: (900, 120),
        ..GraspOptions::default()
    };
    if half_space {
        options.pad_material = options.pad_material.with_model(ComplianceModel::HalfSpace).unwrap();
    }
    if slippery {
        let friction = Friction::coulomb(0.8).and_then(|f| f.with_kinetic(0.4, 1e-3)).and_then(|f| f.with_viscous(1e3)).unwrap();
        options.object_material = options.object_material.with_friction(friction.with_anisotropy(Vec3::z(), 0.5).unwrap()).unwrap();
    }
    if matrix {
        options.object_points = (1_600, 200);
        let same = GraspScene::new(&options).unwrap();
        options.object_material = options.object_material.with_model(matrices::as_matrix(&same.world, same.object)).unwrap();
    }
    let mut scene = GraspScene::new(&options).unwrap();
    let mut most = 0;
    let hashes = (0..300)
        .map(|k| {
            match k {
                230 => scene.remove_support().unwrap(),
                245 => scene.grip.open(),
                _ => {}
            }
            let report = scene.step().unwrap();
            most = most.max(report.contacts);
            scene.world.motion_hash()
        })
        .collect();
    (hashes, most)
}

#[test]
fn two_runs_and_any_number_of_threads_give_the_same_bits() {
    for (half_space, slippery, matrix) in [(false, false, false), (true, false, false), (false, true, false), (false, false, true)] {
        let (reference, most) = hashes(1, half_space, slippery, matrix);
        println!("half-space {half_space}, matrix {matrix}: up to {most} contacts");
        assert!(most > 60, "half-space {half_space}: only {most} contacts at most");
        let distinct: std::collections::BTreeSet<_> = reference.iter().collect();
        assert!(distinct.len() > 290, "the scene moves: {} distinct states", distinct.len());
        for threads in [1, 2, 3] {
            let (again, _) = hashes(threads, half_space, slippery, matrix);
            let first = again.iter().zip(&reference).position(|(a, b)| a != b);
            assert_eq!(
                first, None,
                "half-space {half_space}, all of friction {slippery}, matrix {matrix}, {threads} threads: first step with other bits"
            );
        }
    }
}
