//! A surface made ready for contact: points in tree order, sphere tree, neighbours of every leaf, control points, interpolation.

use crate::error::{Error, Result};
use crate::interrupt::Interrupt;
use crate::math::{Pose, Real, Vec3};
use crate::surface::control_points::{ControlPoints, Weights};
use crate::surface::edges::{Samples, unresolved};
use crate::surface::implicit::kernel::Kernel;
use crate::surface::rows::Rows;
use crate::surface::sampling::point_surface::{PointSurface, Spread};
use crate::surface::search::nearest::pick;
use crate::surface::search::neighbours::NeighbourGrid;
use crate::surface::sphere_tree::SphereTree;
use crate::threads::in_parallel;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::OnceLock;

/// Points of a leaf when the number of control points is not given: the paper's 36,000 / 4,800.
pub const POINTS_PER_LEAF: Real = 7.5;

/// A point surface prepared for contact. Never changes: what moves and deforms is in [`crate::collider::Skin`].
#[derive(Debug, Clone)]
pub struct Surface {
    /// Positions, body frame, m, in tree order.
    pub points: Vec<Vec3>,
    /// Outward unit normals, in tree order.
    pub normals: Vec<Vec3>,
    /// Areas, m^2, in tree order.
    pub areas: Vec<Real>,
    /// `order[k]` is the caller's index of the `k`-th point in tree order.
    pub order: Vec<u32>,
    /// Mean spacing of the points, sqrt(area / count), m.
    pub spacing: Real,
    /// Weight function of the implicit surface.
    pub kernel: Kernel,
    /// The sphere tree.
    pub tree: SphereTree,
    /// Half the distance to the farthest close neighbour, largest over the leaf's points, m.
    pub leaf_gaps: Vec<Real>,
    /// For each leaf the other leaves whose points reach into its border (`r_eps` of Klein and Zachmann: the kernel's cutoff).
    pub leaf_neighbours: Rows,
    /// The control points.
    pub control: ControlPoints,
    /// For each point, in tree order, the control points that move it ...
    pub interpolation: Rows,
    /// ... and their weights, adding up to 1 for each point.
    pub interpolation_weights: Vec<f32>,
    /// Points at edges where the surface is not known well enough to touch: no control point on their own face stands for them, or
    /// fewer than two others of that face are within
    /// reach of the implicit surface. See [`Surface::note`].
    pub unresolved: usize,
    /// Whether normals or areas were estimated: the order of the points is that of the search for it.
    pub(crate) estimated: bool,
    /// See [`Surface::content_hash`].
    pub(crate) hash: OnceLock<u64>,
}

/// Surfaces are equal if they are built of the same in the same way: all else follows.
impl PartialEq for Surface {
    fn eq(&self, other: &Self) -> bool {
        let of = |s: &Self| (s.len(), s.control.len(), s.estimated);
        of(self) == of(other)
            && self.order == other.order
            && self.points == other.points
            && self.normals == other.normals
            && self.areas == other.areas
    }
}

impl Surface {
    /// Prepares a surface.
    ///
    /// `control_points`: how many leaves, hence control points; `None` takes one for every 7.5 points as in the paper.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] when there would be none, or fewer than two points for each; or if the system has no threads to give.
    pub fn build(surface: PointSurface, control_points: Option<usize>) -> Result<Self> {
        Self::build_until(surface, control_points, &Interrupt::default())
    }

    /// [`Self::build`] that ends soon after `interrupt` is raised.
    ///
    /// # Errors
    /// Those of [`Self::build`]; [`Error::Interrupted`].
    pub fn build_until(surface: PointSurface, control_points: Option<usize>, interrupt: &Interrupt) -> Result<Self> {
        in_parallel(|| Self::build_here(surface, control_points, interrupt))?
    }

