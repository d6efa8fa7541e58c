//! `Hand`: a handle to a hand of a world.

use crate::collider::Collider;
use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::grip::Grip;
use crate::material::Material;
use crate::process::SharedWorld;
use crate::skin::{deformed_normals, deformed_points, displacements, first, material, moved_points, surface};
use crate::surface::Surface;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use quasirigid::body::Finger;
use quasirigid::control::grip::PadPath;
use quasirigid::control::inverse_kinematics::{IkOptions, IkSolution, TipGoal, inverse_kinematics};
use quasirigid::math::{Pose, Real, Vec3};
use quasirigid::objects::Side;
use quasirigid::{Error, HandHandle, Result};

/// More iterations of inverse kinematics than this help nobody, and cannot be broken off.
const MOST_ITERATIONS: i64 = 100_000;

/// Positions (fingers, 3) and quaternions (fingers, 4).
type Poses<'py> = (Bound<'py, PyArray2<Real>>, Bound<'py, PyArray2<Real>>);

/// Joint positions (fingers, joints), and by how much they miss (fingers,).
type Postures<'py> = (Bound<'py, PyArray2<Real>>, Bound<'py, PyArray1<Real>>);

#[doc = doc!("Hand")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Hand {
    pub(crate) world: SharedWorld,
    pub(crate) handle: HandHandle,
}

impl Hand {
    fn read<T>(&self, py: Python<'_>, of: impl FnOnce(&quasirigid::World, &quasirigid::world::Hand) -> Result<T>) -> PyResult<T> {
        let world = self.world.lock(py)?;
        world.hand(self.handle).and_then(|hand| of(&world, hand)).or_raise(py)
    }

    /// One row per finger.
    fn table<'py>(&self, py: Python<'py>, of: impl Fn(&Finger) -> &[Real]) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let (values, joints) = self.read(py, |world, hand| {
            let mut values = Vec::new();
            for finger in 0..hand.fingers.len() {
                values.extend_from_slice(of(world.finger(self.handle, finger)?));
            }
            Ok((values, hand.model.fingers()[0].dof()))
        })?;
        conv::rows(py, values, joints)
    }

    /// Gives every finger its row.
    fn set_table(
        &self,
        value: &Bound<'_, PyAny>,
        what: &str,
        set: impl Fn(&mut Finger, &[Real]) -> Result<()>,
        check: impl Fn(&Finger, &[Real]) -> Result<()>,
    ) -> PyResult<()> {
        let py = value.py();
        let (fingers, joints) = self.read(py, |_, hand| Ok((hand.fingers.len(), hand.model.fingers()[0].dof())))?;
        let rows = conv::table(value, what, fingers, joints)?;
        let mut world = self.world.lock(py)?;
        // All rows are looked at before the first is set: a refused table changes nothing.
        for (finger, row) in rows.chunks_exact(joints).enumerate() {
            world.finger(self.handle, finger).and_then(|f| check(f, row)).or_raise(py)?;
        }
        for (finger, row) in rows.chunks_exact(joints).enumerate() {
            world.finger_mut(self.handle, finger).and_then(|f| set(f, row)).or_raise(py)?;
        }
        Ok(())
    }

    /// As near as a finger comes to its goal from `start`.
    fn nearest(
        &self,
        world: &quasirigid::World,
        hand: &quasirigid::world::Hand,
        finger: usize,
        goal: &TipGoal,
        start: &[Real],
        options: &IkOptions,
    ) -> Result<IkSolution> {
        inverse_kinematics(world.finger(self.handle, finger)?.model(), &hand.model.tips()[finger].apex(), goal, start, options)
    }

    /// Reads from the first collider of a finger; `None` where there is none.
    fn of_first<T>(&self, py: Python<'_>, finger: conv::Whole, of: impl FnOnce(Side<'_>) -> T) -> PyResult<Option<T>> {
        let finger = conv::count(py, "finger", finger)?;
        self.read(py, |world, _| Ok(first(world, world.finger_handle(self.handle, finger)?)?.map(of)))
    }
}

#[pymethods]
impl Hand {
    #[getter]
    fn name(&self, py: Python<'_>) -> PyResult<String> {
        self.read(py, |_, hand| Ok(hand.model.name().to_owned()))
    }

