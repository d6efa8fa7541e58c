//! What computes joint targets: inverse kinematics, and a grip that closes until the wanted squeeze.

pub mod grip;
pub mod inverse_kinematics;

pub use grip::{Grip, GripState, PadPath};
