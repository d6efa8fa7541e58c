//! Bad input: every public constructor and setter refuses what makes no sense, with a
//! typed error that says what was expected, what came, and what to do.

use quasirigid::body::{Amount, Finger, FingerModel, HandModel, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::control::grip::{Grip, PadPath};
use quasirigid::control::inverse_kinematics::{IkOptions, TipGoal, inverse_kinematics};
use quasirigid::delassus::Assembled;
use quasirigid::free_motion::StepContext;
use quasirigid::gauss_seidel::{SolverParameters, check_problem};
use quasirigid::math::{Mat3, Pose, Real, Rot, Vec3};
use quasirigid::scenes::{GraspOptions, GraspScene, Incline, Pinch, PinchOptions};
use quasirigid::surface::implicit::kernel::Kernel;
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{Error, Parameters, Result, World};

const NAN: Real = Real::NAN;
const INF: Real = Real::INFINITY;
/// What no length, mass or stiffness can be.
const NOT_POSITIVE: [Real; 5] = [NAN, INF, -INF, -1.0, 0.0];
/// What no friction or damping can be.
const NEGATIVE: [Real; 4] = [NAN, INF, -INF, -1.0];
const NOT_FINITE: [Real; 3] = [NAN, INF, -INF];

/// The three parts of an error, all there.
fn assert_refused<T>(what: &str, result: Result<T>) {
    let Err(error) = result else { panic!("{what}: accepted") };
    let parts = match &error {
        Error::InvalidValue { what, expected, got, hint }
        | Error::InvalidShape { what, expected, got, hint }
        | Error::DegenerateSurface { what, expected, got, hint }
        | Error::UnknownName { what, expected, got, hint }
        | Error::InvalidHandle { what, expected, got, hint } => [what, expected, got, hint],
        other => panic!("{what}: {other:?} is of a kind unknown to this test"),
    };
    assert!(parts.iter().all(|part| !part.trim().is_empty()), "{what}: something is missing in '{error}'");
}

/// A quantity and a call that takes it.
type Row<'a, T> = (&'a str, &'a dyn Fn(Real) -> Result<T>);

/// Tries every bad value in every row of a table.
fn refused<T>(values: &[Real], rows: &[Row<T>]) {
    for (what, make) in rows {
        for &value in values {
            assert_refused(&format!("{what} = {value}"), make(value));
        }
    }
}

fn at(x: Real) -> Pose {
    Pose::from_parts(Vec3::new(x, 0.0, 0.0).into(), Rot::identity())
}

fn turned_by(x: Real) -> Pose {
    Pose::from_parts(Vec3::zeros().into(), Rot::new_unchecked(nalgebra::Quaternion::new(x, 0.0, 0.0, 0.0)))
}

fn ball() -> MassProperties {
    MassProperties::sphere(0.02, Amount::Mass(0.1)).unwrap()
}

fn free() -> RigidBody {
    RigidBody::free("ball", ball(), Motion::Inertial, Pose::identity()).unwrap()
}

#[test]
fn parameters() {
    let with = |change: &dyn Fn(&mut Parameters)| {
        let mut params = Parameters::default();
        change(&mut params);
        World::new(params)
    };
    refused(
        &NOT_POSITIVE,
        &[
            ("dt", &|x| with(&|p| p.dt = x)),
            ("projection_tolerance", &|x| with(&|p| p.projection_tolerance = x)),
            ("tolerance", &|x| with(&|p| p.solver.tolerance = x)),
        ],
    );
    refused(
        &NEGATIVE,
        &[
            ("contact_margin", &|x| with(&|p| p.contact_margin = x)),
            ("traversal_slack", &|x| with(&|p| p.traversal_slack = x)),
            ("projection_slack", &|x| with(&|p| p.projection_slack = x)),
            ("deformation_threshold", &|x| with(&|p| p.deformation_threshold = x)),
        ],
    );
    refused(&NOT_FINITE, &[("gravity", &|x| with(&|p| p.gravity.y = x))]);
    for threads in [0, 1 << 20] {
        assert_refused(&format!("{threads} threads"), with(&|p| p.threads = threads));
    }
    assert_refused("no sweeps", with(&|p| p.solver.max_sweeps = 0));
    assert_refused("no looks", with(&|p| p.collision_every = 0));
    let mut world = World::new(Parameters::default()).unwrap();
    assert_refused("parameters replaced", world.set_parameters(Parameters { dt: NAN, ..Parameters::default() }));
    assert_eq!(world.parameters(), &Parameters::default(), "refused parameters change nothing");
    refused(&NOT_POSITIVE, &[("time step", &|x| StepContext::new(x, Vec3::zeros()))]);
    refused(&NOT_FINITE, &[("gravity", &|x| StepContext::new(1e-3, Vec3::new(0.0, 0.0, x)))]);
    refused(&NOT_POSITIVE, &[("tolerance", &|x| SolverParameters { tolerance: x, ..Default::default() }.check())]);
}

#[test]
fn masses() {
    let mass = |x| Amount::Mass(x);
    refused(
        &NOT_POSITIVE,
        &[
            ("mass", &|x| MassProperties::new(x, Vec3::zeros(), Mat3::identity())),
            ("inertia", &|x| MassProperties::new(1.0, Vec3::zeros(), Mat3::identity() * x)),
            ("box mass", &|x| MassProperties::cuboid(Vec3::repeat(0.1), mass(x))),
            ("box density", &|x| MassProperties::cuboid(Vec3::repeat(0.1), Amount::Density(x))),
            ("box size", &|x| MassProperties::cuboid(Vec3::new(0.1, x, 0.1), mass(1.0))),
            ("sphere radius", &|x| MassProperties::sphere(x, mass(1.0))),
            ("ellipsoid", &|x| MassProperties::ellipsoid(Vec3::new(0.1, 0.1, x), mass(1.0))),
            ("cylinder radius", &|x| MassProperties::cylinder(x, 0.1, mass(1.0))),
            ("cylinder length", &|x| MassProperties::cylinder(0.1, x, mass(1.0))),
            ("capsule radius", &|x| MassProperties::capsule(x, 0.1, mass(1.0))),
            ("scaled mass", &|x| ball().scaled_to_mass(x)),
        ],
    );
    refused(
        &NOT_FINITE,
        &[
            ("centre of mass", &|x| MassProperties::new(1.0, Vec3::new(0.0, x, 0.0), Mat3::identity())),
            ("pose", &|x| ball().transformed(&at(x))),
        ],
    );
    refused(&NEGATIVE, &[("capsule length", &|x| MassProperties::capsule(0.1, x, mass(1.0)))]);
    assert_refused("triangle inequality", MassProperties::new(1.0, Vec3::zeros(), Mat3::from_diagonal(&Vec3::new(1.0, 1.0, 3.0))));
    assert_refused("asymmetric", MassProperties::new(1.0, Vec3::zeros(), Mat3::new(1.0, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)));
    assert_refused("nothing to combine", MassProperties::combined(&[]));
}

#[test]
fn materials() {
    let wood = || Material::preset("wood").unwrap();
    let local = |k, width, share| ComplianceModel::Gaussian { foundation_modulus: k, width, share };
    refused(
        &NOT_POSITIVE,
        &[
            ("density", &|x| wood().with_density(x)),
            ("Young's modulus", &|x| wood().with_elasticity(x, 0.3, 1e-2)),
            ("thickness", &|x| wood().with_elasticity(1e9, 0.3, x)),
            ("foundation modulus", &|x| wood().with_model(local(x, 1e-3, 0.5))),
            ("width", &|x| wood().with_model(local(1e8, x, 0.5))),
        ],
    );
    refused(
        &NEGATIVE,
        &[
            ("friction", &|x| wood().with_friction(x)),
            ("relaxation time", &|x| wood().with_relaxation_time(x)),
            ("Poisson's ratio", &|x| wood().with_elasticity(1e9, x, 1e-2)),
            ("share", &|x| wood().with_model(local(1e8, 1e-3, x))),
            ("relaxation time of its own", &|x| Material { relaxation_time: x, ..wood() }.checked()),
        ],
    );
    assert_refused("friction 1e200", wood().with_friction(1e200));
    assert_refused("share 1", wood().with_model(local(1e8, 1e-3, 1.0)));
    assert_refused("unknown", Material::preset("mithril"));
}

#[test]
fn surfaces() {
    let with_size = |x| Vec3::new(0.1, 0.1, x);
    refused(
        &NOT_POSITIVE,
        &[
            ("box", &|x| shapes::sample_box(with_size(x), 100)),
            ("sphere", &|x| shapes::sample_sphere(x, 100)),
            ("capsule", &|x| shapes::sample_capsule(x, 0.1, 100)),
            ("cylinder radius", &|x| shapes::sample_cylinder(x, 0.1, 100)),
            ("cylinder length", &|x| shapes::sample_cylinder(0.1, x, 100)),
            ("half-space", &|x| shapes::sample_half_space(x, 100)),
            ("fingertip", &|x| shapes::sample_fingertip(with_size(x), 100)),
            ("scale", &|x| shapes::sample_sphere(0.1, 100)?.scaled(x)),
        ],
    );
    refused(&NEGATIVE, &[("capsule length", &|x| shapes::sample_capsule(0.1, x, 100))]);
    refused(
        &NOT_FINITE,
        &[
            ("offset", &|x| shapes::sample_sphere(0.1, 100)?.translated(Vec3::new(x, 0.0, 0.0))),
            ("pose", &|x| shapes::sample_sphere(0.1, 100)?.transformed(&at(x))),
            ("turn", &|x| shapes::sample_sphere(0.1, 100)?.transformed(&turned_by(x))),
        ],
    );
    refused(
        &NOT_POSITIVE,
        &[("bandwidth", &|x| Kernel::new(x, 1.0)), ("cutoff", &|x| Kernel::new(1.0, x)), ("spacing", &Kernel::for_spacing)],
    );
    for n in [0, 1, 3] {
        assert_refused(&format!("box of {n} points"), shapes::sample_box(Vec3::repeat(0.1), n));
        assert_refused(&format!("sphere of {n} points"), shapes::sample_sphere(0.1, n));
        assert_refused(&format!("capsule of {n} points"), shapes::sample_capsule(0.1, 0.1, n));
        assert_refused(&format!("cylinder of {n} points"), shapes::sample_cylinder(0.1, 0.1, n));
        assert_refused(&format!("half-space of {n} points"), shapes::sample_half_space(0.1, n));
        assert_refused(&format!("fingertip of {n} points"), shapes::sample_fingertip(Vec3::repeat(0.1), n));
    }
    assert_refused("no points", PointSurface::from_points(vec![]));
    assert_refused("no points, no normals", PointSurface::from_points_and_normals(vec![], vec![]));
    let points = shapes::sample_sphere(0.1, 60).unwrap();
    let (p, n, a) = (points.points().to_vec(), points.normals().to_vec(), points.areas().to_vec());
    refused(
        &NOT_FINITE,
        &[
            ("a point", &|x| PointSurface::from_points(p.iter().map(|q| q * 1.0).chain([Vec3::repeat(x)]).collect())),
            ("a normal", &|x| PointSurface::new(p.clone(), n.iter().map(|m| m * x).collect(), a.clone())),
        ],
    );
    refused(&NOT_POSITIVE, &[("an area", &|x| PointSurface::new(p.clone(), n.clone(), a.iter().map(|_| x).collect()))]);
    assert_refused("zero normals", PointSurface::new(p.clone(), vec![Vec3::zeros(); 60], a.clone()));
    assert_refused("fewer normals", PointSurface::new(p.clone(), n[1..].to_vec(), a.clone()));
    assert_refused("fewer areas", PointSurface::new(p.clone(), n.clone(), a[1..].to_vec()));
    assert_refused("all in one place", PointSurface::from_points(vec![Vec3::x(); 50]));
    assert_refused("on one line", PointSurface::from_points((0..50).map(|i| Vec3::x() * i as Real).collect()));
    for control_points in [0, 31, 1000, usize::MAX] {
        assert_refused(&format!("{control_points} control points for 60 points"), Surface::build(points.clone(), Some(control_points)));
    }
}

#[test]
fn bodies() {
    refused(
        &NOT_FINITE,
        &[
            ("position", &|x| RigidBody::free("b", ball(), Motion::Inertial, at(x)).map(drop)),
            ("rotation", &|x| RigidBody::free("b", ball(), Motion::Inertial, turned_by(x)).map(drop)),
            ("fixed position", &|x| RigidBody::fixed("b", at(x)).map(drop)),
            ("set pose", &|x| free().set_pose(at(x))),
            ("velocity", &|x| free().set_velocity(Vec3::new(x, 0.0, 0.0), Vec3::zeros())),
            ("spin", &|x| free().set_velocity(Vec3::zeros(), Vec3::new(0.0, 0.0, x))),
            ("force", &|x| free().set_external_wrench(Vec3::new(x, 0.0, 0.0), Vec3::zeros())),
            ("torque", &|x| free().set_external_wrench(Vec3::zeros(), Vec3::new(x, 0.0, 0.0))),
            ("target pose", &|x| RigidBody::fixed("b", Pose::identity())?.move_to(at(x))),
            ("drive target", &|x| PoseDrive::new(at(x), [1.0; 2], [1.0; 2]).map(drop)),
        ],
    );
    refused(
        &NEGATIVE,
        &[
            ("linear viscosity", &|x| free().set_viscosity(x, 0.0)),
            ("angular viscosity", &|x| free().set_viscosity(0.0, x)),
            ("stiffness", &|x| PoseDrive::new(Pose::identity(), [1.0, x], [0.0; 2]).map(drop)),
            ("damping", &|x| PoseDrive::new(Pose::identity(), [1.0; 2], [x, 0.0]).map(drop)),
        ],
    );
    assert_refused("a quasi-static body without viscosity", {
        RigidBody::free("b", ball(), Motion::QuasiStatic, Pose::identity()).unwrap().set_viscosity(0.0, 1.0)
    });
    let mut fixed = RigidBody::fixed("b", Pose::identity()).unwrap();
    assert_refused("velocity of a fixed body", fixed.set_velocity(Vec3::x(), Vec3::zeros()));
    assert_refused("force on a fixed body", fixed.set_external_wrench(Vec3::x(), Vec3::zeros()));
    assert_refused("a free body with a target", free().move_to(Pose::identity()));
    let mut broken = PoseDrive::new(Pose::identity(), [1.0; 2], [0.0; 2]).unwrap();
    broken.target_velocity[3] = NAN;
    assert_refused("target velocity", free().set_drive(Some(broken)));
}

#[test]
fn fingers_and_hands() {
    let hand = HandModel::three_finger().unwrap();
    let model = &hand.fingers()[0];
    let joints = model.joints().to_vec();
    let with = |change: &dyn Fn(&mut quasirigid::body::JointModel)| {
        let mut joints = joints.clone();
        change(&mut joints[2]);
        FingerModel::new("finger", Pose::identity(), joints)
    };
    refused(
        &NEGATIVE,
        &[
            ("viscosity", &|x| with(&|j| j.viscosity = x)),
            ("armature", &|x| with(&|j| j.armature = x)),
            ("stiffness", &|x| with(&|j| j.stiffness = x)),
            ("damping", &|x| with(&|j| j.damping = x)),
        ],
    );
    refused(
        &NOT_POSITIVE,
        &[
            ("torque limit", &|x| with(&|j| j.torque_limit = x)),
            ("axis", &|x| with(&|j| j.axis = if x < 0.0 { Vec3::zeros() } else { Vec3::x() * x })),
        ],
    );
    refused(&NOT_FINITE, &[("origin", &|x| with(&|j| j.origin = at(x))), ("base", &|x| FingerModel::new("finger", at(x), joints.clone()))]);
    assert_refused("crossed limits", with(&|j| (j.lower, j.upper) = (1.0, -1.0)));
    assert_refused("no joint", FingerModel::new("finger", Pose::identity(), vec![]));
    assert_refused("seven joints", FingerModel::new("finger", Pose::identity(), vec![joints[0].clone(); 7]));
    let finger = || Finger::new(model.clone(), Motion::Inertial, Pose::identity(), &[0.0, 0.1, 0.1, 0.1]).unwrap();
    assert_refused("stiff quasi-static joint", {
        Finger::new(with(&|j| j.viscosity = 0.0).unwrap(), Motion::QuasiStatic, Pose::identity(), &[0.0; 4])
    });
    assert_refused("three joint positions", Finger::new(model.clone(), Motion::Inertial, Pose::identity(), &[0.0; 3]));
    assert_refused("beyond the limits", finger().set_joint_positions(&[0.0, 9.0, 0.0, 0.0]));
    refused(
        &NOT_FINITE,
        &[
            ("joint positions", &|x| finger().set_joint_positions(&[0.0, x, 0.0, 0.0])),
            ("joint targets", &|x| finger().set_joint_targets(&[0.0, x, 0.0, 0.0])),
            ("velocities of targets", &|x| finger().set_moving_joint_targets(&[0.0; 4], &[0.0, x, 0.0, 0.0])),
            ("tip goal", &|x| TipGoal::at(Vec3::new(x, 0.0, 0.0)).map(drop)),
            ("tip normal", &|x| TipGoal::facing(Vec3::zeros(), Vec3::new(x, 0.0, 0.0)).map(drop)),
        ],
    );
    assert_refused("two targets", finger().set_joint_targets(&[0.0; 2]));
    assert_refused("zero normal", TipGoal::facing(Vec3::zeros(), Vec3::zeros()));
    let goal = TipGoal::at(Vec3::new(0.0, 0.0, -0.08)).unwrap();
    refused(
        &NOT_POSITIVE,
        &[("position tolerance", &|x| {
            let options = IkOptions { position_tolerance: x, ..IkOptions::default() };
            inverse_kinematics(model, &hand.tips()[0].apex(), &goal, &[0.0; 4], &options)
        })],
    );
    assert_refused("a hand without fingers", HandModel::new("hand", vec![], vec![]));
    assert_refused("a hand of one tip", HandModel::new("hand", hand.fingers().to_vec(), vec![hand.tips()[0]]));

    let mut world = World::new(Parameters::default()).unwrap();
    let pad = shapes::sample_fingertip(Vec3::new(0.012, 0.0085, 0.007), 200).unwrap();
    let pulp = Material::preset("fingertip_pulp").unwrap();
    refused(&NOT_FINITE, &[("base", &|x| World::new(Parameters::default())?.add_hand(&hand, at(x), Motion::Inertial, &pad, None, &pulp))]);
    assert_refused("no control points", world.add_hand(&hand, Pose::identity(), Motion::Inertial, &pad, Some(0), &pulp));
    assert!(world.bodies().is_empty(), "a refused hand leaves nothing behind: {} bodies", world.bodies().len());
    let handle = world.add_hand(&hand, Pose::identity(), Motion::Inertial, &pad, None, &pulp).unwrap();
    for x in NOT_FINITE {
        assert_refused("hand target", world.move_hand_to(handle, at(x)));
    }
    assert_refused("finger 3 of 3", world.finger(handle, 3));
}

#[test]
fn solver_problems() {
    let block = Mat3::identity() * 1e-3;
    assert!(Assembled::from_dense(1, &[block]).is_ok());
    assert_refused("no block", Assembled::from_dense(1, &[]));
    for x in NOT_POSITIVE {
        assert_refused("diagonal block", Assembled::from_dense(1, &[Mat3::identity() * x]));
    }
    assert_refused("starts", Assembled::from_block_rows(vec![0, 2], vec![0], vec![block]));
    assert_refused("column", Assembled::from_block_rows(vec![0, 1], vec![1], vec![block]));
    assert_refused("lengths", check_problem(2, &[Vec3::zeros()], &[0.5, 0.5]));
    assert_refused("friction", check_problem(1, &[Vec3::zeros()], &[-0.5]));
    assert_refused("gap", check_problem(1, &[Vec3::new(NAN, 0.0, 0.0)], &[0.5]));
}

#[test]
fn scenes_and_controllers() {
    let small = || GraspOptions { object_points: (1_200, 160), pad_points: (300, 40), ..GraspOptions::default() };
    refused(
        &NOT_POSITIVE,
        &[
            ("mass", &|x| GraspScene::new(&GraspOptions { mass: x, ..small() }).map(drop)),
            ("size", &|x| GraspScene::new(&GraspOptions { size: Vec3::new(0.06, 0.06, x), ..small() }).map(drop)),
            ("squeeze", &|x| GraspScene::new(&GraspOptions { squeeze: x, ..small() }).map(drop)),
        ],
    );
    assert_refused("too wide a box", GraspScene::new(&GraspOptions { size: Vec3::new(0.3, 0.06, 0.06), ..small() }));
    assert_refused("no points", GraspScene::new(&GraspOptions { object_points: (0, 0), ..small() }));
    refused(&NEGATIVE, &[("friction", &|x| PinchOptions::fingertips(x).map(drop))]);
    refused(&NOT_POSITIVE, &[("mass", &|x| Pinch::new(&PinchOptions { mass: x, ..PinchOptions::fingertips(0.5)? }).map(drop))]);
    let rubber = Material::preset("rubber").unwrap();
    refused(&NEGATIVE, &[("friction", &|x| Incline::new(Parameters::default(), &rubber, x, Motion::Inertial).map(drop))]);

    let mut scene = GraspScene::new(&small()).unwrap();
    let path = PadPath { start: Vec3::new(0.038, 0.0, -0.085), direction: -Vec3::x(), share: 1.0 };
    assert_refused("one path for three fingers", Grip::new(&mut scene.world, scene.hand, &[path], 1.0));
    assert_refused("a start out of reach", Grip::new(&mut scene.world, scene.hand, &[PadPath { start: Vec3::x(), ..path }; 3], 1.0));
    for x in NOT_POSITIVE {
        assert_refused("squeeze", scene.grip.set_squeeze(x));
        assert_refused("share", Grip::new(&mut scene.world, scene.hand, &[PadPath { share: x, ..path }; 3], 1.0));
        if x != -1.0 {
            assert_refused("direction", Grip::new(&mut scene.world, scene.hand, &[PadPath { direction: Vec3::x() * x, ..path }; 3], 1.0));
        }
    }
}

/// A material whose public fields were spoilt by hand must not enter a world.
#[test]
fn a_spoilt_material_does_not_enter_a_world() {
    let mut spoilt = Material::preset("wood").unwrap();
    spoilt.friction = NAN.into();
    let mut world = World::new(Parameters::default()).unwrap();
    let pad = shapes::sample_fingertip(Vec3::new(0.012, 0.0085, 0.007), 200).unwrap();
    let hand = HandModel::three_finger().unwrap();
    assert_refused("hand", world.add_hand(&hand, Pose::identity(), Motion::Inertial, &pad, None, &spoilt));
    assert!(world.bodies().is_empty());
}
