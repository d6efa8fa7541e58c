//! A surface given by points with outward normals and areas, in the frame of its body.

use crate::error::{Error, Result, check_finite, check_positive};
use crate::math::{Mat3, Real, Vec3};
use crate::surface::areas::{AREA_NEIGHBOURS, areas_among};
use crate::surface::nearest::{Nearest, SortedPoints};
use crate::surface::normals::normals_among;
use rayon::prelude::*;

/// Fewest points that enclose a volume.
const MIN_POINTS: usize = 4;
/// Thinner than this share of its length, a set of points counts as a line.
const LINE_ASPECT: Real = 1e-6;
/// Neighbours of a point that must be reached without a hole between the spheres of a tree.
const CLOSE_NEIGHBOURS: usize = 8;

/// Points (m), unit outward normals and areas (m^2) of an unstructured surface, all of one length, in the body's frame.
/// Every value is finite, every area positive, and the points do not all lie on one line.
#[derive(Debug, Clone)]
pub struct PointSurface {
    points: Vec<Vec3>,
    normals: Vec<Vec3>,
    areas: Vec<Real>,
    /// Where neighbours were looked for: what they told, so that nobody has to look again.
    spread: Option<Spread>,
}

/// How the points of a surface lie among each other.
#[derive(Debug, Clone)]
pub(crate) struct Spread {
    /// An order in which near points are near in memory: `order[i]` is the index of the `i`-th.
    pub order: Vec<u32>,
    /// Half the distance from each point to the farthest of its close neighbours, m, in that order.
    pub gaps: Vec<Real>,
}

impl PartialEq for PointSurface {
    fn eq(&self, other: &Self) -> bool {
        self.points == other.points && self.normals == other.normals && self.areas == other.areas
    }
}

impl PointSurface {
    /// From points (m), outward normals (any length but zero; normalised here) and areas (m^2, > 0), all of one length, at least 4.
    ///
    /// # Errors
    /// [`Error::InvalidShape`] if lengths differ; [`Error::InvalidValue`] for a number that is not finite, a zero normal or an
    /// area that is not positive; [`Error::DegenerateSurface`] for under 4 points, or points all in one place or on one line.
    pub fn new(points: Vec<Vec3>, mut normals: Vec<Vec3>, areas: Vec<Real>) -> Result<Self> {
        check_points(&points)?;
        normalise(&points, &mut normals)?;
        if areas.len() != points.len() {
            return Err(Error::shape("areas", format!("{} values, one per point", points.len()), areas.len(), "give one area per point"));
        }
        check_finite("areas", &areas)?;
        if let Some((i, area)) = areas.iter().enumerate().find(|(_, a)| **a <= 0.0) {
            return Err(Error::value("areas", "values > 0 (m^2)", format!("{area} at position {i}"), "remove points without area"));
        }
        Ok(Self { points, normals, areas, spread: None })
    }

    /// From points (m) and outward normals; areas are estimated, see [`super::areas::estimate_areas`].
    ///
    /// # Errors
    /// Those of [`PointSurface::new`]; [`Error::DegenerateSurface`] also where so many points coincide that no area is left to one.
    pub fn from_points_and_normals(points: Vec<Vec3>, mut normals: Vec<Vec3>) -> Result<Self> {
        check_points(&points)?;
        normalise(&points, &mut normals)?; // areas need unit normals
        Self::estimated(points, Some(normals))
    }

    /// From bare points (m): normals estimated and oriented consistently, see [`super::normals::estimate_normals`], then areas.
    ///
    /// # Errors
    /// Those of [`PointSurface::from_points_and_normals`].
    pub fn from_points(points: Vec<Vec3>) -> Result<Self> {
        check_points(&points)?;
        Self::estimated(points, None)
    }

    /// Areas, and normals if there are none, from one search for neighbours. The points and normals given have been checked.
    fn estimated(points: Vec<Vec3>, normals: Option<Vec<Vec3>>) -> Result<Self> {
        let sorted = SortedPoints::new(&points, AREA_NEIGHBOURS);
        let nearest = sorted.nearest(AREA_NEIGHBOURS);
        let sorted_normals = normals.as_ref().map_or_else(|| normals_among(&sorted.points, &nearest), |normals| sorted.pick(normals));
        let areas = sorted.hand_back(&areas_among(&sorted.points, &sorted_normals, &nearest));
        if let Some(i) = areas.iter().position(|a| !(a.is_finite() && *a > 0.0)) {
            let hint = "remove duplicate points, or give areas";
            return Err(Error::degenerate(
                "areas estimated from the points",
                "every point apart from others",
                format!("no area at point {i}"),
                hint,
            ));
        }
        let mut normals = normals.unwrap_or_else(|| sorted.hand_back(&sorted_normals));
        normalise(&points, &mut normals)?;
        let spread = Some(Spread { gaps: gaps_among(&sorted.points, &nearest), order: sorted.order });
        Ok(Self { points, normals, areas, spread })
    }

