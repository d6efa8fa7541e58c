//! Small worlds shared by tests, benchmarks, examples and the Python package.

pub mod grasp;
pub mod incline;
pub mod indentation;
pub mod pinch;

pub use grasp::{GraspOptions, GraspScene};
pub use incline::Incline;
pub use indentation::{Indentation, IndentationOptions};
pub use pinch::{Pinch, PinchOptions};
