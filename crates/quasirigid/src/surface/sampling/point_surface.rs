//! A surface given by points with outward normals and areas, in the frame of its body.

use crate::error::{Error, Result, check_finite, check_positive};
use crate::interrupt::Interrupt;
use crate::math::{Real, Vec3};
use crate::surface::sampling::areas::AREA_NEIGHBOURS;
use crate::surface::sampling::cloud::{CLOSE_NEIGHBOURS, Neighbourhoods, check_points, estimated_areas, gaps_among, normalise};
use crate::surface::sampling::findings::{Findings, NormalsFound};
use crate::surface::sampling::orientation::{check, estimate};
use crate::surface::search::nearest::SortedPoints;
use crate::threads::in_parallel;

/// Points (m), unit outward normals and areas (m^2) of an unstructured surface, all of one length, in the body's frame.
/// Every value is finite, every area positive, and the points do not all lie on one line.
#[derive(Debug, Clone)]
pub struct PointSurface {
    points: Vec<Vec3>,
    normals: Vec<Vec3>,
    areas: Vec<Real>,
    /// What was found where neighbours were searched for, so that they need not be searched for again.
    spread: Option<Spread>,
    findings: Findings,
}

/// How the points of a surface lie among each other.
#[derive(Debug, Clone)]
pub(crate) struct Spread {
    /// An order in which near points are near in memory: `order[i]` is the index of the `i`-th.
    pub order: Vec<u32>,
    /// Half the distance from each point to the farthest of its close neighbours, m, in that order.
    pub gaps: Vec<Real>,
}

impl Spread {
    /// Looks for `k` neighbours of each point.
    fn among(points: &[Vec3], k: usize, interrupt: &Interrupt) -> Self {
        let sorted = SortedPoints::new(points, k);
        let nearest = sorted.nearest(k, interrupt);
        Self { gaps: gaps_among(&sorted.points, &nearest), order: sorted.order }
    }
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
        Ok(Self { points, normals, areas, spread: None, findings: Findings::default() })
    }

    /// From points (m) and outward normals; areas are estimated, see [`crate::surface::sampling::areas::estimate_areas`].
    ///
    /// The normals are checked against the points: those without a common side are oriented, those of a closed
    /// surface that point in are turned. Stray points are left out. [`Self::findings`] says so.
    ///
    /// # Errors
    /// Those of [`PointSurface::new`]; [`Error::InvalidValue`] if the normals stand across the surface, as colours do;
    /// [`Error::DegenerateSurface`] also where so many points coincide that no area is left to one.
    pub fn from_points_and_normals(points: Vec<Vec3>, normals: Vec<Vec3>) -> Result<Self> {
        Self::from_cloud(points, Some(normals), None, &Interrupt::default())
    }

    /// From bare points (m): normals estimated and oriented consistently, see [`super::normals::estimate_normals`],
    /// then areas. What the cloud has besides a surface, stray points and noise, is in [`Self::findings`].
    ///
    /// # Errors
    /// Those of [`PointSurface::from_points_and_normals`].
    pub fn from_points(points: Vec<Vec3>) -> Result<Self> {
        Self::from_cloud(points, None, None, &Interrupt::default())
    }

    /// From points (m) and what is known of them: normals, areas (m^2), both or neither. Whoever knows the areas
    /// has a surface, not a cloud: no point of it is stray. Ends soon after `interrupt` is raised.
    ///
    /// # Errors
    /// Those of the other constructors; [`Error::Interrupted`].
    pub fn from_cloud(points: Vec<Vec3>, normals: Option<Vec<Vec3>>, areas: Option<Vec<Real>>, interrupt: &Interrupt) -> Result<Self> {
        in_parallel(|| Self::from_cloud_here(points, normals, areas, interrupt))?
    }

    fn from_cloud_here(
        mut points: Vec<Vec3>,
        mut normals: Option<Vec<Vec3>>,
        areas: Option<Vec<Real>>,
        interrupt: &Interrupt,
    ) -> Result<Self> {
        check_points(&points)?;
        if let Some(normals) = &mut normals {
            normalise(&points, normals)?;
        }
        let mut cloud = Neighbourhoods::new(&points, interrupt)?;
        let mut findings = Findings::default();
        if areas.is_none() {
            findings.strays = cloud.drop_strays(&mut points, normals.as_mut(), interrupt)?;
        }
        let Neighbourhoods { sorted, nearest } = cloud;
        let mut smooth = None;
        let mut sorted_normals = match &normals {
            Some(given) => {
                let (found, right) = check(&sorted, &nearest, &sorted.pick(given), interrupt);
                interrupt.check()?;
                if let NormalsFound::NotNormals(share) = found {
                    return Err(Error::value(
                        "normals",
                        "directions at right angles to the surface that the points lie on",
                        format!("{:.0} % of them more than 45 degrees off it", 100.0 * share),
                        "colours are no normals: leave them out, and normals are estimated",
                    ));
                }
                findings.normals = found;
                right
            }
            None => {
                let estimate = estimate(&sorted, &nearest, interrupt);
                findings.noise = Some(estimate.noise).filter(|noise| *noise > 0.0);
                findings.doubtful = Some(estimate.doubtful).filter(|share| *share > 0.0);
                smooth = estimate.smooth;
                Some(estimate.normals)
            }
        };
        interrupt.check()?;
        if let Some(found) = &mut sorted_normals {
            let mut found = sorted.hand_back(found);
            normalise(&points, &mut found)?;
            normals = Some(found);
        }
        let normals = normals.unwrap_or_default();
        let spread = Some(Spread { gaps: gaps_among(&sorted.points, &nearest), order: sorted.order.clone() });
        if let Some(areas) = areas {
            return Ok(Self { findings, ..Self::new(points, normals, areas)? });
        }
        let (areas, guessed) = match smooth {
            // Cells among points that noise lifts off the surface would overlap.
            Some(smooth) => {
                let even = Neighbourhoods::new(&sorted.hand_back(&smooth), interrupt)?;
                estimated_areas(&even.sorted, &even.sorted.pick(&normals), &even.nearest, interrupt)?
            }
            None => estimated_areas(&sorted, &sorted_normals.unwrap_or_else(|| sorted.pick(&normals)), &nearest, interrupt)?,
        };
        findings.guessed_areas = guessed;
        Ok(Self { points, normals, areas, spread, findings })
    }

    /// What was found in the cloud of points that this was made of, and what was done about it.
    pub fn findings(&self) -> &Findings {
        &self.findings
    }

    /// How the points lie among each other, looked for if that has not been done.
    pub(crate) fn spread(&mut self, interrupt: &Interrupt) -> Spread {
        self.spread.take().unwrap_or_else(|| Spread::among(&self.points, CLOSE_NEIGHBOURS, interrupt))
    }

    /// The same surface as if its normals or areas had been estimated: points stay in the order in which they were sorted for that search.
    pub(crate) fn with_estimated_order(self) -> Result<Self> {
        let spread = in_parallel(|| Spread::among(&self.points, AREA_NEIGHBOURS, &Interrupt::default()))?;
        Ok(Self { spread: Some(spread), ..self })
    }

    /// Whether normals or areas were estimated.
    pub(crate) fn is_estimated(&self) -> bool {
        self.spread.is_some()
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