    /// How the points lie among each other, looked for if that has not been done.
    pub(crate) fn spread(&mut self) -> Spread {
        self.spread.take().unwrap_or_else(|| {
            let sorted = SortedPoints::new(&self.points, CLOSE_NEIGHBOURS);
            let nearest = sorted.nearest(CLOSE_NEIGHBOURS);
            Spread { gaps: gaps_among(&sorted.points, &nearest), order: sorted.order }
        })
    }

    /// Points, m.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// Unit outward normals.
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Areas, m^2.
    pub fn areas(&self) -> &[Real] {
        &self.areas
    }

    /// Points (m), normals and areas (m^2), given away.
    pub fn into_parts(self) -> (Vec<Vec3>, Vec<Vec3>, Vec<Real>) {
        (self.points, self.normals, self.areas)
    }

    /// Number of points, at least 4.
    #[allow(clippy::len_without_is_empty)] // never empty
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Sum of the areas, m^2.
    pub fn total_area(&self) -> Real {
        self.areas.iter().sum()
    }

    /// Typical distance between neighbours, m: the square root of the mean area.
    pub fn spacing(&self) -> Real {
        (self.total_area() / self.len() as Real).sqrt()
    }

    /// Lowest and highest corner of the axis-aligned box around the points, m.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let first = self.points[0];
        self.points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)))
    }

    /// The surface grown by `factor` (> 0) about the origin of the body's frame; areas grow by its square.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] if the factor is not finite and positive, or takes values out of range.
    pub fn scaled(mut self, factor: Real) -> Result<Self> {
        check_positive("scale factor", factor, "-")?;
        self.points.iter_mut().for_each(|p| *p *= factor);
        self.areas.iter_mut().for_each(|a| *a *= factor * factor);
        Self::new(self.points, self.normals, self.areas)
    }

    /// The surface moved by `offset` (m, body frame).
    ///
    /// # Errors
    /// [`Error::InvalidValue`] if the offset is not finite; [`Error::DegenerateSurface`] if it is so large that the points merge.
    pub fn translated(mut self, offset: Vec3) -> Result<Self> {
        check_finite("offset", offset.iter())?;
        self.points.iter_mut().for_each(|p| *p += offset);
        Self::new(self.points, self.normals, self.areas)
    }
}

/// Half the distance from each point to the farthest of its close neighbours, m.
fn gaps_among(points: &[Vec3], nearest: &Nearest) -> Vec<Real> {
    let gap = |i: usize| {
        let close = &nearest.of(i)[..nearest.k.min(CLOSE_NEIGHBOURS)];
        0.5 * close.last().map_or(0.0, |&j| (points[j as usize] - points[i]).norm())
    };
    (0..points.len()).into_par_iter().with_min_len(4096).map(gap).collect()
}

/// Enough points, all finite, not all in one place or on one line.
fn check_points(points: &[Vec3]) -> Result<()> {
    let hint = "give a cloud of points that covers the surface";
    if points.len() < MIN_POINTS || points.len() >= u32::MAX as usize {
        return Err(Error::degenerate("points", format!("{MIN_POINTS} points or more, under 2^32"), points.len(), hint));
    }
    if let Some((i, p)) = points.iter().enumerate().find(|(_, p)| !p.iter().all(|c| c.is_finite())) {
        let got = format!("({}, {}, {}) at position {i}", p.x, p.y, p.z);
        return Err(Error::value("points", "finite coordinates (m)", got, "remove or repair the non-finite points"));
    }
    let first = points[0];
    let extent = points.iter().map(|p| (p - first).amax()).fold(0.0, Real::max);
    if !(extent.is_finite() && extent > Real::MIN_POSITIVE) {
        return Err(Error::degenerate("points", "points apart from each other", format!("an extent of {extent} m"), hint));
    }
    // Scatter of the points over their extent, so that neither very small nor very large sets under- or overflow.
    let n = points.len() as Real;
    let mean = points.iter().map(|p| (p - first) / extent).sum::<Vec3>() / n;
    let scatter: Mat3 = points.iter().map(|p| (p - first) / extent - mean).map(|d| d * d.transpose()).sum();
    let mut eigenvalues: [Real; 3] = scatter.symmetric_eigenvalues().into();
    eigenvalues.sort_by(Real::total_cmp);
    if eigenvalues[1] <= LINE_ASPECT * LINE_ASPECT * eigenvalues[2] {
        return Err(Error::degenerate("points", "points that span a surface", "points on one line", hint));
    }
    Ok(())
}

