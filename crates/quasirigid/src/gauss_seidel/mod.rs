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
//! No friction pyramid, no regularisation. [`solve`] does the sweeps, [`ContactBlock`] solves one contact, [`natural_map_residual`] says how far off
//! the result is, [`Delassus`] is what an operator must offer, [`MatrixFree`] and [`Assembled`] are the two there are.

mod anderson;
mod assembled;
mod attempt;
mod block_lu;
mod contact_solve;
mod deadline;
mod delassus;
mod dense_lu;
mod interior_point;
mod matrix_free;
mod newton;
mod parameters;
mod proximal;
mod residual;
mod sweep;
mod system;

pub use assembled::Assembled;
pub use attempt::{solve_system, solve_system_until};
pub use contact_solve::{ContactBlock, ContactStatus};
pub use delassus::Delassus;
pub use matrix_free::{MatrixFree, NO_BODY};
pub use parameters::{Measure, SolveReport, SolverParameters, Stop, check_problem};
pub use residual::{natural_map, natural_map_residual, project_on_cone, residual_as_given};
pub use sweep::{Scratch, solve};
pub use system::{ContactSystem, SystemSolution};