    #[doc = doc!("Hand.position")]
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let base = self.read(py, |_, hand| Ok(hand.base))?;
        conv::state("Hand.position", conv::from_vec3(py, &base.translation.vector))
    }

    #[doc = doc!("Hand.quaternion")]
    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let base = self.read(py, |_, hand| Ok(hand.base))?;
        conv::state("Hand.quaternion", conv::from_rot(py, &base.rotation))
    }

    #[doc = doc!("Hand.move_to")]
    #[pyo3(signature = (position, quaternion = None))]
    fn move_to(&self, py: Python<'_>, position: &Bound<'_, PyAny>, quaternion: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let current = self.read(py, |_, hand| Ok(hand.base.rotation))?;
        let pose = conv::pose(position, quaternion, &current)?;
        self.world.lock(py)?.move_hand_to(self.handle, pose).or_raise(py)
    }

    #[getter]
    fn finger_count(&self, py: Python<'_>) -> PyResult<usize> {
        self.read(py, |_, hand| Ok(hand.fingers.len()))
    }

    #[getter]
    fn finger_names(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.read(py, |_, hand| Ok(hand.model.fingers().iter().map(|finger| finger.name().to_owned()).collect()))
    }

    #[doc = doc!("Hand.body_indices")]
    #[getter]
    fn body_indices(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        self.read(py, |world, hand| hand.fingers.iter().map(|&finger| world.dense(finger)).collect())
    }

    #[doc = doc!("Hand.quarantined")]
    #[getter]
    fn quarantined(&self, py: Python<'_>) -> PyResult<bool> {
        let states = self.read(py, |world, hand| hand.fingers.iter().map(|&finger| world.entry(finger).map(|e| e.quarantined)).collect());
        states.map(|states: Vec<bool>| states.contains(&true))
    }

    #[doc = doc!("Hand.joint_positions")]
    #[getter]
    fn joint_positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("Hand.joint_positions", self.table(py, Finger::joint_positions)?)
    }

    #[setter]
    fn set_joint_positions(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let check = |finger: &Finger, row: &[Real]| finger.clone().set_joint_positions(row);
        self.set_table(value, "joint_positions", Finger::set_joint_positions, check)
    }

    #[doc = doc!("Hand.joint_velocities")]
    #[getter]
    fn joint_velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("Hand.joint_velocities", self.table(py, Finger::joint_velocities)?)
    }

    #[doc = doc!("Hand.joint_targets")]
    #[getter]
    fn joint_targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("Hand.joint_targets", self.table(py, Finger::joint_targets)?)
    }

    #[setter]
    fn set_joint_targets(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        // Any finite number will do, and `conv` has seen to that.
        self.set_table(value, "joint_targets", Finger::set_joint_targets, |_, _| Ok(()))
    }

    #[doc = doc!("Hand.joint_torques")]
    #[getter]
    fn joint_torques<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("Hand.joint_torques", self.table(py, Finger::motor_torques)?)
    }

    #[doc = doc!("Hand.tip_poses")]
    fn tip_poses<'py>(&self, py: Python<'py>) -> PyResult<Poses<'py>> {
        let poses: Vec<Pose> = self.read(py, |world, hand| {
            let tips = hand.model.tips().iter().enumerate();
            tips.map(|(i, tip)| world.finger(self.handle, i).map(|f| f.link_pose(f.model().dof() - 1) * tip.apex())).collect()
        })?;
        let turns = poses.iter().flat_map(|p| [p.rotation.w, p.rotation.i, p.rotation.j, p.rotation.k]).collect();
        Ok((conv::from_points(py, poses.iter().map(|p| p.translation.vector))?, conv::rows(py, turns, 4)?))
    }

    #[doc = doc!("Hand.blocked_forces")]
    fn blocked_forces<'py>(&self, joint_targets: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let py = joint_targets.py();
        let (fingers, joints) = self.read(py, |_, hand| Ok((hand.fingers.len(), hand.model.fingers()[0].dof())))?;
        let targets = conv::table(joint_targets, "joint targets", fingers, joints)?;
        let forces: Vec<Vec3> = self.read(py, |world, hand| {
            let rows = hand.model.tips().iter().zip(targets.chunks_exact(joints)).enumerate();
            rows.map(|(i, (tip, row))| {
                let (finger, last) = (world.finger(self.handle, i)?, joints - 1);
                finger.blocked_force(last, &(finger.link_pose(last) * tip.apex()).translation.vector, row)
            })
            .collect()
        })?;
        conv::from_points(py, forces)
    }

    #[doc = doc!("Hand.link_poses")]
    #[getter]
    fn link_poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (values, fingers, joints) = self.read(py, |world, hand| {
            let (fingers, joints) = (hand.fingers.len(), hand.model.fingers()[0].dof());
            let mut values = Vec::with_capacity(7 * fingers * joints);
            for i in 0..fingers {
                let finger = world.finger(self.handle, i)?;
                for p in (0..joints).map(|link| finger.link_pose(link)) {
                    values.extend_from_slice(p.translation.vector.as_slice());
                    values.extend([p.rotation.w, p.rotation.i, p.rotation.j, p.rotation.k]);
                }
            }
            Ok((values, fingers, joints))
        })?;
        conv::state("Hand.link_poses", values.into_pyarray(py).reshape([fingers, joints, 7])?)
    }

    #[doc = doc!("Hand.inverse_kinematics")]
    fn inverse_kinematics<'py>(
        &self,
        py: Python<'py>,
        finger: conv::Whole,
        position: &Bound<'_, PyAny>,
        normal: &Bound<'_, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<Real>>> {
        let finger = conv::count(py, "finger", finger)?;
        let goal = TipGoal::facing(conv::vec3(position, "position")?, conv::vec3(normal, "normal")?).or_raise(py)?;
        let found = self.read(py, |world, hand| {
            let body = world.finger(self.handle, finger)?;
            let tip = hand.model.tips()[finger].apex();
            let found = inverse_kinematics(body.model(), &tip, &goal, body.joint_positions(), &IkOptions::default())?;
            Ok(found.converged.then(|| found.positions[..body.model().dof()].to_vec()).ok_or(found))
        })?;
        found.map(|joints| conv::from_vec(py, joints)).map_err(|best| {
            let (mm, degrees) = (1e3 * best.position_error, best.angle_error.to_degrees());
            let got = format!("{:?} m, missed by {mm:.2} mm and {degrees:.2} degrees", goal.position.as_slice());
            let expected = "a place and a direction that the finger reaches";
            to_py(py, &Error::value("position", expected, got, "aim nearer to the palm, or move the hand"))
        })
    }

    #[doc = doc!("Hand.reach")]
    #[pyo3(signature = (finger, position, normal, *, start = None, angle_weight = 0.005, iterations = 20.into()),
           text_signature = "($self, finger, position, normal, *, start=None, angle_weight=0.005, iterations=20)")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    fn reach<'py>(
        &self,
        py: Python<'py>,
        finger: conv::Whole,
        position: &Bound<'_, PyAny>,
        normal: &Bound<'_, PyAny>,
        start: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = conv::real)] angle_weight: Real,
        iterations: conv::Whole,
    ) -> PyResult<(Bound<'py, PyArray1<Real>>, Real)> {
        let finger = conv::count(py, "finger", finger)?;
        let goal = TipGoal::facing(conv::vec3(position, "position")?, conv::vec3(normal, "normal")?).or_raise(py)?;
        let start = start.map(|start| conv::vector(start, "start")).transpose()?;
        let max_iterations = conv::within(py, "iterations", iterations, 0, MOST_ITERATIONS)? as usize;
        let options = IkOptions { angle_weight, max_iterations, restarts: 0, ..IkOptions::default() };
        let (joints, error) = self.read(py, |world, hand| {
            let start = start.as_deref().map_or_else(|| world.finger(self.handle, finger).map(Finger::joint_targets), Ok)?;
            let found = self.nearest(world, hand, finger, &goal, start, &options)?;
            Ok((found.positions[..start.len()].to_vec(), found.position_error))
        })?;
        Ok((conv::from_vec(py, joints), error))
    }

    #[doc = doc!("Hand.reach_all")]
    #[pyo3(signature = (positions, normals, start, *, angle_weight = 0.005, iterations = 20.into(), step_tolerance = 1e-12),
           text_signature = "($self, positions, normals, start, *, angle_weight=0.005, iterations=20, step_tolerance=1e-12)")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    fn reach_all<'py>(
        &self,
        py: Python<'py>,
        positions: &Bound<'_, PyAny>,
        normals: &Bound<'_, PyAny>,
        start: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = conv::real)] angle_weight: Real,
        iterations: conv::Whole,
        #[pyo3(from_py_with = conv::real)] step_tolerance: Real,
    ) -> PyResult<Postures<'py>> {
        let (fingers, joints) = self.read(py, |_, hand| Ok((hand.fingers.len(), hand.model.fingers()[0].dof())))?;
        let positions = conv::table(positions, "positions", fingers, 3)?;
        let normals = conv::table(normals, "normals", fingers, 3)?;
        let start = conv::table(start, "start", fingers, joints)?;
        let max_iterations = conv::within(py, "iterations", iterations, 0, MOST_ITERATIONS)? as usize;
        let options = IkOptions { angle_weight, step_tolerance, max_iterations, restarts: 0, ..IkOptions::default() };
        let (mut found, mut errors) = (Vec::with_capacity(fingers * joints), Vec::with_capacity(fingers));
        self.read(py, |world, hand| {
            for (finger, start) in start.chunks_exact(joints).enumerate() {
                let row = 3 * finger..3 * finger + 3;
                let goal = TipGoal::facing(Vec3::from_column_slice(&positions[row.clone()]), Vec3::from_column_slice(&normals[row]))?;
                let nearest = self.nearest(world, hand, finger, &goal, start, &options)?;
                found.extend_from_slice(&nearest.positions[..joints]);
                errors.push(nearest.position_error);
            }
            Ok(())
        })?;
        Ok((conv::rows(py, found, joints)?, conv::from_vec(py, errors)))
    }

    #[doc = doc!("Hand.deformed_points")]
    fn deformed_points<'py>(&self, py: Python<'py>, finger: conv::Whole) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let points = self.of_first(py, finger, deformed_points)?.unwrap_or_default();
        conv::from_points(py, points)
    }

    #[doc = doc!("Hand.deformed_normals")]
    fn deformed_normals<'py>(&self, py: Python<'py>, finger: conv::Whole) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let normals = self.of_first(py, finger, deformed_normals)?.unwrap_or_default();
        conv::from_points(py, normals)
    }

    #[doc = doc!("Hand.moved_points")]
    fn moved_points<'py>(&self, py: Python<'py>, finger: conv::Whole) -> PyResult<conv::Numbered<'py>> {
        let moved = self.of_first(py, finger, moved_points)?.unwrap_or_default();
        conv::from_numbered(py, moved)
    }

    #[doc = doc!("Hand.surface")]
    fn surface(&self, py: Python<'_>, finger: conv::Whole) -> PyResult<Option<Surface>> {
        self.of_first(py, finger, surface)
    }

    #[doc = doc!("Hand.colliders")]
    fn colliders(this: &Bound<'_, Self>, finger: conv::Whole) -> PyResult<Vec<Collider>> {
        let (py, hand) = (this.py(), this.get());
        let finger = conv::count(py, "finger", finger)?;
        let handles = hand.read(py, |world, _| world.colliders_of(world.finger_handle(hand.handle, finger)?))?;
        let owner = || this.clone().into_any().unbind();
        let collider = |handle| Collider { world: hand.world.clone(), handle, owner: owner(), finger: Some(finger) };
        Ok(handles.into_iter().map(collider).collect())
    }

    #[doc = doc!("Hand.material")]
    #[getter]
    fn material(&self, py: Python<'_>) -> PyResult<Option<Material>> {
        self.of_first(py, 0.into(), material)
    }

    #[setter]
    fn set_material(&self, py: Python<'_>, value: &Material) -> PyResult<()> {
        let fingers = self.read(py, |_, hand| Ok(hand.fingers.clone()))?;
        let mut world = self.world.lock(py)?;
        fingers.into_iter().try_for_each(|finger| world.set_material(finger, &value.engine)).or_raise(py)
    }

    #[doc = doc!("Hand.displacements")]
    fn displacements<'py>(&self, py: Python<'py>, finger: conv::Whole) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let values = self.of_first(py, finger, displacements)?.unwrap_or_default();
        conv::from_points(py, values)
    }

    #[doc = doc!("Hand.grip")]
    #[pyo3(signature = (starts, directions, *, squeeze = 4.0, shares = None))]
    fn grip(
        &self,
        py: Python<'_>,
        starts: &Bound<'_, PyAny>,
        directions: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = conv::real)] squeeze: Real,
        shares: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Grip> {
        let (starts, directions) = (conv::points(starts, "starts")?, conv::points(directions, "directions")?);
        let shares = shares.map(|shares| conv::vector(shares, "shares")).transpose()?;
        let paths = PadPath::of_fingers(&starts, &directions, shares.as_deref()).or_raise(py)?;
        let grip = quasirigid::control::grip::Grip::new(&mut *self.world.lock(py)?, self.handle, &paths, squeeze).or_raise(py)?;
        Ok(Grip::new(self.world.clone(), grip))
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let text = self.read(py, |_, hand| Ok(format!("Hand({:?}, {} fingers)", hand.model.name(), hand.fingers.len())));
        text.unwrap_or_else(|_| "Hand(removed)".into())
    }
}
