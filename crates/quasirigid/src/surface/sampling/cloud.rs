//! A cloud of points before it is a surface: what it must have, stray points, neighbours, estimated areas.

use crate::error::{Error, Result};
use crate::interrupt::Interrupt;
use crate::math::{Mat3, Real, Vec3};
use crate::surface::sampling::areas::{AREA_NEIGHBOURS, areas_among};
use crate::surface::sampling::findings::{Findings, NormalsFound};
use crate::surface::sampling::memory::check_memory;
use crate::surface::sampling::orientation::check;
use crate::surface::sampling::strays::find_strays;
use crate::surface::search::nearest::{Nearest, SortedPoints};
use crate::threads::in_parallel;
use rayon::prelude::*;

/// Fewest points that enclose a volume.
const MIN_POINTS: usize = 4;
/// Thinner than this share of its length, a set of points counts as a line.
const LINE_ASPECT: Real = 1e-6;
/// Neighbours of a point that must be reached without a hole between the spheres of a tree.
pub(super) const CLOSE_NEIGHBOURS: usize = 8;

/// Points in the order of a grid, and the neighbours of each.
pub(super) struct Neighbourhoods {
    pub sorted: SortedPoints,
    pub nearest: Nearest,
}

impl Neighbourhoods {
    pub fn new(points: &[Vec3], interrupt: &Interrupt) -> Result<Self> {
        let sorted = SortedPoints::new(points, AREA_NEIGHBOURS);
        interrupt.check()?;
        let nearest = sorted.nearest(AREA_NEIGHBOURS, interrupt);
        interrupt.check()?;
        Ok(Self { sorted, nearest })
    }

    /// Takes stray points out of the lists and itself; returns where they were.
    pub fn drop_strays(&mut self, points: &mut Vec<Vec3>, normals: Option<&mut Vec<Vec3>>, interrupt: &Interrupt) -> Result<Vec<u32>> {
        let Some(stray) = find_strays(&self.sorted.points, &self.nearest).map(|stray| self.sorted.hand_back(&stray)) else {
            return Ok(Vec::new());
        };
        retain(points, &stray);
        if let Some(normals) = normals {
            retain(normals, &stray);
        }
        check_points(points)?;
        *self = Self::new(points, interrupt)?;
        Ok((0..stray.len() as u32).filter(|&i| stray[i as usize]).collect())
    }
}

/// Keeps what is not stray.
fn retain(values: &mut Vec<Vec3>, stray: &[bool]) {
    let mut left = stray.iter();
    values.retain(|_| left.next() == Some(&false));
}

/// What is to be known of a cloud before a surface is made of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Screened {
    /// Positions of the points that are part of the surface, in rising order.
    pub kept: Vec<u32>,
    /// Their normals, where some were given and are normals: unit, with a common side.
    pub normals: Option<Vec<Vec3>>,
    /// What was found.
    pub findings: Findings,
}

/// Looks for stray points (of points in m) and checks the normals that came with them, without making a surface.
///
/// # Errors
/// Those of [`crate::surface::PointSurface::new`]; [`Error::Interrupted`].
pub fn screen_cloud(points: Vec<Vec3>, normals: Option<Vec<Vec3>>, interrupt: &Interrupt) -> Result<Screened> {
    in_parallel(|| screen_cloud_here(points, normals, interrupt))?
}

fn screen_cloud_here(mut points: Vec<Vec3>, mut normals: Option<Vec<Vec3>>, interrupt: &Interrupt) -> Result<Screened> {
    check_points(&points)?;
    if let Some(normals) = &mut normals {
        normalise(&points, normals)?;
    }
    let count = points.len() as u32;
    let mut cloud = Neighbourhoods::new(&points, interrupt)?;
    let strays = cloud.drop_strays(&mut points, normals.as_mut(), interrupt)?;
    let mut findings = Findings { strays, ..Findings::default() };
    if let Some(given) = &mut normals {
        let Neighbourhoods { sorted, nearest } = &cloud;
        let (found, right) = check(sorted, nearest, &sorted.pick(given), interrupt);
        interrupt.check()?;
        findings.normals = found;
        if let Some(right) = right {
            *given = sorted.hand_back(&right);
        }
        if matches!(found, NormalsFound::NotNormals(_)) {
            normals = None;
        }
    }
    let kept = (0..count).filter(|i| findings.strays.binary_search(i).is_err()).collect();
    Ok(Screened { kept, normals, findings })
}

/// Areas in the caller's order, and how many of them are guessed: noise can put two neighbours on either side of a point so near to
/// it in its plane that its cell has no area left. Such a point gets that of a disc that holds its eight nearest.
pub(super) fn estimated_areas(
    sorted: &SortedPoints,
    normals: &[Vec3],
    nearest: &Nearest,
    interrupt: &Interrupt,
) -> Result<(Vec<Real>, usize)> {
    let mut areas = areas_among(&sorted.points, normals, nearest, interrupt);
    interrupt.check()?;
    let mut guessed = 0;
    for (i, area) in areas.iter_mut().enumerate().filter(|(_, area)| !(area.is_finite() && **area > 0.0)) {
        let close = &nearest.of(i)[..nearest.k.min(CLOSE_NEIGHBOURS)];
        let farthest2 = close.last().map_or(0.0, |&j| (sorted.points[j as usize] - sorted.points[i]).norm_squared());
        *area = std::f64::consts::PI * farthest2 / (CLOSE_NEIGHBOURS as Real + 0.5);
        guessed += 1;
    }
    if let Some(i) = areas.iter().position(|area| !(area.is_finite() && *area > 0.0)) {
        return Err(Error::degenerate(
            "areas estimated from the points",
            "every point apart from others",
            format!("no area at point {}, which has {CLOSE_NEIGHBOURS} others in the same place", sorted.order[i]),
            "remove duplicate points, or give areas",
        ));
    }
    Ok((sorted.hand_back(&areas), guessed))
}

/// Half the distance from each point to the farthest of its close neighbours, m.
pub(super) fn gaps_among(points: &[Vec3], nearest: &Nearest) -> Vec<Real> {
    let gap = |i: usize| {
        let close = &nearest.of(i)[..nearest.k.min(CLOSE_NEIGHBOURS)];
        0.5 * close.last().map_or(0.0, |&j| (points[j as usize] - points[i]).norm())
    };
    (0..points.len()).into_par_iter().with_min_len(4096).map(gap).collect()
}

/// Enough points, all finite, not all in one place or on one line.
pub(super) fn check_points(points: &[Vec3]) -> Result<()> {
    let hint = "give a cloud of points that covers the surface";
    if points.len() < MIN_POINTS || points.len() >= u32::MAX as usize {
        return Err(Error::degenerate("points", format!("{MIN_POINTS} points or more, under 2^32"), points.len(), hint));
    }
    if let Some((i, p)) = points.iter().enumerate().find(|(_, p)| !p.iter().all(|c| c.is_finite())) {
        let got = format!("({}, {}, {}) at position {i}", p.x, p.y, p.z);
        return Err(Error::value("points", "finite coordinates (m)", got, "remove or repair the non-finite points"));
    }
    check_memory(points.len())?;
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
pub(super) fn normalise(points: &[Vec3], normals: &mut [Vec3]) -> Result<()> {
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
