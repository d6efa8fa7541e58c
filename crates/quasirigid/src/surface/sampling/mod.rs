//! Points on a surface, and what belongs to every point: shapes that are sampled
//! exactly, normals and areas of points that somebody else has sampled.

pub mod areas;
pub mod cloud;
pub mod findings;
pub(crate) mod memory;
pub mod normals;
mod orientation;
pub mod point_surface;
pub mod shapes;
mod strays;
mod winding_number;

pub use point_surface::PointSurface;
