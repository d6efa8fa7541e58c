//! `Body`: a handle to a rigid body of a world.

use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::material::Material;
use crate::surface::Surface;
use crate::world::{World, mass_properties};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use quasirigid::body::{BodyEntry, PoseDrive, RigidBody, Skin};
use quasirigid::math::{Real, Vec3};
use quasirigid::{BodyHandle, Error, Result};

#[doc = doc!("Body")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Body {
    pub(crate) world: Py<World>,
    pub(crate) handle: BodyHandle,
}

impl Body {
    fn read<T>(&self, py: Python<'_>, of: impl FnOnce(&RigidBody) -> T) -> PyResult<T> {
        let world = self.world.get().lock(py);
        world.body(self.handle).map(of).or_raise(py)
    }

    fn write(&self, py: Python<'_>, change: impl FnOnce(&mut RigidBody) -> Result<()>) -> PyResult<()> {
        let mut world = self.world.get().lock(py);
        world.body_mut(self.handle).and_then(change).or_raise(py)
    }
}

/// The points of a body's surface as deformed now, world.
pub fn deformed_points(entry: &BodyEntry) -> Vec<Vec3> {
    let Some(skin) = &entry.skin else { return Vec::new() };
    let pose = entry.body.link_pose(entry.skin_link);
    let mut points = skin.surface.in_callers_order(&skin.deformed_points());
    points.iter_mut().for_each(|p| *p = pose.rotation * *p + pose.translation.vector);
    points
}

/// The normals of a body's surface as deformed now, world.
pub fn deformed_normals(entry: &BodyEntry) -> Vec<Vec3> {
    let Some(skin) = &entry.skin else { return Vec::new() };
    let turn = entry.body.link_pose(entry.skin_link).rotation;
    let mut normals = skin.surface.in_callers_order(&skin.deformed_normals());
    normals.iter_mut().for_each(|n| *n = turn * *n);
    normals
}

/// The displaced points of a surface: index and place in the frame of its link.
pub fn moved_points(entry: &BodyEntry) -> (Vec<u32>, Vec<Vec3>) {
    entry.skin.as_ref().map_or_else(Default::default, Skin::moved_points)
}

/// The surface at rest, frame of its link.
pub fn surface(entry: &BodyEntry) -> Option<Surface> {
    entry.skin.as_ref().map(|skin| Surface { engine: skin.surface.clone() })
}

/// What the surface is made of.
pub fn material(entry: &BodyEntry) -> Option<Material> {
    entry.skin.as_ref().map(|skin| Material { engine: skin.material.clone() })
}

/// The elastic displacement of every control point, frame of the link.
pub fn displacements(entry: &BodyEntry) -> Vec<Vec3> {
    entry.skin.as_ref().map_or_else(Vec::new, |skin| skin.displacement.clone())
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
        self.world.get().lock(py).dense(self.handle).or_raise(py)
    }

    #[doc = doc!("Body.mass")]
    #[getter]
    fn mass(&self, py: Python<'_>) -> PyResult<Real> {
        self.read(py, |body| if body.dof() == 0 { 0.0 } else { body.mass_properties().mass() })
    }

    #[doc = doc!("Body.surface")]
    #[getter]
    fn surface(&self, py: Python<'_>) -> PyResult<Option<Surface>> {
        self.world.get().lock(py).entry(self.handle).map(surface).or_raise(py)
    }

    #[doc = doc!("Body.material")]
    #[getter]
    fn material(&self, py: Python<'_>) -> PyResult<Option<Material>> {
        self.world.get().lock(py).entry(self.handle).map(material).or_raise(py)
    }

    #[setter]
    fn set_material(&self, py: Python<'_>, value: &Material) -> PyResult<()> {
        self.world.get().lock(py).set_material(self.handle, &value.engine).or_raise(py)
    }

    #[doc = doc!("Body.set_mass")]
    fn set_mass(&self, py: Python<'_>, mass: &Bound<'_, PyAny>) -> PyResult<()> {
        let surface = self.surface(py)?;
        let surface = surface.ok_or_else(|| {
            to_py(py, &Error::value("mass", "a body with a surface", "one without", "give MassProperties when it is added"))
        })?;
        let mass = mass_properties(Some(mass), &surface.engine, py)?;
        self.world.get().lock(py).set_mass(self.handle, mass).or_raise(py)
    }

    #[doc = doc!("Body.quarantined")]
    #[getter]
    fn quarantined(&self, py: Python<'_>) -> PyResult<bool> {
        self.world.get().lock(py).entry(self.handle).map(|entry| entry.quarantined).or_raise(py)
    }

    #[doc = doc!("Body.position")]
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<Real>>> {
        let position = self.read(py, |body| body.pose().translation.vector)?;
        Ok(conv::from_vec3(py, &position))
    }

    #[doc = doc!("Body.quaternion")]
    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<Real>>> {
        let rotation = self.read(py, |body| body.pose().rotation)?;
        Ok(conv::from_rot(py, &rotation))
    }

    #[doc = doc!("Body.centre_of_mass")]
    #[getter]
    fn centre_of_mass<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<Real>>> {
        let centre = self.read(py, RigidBody::center_of_mass)?;
        Ok(conv::from_vec3(py, &centre))
    }

    #[doc = doc!("Body.linear_velocity")]
    #[getter]
    fn linear_velocity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<Real>>> {
        let velocity = self.read(py, |body| *body.linear_velocity())?;
        Ok(conv::from_vec3(py, &velocity))
    }

    #[doc = doc!("Body.angular_velocity")]
    #[getter]
    fn angular_velocity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<Real>>> {
        let velocity = self.read(py, RigidBody::angular_velocity)?;
        Ok(conv::from_vec3(py, &velocity))
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

    #[doc = doc!("Body.set_drive")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (position, quaternion = None, *, stiffness, damping, linear_velocity = None, angular_velocity = None),
           text_signature = "($self, position, quaternion=None, *, stiffness, damping, linear_velocity=(0.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, 0.0))")]
    fn set_drive(
        &self,
        py: Python<'_>,
        position: &Bound<'_, PyAny>,
        quaternion: Option<&Bound<'_, PyAny>>,
        stiffness: &Bound<'_, PyAny>,
        damping: &Bound<'_, PyAny>,
        linear_velocity: Option<&Bound<'_, PyAny>>,
        angular_velocity: Option<&Bound<'_, PyAny>>,
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
        self.write(py, |body| body.set_drive(Some(drive)))
    }

    #[doc = doc!("Body.clear_drive")]
    fn clear_drive(&self, py: Python<'_>) -> PyResult<()> {
        self.write(py, |body| body.set_drive(None))
    }

    #[doc = doc!("Body.deformed_normals")]
    fn deformed_normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let normals = self.world.get().lock(py).entry(self.handle).map(deformed_normals).or_raise(py)?;
        conv::from_points(py, normals)
    }

    #[doc = doc!("Body.deformed_points")]
    fn deformed_points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let points = self.world.get().lock(py).entry(self.handle).map(deformed_points).or_raise(py)?;
        conv::from_points(py, points)
    }

    #[doc = doc!("Body.moved_points")]
    fn moved_points<'py>(&self, py: Python<'py>) -> PyResult<conv::Numbered<'py>> {
        let moved = self.world.get().lock(py).entry(self.handle).map(moved_points).or_raise(py)?;
        conv::from_numbered(py, moved)
    }

    #[doc = doc!("Body.displacements")]
    fn displacements<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let values = self.world.get().lock(py).entry(self.handle).map(displacements).or_raise(py)?;
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
