//! Hashes and end states of scenes that between them reach every path of a step: for comparing two
//! builds on one machine. Where a change must not change results, the two outputs are equal; where
//! it may change rounding, the numbers agree to the digits that are asked for.
//!
//! ```sh
//! cargo run --release --example state_hashes > before.txt     # then change something, and:
//! cargo run --release --example state_hashes | diff before.txt -
//! ```
//!
//! A line has the scene, the hash of the states of all its steps, the number of contacts summed over them, and the final poses.

use quasirigid::body::{Amount, HandModel, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{Friction, Material};
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::scenes::{GraspOptions, GraspScene, Incline, Pinch, PinchOptions};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{BodyHandle, Parameters, Result, World};
use std::sync::Arc;

type Scene = fn(&mut Trace) -> Result<World>;

fn main() -> Result<()> {
    let scenes: [(&str, Scene); 11] = [
        ("box grasp", box_grasp),
        ("half-space pads", half_space_pads),
        ("directed and Stribeck friction", directed_friction),
        ("directed friction, round", directed_friction_round),
        ("viscous film", viscous_film),
        ("collision every 4 steps", collision_every_4),
        ("deep overlap", deep_overlap),
        ("edges", edges),
        ("quasi-static", quasi_static),
        ("tracked hand", tracked_hand),
        ("bodies removed", bodies_removed),
    ];
    for (name, run) in scenes {
        let mut trace = Trace { hash: 0, contacts: 0 };
        let world = run(&mut trace)?;
        println!("{name}: {:016x}, {} contacts", trace.hash, trace.contacts);
        for entry in world.bodies() {
            let pose = entry.body.link_pose(entry.body.link_count() - 1);
            println!("    {} {:.17e} {:.17e}", entry.body.name(), pose.translation.vector.transpose(), pose.rotation.coords.transpose());
        }
    }
    Ok(())
}

/// What the steps of a scene were.
struct Trace {
    hash: u64,
    contacts: usize,
}

impl Trace {
    fn step(&mut self, world: &mut World) {
        world.step();
        self.note(world);
    }

    fn note(&mut self, world: &World) {
        self.hash = self.hash.rotate_left(5).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ world.motion_hash();
        self.contacts += world.contacts().len();
    }
}

fn box_grasp(trace: &mut Trace) -> Result<World> {
    let options = GraspOptions { object_points: (12_000, 1_600), pad_points: (1_200, 160), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options)?;
    for step in 0..1_500 {
        if step == 1_000 {
            scene.remove_support()?;
        }
        if step > 1_100 {
            let base = scene.world.hand(scene.hand)?.base;
            let rotation = Rot::from_axis_angle(&Vec3::y_axis(), 2e-3);
            scene.world.move_hand_to(
                scene.hand,
                Pose::from_parts((base.translation.vector + Vec3::z() * 1e-4).into(), rotation * base.rotation),
            )?;
        }
        scene.step()?;
        trace.note(&scene.world);
    }
    Ok(scene.world)
}

fn pinched(trace: &mut Trace, options: &PinchOptions) -> Result<World> {
    let mut pinch = Pinch::new(options)?;
    for step in 0..700 {
        if step == 250 {
            pinch.set_gravity(Vec3::new(0.0, 0.0, -9.81))?;
        }
        let t = Real::from(step) * 1e-3;
        for (pad, side) in [(0, 1.0), (1, -1.0)] {
            let inward = if step < 200 { side * 5e-6 } else { 0.0 };
            let sway = if step > 400 { 2e-5 * (20.0 * t).sin() } else { 0.0 };
            pinch.shift_pad(pad, Vec3::new(inward, sway, 0.5 * sway))?;
        }
        trace.step(&mut pinch.world);
    }
    Ok(pinch.world)
}

fn fingertips(mu: Real) -> Result<PinchOptions> {
    Ok(PinchOptions { box_points: (6_000, 800), ..PinchOptions::fingertips(mu)? })
}

fn half_space_pads(trace: &mut Trace) -> Result<World> {
    let mut options = fingertips(0.6)?;
    options.pad_material = options.pad_material.with_model(quasirigid::collider::ComplianceModel::HalfSpace)?;
    options.box_material = Material::preset("rubber")?.with_model(quasirigid::collider::ComplianceModel::HalfSpace)?;
    pinched(trace, &options)
}

fn collision_every_4(trace: &mut Trace) -> Result<World> {
    let params = Parameters { collision_every: 4, ..Parameters::default() };
    pinched(trace, &PinchOptions { params, ..fingertips(0.6)? })
}

fn quasi_static(trace: &mut Trace) -> Result<World> {
    pinched(trace, &PinchOptions { motion: Motion::QuasiStatic, ..fingertips(0.6)? })
}

fn sliding(trace: &mut Trace, friction: Friction) -> Result<World> {
    let mut incline = Incline::new(Parameters::default(), &Material::preset("rubber")?, friction, Motion::Inertial)?;
    for step in 0..600 {
        if step == 100 {
            incline.tilt(0.35, 0.6)?;
        }
        if step == 400 {
            incline.tilt(0.1, 0.6)?;
        }
        trace.step(&mut incline.world);
    }
    Ok(incline.world)
}

fn directed_friction(trace: &mut Trace) -> Result<World> {
    sliding(trace, Friction::coulomb(0.4)?.with_kinetic(0.25, 2e-3)?.with_anisotropy(Vec3::x(), 0.5)?)
}

fn directed_friction_round(trace: &mut Trace) -> Result<World> {
    let mut options = fingertips(0.6)?;
    options.box_material = options.box_material.with_friction(Friction::coulomb(0.5)?.with_anisotropy(Vec3::new(0.0, 1.0, 1.0), 1.7)?)?;
    pinched(trace, &options)
}

fn viscous_film(trace: &mut Trace) -> Result<World> {
    sliding(trace, Friction::coulomb(0.1)?.with_viscous(200.0)?)
}

fn surface(points: quasirigid::surface::PointSurface, control: usize) -> Result<Arc<Surface>> {
    Ok(Arc::new(Surface::build(points, Some(control))?))
}

fn cube(world: &mut World, edge: Real, at: Pose, material: &str) -> Result<BodyHandle> {
    let size = Vec3::repeat(edge);
    let body = RigidBody::free("cube", MassProperties::cuboid(size, Amount::Mass(0.1))?, Motion::Inertial, at)?;
    world.add_body(body, Some((surface(shapes::sample_box(size, 2_400)?, 320)?, Material::preset(material)?)))
}

fn table(world: &mut World) -> Result<BodyHandle> {
    let plane = surface(shapes::sample_half_space(0.4, 3_600)?, 450)?;
    world.add_body(RigidBody::fixed("table", Pose::identity())?, Some((plane, Material::preset("rubber")?)))
}

fn deep_overlap(trace: &mut Trace) -> Result<World> {
    let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() })?;
    cube(&mut world, 0.04, Pose::identity(), "rubber")?;
    cube(&mut world, 0.03, Pose::translation(0.028, 0.004, 0.003), "wood")?;
    for _ in 0..500 {
        trace.step(&mut world);
    }
    Ok(world)
}

