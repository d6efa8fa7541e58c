//! What is copied and pickled beside its world: handles and controllers. In one call of `copy.deepcopy` or pickle they belong to the same
//! copy of the world.

use crate::body::Body;
use crate::collider::Collider;
use crate::errors::{OrRaise, make};
use crate::grip::Grip;
use crate::hand::Hand;
use crate::process::SharedWorld;
use crate::value::{from_cbor, to_cbor};
use crate::world::World;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};
use quasirigid::{BodyHandle, ColliderHandle, HandHandle};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// What `reduce` gives pickle: what makes the object, and of what.
pub type Reduced<'py, T> = (Bound<'py, PyAny>, T);

/// The `World` that a handle is of: the one that gave it out, or another around the same engine if nobody has that any more.
fn world_of<'py>(py: Python<'py>, engine: &SharedWorld) -> PyResult<Bound<'py, World>> {
    if let Some(world) = engine.object(py) {
        return Ok(world.cast_into()?);
    }
    let world = Bound::new(py, World::around(engine.clone(), None))?;
    engine.belongs_to(world.as_any())?;
    Ok(world)
}

/// The world that belongs to something which is copied deeply: the copy that was made in the same call, or one that is made now.
fn copied_world<'py>(py: Python<'py>, engine: &SharedWorld, memo: &Bound<'py, PyAny>) -> PyResult<Bound<'py, World>> {
    Ok(py.import("copy")?.getattr("deepcopy")?.call1((world_of(py, engine)?, memo))?.cast_into()?)
}

/// The content of what is pickled beside its world.
fn beside(py: Python<'_>, content: &impl Serialize) -> PyResult<Py<PyBytes>> {
    let bytes = to_cbor(content).map_err(|why| damaged(py, &why))?;
    Ok(PyBytes::new(py, &bytes).unbind())
}

/// What [`beside`] has written.
fn read_beside<T: DeserializeOwned>(py: Python<'_>, bytes: &[u8]) -> PyResult<T> {
    from_cbor(bytes).map_err(|why| damaged(py, &why))
}

/// The exception for bytes that hold no state.
pub fn damaged(py: Python<'_>, why: &str) -> PyErr {
    make(py, "SnapshotError", ["snapshot", "a whole snapshot", why, "it is damaged: write it anew"])
}

/// What pickle makes a handle of: its world, and what it names there.
type ReducedHandle<'py> = Reduced<'py, (Bound<'py, World>, Py<PyBytes>)>;

#[pymethods]
impl World {
    #[doc = doc!("World.body")]
    fn body(this: &Bound<'_, Self>, handle: &Body) -> PyResult<Body> {
        let handle = this.get().lock(this.py())?.own_body(handle.handle).or_raise(this.py())?;
        Ok(Body { world: Self::shared(this)?, handle })
    }

    #[doc = doc!("World.hand")]
    fn hand(this: &Bound<'_, Self>, handle: &Hand) -> PyResult<Hand> {
        let handle = this.get().lock(this.py())?.own_hand(handle.handle).or_raise(this.py())?;
        Ok(Hand { world: Self::shared(this)?, handle })
    }

    #[doc = doc!("World.collider")]
    fn collider(this: &Bound<'_, Self>, handle: &Collider) -> PyResult<Collider> {
        let handle = this.get().lock(this.py())?.own_collider(handle.handle).or_raise(this.py())?;
        Self::collider_handle(this, handle)
    }
}

#[pymethods]
impl Body {
    fn __copy__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __deepcopy__<'py>(&self, py: Python<'py>, memo: &Bound<'py, PyAny>) -> PyResult<Self> {
        World::body(&copied_world(py, &self.world, memo)?, self)
    }

    #[classmethod]
    fn _unpickled(_class: &Bound<'_, PyType>, world: &Bound<'_, World>, handle: &[u8]) -> PyResult<Self> {
        let handle: BodyHandle = read_beside(world.py(), handle)?;
        World::body(world, &Self { world: World::shared(world)?, handle })
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<ReducedHandle<'py>> {
        let (py, body) = (this.py(), this.get());
        Ok((this.get_type().getattr("_unpickled")?, (world_of(py, &body.world)?, beside(py, &body.handle)?)))
    }
}

#[pymethods]
impl Hand {
    fn __copy__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __deepcopy__<'py>(&self, py: Python<'py>, memo: &Bound<'py, PyAny>) -> PyResult<Self> {
        World::hand(&copied_world(py, &self.world, memo)?, self)
    }

    #[classmethod]
    fn _unpickled(_class: &Bound<'_, PyType>, world: &Bound<'_, World>, handle: &[u8]) -> PyResult<Self> {
        let handle: HandHandle = read_beside(world.py(), handle)?;
        World::hand(world, &Self { world: World::shared(world)?, handle })
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<ReducedHandle<'py>> {
        let (py, hand) = (this.py(), this.get());
        Ok((this.get_type().getattr("_unpickled")?, (world_of(py, &hand.world)?, beside(py, &hand.handle)?)))
    }
}

#[pymethods]
impl Collider {
    fn __copy__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __deepcopy__<'py>(&self, py: Python<'py>, memo: &Bound<'py, PyAny>) -> PyResult<Self> {
        World::collider(&copied_world(py, &self.world, memo)?, self)
    }

    #[classmethod]
    fn _unpickled(_class: &Bound<'_, PyType>, world: &Bound<'_, World>, handle: &[u8]) -> PyResult<Self> {
        let (py, handle): (_, ColliderHandle) = (world.py(), read_beside(world.py(), handle)?);
        let handle = world.get().lock(py)?.own_collider(handle).or_raise(py)?;
        World::collider_handle(world, handle)
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<ReducedHandle<'py>> {
        let (py, collider) = (this.py(), this.get());
        Ok((this.get_type().getattr("_unpickled")?, (world_of(py, &collider.world)?, beside(py, &collider.handle)?)))
    }
}

/// A controller for the copy of its world.
fn grip_of_copy(world: &Bound<'_, World>, grip: &quasirigid::control::grip::Grip) -> PyResult<Grip> {
    let grip = grip.for_copy(&*world.get().lock(world.py())?).or_raise(world.py())?;
    Ok(Grip::new(World::shared(world)?, grip))
}

#[pymethods]
impl Grip {
    fn __copy__(&self, py: Python<'_>) -> PyResult<Self> {
        Ok(Self::new(self.world.clone(), self.lock(py)?.clone()))
    }

    fn __deepcopy__<'py>(&self, py: Python<'py>, memo: &Bound<'py, PyAny>) -> PyResult<Self> {
        let world = copied_world(py, &self.world, memo)?;
        let grip = self.lock(py)?.clone();
        grip_of_copy(&world, &grip)
    }

    #[classmethod]
    fn _unpickled(_class: &Bound<'_, PyType>, world: &Bound<'_, World>, state: &[u8]) -> PyResult<Self> {
        grip_of_copy(world, &read_beside(world.py(), state)?)
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<ReducedHandle<'py>> {
        let (py, grip) = (this.py(), this.get());
        let state = beside(py, &*grip.lock(py)?)?;
        Ok((this.get_type().getattr("_unpickled")?, (world_of(py, &grip.world)?, state)))
    }
}
