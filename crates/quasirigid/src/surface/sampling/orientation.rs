//! Which way the normals of a cloud look, by the agreement of all its points, and whether normals that came with it can be right.
//!
//! The spanning tree of [`super::normals`] is right wherever a neighbourhood is one sheet. It is judged by the winding number
//! field of the normals that it gives ([`super::winding_number`]): where they are consistent, the field falls along them. If
//! it does not, as on a wall as thin as the points are apart or under noise, normals are found from the field itself, after
//! Lin, Shi, Liu, *Fast and globally consistent normal orientation based on the winding number normal consistency* (2024):
//! area vectors `m` that make the winding number 1/2 at every point (one step down the gradient of `|A m - 1/2|^2`), turned
//! into the direction in which their own field falls, again and again.

use crate::interrupt::Interrupt;
use crate::math::{Real, Vec3};
use crate::surface::implicit::eigenvector::smallest_eigenvector;
use crate::surface::sampling::findings::NormalsFound;
use crate::surface::sampling::normals::{disagreements, normals_among, orient, scatter};
use crate::surface::sampling::strays::{FEWEST, local_spacings, median};
use crate::surface::sampling::winding_number::WindingTree;
use crate::surface::search::nearest::{Nearest, SortedPoints};
use rayon::prelude::*;

/// Of fewer points most lie beside an edge, and an edge cannot be distinguished from noise.
const FEWEST_JUDGED: usize = 200;
/// Points whose normals are judged.
const JUDGED: usize = 4096;
/// Share of the judged points whose normals the field must fall along. Even samples of smooth bodies and boxes are above 0.999.
const CONSISTENT: Real = 0.995;
const CONSISTENT_IN_NOISE: Real = 0.97;
/// Steps of the search for normals from the field, and the width that distances count as at first and at last,
/// spacings. The width ends where single points stop to matter; it begins where the field is smooth.
const STEPS: usize = 20;
const WIDTHS: (Real, Real) = (3.0, 1.0);
/// Points that normals from the field are found for; of more, an even part, and the others take those of their neighbours.
const MOST_SOLVED: usize = 24_000;
/// Scatter of the points about the surface that is noise, in spacings: from there on normals are smoothed.
pub(crate) const NOISY: Real = 0.12;
/// Neighbours of a plane that is fitted through noise.
const NOISY_NEIGHBOURS: usize = 40;
/// Area vectors that add up to less than this share of their lengths belong to a closed surface: of a closed one it is zero.
const CLOSED: Real = 0.1;
/// Spread of the winding number over the points of a closed surface: below the
/// first all its normals look out, above the second they cannot.
const EVEN: Real = 0.15;
const EVEN_IN_NOISE: Real = 0.5;
const COHERENT: Real = 0.55;
/// Normals from the field replace those of the tree if their spread is below this share of that of these, and more than a few differ.
const LESS_SPREAD: Real = 0.7;
const DIFFERING_SHARE: Real = 0.005;
/// Share of points on walls from which on a cloud is taken for one with thin walls.
const WALL_SHARE: Real = 0.1;
/// Share of doubtful normals that is not reported.
const NEGLIGIBLE: Real = 0.002;
/// Share of given normals that may be more than 45 degrees off the surface: edges and noise have some.
const MOST_OFF: Real = 0.3;
/// A neighbourhood is flat where it is this much thinner than wide; only there it says which way its normal is.
const FLAT: Real = 0.25;
/// Share of pairs of neighbours in one smooth piece that may look to different sides: none do where normals are right.
const MOST_SPLIT: Real = 0.002;

/// Normals found for bare points, and how far they can be trusted.
pub(crate) struct Estimate {
    pub normals: Vec<Vec3>,
    /// Standard deviation of the points about the surface, spacings.
    pub noise: Real,
    /// Share of the points whose normals may look to the wrong side.
    pub doubtful: Real,
    /// The points on the surface that noise scatters them about, m, where there is noise.
    pub smooth: Option<Vec<Vec3>>,
}

/// How consistent normals are.
#[derive(Debug, Clone, Copy)]
struct Judgement {
    /// Share of the points where the field falls along the normal.
    agree: Real,
    /// Middle value of the winding number at the points: positive if normals of a closed surface look out.
    winding: Real,
    /// Mean difference from it, as a share of it: 0 for a closed surface, large if parts of it look elsewhere.
    spread: Real,
}

