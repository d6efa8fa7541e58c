//! Real-time grasping with soft fingertips.
//!
//! Quasi-rigid bodies with point-sampled surfaces, sphere-tree collision detection, Signorini contact with exact Coulomb
//! friction solved by Gauss-Seidel on the Delassus operator, and local surface compliance, after Le Garrec, Andriot, Merlhiot
//! and Bidaud, *Virtual Grasping of Deformable Objects with Exact Contact Friction in Real Time* (2006).
//!
//! SI units throughout: m, kg, s, N, Pa, rad. World frame z up.

pub mod body;
pub mod collision;
pub mod constrained_motion;
pub mod contact_problem;
pub mod error;
pub mod free_motion;
pub mod gauss_seidel;
pub mod grip;
pub mod math;
pub mod params;
pub mod report;
pub mod scenes;
pub mod surface;
pub mod workspace;
pub mod world;
mod world_edit;
mod world_friction;
mod world_hands;

mod step;

pub use error::{Error, Result};
pub use params::Parameters;
pub use report::StepReport;
pub use world::{BodyHandle, HandHandle, World};
pub use world_friction::FrictionSide;
