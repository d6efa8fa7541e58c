//! Real-time grasping with soft fingertips.
//!
//! Quasi-rigid bodies with point-sampled surfaces, sphere-tree collision detection, Signorini contact with exact Coulomb
//! friction solved by Gauss-Seidel on the Delassus operator, and local surface compliance, after Le Garrec, Andriot, Merlhiot
//! and Bidaud, *Virtual Grasping of Deformable Objects with Exact Contact Friction in Real Time* (2006).
//!
//! SI units throughout: m, kg, s, N, Pa, rad. World frame z up.

pub mod body;
pub mod collider;
pub mod collision;
pub mod constrained_motion;
pub mod contact_problem;
pub mod control;
pub mod delassus;
pub mod error;
pub mod free_motion;
pub mod gauss_seidel;
pub mod interrupt;
mod linear;
pub mod math;
pub mod objects;
pub mod pair;
pub mod params;
pub mod scenes;
pub mod slots;
pub mod solve_system;
mod step;
pub mod surface;
mod threads;
pub mod world;

pub use error::{Error, Result};
pub use params::Parameters;
pub use world::report::StepReport;
pub use world::{BodyHandle, ColliderHandle, FrictionSide, HandHandle, Snapshot, World};
