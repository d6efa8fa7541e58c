//! `Body`: a handle to a rigid body of a world.

use crate::collider::Collider;
use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::mass_properties::mass_properties;
use crate::material::Material;
use crate::process::SharedWorld;
use crate::skin::{deformed_normals, deformed_points, displacements, first, material, moved_points, surface};
use crate::surface::Surface;
use numpy::PyArray2;
use pyo3::prelude::*;
use quasirigid::body::{PoseDrive, RigidBody};
use quasirigid::math::{Real, Vec3};
use quasirigid::objects::Side;
use quasirigid::{BodyHandle, Error, Result};

#[doc = doc!("Body")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Body {
    pub(crate) world: SharedWorld,
    pub(crate) handle: BodyHandle,
}

impl Body {
    fn read<T>(&self, py: Python<'_>, of: impl FnOnce(&RigidBody) -> T) -> PyResult<T> {
        let world = self.world.lock(py)?;
        world.body(self.handle).map(of).or_raise(py)
    }

    /// Reads from the first collider; `None` where there is none.
    fn of_first<T>(&self, py: Python<'_>, of: impl FnOnce(Side<'_>) -> T) -> PyResult<Option<T>> {
        let world = self.world.lock(py)?;
        first(&world, self.handle).map(|side| side.map(of)).or_raise(py)
    }

    fn write(&self, py: Python<'_>, change: impl FnOnce(&mut RigidBody) -> Result<()>) -> PyResult<()> {
        let mut world = self.world.lock(py)?;
        world.body_mut(self.handle).and_then(change).or_raise(py)
    }
}

#[pymethods]
impl Body {
    #[getter]
    fn name(&self, py: Python<'_>) -> PyResult<String> {
        self.read(py, |body| body.name().to_owned())
    }

    #[doc = doc!("Body.index")]
    #[getter]
    fn index(&self, py: Python<'_>) -> PyResult<usize> {
        self.world.lock(py)?.dense(self.handle).or_raise(py)
    }

    #[doc = doc!("Body.colliders")]
    #[getter]
    fn colliders(this: &Bound<'_, Self>) -> PyResult<Vec<Collider>> {
        let (py, body) = (this.py(), this.get());
        let handles = body.world.lock(py)?.colliders_of(body.handle).or_raise(py)?;
        let owner = || this.clone().into_any().unbind();
        Ok(handles.into_iter().map(|handle| Collider { world: body.world.clone(), handle, owner: owner(), finger: None }).collect())
    }

    #[doc = doc!("Body.mass")]
    #[getter]
    fn mass(&self, py: Python<'_>) -> PyResult<Real> {
        self.read(py, |body| if body.dof() == 0 { 0.0 } else { body.mass_properties().mass() })
    }

    #[doc = doc!("Body.surface")]
    #[getter]
    fn surface(&self, py: Python<'_>) -> PyResult<Option<Surface>> {
        self.of_first(py, surface)
    }

    #[doc = doc!("Body.material")]
    #[getter]
    fn material(&self, py: Python<'_>) -> PyResult<Option<Material>> {
        self.of_first(py, material)
    }

    #[setter]
    fn set_material(&self, py: Python<'_>, value: &Material) -> PyResult<()> {
        self.world.lock(py)?.set_material(self.handle, &value.engine).or_raise(py)
    }

    #[doc = doc!("Body.set_mass")]
    fn set_mass(&self, py: Python<'_>, mass: &Bound<'_, PyAny>) -> PyResult<()> {
        let surface = self.surface(py)?;
        let surface = surface.ok_or_else(|| {
            to_py(py, &Error::value("mass", "a body with a surface", "one without", "give MassProperties when it is added"))
        })?;
        let mass = mass_properties(Some(mass), &surface.engine, py)?;
        self.world.lock(py)?.set_mass(self.handle, mass).or_raise(py)
    }

    #[doc = doc!("Body.quarantined")]
    #[getter]
    fn quarantined(&self, py: Python<'_>) -> PyResult<bool> {
        self.world.lock(py)?.entry(self.handle).map(|entry| entry.quarantined).or_raise(py)
    }

