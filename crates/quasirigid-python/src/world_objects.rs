//! What is in a `World`: bodies, hands and colliders are added and removed, and pairs of them kept apart.

use crate::body::Body;
use crate::collider::{Collider, groups};
use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::hand::Hand;
use crate::hand_model::HandModel;
use crate::mass_properties::mass_properties;
use crate::material::Material;
use crate::surface::Surface;
use crate::world::World;
use pyo3::prelude::*;
use quasirigid::body::{Motion, RigidBody};
use quasirigid::collider::Filter;
use quasirigid::math::{Pose, Rot, Vec3};
use quasirigid::world::Pads;
use quasirigid::{ColliderHandle, Error};

impl World {
    /// Applies `change` to every pair of a collider of `a` and one of `b`.
    fn each_pair(
        &self,
        a: &Bound<'_, PyAny>,
        b: &Bound<'_, PyAny>,
        change: impl Fn(&mut quasirigid::World, ColliderHandle, ColliderHandle) -> quasirigid::Result<()>,
    ) -> PyResult<()> {
        let py = a.py();
        let mut engine = self.lock(py)?;
        let (of_a, of_b) = (colliders_of(&engine, a)?, colliders_of(&engine, b)?);
        of_a.iter().flat_map(|&a| of_b.iter().map(move |&b| (a, b))).try_for_each(|(a, b)| change(&mut engine, a, b)).or_raise(py)
    }
}

/// A collider, or those that a body or the fingers of a hand have now.
fn colliders_of(engine: &quasirigid::World, value: &Bound<'_, PyAny>) -> PyResult<Vec<ColliderHandle>> {
    let py = value.py();
    if let Ok(collider) = value.cast::<Collider>() {
        return Ok(vec![collider.get().handle]);
    }
    if let Ok(body) = value.cast::<Body>() {
        return engine.colliders_of(body.get().handle).or_raise(py);
    }
    if let Ok(hand) = value.cast::<Hand>() {
        let fingers = &engine.hand(hand.get().handle).or_raise(py)?.fingers;
        let colliders: quasirigid::Result<Vec<_>> = fingers.iter().map(|&finger| engine.colliders_of(finger)).collect();
        return colliders.map(|colliders| colliders.concat()).or_raise(py);
    }
    Err(to_py(py, &Error::handle("pair", "a Collider, a Body or a Hand", value.get_type(), "name the two that are not to touch")))
}

fn motion(py: Python<'_>, name: &str, known: &str) -> PyResult<Option<Motion>> {
    match name {
        "inertial" => Ok(Some(Motion::Inertial)),
        "quasi-static" => Ok(Some(Motion::QuasiStatic)),
        "fixed" if known.contains("fixed") => Ok(None),
        other => Err(to_py(py, &Error::unknown("motion", known, format!("{other:?}"), "choose one of them"))),
    }
}

fn optional_pose(position: Option<&Bound<'_, PyAny>>, quaternion: Option<&Bound<'_, PyAny>>) -> PyResult<Pose> {
    let position = position.map_or(Ok(Vec3::zeros()), |p| conv::vec3(p, "position"))?;
    let rotation = quaternion.map_or(Ok(Rot::identity()), |q| conv::quaternion(q, "quaternion"))?;
    Ok(Pose::from_parts(position.into(), rotation))
}

#[pymethods]
impl World {
    #[doc = doc!("World.bodies")]
    #[getter]
    fn bodies(this: &Bound<'_, Self>) -> PyResult<Vec<Body>> {
        let (handles, world) = (this.get().lock(this.py())?.rigid_bodies(), Self::shared(this)?);
        Ok(handles.into_iter().map(|handle| Body { world: world.clone(), handle }).collect())
    }

    #[doc = doc!("World.hands")]
    #[getter]
    fn hands(this: &Bound<'_, Self>) -> PyResult<Vec<Hand>> {
        let (handles, world) = (this.get().lock(this.py())?.hand_handles(), Self::shared(this)?);
        Ok(handles.into_iter().map(|handle| Hand { world: world.clone(), handle }).collect())
    }

