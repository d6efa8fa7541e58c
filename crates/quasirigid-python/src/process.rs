//! What a forked child may not use, and mutexes that it does not wait for in vain.
//!
//! A child has the memory of its parent and none of its threads. A mutex that one of them held when the process was forked stays locked in
//! the child for ever, and what it guards is half changed.

use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::{PyWeakrefMethods, PyWeakrefReference};
use std::ops::Deref;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

/// The exception for something that is of no use in this process, which was forked from the one that it belongs to.
pub fn elsewhere(py: Python<'_>, what: &str, got: &str, hint: &str) -> PyErr {
    crate::errors::make(py, "ForkError", [what, "one that is used by the process that made it", got, hint])
}

/// A mutex that knows in which process it is.
///
/// Python forks while it holds the GIL. So a thread that holds the GIL and finds the mutex free in a child knows that no thread of the
/// parent held it then, and one that finds it locked before anybody has used it in this process knows that nobody will ever let go of it.
pub struct ForkMutex<T> {
    content: Arc<Mutex<T>>,
    /// The process in which it was last found in order.
    process: AtomicU32,
    /// What it guards, for the message.
    what: &'static str,
}

/// The engine of a world, which the world and the handles that it gave out share. Threads may look at it while one steps.
pub type SharedWorld = Arc<WorldEngine>;

/// The engine of a world, and the `World` of Python that it belongs to, as long as somebody has that: what is copied or pickled beside it
/// shall belong to the same copy.
pub struct WorldEngine {
    engine: ForkMutex<quasirigid::World>,
    object: Mutex<Option<Py<PyWeakrefReference>>>,
}

impl WorldEngine {
    /// Guards the engine of a world.
    pub fn shared(engine: quasirigid::World) -> SharedWorld {
        Arc::new(Self { engine: ForkMutex::new("world", engine), object: Mutex::new(None) })
    }

    /// The `World`, if somebody has it.
    pub fn object<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        self.object.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner).as_ref()?.bind(py).upgrade()
    }

    /// Takes note of the `World`, unless there is one already.
    pub fn belongs_to(&self, world: &Bound<'_, PyAny>) -> PyResult<()> {
        if self.object(world.py()).is_none() {
            let reference = PyWeakrefReference::new(world)?.unbind();
            *self.object.lock_py_attached(world.py()).unwrap_or_else(PoisonError::into_inner) = Some(reference);
        }
        Ok(())
    }
}

impl Deref for WorldEngine {
    type Target = ForkMutex<quasirigid::World>;

    fn deref(&self) -> &Self::Target {
        &self.engine
    }
}

impl<T> ForkMutex<T> {
    /// Guards `content`, which users call `what`.
    pub fn new(what: &'static str, content: T) -> Self {
        Self { content: Arc::new(Mutex::new(content)), process: AtomicU32::new(std::process::id()), what }
    }

    /// What it guards, waiting without the GIL if another thread has it: that one may want the GIL before it gives it back. An error in a
    /// forked child, if a thread of its parent had it at the fork.
    pub fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, T>> {
        self.check(py)?;
        Ok(self.content.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner))
    }

    /// The same for a thread that has let go of the GIL already, and has called [`ForkMutex::check`] before that.
    pub fn lock_detached(&self) -> MutexGuard<'_, T> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Refuses what a thread of the parent had at the fork. Before a thread locks without the GIL, it asks this with it.
    pub fn check(&self, py: Python<'_>) -> PyResult<()> {
        if self.in_order() {
            return Ok(());
        }
        let (got, hint) =
            ("one that another thread of the parent was using when this process was forked", "make one here, or fork while it rests");
        Err(elsewhere(py, self.what, got, hint))
    }

    /// For a thread that holds the GIL.
    fn in_order(&self) -> bool {
        let here = std::process::id();
        if self.process.load(Ordering::Relaxed) == here {
            return true;
        }
        let free = !matches!(self.content.try_lock(), Err(TryLockError::WouldBlock));
        if free {
            self.process.store(here, Ordering::Relaxed);
        }
        free
    }
}

impl<T> Drop for ForkMutex<T> {
    fn drop(&mut self) {
        if !self.in_order() {
            // Half changed: not even fit to be freed. It stays until the child ends.
            std::mem::forget(self.content.clone());
        }
    }
}
