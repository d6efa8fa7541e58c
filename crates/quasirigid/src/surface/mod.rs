//! Point surfaces: sampled shapes, neighbours, normals and areas, the smooth surface through the points, and what contact needs on top:
//! sphere tree, control points, compliance.

pub mod areas;
mod candidates;
mod cells;
pub mod compliance;
pub mod compliance_matrix;
pub mod control_points;
pub mod eigenvector;
pub mod kernel;
mod lane;
mod local_fit;
pub mod moving_least_squares;
pub(crate) mod nearest;
pub mod neighbours;
pub mod normals;
pub mod point_surface;
pub mod shapes;
pub mod sphere_tree;
pub mod surface_model;

pub use compliance::{Compliance, HalfSpaceCompliance, Loaded, LocalCompliance};
pub use compliance_matrix::ComplianceMatrix;
pub use control_points::{ControlPoints, Weights};
pub use kernel::Kernel;
pub use moving_least_squares::Projection;
pub use neighbours::NeighbourGrid;
pub use point_surface::PointSurface;
pub use sphere_tree::SphereTree;
pub use surface_model::Surface;
