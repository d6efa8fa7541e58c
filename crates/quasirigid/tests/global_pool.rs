//! Nothing goes to rayon's global pool: a forked child has that pool without its threads, and would wait for ever.
//!
//! Here its threads are made to sleep as soon as they have started, so that work given to it is never done, as in a child.

use quasirigid::body::{Amount, HandModel, MassProperties, Motion, RigidBody};
use quasirigid::collider::Material;
use quasirigid::math::{Pose, Vec3};
use quasirigid::surface::sampling::{areas, normals};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{Parameters, World};
use std::sync::{Arc, mpsc};
use std::time::Duration;

fn use_everything() {
    let (points, unit_normals, _) = shapes::sample_sphere(0.03, 5000).unwrap().into_parts();
    let found = normals::estimate_normals(&points).unwrap();
    assert_eq!(areas::estimate_areas(&points, &found).unwrap().len(), 5000);
    PointSurface::from_points_and_normals(points.clone(), unit_normals).unwrap();
    let ball = Arc::new(Surface::build(PointSurface::from_points(points).unwrap(), Some(600)).unwrap());
    let pad = shapes::sample_fingertip(Vec3::new(0.012, 0.0085, 0.007), 600).unwrap();
    for (threads, model) in [(1, None), (2, Some(HandModel::three_finger().unwrap()))] {
        let mut world = World::new(Parameters { threads, ..Parameters::default() }).unwrap();
        let material = Material::preset("rubber").unwrap();
        let mass = MassProperties::sphere(0.03, Amount::Mass(0.1)).unwrap();
        let below = RigidBody::fixed("below", Pose::identity()).unwrap();
        let above = RigidBody::free("above", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.055)).unwrap();
        for body in [below, above] {
            world.add_body(body, Some((ball.clone(), material.clone()))).unwrap();
        }
        if let Some(model) = model {
            world.add_hand(&model, Pose::translation(0.0, 0.0, 0.5), Motion::Inertial, &pad, Some(80), &material).unwrap();
        }
        assert!(world.step().contacts > 0);
        world.set_parameters(Parameters { threads: 3, ..world.parameters().clone() }).unwrap();
        world.step();
    }
}

#[test]
fn no_work_goes_to_the_global_pool() {
    let asleep = |_| {
        loop {
            std::thread::park();
        }
    };
    rayon::ThreadPoolBuilder::new().num_threads(2).start_handler(asleep).build_global().unwrap();
    let (done, wait) = mpsc::channel();
    std::thread::spawn(move || {
        use_everything();
        done.send(())
    });
    wait.recv_timeout(Duration::from_secs(60)).expect("work was given to the global pool, or failed above");
}