/// What a cloud is judged by.
struct Cloud<'a> {
    sorted: &'a SortedPoints,
    nearest: &'a Nearest,
    tree: WindingTree<'a>,
    spacings: Vec<Real>,
    spacing: Real,
    sample: Vec<u32>,
    interrupt: &'a Interrupt,
}

impl<'a> Cloud<'a> {
    fn new(sorted: &'a SortedPoints, nearest: &'a Nearest, interrupt: &'a Interrupt) -> Self {
        let points = &sorted.points;
        let spacings = local_spacings(points, nearest);
        let step = points.len().div_ceil(JUDGED).max(1);
        let sample = (0..points.len() as u32).step_by(step).collect();
        Self { sorted, nearest, tree: WindingTree::new(points), spacing: median(spacings.clone()), spacings, sample, interrupt }
    }

    fn points(&self) -> &[Vec3] {
        &self.sorted.points
    }

    fn vectors(&self, normals: &[Vec3]) -> Vec<Vec3> {
        normals.iter().zip(&self.spacings).map(|(n, s)| n * (s * s)).collect()
    }

    fn judge(&self, normals: &[Vec3]) -> Judgement {
        let field = self.tree.field(&self.vectors(normals), self.spacing, &self.sample);
        let agree = field.iter().zip(&self.sample).filter(|((_, out), i)| out.dot(&normals[**i as usize]) > 0.0).count();
        let winding = median(field.iter().map(|f| f.0).collect());
        let off = field.iter().map(|f| (f.0 - winding).abs()).sum::<Real>() / field.len() as Real;
        Judgement { agree: agree as Real / field.len() as Real, winding, spread: off / winding.abs().max(1e-6) }
    }

    /// Whether the normals of the whole cloud add up to next to nothing, as those of a closed surface do.
    fn is_closed(&self, normals: &[Vec3]) -> bool {
        let vectors = self.vectors(normals);
        vectors.iter().sum::<Vec3>().norm() < CLOSED * vectors.iter().map(Vec3::norm).sum::<Real>()
    }

    /// Share of the points in flat neighbourhoods whose normals are more than 45
    /// degrees off the plane's; 0 if hardly any neighbourhood is flat.
    fn off_the_surface(&self, normals: &[Vec3]) -> Real {
        let of = |&i: &u32| {
            let (i, points) = (i as usize, self.points());
            let around = || self.nearest.of(i).iter().map(|&j| points[j as usize]);
            let moments = scatter(&points[i], around());
            let normal = smallest_eigenvector(&moments)?;
            let across = normal.dot(&(moments * normal)).max(0.0);
            let along = 0.5 * (moments.trace() - across);
            (across < FLAT * FLAT * along).then(|| normal.dot(&normals[i]).abs() < std::f64::consts::FRAC_1_SQRT_2)
        };
        let flat: Vec<bool> = self.sample.iter().filter_map(of).collect();
        if flat.len() * 10 < self.sample.len() {
            return 0.0;
        }
        flat.iter().filter(|off| **off).count() as Real / flat.len() as Real
    }

    /// Share of the points that have two neighbours or more which look the other way.
    fn share_on_walls(&self, normals: &[Vec3]) -> Real {
        let opposed = |&&i: &&u32| {
            let near = self.nearest.of(i as usize);
            near.iter().filter(|&&j| normals[i as usize].dot(&normals[j as usize]) < -0.5).count() >= 2
        };
        self.sample.iter().filter(opposed).count() as Real / self.sample.len() as Real
    }

    /// Standard deviation of the points about the surface, spacings. Between two points of a smooth
    /// surface the tangent planes rise as much on one side as they fall on the other, whatever the
    /// curvature: `(n_i + n_j) . (p_j - p_i) / 2` is the difference of their heights.
    fn noise(&self, normals: &[Vec3]) -> Real {
        let of = |&i: &u32| {
            let i = i as usize;
            let near = self.nearest.of(i).iter().take(6).map(|&j| j as usize);
            let same = near.filter(|&j| normals[i].dot(&normals[j]) > 0.5);
            same.map(move |j| (0.5 * (normals[i] + normals[j]).dot(&(self.points()[j] - self.points()[i]))).abs()).collect::<Vec<_>>()
        };
        let differences: Vec<Real> = self.sample.iter().flat_map(of).collect();
        // The middle of the size of a normal variable is 0.6745 of its deviation; the difference of two has sqrt(2) times that of one.
        median(differences) / (0.6745 * 2.0_f64.sqrt()) / self.spacing.max(Real::MIN_POSITIVE)
    }