    #[doc = doc!("Body.position")]
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let position = self.read(py, |body| body.pose().translation.vector)?;
        conv::state("Body.position", conv::from_vec3(py, &position))
    }

    #[doc = doc!("Body.quaternion")]
    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rotation = self.read(py, |body| body.pose().rotation)?;
        conv::state("Body.quaternion", conv::from_rot(py, &rotation))
    }

    #[doc = doc!("Body.centre_of_mass")]
    #[getter]
    fn centre_of_mass<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let centre = self.read(py, RigidBody::center_of_mass)?;
        conv::state("Body.centre_of_mass", conv::from_vec3(py, &centre))
    }

    #[doc = doc!("Body.linear_velocity")]
    #[getter]
    fn linear_velocity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let velocity = self.read(py, |body| *body.linear_velocity())?;
        conv::state("Body.linear_velocity", conv::from_vec3(py, &velocity))
    }

    #[doc = doc!("Body.angular_velocity")]
    #[getter]
    fn angular_velocity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let velocity = self.read(py, RigidBody::angular_velocity)?;
        conv::state("Body.angular_velocity", conv::from_vec3(py, &velocity))
    }

    #[doc = doc!("Body.set_velocity")]
    #[pyo3(signature = (linear, angular = None), text_signature = "($self, linear, angular=(0.0, 0.0, 0.0))")]
    fn set_velocity(&self, py: Python<'_>, linear: &Bound<'_, PyAny>, angular: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let linear = conv::vec3(linear, "linear")?;
        let angular = angular.map_or(Ok(Vec3::zeros()), |w| conv::vec3(w, "angular"))?;
        self.write(py, |body| body.set_velocity(linear, angular))
    }

    #[doc = doc!("Body.apply_wrench")]
    #[pyo3(signature = (force, torque = None), text_signature = "($self, force, torque=(0.0, 0.0, 0.0))")]
    fn apply_wrench(&self, py: Python<'_>, force: &Bound<'_, PyAny>, torque: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let force = conv::vec3(force, "force")?;
        let torque = torque.map_or(Ok(Vec3::zeros()), |t| conv::vec3(t, "torque"))?;
        self.write(py, |body| body.set_external_wrench(force, torque))
    }

    #[doc = doc!("Body.move_to")]
    #[pyo3(signature = (position, quaternion = None))]
    fn move_to(&self, py: Python<'_>, position: &Bound<'_, PyAny>, quaternion: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let current = self.read(py, |body| body.pose().rotation)?;
        let pose = conv::pose(position, quaternion, &current)?;
        self.write(py, |body| body.move_to(pose))
    }

    #[doc = doc!("Body.set_pose")]
    #[pyo3(signature = (position, quaternion = None))]
    fn set_pose(&self, py: Python<'_>, position: &Bound<'_, PyAny>, quaternion: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let current = self.read(py, |body| body.pose().rotation)?;
        let pose = conv::pose(position, quaternion, &current)?;
        self.write(py, |body| body.set_pose(pose))
    }

    #[doc = doc!("Body.set_drive")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (position, quaternion = None, *, stiffness, damping, linear_velocity = None, angular_velocity = None,
                        max_pull = None, max_speed = None),
           text_signature = "($self, position, quaternion=None, *, stiffness, damping, linear_velocity=(0.0, 0.0, 0.0), \
                             angular_velocity=(0.0, 0.0, 0.0), max_pull=None, max_speed=None)")]
    fn set_drive(
        &self,
        py: Python<'_>,
        position: &Bound<'_, PyAny>,
        quaternion: Option<&Bound<'_, PyAny>>,
        stiffness: &Bound<'_, PyAny>,
        damping: &Bound<'_, PyAny>,
        linear_velocity: Option<&Bound<'_, PyAny>>,
        angular_velocity: Option<&Bound<'_, PyAny>>,
        max_pull: Option<&Bound<'_, PyAny>>,
        max_speed: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let current = self.read(py, |body| body.pose().rotation)?;
        let target = conv::pose(position, quaternion, &current)?;
        let mut drive =
            PoseDrive::new(target, conv::pair(stiffness, "stiffness")?.into(), conv::pair(damping, "damping")?.into()).or_raise(py)?;
        for (rows, value, what) in [(0, linear_velocity, "linear_velocity"), (3, angular_velocity, "angular_velocity")] {
            if let Some(value) = value {
                drive.target_velocity.fixed_rows_mut::<3>(rows).copy_from(&conv::vec3(value, what)?);
            }
        }
        for (limit, value, what) in [(&mut drive.max_pull, max_pull, "max_pull"), (&mut drive.max_speed, max_speed, "max_speed")] {
            if let Some(value) = value {
                *limit = conv::pair(value, what)?.into();
            }
        }
        self.write(py, |body| body.set_drive(Some(drive)))
    }

    #[doc = doc!("Body.clear_drive")]
    fn clear_drive(&self, py: Python<'_>) -> PyResult<()> {
        self.write(py, |body| body.set_drive(None))
    }

    #[doc = doc!("Body.deformed_normals")]
    fn deformed_normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let normals = self.of_first(py, deformed_normals)?.unwrap_or_default();
        conv::from_points(py, normals)
    }

    #[doc = doc!("Body.deformed_points")]
    fn deformed_points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let points = self.of_first(py, deformed_points)?.unwrap_or_default();
        conv::from_points(py, points)
    }

    #[doc = doc!("Body.moved_points")]
    fn moved_points<'py>(&self, py: Python<'py>) -> PyResult<conv::Numbered<'py>> {
        let moved = self.of_first(py, moved_points)?.unwrap_or_default();
        conv::from_numbered(py, moved)
    }

    #[doc = doc!("Body.displacements")]
    fn displacements<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let values = self.of_first(py, displacements)?.unwrap_or_default();
        conv::from_points(py, values)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let place = |body: &RigidBody| {
            let p = body.pose().translation.vector;
            format!("Body({:?}, position=({:.6}, {:.6}, {:.6}))", body.name(), p.x, p.y, p.z)
        };
        self.read(py, place).unwrap_or_else(|_| "Body(removed)".into())
    }
}