    fn build_here(mut surface: PointSurface, control_points: Option<usize>, interrupt: &Interrupt) -> Result<Self> {
        let count = surface.len();
        let leaf_count = control_points.unwrap_or_else(|| ((count as Real / POINTS_PER_LEAF).round() as usize).max(1));
        if leaf_count == 0 || leaf_count > count / 2 {
            return Err(Error::value(
                "control_points",
                format!("between 1 and {} (half the {count} points)", count / 2),
                leaf_count,
                "sample more points, or ask for fewer control points",
            ));
        }
        let (spacing, estimated) = (surface.spacing(), surface.is_estimated());
        let kernel = Kernel::for_spacing(spacing)?;
        let Spread { order: near_order, gaps } = surface.spread(interrupt);
        interrupt.check()?;
        let points = pick(surface.points(), &near_order);
        let normals = pick(surface.normals(), &near_order);
        let areas = pick(surface.areas(), &near_order);
        drop(surface);
        // Here in near order; from now on in tree order.
        let (tree, order) = SphereTree::build(&points, &normals, &areas, &gaps, leaf_count, interrupt);
        interrupt.check()?;
        let (points, normals, areas, gaps) = (pick(&points, &order), pick(&normals, &order), pick(&areas, &order), pick(&gaps, &order));
        let order = pick(&near_order, &order);
        let leaf_gaps: Vec<Real> = (0..leaf_count).map(|l| gaps[tree.leaf(l).points()].iter().copied().fold(0.0, Real::max)).collect();
        let leaf_neighbours = neighbours_of_leaves(&tree, kernel.cutoff());
        interrupt.check()?;
        // A leaf's centre hardly moves as it is projected: only points about a cutoff away have weight.
        let border = |leaf: usize, ranges: &mut Vec<Range<u32>>| {
            let (own, reach) = (tree.leaf(leaf), 1.2 * kernel.cutoff());
            ranges.push(own.first_point..own.first_point + own.point_count);
            for other in leaf_neighbours.row(leaf).iter().map(|&other| tree.leaf(other as usize)) {
                if (other.center - own.center).norm_squared() < (other.radius + reach).powi(2) {
                    ranges.push(other.first_point..other.first_point + other.point_count);
                }
            }
        };
        let samples = Samples { points: &points, normals: &normals, spacing };
        let control = ControlPoints::build(&tree, samples, &kernel, &leaf_neighbours, border, interrupt);
        interrupt.check()?;
        let (interpolation, interpolation_weights) = interpolate(&tree, &points, &normals, &control, &leaf_neighbours, interrupt);
        interrupt.check()?;
        let unresolved = unresolved(&tree, samples, &control.normals, &leaf_neighbours, kernel.cutoff());
        interrupt.check()?;
        Ok(Self {
            points,
            normals,
            areas,
            order,
            spacing,
            kernel,
            tree,
            leaf_gaps,
            leaf_neighbours,
            control,
            interpolation,
            interpolation_weights,
            unresolved,
            estimated,
            hash: OnceLock::new(),
        })
    }

    /// What to tell whoever gave the surface: that parts of it may not be felt, and what to do.
    pub fn note(&self) -> Option<String> {
        (self.unresolved > 0).then(|| {
            format!(
                "{} of {} points lie on faces too narrow for how they are sampled (points are {:.3e} m apart, \
                 control points {:.3e} m): contact there may be missed; give more points on \
                 these faces, {:.3e} m apart at most, or more control points",
                self.unresolved,
                self.len(),
                self.spacing,
                self.control.spacing,
                0.5 * self.kernel.cutoff()
            )
        })
    }