fn edges(trace: &mut Trace) -> Result<World> {
    let mut world = World::new(Parameters::default())?;
    table(&mut world)?;
    for (x, tilt) in [(-0.1, 0.6), (0.0, 0.2), (0.1, std::f64::consts::FRAC_PI_4)] {
        let pose = Pose::from_parts(Vec3::new(x, 0.0, 0.03).into(), Rot::from_euler_angles(tilt, 0.5 * tilt, 0.1));
        cube(&mut world, 0.03, pose, "silicone")?;
    }
    for _ in 0..600 {
        trace.step(&mut world);
    }
    Ok(world)
}

fn tracked_hand(trace: &mut Trace) -> Result<World> {
    let mut world = World::new(Parameters::default())?;
    table(&mut world)?;
    cube(&mut world, 0.04, Pose::translation(0.0, 0.0, 0.02), "wood")?;
    let tip = surface(shapes::sample_fingertip(Vec3::new(0.009, 0.009, 0.008), 1_200)?, 160)?;
    let pulp = Material::preset("fingertip_pulp")?;
    let mut tips = Vec::new();
    let pose = |side: Real, t: Real| {
        let inward = (0.1 * t).min(0.0095);
        let lift = 0.1 * (t - 0.25).clamp(0.0, 0.3);
        let rotation = Rot::from_axis_angle(&Vec3::y_axis(), -side * std::f64::consts::FRAC_PI_2);
        let sway = 0.002 * (9.0 * t).sin();
        Pose::from_parts(Vec3::new(side * (0.036 - inward) + sway, 0.0, 0.02 + lift).into(), rotation)
    };
    for side in [-1.0, 1.0] {
        let mass = MassProperties::cuboid(Vec3::repeat(0.018), Amount::Mass(0.02))?;
        let body = RigidBody::free("tip", mass, Motion::Inertial, pose(side, 0.0))?;
        tips.push((side, world.add_body(body, Some((tip.clone(), pulp.clone())))?));
    }
    let model = HandModel::three_finger()?;
    let pad = shapes::sample_fingertip(model.tips()[0].pad_semi_axes, 900)?;
    let hand = world.add_hand(&model, Pose::translation(0.0, 0.15, 0.12), Motion::QuasiStatic, &pad, Some(120), &pulp)?;
    for step in 0..700 {
        let t = Real::from(step) * 1e-3;
        for (side, body) in &tips {
            let drive = PoseDrive::new(pose(*side, t), [2_000.0, 2.0], [20.0, 0.02])?;
            world.body_mut(*body)?.set_drive(Some(drive))?;
        }
        world.move_hand_to(hand, Pose::translation(0.0, 0.15 - 0.2 * t, 0.12))?;
        trace.step(&mut world);
    }
    Ok(world)
}

fn bodies_removed(trace: &mut Trace) -> Result<World> {
    let mut world = World::new(Parameters::default())?;
    let table = table(&mut world)?;
    let mut cubes = Vec::new();
    for k in 0..4 {
        let pose = Pose::translation(0.002 * Real::from(k), 0.0, 0.016 + 0.031 * Real::from(k));
        cubes.push(cube(&mut world, 0.03, pose, "rubber")?);
    }
    world.set_friction(table, cubes[0], Some(Friction::coulomb(0.3)?))?;
    world.set_friction(cubes[1], cubes[2], Some(Friction::coulomb(0.5)?))?;
    for step in 0..700 {
        if step == 200 {
            world.remove_body(cubes[0])?;
        }
        if step == 350 {
            cube(&mut world, 0.03, Pose::translation(0.05, 0.0, 0.02), "wood")?;
        }
        if step == 450 {
            world.remove_body(cubes[2])?;
        }
        trace.step(&mut world);
    }
    Ok(world)
}
