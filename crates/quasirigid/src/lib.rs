//! Real-time grasping with soft fingertips.
//!
//! Quasi-rigid bodies with point-sampled surfaces, sphere-tree collision detection, Signorini contact with exact Coulomb
//! friction solved by Gauss-Seidel on the Delassus operator, and local surface compliance, after Le Garrec, Andriot, Merlhiot
//! and Bidaud, *Virtual Grasping of Deformable Objects with Exact Contact Friction in Real Time* (2006).
//!
//! SI units throughout: m, kg, s, N, Pa, rad. World frame z up.

pub mod body;
pub mod constrained_motion;
pub mod error;
pub mod free_motion;
pub mod math;