/// One normal per point, finite and not zero, made unit.
fn normalise(points: &[Vec3], normals: &mut [Vec3]) -> Result<()> {
    if normals.len() != points.len() {
        return Err(Error::shape(
            "normals",
            format!("{} vectors, one per point", points.len()),
            normals.len(),
            "give one normal per point",
        ));
    }
    for (i, n) in normals.iter_mut().enumerate() {
        let largest = n.amax();
        if !(largest.is_finite() && largest > 0.0) {
            let got = format!("({}, {}, {}) at position {i}", n.x, n.y, n.z);
            return Err(Error::value(
                "normals",
                "finite vectors longer than zero",
                got,
                "repair the normals, or leave them out to have them estimated",
            ));
        }
        let unit = (*n / largest).normalize();
        // A unit vector is left alone, so that building a surface twice gives the same bits.
        if (n.norm() - 1.0).abs() > 1e-15 {
            *n = unit;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::shapes::{sample_box, sample_half_space, sample_sphere};

    #[test]
    fn a_sphere_from_bare_points_has_its_normals_and_areas() {
        let exact = sample_sphere(0.02, 2400).unwrap();
        let surface = PointSurface::from_points(exact.points().to_vec()).unwrap();
        let worst = surface.normals().iter().zip(exact.normals()).map(|(a, b)| a.angle(b).to_degrees()).fold(0.0, Real::max);
        assert!(worst < 2.0, "normal off by {worst} degrees");
        let area = surface.total_area() / exact.total_area() - 1.0;
        assert!(area.abs() < 0.01, "area off by {area}");
    }

    #[test]
    fn spacing_bounds_scale_and_translation() {
        let surface = sample_half_space(0.1, 400).unwrap();
        assert!((surface.spacing() - 0.005).abs() < 1e-12);
        let surface = surface.scaled(2.0).unwrap().translated(Vec3::new(0.0, 0.0, 1.0)).unwrap();
        assert!((surface.spacing() - 0.01).abs() < 1e-12);
        let (low, high) = surface.bounds();
        assert!((low - Vec3::new(-0.095, -0.095, 1.0)).norm() < 1e-12 && (high - Vec3::new(0.095, 0.095, 1.0)).norm() < 1e-12);
    }

    #[test]
    fn bad_surfaces_are_refused_with_what_was_found() {
        let (points, normals, areas) = sample_box(Vec3::repeat(0.1), 60).unwrap().into_parts();
        type Spoil<'a> = &'a dyn Fn(&mut Vec<Vec3>, &mut Vec<Vec3>, &mut Vec<Real>);
        let with = |f: Spoil| {
            let (mut p, mut n, mut a) = (points.clone(), normals.clone(), areas.clone());
            f(&mut p, &mut n, &mut a);
            PointSurface::new(p, n, a).map(|_| ()).unwrap_err()
        };
        assert!(with(&|p, _, _| p[3].y = Real::NAN).to_string().contains("position 3"));
        assert!(with(&|p, _, _| p[3].y = Real::INFINITY).to_string().contains("position 3"));
        assert!(with(&|_, n, _| n[7] = Vec3::zeros()).to_string().contains("position 7"));
        assert!(with(&|_, n, _| n[7].x = Real::NAN).to_string().contains("position 7"));
        assert!(with(&|_, _, a| a[9] = 0.0).to_string().contains("position 9"));
        assert!(with(&|_, _, a| a[9] = Real::NAN).to_string().contains("position 9"));
        assert!(matches!(with(&|_, n, _| n.truncate(5)), Error::InvalidShape { .. }));
        assert!(matches!(with(&|_, _, a| a.truncate(5)), Error::InvalidShape { .. }));
        let line: Vec<Vec3> = (0..50).map(|i| Vec3::new(1.0, 2.0, 3.0) * i as Real).collect();
        for degenerate in [vec![], points[..3].to_vec(), vec![points[0]; 20], line] {
            assert!(matches!(PointSurface::from_points(degenerate), Err(Error::DegenerateSurface { .. })));
        }
        for scale in [0.0, -1.0, Real::NAN, Real::INFINITY, 1e-200, 1e308] {
            assert!(sample_sphere(1.0, 10).unwrap().scaled(scale).is_err());
        }
        assert!(sample_sphere(1.0, 10).unwrap().translated(Vec3::repeat(Real::NAN)).is_err());
        let huge = points.iter().map(|p| p * 1e300).collect();
        assert!(PointSurface::from_points(huge).is_err());
    }
}
