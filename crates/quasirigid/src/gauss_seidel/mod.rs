//! Stage 4, `gauss_seidel`: Signorini and Coulomb solved exactly, contact by contact, on the Delassus operator.
//!
//! This stage knows neither bodies nor meshes. Given `delta_free` (m), the friction coefficients `mu` and an operator `W` (m/N) it finds
//! reactions `f` (N) in contact frames (normal, tangent1, tangent2) such that with `delta = W f + delta_free`
//!
//! ```text
//! 0 <= f_n  perp  delta_n >= 0
//! |f_t| < mu f_n  =>  delta_t = 0;      |f_t| = mu f_n  =>  delta_t = -lambda f_t,  lambda >= 0
//! ```
//!
//! No friction pyramid, no regularisation. [`solve`] does the sweeps, what an operator must offer is in [`crate::delassus`].

mod anderson;
pub(crate) mod deadline;
pub(crate) mod newton;
mod parameters;
pub(crate) mod sweep;

pub use parameters::{Measure, SolveReport, SolverParameters, Stop, check_problem};
pub use sweep::{Scratch, solve};
