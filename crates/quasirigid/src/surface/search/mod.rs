//! Which points are near a place, and near each other.

mod candidates;
mod cells;
pub(crate) mod lane;
pub(crate) mod nearest;
pub mod neighbours;

pub use neighbours::NeighbourGrid;
