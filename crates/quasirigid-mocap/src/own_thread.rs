//! A thread that is joined by the process that has started it, and by no child of that.

use std::thread::JoinHandle;

/// A thread of one process. A forked child has a copy of the handle but no such thread: to join it there would wait for ever.
#[derive(Debug)]
pub(crate) struct OwnThread {
    /// None once it was joined.
    handle: Option<JoinHandle<()>>,
    process: u32,
}

impl OwnThread {
    /// A thread that this process has started.
    pub fn new(handle: JoinHandle<()>) -> Self {
        Self { handle: Some(handle), process: std::process::id() }
    }

    /// Whether another process has started it.
    pub fn is_elsewhere(&self) -> bool {
        self.process != std::process::id()
    }

    /// Waits for its end, in the process that has started it.
    pub fn join(&mut self) {
        if self.is_elsewhere() {
            return;
        }
        if let Some(handle) = self.handle.take() {
            // Our threads have no way to panic; if one did, there is nobody left to tell.
            let _ = handle.join();
        }
    }
}

impl Drop for OwnThread {
    fn drop(&mut self) {
        if self.is_elsewhere() {
            // Even to let go of it asks the system about a thread that is not there.
            std::mem::forget(self.handle.take());
        }
    }
}