    /// Normals from the winding number field alone; outward.
    fn solved_field(&self) -> Vec<Vec3> {
        let n = self.points().len();
        let step = n.div_ceil(MOST_SOLVED);
        if step == 1 {
            return solve(&self.tree, n, self.spacing, self.interrupt);
        }
        let some: Vec<Vec3> = self.points().iter().step_by(step).copied().collect();
        let solved = solve(&WindingTree::new(&some), some.len(), self.spacing * (step as Real).sqrt(), self.interrupt);
        // The neighbours in the order of the cells: the same as in space, but for a few.
        (0..n).map(|i| solved[(i / step).min(solved.len() - 1)]).collect()
    }

    /// Means of the normals around each point, near ones before others.
    fn smoothed(&self, normals: &[Vec3], rounds: usize) -> Vec<Vec3> {
        let mut normals = normals.to_vec();
        for _ in 0..rounds {
            let mean = |i: usize| {
                let s2 = self.spacings[i].max(self.spacing * 0.25).powi(2);
                let add = |sum: Vec3, &j: &u32| {
                    let d2 = (self.points()[j as usize] - self.points()[i]).norm_squared();
                    sum + normals[j as usize] * (-d2 / (2.0 * s2)).exp()
                };
                self.nearest.of(i).iter().fold(normals[i], add).try_normalize(1e-9).unwrap_or(normals[i])
            };
            normals = (0..normals.len()).into_par_iter().with_min_len(256).map(mean).collect();
        }
        normals
    }

    /// The points moved along their normals to the mean height of the surface around them (see [`Self::noise`]), m.
    fn on_the_surface(&self, normals: &[Vec3]) -> Vec<Vec3> {
        let points = self.points();
        let wide = self.sorted.nearest(NOISY_NEIGHBOURS, self.interrupt);
        let moved = |i: usize| {
            let near = wide.of(i).iter().map(|&j| j as usize).filter(|&j| normals[i].dot(&normals[j]) > 0.5);
            let height = |j: usize| 0.5 * (normals[i] + normals[j]).dot(&(points[i] - points[j]));
            let (sum, count) = near.fold((0.0, 1.0), |(sum, count), j| (sum + height(j), count + 1.0));
            points[i] - normals[i] * (sum / count)
        };
        (0..points.len()).into_par_iter().with_min_len(256).map(moved).collect()
    }

    /// Planes through many neighbours, oriented like the normals given.
    fn refitted(&self, normals: &[Vec3]) -> Vec<Vec3> {
        let points = self.points();
        let wide = self.sorted.nearest(NOISY_NEIGHBOURS, self.interrupt);
        let fit = |i: usize| {
            if self.interrupt.raised() {
                return normals[i];
            }
            let near = wide.of(i).iter().map(|&j| j as usize).filter(|&j| normals[i].dot(&normals[j]) > 0.0);
            let plane = smallest_eigenvector(&scatter(&points[i], near.map(|j| points[j])));
            plane.map_or(normals[i], |n| if n.dot(&normals[i]) < 0.0 { -n } else { n })
        };
        (0..points.len()).into_par_iter().with_min_len(256).map(fit).collect()
    }
}