    #[doc = doc!("World.add_body")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (surface, material, *, mass = None, motion = "inertial", position = None, quaternion = None, name = None,
                        viscosity = None),
           text_signature = "($self, surface, material, *, mass=None, motion='inertial', position=(0.0, 0.0, 0.0), \
                             quaternion=(1.0, 0.0, 0.0, 0.0), name=None, viscosity=None)")]
    fn add_body(
        this: &Bound<'_, Self>,
        surface: &Surface,
        material: &Material,
        mass: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = conv::text)] motion: &str,
        position: Option<&Bound<'_, PyAny>>,
        quaternion: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = conv::optional_text)] name: Option<&str>,
        viscosity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Body> {
        let py = this.py();
        let pose = optional_pose(position, quaternion)?;
        let name = name.unwrap_or("body");
        let mut body = match self::motion(py, motion, "\"inertial\", \"quasi-static\" or \"fixed\"")? {
            Some(motion) => RigidBody::free(name, mass_properties(mass, &surface.engine, py)?, motion, pose),
            None => RigidBody::fixed(name, pose),
        }
        .or_raise(py)?;
        if let Some(viscosity) = viscosity {
            let (linear, angular) = conv::pair(viscosity, "viscosity")?;
            body.set_viscosity(linear, angular).or_raise(py)?;
        }
        let handle = this.get().lock(py)?.add_body(body, Some((surface.engine.clone(), material.engine.clone()))).or_raise(py)?;
        Ok(Body { world: Self::shared(this)?, handle })
    }

    #[doc = doc!("World.add_hand")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (model = None, *, position = None, quaternion = None, material = None, motion = "inertial", points = 2400.into(),
                        control_points = 320.into()),
           text_signature = "($self, model=None, *, position=(0.0, 0.0, 0.0), quaternion=(1.0, 0.0, 0.0, 0.0), material=None, \
                             motion='inertial', points=2400, control_points=320)")]
    fn add_hand(
        this: &Bound<'_, Self>,
        model: Option<&HandModel>,
        position: Option<&Bound<'_, PyAny>>,
        quaternion: Option<&Bound<'_, PyAny>>,
        material: Option<&Material>,
        #[pyo3(from_py_with = conv::text)] motion: &str,
        points: conv::Whole,
        control_points: conv::Whole,
    ) -> PyResult<Hand> {
        let py = this.py();
        let model = match model {
            Some(model) => model.engine.clone(),
            None => quasirigid::body::HandModel::three_finger().or_raise(py)?,
        };
        let pose = optional_pose(position, quaternion)?;
        let motion = self::motion(py, motion, "\"inertial\" or \"quasi-static\"")?.unwrap_or(Motion::Inertial);
        let mut pads = Pads::usual().or_raise(py)?;
        if let Some(material) = material {
            pads.material = material.engine.clone();
        }
        pads.points = conv::count(py, "points", points)?;
        pads.control_points = conv::count(py, "control_points", control_points)?;
        let handle = this.get().lock(py)?.add_hand_with_pads(&model, pose, motion, &pads).or_raise(py)?;
        Ok(Hand { world: Self::shared(this)?, handle })
    }

    #[doc = doc!("World.remove")]
    fn remove(&self, py: Python<'_>, handle: &Bound<'_, PyAny>) -> PyResult<()> {
        if let Ok(body) = handle.cast::<Body>() {
            return self.lock(py)?.remove_body(body.get().handle).or_raise(py);
        }
        if let Ok(hand) = handle.cast::<Hand>() {
            return self.lock(py)?.remove_hand(hand.get().handle).or_raise(py);
        }
        if let Ok(collider) = handle.cast::<Collider>() {
            return self.lock(py)?.remove_collider(collider.get().handle).or_raise(py);
        }
        let hint = "give what add_body, add_hand or add_collider returned";
        Err(to_py(py, &Error::handle("remove", "a Body, a Hand or a Collider", handle.get_type(), hint)))
    }

    #[doc = doc!("World.colliders")]
    #[getter]
    fn colliders(this: &Bound<'_, Self>) -> PyResult<Vec<Collider>> {
        let py = this.py();
        let handles = this.get().lock(py)?.colliders();
        handles.into_iter().map(|handle| Self::collider_handle(this, handle)).collect()
    }

    #[doc = doc!("World.indentations")]
    fn indentations(this: &Bound<'_, Self>) -> PyResult<Vec<(Collider, Collider, f64, f64)>> {
        let py = this.py();
        let found = this.get().lock(py)?.indentations();
        let handle_of = |collider| Self::collider_handle(this, collider);
        found.into_iter().map(|([a, b], [of_a, of_b])| Ok((handle_of(a)?, handle_of(b)?, of_a, of_b))).collect()
    }

    #[doc = doc!("World.add_collider")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (body, surface, material, *, link = 0.into(), finger = None, group = 1.into(), mask = 0xffff_ffff.into()),
           text_signature = "($self, body, surface, material, *, link=0, finger=None, group=1, mask=0xffffffff)")]
    fn add_collider(
        this: &Bound<'_, Self>,
        body: &Bound<'_, PyAny>,
        surface: &Surface,
        material: &Material,
        link: conv::Whole,
        finger: Option<conv::Whole>,
        group: conv::Whole,
        mask: conv::Whole,
    ) -> PyResult<Collider> {
        let py = this.py();
        let filter = Filter { group: groups(py, "group", group)?, mask: groups(py, "mask", mask)? };
        let link = conv::count(py, "link", link)?;
        let finger = finger.map(|finger| conv::count(py, "finger", finger)).transpose()?;
        let mut engine = this.get().lock(py)?;
        let wrong =
            |expected, got: String| Err(to_py(py, &Error::handle("add_collider", expected, got, "say whom the surface is fixed to")));
        let on = match (body.cast::<Body>(), body.cast::<Hand>(), finger) {
            (Ok(body), _, None) => body.get().handle,
            (_, Ok(hand), Some(finger)) => engine.finger_handle(hand.get().handle, finger).or_raise(py)?,
            (Ok(_), _, Some(finger)) => return wrong("a Hand with finger=", format!("a Body with finger={finger}")),
            (_, Ok(_), None) => return wrong("a Hand with finger=", "a Hand without".into()),
            _ => return wrong("a Body, or a Hand with finger=", body.get_type().to_string()),
        };
        let handle = engine.add_collider(on, link, surface.engine.clone(), material.engine.clone(), filter).or_raise(py)?;
        Ok(Collider { world: Self::shared(this)?, handle, owner: body.clone().unbind(), finger })
    }

    #[doc = doc!("World.exclude")]
    fn exclude(&self, a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>) -> PyResult<()> {
        self.each_pair(a, b, quasirigid::World::exclude_pair)
    }

    #[doc = doc!("World.include")]
    fn include(&self, a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>) -> PyResult<()> {
        self.each_pair(a, b, quasirigid::World::include_pair)
    }
}
