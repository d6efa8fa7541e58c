//! Points of a cloud that are no part of its surface: flying pixels, the origin that a depth camera reports for "nothing seen", dust.
//!
//! Two statistical tests, both against the points around and not against one length
//! for the whole cloud (a cloud may be dense here and thin there):
//! - *isolated*: points that are connected by steps of a few local spacings make parts,
//!   and a part of very few points is stray. (The outlier filters of Open3D
//!   and PCL look at mean distances to neighbours in the same spirit, one point at a time.)
//! - *off*: a point that stands off the plane of its neighbours by more than a spacing, where these lie in a plane themselves.

use crate::math::{Real, Vec3};
use crate::surface::implicit::eigenvector::smallest_eigenvector;
use crate::surface::sampling::normals::{Parts, scatter};
use crate::surface::search::nearest::Nearest;
use rayon::prelude::*;

/// With fewer points a stray one cannot be distinguished from a corner.
pub(crate) const FEWEST: usize = 60;
/// The spacing around a point is estimated from the distance of this neighbour: a
/// disc of that radius holds as many points as squares of one spacing.
const SPACING_NEIGHBOUR: usize = 4;
/// A step longer than this many local spacings is a gap.
const GAP: Real = 4.0;
/// Parts of fewer points, and of fewer than this share of all, are stray.
const STRAY_PART: usize = 12;
const STRAY_PART_SHARE: Real = 0.005;
/// With more than this share isolated the cloud has no surface to which the others could belong, and all are kept.
const MOST_STRAYS: Real = 0.2;
/// A point is off when it is higher than this over the plane of its neighbours, in local spacings ...
const OFF: Real = 1.2;
/// ... and than this many times the scatter of these about that plane.
const OFF_SCATTER: Real = 6.0;

/// Distance (m) at which an evenly spread cloud has its next points around each
/// point: from the fourth neighbour, the middle one of those around.
pub(crate) fn local_spacings(points: &[Vec3], nearest: &Nearest) -> Vec<Real> {
    let fourth = |i: usize| {
        let near = nearest.of(i);
        let far = near.get(SPACING_NEIGHBOUR - 1).or(near.last()).map_or(0.0, |&j| (points[j as usize] - points[i]).norm());
        // A disc with this neighbour on its rim holds four points and a half.
        far * (std::f64::consts::PI / (SPACING_NEIGHBOUR as Real + 0.5)).sqrt()
    };
    let single: Vec<Real> = (0..points.len()).into_par_iter().with_min_len(1024).map(fourth).collect();
    let middle = |i: usize| {
        let mut around: Vec<Real> = nearest.of(i).iter().map(|&j| single[j as usize]).collect();
        let half = around.len() / 2;
        if around.is_empty() { single[i] } else { *around.select_nth_unstable_by(half, Real::total_cmp).1 }
    };
    (0..points.len()).into_par_iter().with_min_len(1024).map(middle).collect()
}

/// The middle one of some values; 0 of none.
pub(crate) fn median(mut values: Vec<Real>) -> Real {
    let half = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(half, Real::total_cmp).1 }
}

/// Which points are stray, in the order of the points (`None` if none is). `nearest` has at best 12 neighbours of each or more.
pub(crate) fn find_strays(points: &[Vec3], nearest: &Nearest) -> Option<Vec<bool>> {
    let n = points.len();
    if n < FEWEST {
        return None;
    }
    let spacings = local_spacings(points, nearest);
    // Where points coincide their distance says nothing.
    let least = 0.25 * median(spacings.clone());
    if least <= 0.0 {
        return None;
    }
    let spacing = |i: usize| spacings[i].max(least);
    let mut parts = Parts::new(n);
    for i in 0..n {
        for &j in nearest.of(i) {
            let j = j as usize;
            if (points[j] - points[i]).norm() <= GAP * spacing(i).min(spacing(j)) {
                parts.join(i, j, false);
            }
        }
    }
    let roots = parts.roots();
    let mut sizes = vec![0_usize; n];
    roots.iter().for_each(|&(root, _)| sizes[root as usize] += 1);
    let is_isolated = |i: usize| {
        let size = sizes[roots[i].0 as usize];
        size < STRAY_PART && (size as Real) < STRAY_PART_SHARE * n as Real
    };
    let mut stray: Vec<bool> =
        (0..n).into_par_iter().with_min_len(1024).map(|i| is_isolated(i) || is_off(i, points, nearest, spacing(i))).collect();
    let count = stray.iter().filter(|s| **s).count();
    if count as Real > MOST_STRAYS * n as Real {
        stray = (0..n).map(is_isolated).collect();
    }
    let count = stray.iter().filter(|s| **s).count();
    (count > 0 && count as Real <= MOST_STRAYS * n as Real).then_some(stray)
}

/// Whether a point stands off the plane of its neighbours.
fn is_off(i: usize, points: &[Vec3], nearest: &Nearest, spacing: Real) -> bool {
    let near = nearest.of(i);
    let around = || near.iter().map(|&j| points[j as usize]);
    let middle = around().sum::<Vec3>() / near.len() as Real;
    let Some(normal) = smallest_eigenvector(&scatter(&middle, around())) else { return false };
    let height = |p: &Vec3| normal.dot(&(p - middle));
    let scattered = (around().map(|p| height(&p).powi(2)).sum::<Real>() / near.len() as Real).sqrt();
    let own = height(&points[i]).abs();
    // A point to the side of its neighbours may lie on the next face, behind an edge: what is off stands over them.
    let beside = ((points[i] - middle).norm_squared() - own * own).max(0.0).sqrt();
    own > OFF * spacing && own > OFF_SCATTER * scattered && beside < own
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::sampling::point_surface::PointSurface;
    use crate::surface::shapes::{sample_box, sample_capsule, sample_cylinder, sample_half_space, sample_sphere};

    #[test]
    fn a_stray_point_is_found_wherever_it_is_and_clean_shapes_have_none() {
        for (name, shape) in [
            ("ball", sample_sphere(0.03, 1500)),
            ("box", sample_box(Vec3::new(0.06, 0.05, 0.08), 600)),
            ("thin plate", sample_box(Vec3::new(0.08, 0.08, 0.002), 1500)),
            ("rod", sample_capsule(0.003, 0.15, 1500)),
            ("can", sample_cylinder(0.03, 0.09, 900)),
            ("floor", sample_half_space(0.1, 400)),
        ] {
            let points = shape.unwrap().into_parts().0;
            assert!(PointSurface::from_points(points.clone()).unwrap().findings().strays.is_empty(), "{name}");
            for stray in [Vec3::new(0.0, 0.0, 0.1), Vec3::new(0.3, -0.2, 0.1), Vec3::new(0.01, 0.02, -0.09)] {
                let mut dirty = points.clone();
                dirty.insert(17, stray);
                let surface = PointSurface::from_points(dirty).unwrap();
                assert_eq!(surface.findings().strays, [17], "{name}, {stray:?}");
                assert_eq!(surface.points(), points, "{name}");
            }
        }
    }
}
