//! Point surfaces: sampled shapes, neighbours, normals and areas, and the smooth surface through the points.

pub mod areas;
pub mod eigenvector;
pub mod kernel;
mod lane;
mod local_fit;
pub mod moving_least_squares;
pub mod neighbours;
pub mod normals;
pub mod point_surface;
pub mod shapes;

pub use kernel::Kernel;
pub use moving_least_squares::Projection;
pub use neighbours::NeighbourGrid;
pub use point_surface::PointSurface;
