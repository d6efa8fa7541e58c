//! Point surfaces: sampled shapes, neighbours, normals and areas, the smooth surface through the points, and what contact needs on top:
//! sphere tree, control points, compliance.

pub mod compliance;
pub mod control_points;
mod edges;
pub mod implicit;
pub mod rows;
pub mod sampling;
pub mod search;
pub mod sphere_tree;
pub mod surface_model;
pub mod surface_source;

pub use compliance::{AxialCompliance, Compliance, ComplianceMatrix, GreensFunction, Loaded, LocalCompliance};
pub use control_points::{ControlPoints, Weights};
pub use implicit::{Kernel, Projection};
pub use sampling::cloud::{Screened, screen_cloud};
pub use sampling::findings::{Findings, NormalsFound};
pub use sampling::memory::check_memory;
pub use sampling::{PointSurface, shapes};
pub use search::NeighbourGrid;
pub use sphere_tree::SphereTree;
pub use surface_model::Surface;
pub use surface_source::SurfaceSource;