    /// Adds the point ranges of a leaf and of the leaves that reach into its border.
    pub fn border_ranges(&self, leaf: usize, ranges: &mut Vec<Range<u32>>) {
        border_ranges(&self.tree, &self.leaf_neighbours, leaf, ranges);
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no points. Never true of a built surface.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Sum of the areas, m^2.
    pub fn total_area(&self) -> Real {
        self.tree.nodes[0].area
    }

    /// Weights of the control points around `x` (body frame) near leaf `leaf`, eq. 8.
    pub fn control_weights(&self, x: &Vec3, normal: &Vec3, leaf: usize) -> Weights {
        self.control.weights(x, normal, leaf as u32, self.leaf_neighbours.row(leaf))
    }

    /// The values, one for each point in tree order, in the caller's order.
    pub fn in_callers_order<T: Copy + Default>(&self, values: &[T]) -> Vec<T> {
        let mut out = vec![T::default(); values.len()];
        for (k, &i) in self.order.iter().enumerate() {
            out[i as usize] = values[k];
        }
        out
    }
}

fn border_ranges(tree: &SphereTree, neighbours: &Rows, leaf: usize, ranges: &mut Vec<Range<u32>>) {
    for &l in std::iter::once(&(leaf as u32)).chain(neighbours.row(leaf)) {
        let node = tree.leaf(l as usize);
        ranges.push(node.first_point..node.first_point + node.point_count);
    }
}

impl PointSurface {
    /// The surface turned and moved by `pose`.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] if the pose is not finite.
    pub fn transformed(self, pose: &Pose) -> Result<Self> {
        let (mut points, mut normals, areas) = self.into_parts();
        points.iter_mut().for_each(|p| *p = pose.rotation * *p + pose.translation.vector);
        normals.iter_mut().for_each(|n| *n = pose.rotation * *n);
        Self::new(points, normals, areas)
    }
}

/// Leaves whose spheres come within `reach` of each leaf's sphere.
fn neighbours_of_leaves(tree: &SphereTree, reach: Real) -> Rows {
    let centers: Vec<Vec3> = tree.leaves.iter().map(|&n| tree.nodes[n as usize].center).collect();
    let largest = tree.leaves.iter().map(|&n| tree.nodes[n as usize].radius).fold(0.0, Real::max);
    let grid = NeighbourGrid::build(&centers, 2.0 * largest + reach);
    let row = |(leaf, center): (usize, &Vec3)| {
        let radius = tree.leaf(leaf).radius;
        let mut row = Vec::new();
        grid.for_each_within(center, radius + largest + reach, |other, distance2| {
            if other as usize != leaf && distance2.sqrt() <= radius + tree.leaf(other as usize).radius + reach {
                row.push(other);
            }
        });
        row.sort_unstable();
        row
    };
    let found: Vec<Vec<u32>> = centers.par_iter().enumerate().map(row).collect();
    let mut rows = Rows::default();
    found.into_iter().for_each(|row| rows.push_row(row));
    rows
}

fn interpolate(
    tree: &SphereTree,
    points: &[Vec3],
    normals: &[Vec3],
    control: &ControlPoints,
    neighbours: &Rows,
    interrupt: &Interrupt,
) -> (Rows, Vec<f32>) {
    let of_leaf = |leaf: usize| {
        if interrupt.raised() {
            return (Vec::new(), Vec::new());
        }
        let node = tree.leaf(leaf);
        let (mut counts, mut entries) = (Vec::with_capacity(node.point_count as usize), Vec::new());
        for k in node.points() {
            let w = control.weights(&points[k], &normals[k], leaf as u32, neighbours.row(leaf));
            counts.push(w.len);
            entries.extend(w.iter().map(|(c, weight)| (c as u32, weight as f32)));
        }
        (counts, entries)
    };
    let found: Vec<_> = (0..tree.leaves.len()).into_par_iter().map(of_leaf).collect();
    let mut rows = Rows::default();
    let mut weights = Vec::with_capacity(found.iter().map(|(_, entries)| entries.len()).sum());
    for (counts, entries) in found {
        let mut rest = entries.as_slice();
        for count in counts {
            let (row, after) = rest.split_at(count);
            rows.push_row(row.iter().map(|entry| entry.0));
            weights.extend(row.iter().map(|entry| entry.1));
            rest = after;
        }
    }
    (rows, weights)
}