/// Normals and their orientation from bare points, in the order of `sorted`.
pub(crate) fn estimate(sorted: &SortedPoints, nearest: &Nearest, interrupt: &Interrupt) -> Estimate {
    let mut normals = normals_among(&sorted.points, nearest, interrupt);
    if normals.len() < FEWEST_JUDGED || interrupt.raised() {
        return Estimate { normals, noise: 0.0, doubtful: 0.0, smooth: None };
    }
    let cloud = Cloud::new(sorted, nearest, interrupt);
    let (judged, noise) = (cloud.judge(&normals), cloud.noise(&normals));
    let noisy = noise >= NOISY;
    // What looks like noise on a thin wall is the other side of the wall.
    let walls = noisy && cloud.share_on_walls(&normals) > WALL_SHARE;
    let (agreeing, even) = if noisy && !walls { (CONSISTENT_IN_NOISE, EVEN_IN_NOISE) } else { (CONSISTENT, EVEN) };
    let closed = cloud.is_closed(&normals);
    let mut doubtful = 0.0;
    let mut thin = false;
    if judged.agree < agreeing || if closed { judged.spread > even } else { noisy } {
        let solved = cloud.solved_field();
        let by_field = cloud.judge(&solved);
        let differ = differing(&normals, &solved);
        let possible = by_field.spread < judged.spread && cloud.is_closed(&solved);
        thin =
            possible && by_field.spread < LESS_SPREAD * judged.spread && by_field.spread < COHERENT && (walls || differ > DIFFERING_SHARE);
        if thin {
            normals = solved;
            // Where a normal does not look the way of those around it, the other side of a wall is as near as its own.
            doubtful = differing(&normals, &cloud.smoothed(&normals, 2));
        } else if possible {
            doubtful = differ;
        }
    }
    let noise = if noisy { cloud.noise(&normals) } else { 0.0 };
    if noise < NOISY {
        return Estimate { normals, noise: 0.0, doubtful: significant(doubtful), smooth: None };
    }
    if !thin && !walls {
        // Across a thin wall means would mix its two sides.
        normals = cloud.refitted(&cloud.smoothed(&normals, 1));
    }
    let smooth = Some(cloud.on_the_surface(&normals));
    Estimate { normals, noise, doubtful: significant(doubtful), smooth }
}

/// The share, or 0 where it is negligible.
fn significant(share: Real) -> Real {
    if share > NEGLIGIBLE { share } else { 0.0 }
}

/// Share of two lists of normals that point to different sides.
fn differing(a: &[Vec3], b: &[Vec3]) -> Real {
    a.iter().zip(b).filter(|(a, b)| a.dot(b) < 0.0).count() as Real / a.len().max(1) as Real
}

/// What given normals turned out to be, and what they should be, in the order of `sorted`; `None` where they are right.
pub(crate) fn check(sorted: &SortedPoints, nearest: &Nearest, given: &[Vec3], interrupt: &Interrupt) -> (NormalsFound, Option<Vec<Vec3>>) {
    let points = &sorted.points;
    if given.len() < FEWEST || interrupt.raised() {
        return (NormalsFound::Kept, None);
    }
    let cloud = Cloud::new(sorted, nearest, interrupt);
    let off = cloud.off_the_surface(given);
    if off > MOST_OFF {
        return (NormalsFound::NotNormals(off), None);
    }
    let (split, all) = disagreements(points, given, nearest);
    if split as Real <= MOST_SPLIT * all as Real {
        let judged = cloud.judge(given);
        if cloud.is_closed(given) && judged.winding < 0.0 && judged.spread < COHERENT {
            return (NormalsFound::TurnedOutward, Some(given.iter().map(|n| -n).collect()));
        }
        return (NormalsFound::Kept, None);
    }
    // The planes are right, the sides are not: those of the spanning tree over these planes, or those of the field if it knows better.
    let mut oriented = given.to_vec();
    orient(points, &mut oriented, nearest);
    let judged = cloud.judge(&oriented);
    if judged.agree < CONSISTENT || (cloud.is_closed(&oriented) && judged.spread > EVEN) {
        let solved = cloud.solved_field();
        let by_field: Vec<Vec3> = given.iter().zip(&solved).map(|(n, out)| if n.dot(out) < 0.0 { -n } else { *n }).collect();
        let field = cloud.judge(&by_field);
        if field.spread < LESS_SPREAD * judged.spread && field.spread < COHERENT {
            oriented = by_field;
        }
    }
    let turned = given.iter().zip(&oriented).filter(|(a, b)| a.dot(b) < 0.0).count();
    (NormalsFound::Oriented(turned), (turned > 0).then_some(oriented))
}

