//! Threads of the engine, safe to use in a process that was forked.
//!
//! A forked child has the memory of its parent, but none of its threads. A pool that was made before the fork looks
//! whole in the child, and work that is given to it waits for ever. So nothing here is global: building a surface has
//! threads for as long as it takes, and a world knows which process the threads of its own are in.

use crate::error::{Error, Result};

/// Runs `work`, which goes through rayon's parallel iterators, on threads that
/// end with it: as many as there are cores, or `RAYON_NUM_THREADS`.
///
/// Inside a pool of the caller's own it runs there. rayon's global pool, where parallel
/// iterators go by default, is never used: see the page of this module.
pub(crate) fn in_parallel<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T> {
    if rayon::current_thread_index().is_some() {
        return Ok(work());
    }
    Ok(make_pool(0)?.install(work))
}

/// The threads of a world.
#[derive(Debug, Default)]
pub(crate) struct WorkerPool {
    /// None: the thread that steps the world does all the work.
    pool: Option<rayon::ThreadPool>,
    /// The process whose threads they are.
    process: u32,
}

impl WorkerPool {
    /// `threads` of them; none if that is 1.
    pub fn new(threads: usize) -> Result<Self> {
        let pool = if threads == 1 { None } else { Some(make_pool(threads)?) };
        Ok(Self { pool, process: std::process::id() })
    }

    /// The pool to work in. In a forked child it is made again, with as many threads; None where
    /// the system has no more threads to give, for the result is the same without.
    pub fn of_this_process(&mut self, threads: usize) -> Option<&rayon::ThreadPool> {
        if self.pool.is_some() && self.process != std::process::id() {
            *self = Self::new(threads).unwrap_or_default();
        }
        self.pool.as_ref()
    }
}

impl Drop for WorkerPool {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            // To end a pool is to wake its threads, which would wait for what threads
            // of the parent hold. Its memory stays until the child ends.
            std::mem::forget(self.pool.take());
        }
    }
}

fn make_pool(threads: usize) -> Result<rayon::ThreadPool> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| Error::value("threads", "a number of threads that the system can start", error, "ask for fewer"))
}
