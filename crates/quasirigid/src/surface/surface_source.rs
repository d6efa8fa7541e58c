//! What a surface is built of, to build it again elsewhere, for example in another process.
//!
//! A tenth of the size of the surface, and nothing in it is trusted: what is read is checked as if a user had given it.

use crate::error::Result;
use crate::math::{Real, Vec3};
use crate::surface::sampling::point_surface::PointSurface;
use crate::surface::surface_model::Surface;
use serde::{Deserialize, Serialize};

/// Builds a surface with the same bits as the one that it was taken from.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SurfaceSource {
    /// Positions, m, in the caller's order.
    pub points: Vec<Vec3>,
    /// Outward unit normals.
    pub normals: Vec<Vec3>,
    /// Areas, m^2.
    pub areas: Vec<Real>,
    /// How many control points.
    pub control_points: usize,
    /// Whether normals or areas were estimated: the points stay in the order in which they were sorted for that search.
    pub estimated: bool,
}

impl SurfaceSource {
    /// Builds the surface.
    ///
    /// # Errors
    /// As [`PointSurface::new`] and [`Surface::build`].
    pub fn build(self) -> Result<Surface> {
        let points = PointSurface::new(self.points, self.normals, self.areas)?;
        let points = if self.estimated { points.with_estimated_order()? } else { points };
        Surface::build(points, Some(self.control_points))
    }
}

impl Surface {
    /// What it is built of.
    pub fn source(&self) -> SurfaceSource {
        SurfaceSource {
            points: self.in_callers_order(&self.points),
            normals: self.in_callers_order(&self.normals),
            areas: self.in_callers_order(&self.areas),
            control_points: self.control.len(),
            estimated: self.estimated,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::shapes::sample_capsule;

    /// All numbers of a surface that a step looks at.
    fn bits(surface: &Surface) -> Vec<u64> {
        let vectors = [&surface.points, &surface.normals, &surface.control.points, &surface.control.normals];
        let spheres = surface.tree.nodes.iter().flat_map(|node| [node.center.x, node.center.y, node.center.z, node.radius, node.area]);
        let numbers = vectors.into_iter().flatten().flat_map(|v| [v.x, v.y, v.z]);
        let numbers = numbers.chain(surface.areas.iter().copied()).chain(surface.leaf_gaps.iter().copied()).chain(spheres);
        let weights = surface.interpolation_weights.iter().map(|&weight| Real::from(weight));
        let mut bits: Vec<u64> = numbers.chain(weights).map(Real::to_bits).collect();
        bits.extend(surface.order.iter().chain(&surface.interpolation.index).chain(&surface.leaf_neighbours.index).map(|&i| u64::from(i)));
        bits
    }

    #[test]
    fn a_surface_that_is_built_again_has_the_same_bits() {
        let (points, normals, areas) = sample_capsule(0.01, 0.04, 1500).unwrap().into_parts();
        let made = [
            PointSurface::new(points.clone(), normals.clone(), areas),
            PointSurface::from_points_and_normals(points.clone(), normals),
            PointSurface::from_points(points),
        ];
        for (how, made) in ["given whole", "areas estimated", "normals and areas estimated"].into_iter().zip(made) {
            let surface = Surface::build(made.unwrap(), Some(200)).unwrap();
            let again = surface.source().build().unwrap();
            assert!(bits(&surface) == bits(&again) && surface == again, "{how}");
        }
    }
}