/// Normals from the field of the area vectors that make the winding number 1/2 everywhere (Lin et al. 2024, algorithm 1).
fn solve(tree: &WindingTree, n: usize, spacing: Real, interrupt: &Interrupt) -> Vec<Vec3> {
    let all: Vec<u32> = (0..n as u32).collect();
    let mut vectors = vec![Vec3::zeros(); n];
    for step in 0..STEPS {
        if interrupt.raised() {
            break;
        }
        let share = step as Real / (STEPS - 1) as Real;
        let width = spacing * (WIDTHS.0 + (WIDTHS.1 - WIDTHS.0) * share);
        let missing: Vec<Real> = tree.at_points(&vectors, width).iter().map(|w| 0.5 - w).collect();
        let down = tree.adjoint(&missing, width);
        let change = tree.at_points(&down, width);
        let (squares, changed) = (down.iter().map(Vec3::norm_squared).sum::<Real>(), change.iter().map(|c| c * c).sum::<Real>());
        if changed > 0.0 {
            let length = squares / changed;
            vectors.iter_mut().zip(&down).for_each(|(m, d)| *m += d * length);
        }
        let field = tree.field(&vectors, width, &all);
        for (m, (_, out)) in vectors.iter_mut().zip(&field) {
            if let Some(direction) = out.try_normalize(Real::MIN_POSITIVE) {
                *m = direction * m.norm();
            }
        }
    }
    vectors.into_iter().map(|m| m.try_normalize(Real::MIN_POSITIVE).unwrap_or(Vec3::z())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::sampling::cloud::screen_cloud;
    use crate::surface::sampling::findings::Findings;
    use crate::surface::sampling::point_surface::PointSurface;
    use crate::surface::shapes::{sample_box, sample_half_space, sample_sphere};

    fn on_their_side(found: &[Vec3], exact: &[Vec3]) -> Real {
        1.0 - differing(found, exact)
    }

    #[test]
    fn a_wall_as_thin_as_the_points_are_apart_has_two_sides() {
        let plate = sample_box(Vec3::new(0.08, 0.08, 0.0032), 1500).unwrap(); // 1.1 spacings
        let surface = PointSurface::from_points(plate.points().to_vec()).unwrap();
        let right = on_their_side(surface.normals(), plate.normals());
        assert!(right > 0.99, "{:.2} % on their side", 100.0 * right);
    }

    #[test]
    fn given_normals_are_kept_oriented_turned_or_refused_as_the_points_tell() {
        let never = Interrupt::default();
        let ball = sample_sphere(0.03, 1500).unwrap();
        let (points, exact) = (ball.points(), ball.normals());
        let up: Vec<Vec3> = exact.iter().map(|n| if n.z < 0.0 { -n } else { *n }).collect();
        let inward: Vec<Vec3> = exact.iter().map(|n| -n).collect();
        let colours: Vec<Vec3> = exact.iter().map(|n| n.map(|c| 0.5 + 0.4 * (40.0 * c).sin())).collect();
        let found = |given: &[Vec3]| screen_cloud(points.to_vec(), Some(given.to_vec()), &never).unwrap();
        assert_eq!(found(exact).findings, Findings::default());
        for (given, wanted) in [(up, NormalsFound::Oriented(750)), (inward, NormalsFound::TurnedOutward)] {
            let screened = found(&given);
            assert_eq!(screened.findings.normals, wanted);
            assert_eq!(on_their_side(&screened.normals.unwrap(), exact), 1.0);
        }
        assert!(matches!(found(&colours).findings.normals, NormalsFound::NotNormals(share) if share > 0.3));
        assert!(PointSurface::from_points_and_normals(points.to_vec(), colours).is_err());
        // An open surface has the side that its normals say.
        let floor = sample_half_space(0.1, 900).unwrap();
        let down: Vec<Vec3> = floor.normals().iter().map(|n| -n).collect();
        let surface = PointSurface::from_points_and_normals(floor.points().to_vec(), down.clone()).unwrap();
        assert_eq!(surface.normals(), down);
    }

    #[test]
    fn a_raised_interrupt_ends_the_building() {
        let interrupt = Interrupt::default();
        interrupt.raise();
        let points = sample_sphere(0.03, 1500).unwrap().points().to_vec();
        assert_eq!(PointSurface::from_cloud(points, None, None, &interrupt), Err(crate::Error::Interrupted));
    }
}
