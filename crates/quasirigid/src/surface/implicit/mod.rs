//! The smooth surface through the points: a moving-least-squares implicit function, and projection on its zero set.
//!
//! Around a position `x`, points `p_k` with unit outward normals `n_k` get weights `w_k = theta(|x - p_k|) c_k`: a truncated Gaussian
//! and the agreement `c_k` of `n_k` with a reference normal. With `a = sum w_k p_k / sum w_k` and `n` the eigenvector of the smallest
//! eigenvalue of `sum w_k (p_k - a)(p_k - a)^T`, oriented by the stored normals, there are two estimates of the signed distance:
//!
//! ```text
//! f(x) = n . (x - a)                                   plane fit (Alexa and Adamson, On normals and projection operators, 2004)
//! g(x) = sum w_k n_k . (x - p_k) / sum w_k             mean of the tangent planes (Hermite data)
//! ```
//!
//! **Curvature.** Let the surface be `z = (k1 u^2 + k2 v^2)/2` about the foot of `x`, with weights symmetric in u and v and
//! `Z = E[z] = (k1 E[u^2] + k2 E[v^2])/2`. The mean point lies at height Z, so at the foot `f = -Z`: for a sphere (k1 = k2 = -1/R,
//! `E[u^2] = E[v^2] = h^2/2`) the plane lies `h^2/(2R)` inside. The tangent plane of point k passes over the foot at height
//! `z - u dz/du - v dz/dv = z - 2z = -z`, so `g = +Z`: as far outside. The mean `(f + g)/2` has no second-order error, whatever the two
//! curvatures; it is the signed distance used here.
//!
//! **Edges.** The reference is the normal of the nearest point (among those that face the query, if a direction is given), and
//! `c_k = s^2 (3 - 2 s)`, `s = (n_k . n_ref - cos 60) / (cos 30 - cos 60)` kept in 0..1: a face stays flat up to its edge, because
//! points of the next face have no weight. Within 30 degrees the weight is full, so that on a smooth surface nothing
//! depends on which point is nearest. (A factor that falls from the start, `max(0, (n_k . n_ref - 1/2)/(1/2))^2`, errs 15 times more
//! on a sphere of radius 4.9 spacings and 7 times more at 9.8: it follows the reference as that jumps from point to point.)
//!
//! What this reaches stands in the table at [`evaluate`]; the tests below and `tests/surface.rs` print it.
//!
//! Nothing here allocates.

pub mod eigenvector;
pub mod kernel;
mod local_fit;

pub use kernel::Kernel;

use crate::math::{Real, Vec3};
use crate::surface::implicit::local_fit::{Block, Fit, Moments, nearest_in};
use crate::surface::search::lane::LANES;
use std::ops::Range;

/// Candidates near the query that are copied aside; with more, every evaluation looks at all ranges again.
const GATHER: usize = 160;
/// A query farther than this share of the cutoff from its nearest point starts from that point's tangent plane.
const FAR: Real = 0.7;
/// Orthogonal steps for such a query: each takes the lateral error down by about distance over radius of curvature.
const FAR_STEPS: usize = 4;

/// Two surfaces face each other when the product of their outward normals is below this: less than about 75 degrees from opposed.
///
/// Not 0: where a box stands near the edge of a table the side of the table is at right angles to the box's face, and a turn
/// of 1e-5 rad would make it face the box; the contact would then jump between the two faces from step to step.
pub const FACING_COSINE: Real = -0.25;

/// Where a position lands on the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Position on the surface, m, in the frame of the points.
    pub point: Vec3,
    /// Unit outward normal of the surface there.
    pub normal: Vec3,
    /// About the root of the sum of squares of the two principal curvatures there, 1/m: 0 for a plane, with rounding.
    pub curvature: Real,
    /// Index of the candidate nearest to `point` (of those that face the query, if a direction was given).
    pub nearest: usize,
    /// Evaluations of the surface that it took; `max_iterations` may mean that the tolerance was not reached.
    pub iterations: u32,
}

/// The points that decide where the surface is: `points[r]` for `r` in `ranges`, in the caller's memory.
#[derive(Debug, Clone, Copy)]
pub struct Cloud<'a> {
    /// Positions, m.
    pub points: &'a [Vec3],
    /// Unit outward normals.
    pub normals: &'a [Vec3],
    /// Which of them are meant; what is beyond the end of the arrays is cut.
    pub ranges: &'a [Range<u32>],
    /// Their weight by distance.
    pub kernel: &'a Kernel,
    /// Only points with `n_k . facing <` [`FACING_COSINE`] may give the reference normal: the outward normal of the touching surface.
    pub facing: Option<&'a Vec3>,
}

/// Signed distance (m, positive outside) and unit normal of the surface at `x` (m, frame of the points).
/// `None` if under 3 points within the cutoff agree with the reference, or they make no plane.
///
/// Error of the zero set on a sphere of radius R with `Kernel::for_spacing(s)`, worst of 2,000 positions, in spacings:
///
/// | R/s | plane fit f | Hermite mean g | (f + g)/2 | angle of n, rad |
/// | --- | --- | --- | --- | --- |
/// | 4.9 | 3.1e-1 | 3.1e-1 | 1.9e-4 | 1.3e-2 |
/// | 9.8 | 1.6e-1 | 1.6e-1 | 1.8e-5 | 3.5e-3 |
/// | 19.5 | 7.8e-2 | 7.8e-2 | 9.6e-6 | 1.5e-3 |
/// | 39.1 | 3.9e-2 | 3.9e-2 | 4.9e-6 | 8.1e-4 |
pub fn evaluate(x: &Vec3, cloud: &Cloud) -> Option<(Real, Vec3)> {
    let fit = cloud.fit(x, cloud.nearest(x)?.0)?;
    Some((fit.distance(), fit.normal))
}

/// Projects `x` (m, frame of the points) on the surface: repeats `x <- x - n d(x)` until `|d| < tolerance`
/// (m; predicted from the last two), with `d` and `n` from [`evaluate`] and at most `max_iterations`
/// evaluations. `None` as there, but `x` may be any distance away: beyond the cutoff it starts from the
/// tangent plane of its nearest point and keeps to the line from `x` along the normal.
pub fn project(x: &Vec3, cloud: &Cloud, tolerance: Real, max_iterations: u32) -> Option<Projection> {
    let Cloud { points, normals, kernel, .. } = *cloud;
    let (mut nearest, r2) = cloud.nearest(x)?;
    let mut near = Gathered::nothing();
    // About how far the query has to move: its height over the tangent plane of its nearest point.
    let mut height = normals[nearest].dot(&(x - points[nearest]));
    let far = r2 > FAR * FAR * kernel.cutoff() * kernel.cutoff();
    let mut y = *x;
    if far {
        y -= normals[nearest] * height;
        height = 0.0;
    }
    let mut iterations = 0;
    let mut last = 0.0;
    loop {
        // The candidates at hand are complete while y stays within the slack of where the candidates were gathered.
        if !near.holds(&y) {
            near.gather(cloud, &y, height.abs() + 0.1 * kernel.cutoff());
            height = 0.0;
        }
        let fit = if near.count <= GATHER {
            let blocks = &near.blocks[..near.count.div_ceil(LANES)];
            nearest = nearest_in(blocks, &y).map_or(nearest, |place| near.indices[place] as usize);
            let mut moments = Moments::about(&y, &normals[nearest]);
            blocks.iter().for_each(|block| moments.add(block, kernel));
            moments.fit()?
        } else {
            nearest = cloud.nearest(&y)?.0;
            cloud.fit(&y, nearest)?
        };
        iterations += 1;
        let distance = fit.distance();
        let foot = y - fit.normal * distance;
        if far && iterations as usize <= FAR_STEPS && iterations < max_iterations {
            // From x itself along the newest normal, to the newest tangent plane (Alexa and Adamson's orthogonal projection).
            y = x - fit.normal * fit.normal.dot(&(x - foot));
            continue;
        }
        // The error shrinks by about the same factor every time, so that of `foot` can be predicted: one evaluation less.
        let next = distance * distance / last;
        if distance.abs().min(next) < tolerance || iterations >= max_iterations {
            // Of normals (-k1 u, -k2 v, 1) with E[u^2] = E[v^2] = h^2/2 the mean is shorter by (k1^2 + k2^2) h^2/4.
            let curvature = 2.0 * fit.spread.sqrt() / kernel.bandwidth();
            return Some(Projection { point: foot, normal: fit.normal, curvature, nearest, iterations });
        }
        last = distance.abs();
        y = foot;
    }
}

/// The candidates close to one position.
struct Gathered {
    blocks: [Block; GATHER / LANES],
    indices: [u32; GATHER],
    /// Over `GATHER` if they did not fit.
    count: usize,
    centre: Vec3,
    slack: Real,
}

impl Gathered {
    #[inline(always)]
    fn nothing() -> Self {
        let blocks = [Block::EMPTY; GATHER / LANES];
        Self { blocks, indices: [0; GATHER], count: 0, centre: Vec3::zeros(), slack: Real::NEG_INFINITY }
    }

    fn holds(&self, y: &Vec3) -> bool {
        self.slack >= 0.0 && (y - self.centre).norm_squared() <= self.slack * self.slack
    }

    /// Takes all candidates that have weight somewhere within `slack` (m) of `y`.
    fn gather(&mut self, cloud: &Cloud, y: &Vec3, slack: Real) {
        let reach2 = (cloud.kernel.cutoff() + slack) * (cloud.kernel.cutoff() + slack);
        let mut count = 0;
        cloud.for_each(|k, point, normal| {
            if (point - y).norm_squared() < reach2 {
                if count < GATHER {
                    self.indices[count] = k as u32;
                    self.blocks[count / LANES].set(count % LANES, point, normal, cloud.faces(normal));
                }
                count += 1;
            }
        });
        // What an earlier, larger gathering left in the last block must not count.
        if count < GATHER {
            for lane in count % LANES..LANES {
                self.blocks[count / LANES].set(lane, &Vec3::zeros(), &Vec3::zeros(), false);
            }
        }
        (self.count, self.centre, self.slack) = (count, *y, slack);
    }
}

impl Cloud<'_> {
    /// Visits all candidates, cut to what there is.
    #[inline(always)]
    fn for_each(&self, mut visit: impl FnMut(usize, &Vec3, &Vec3)) {
        let len = self.points.len().min(self.normals.len());
        for range in self.ranges {
            let end = (range.end as usize).min(len);
            let start = (range.start as usize).min(end);
            for (i, (point, normal)) in self.points[start..end].iter().zip(&self.normals[start..end]).enumerate() {
                visit(start + i, point, normal);
            }
        }
    }

    /// Whether a point with this normal may give the reference.
    #[inline(always)]
    fn faces(&self, normal: &Vec3) -> bool {
        self.facing.is_none_or(|facing| normal.dot(facing) < FACING_COSINE)
    }

    /// Index and squared distance (m^2) of the nearest candidate that faces the query, the first of equals.
    fn nearest(&self, x: &Vec3) -> Option<(usize, Real)> {
        let mut best = (usize::MAX, Real::INFINITY);
        self.for_each(|k, point, normal| {
            let r2 = (point - x).norm_squared();
            if r2 < best.1 && self.faces(normal) {
                best = (k, r2);
            }
        });
        (best.0 != usize::MAX).then_some(best)
    }

    /// The local surface at `x`, straight from the ranges.
    fn fit(&self, x: &Vec3, reference: usize) -> Option<Fit> {
        let mut moments = Moments::about(x, &self.normals[reference]);
        let mut block = Block::EMPTY;
        let mut filled = 0;
        self.for_each(|_, point, normal| {
            block.set(filled, point, normal, true);
            filled += 1;
            if filled == LANES {
                moments.add(&block, self.kernel);
                (block, filled) = (Block::EMPTY, 0);
            }
        });
        moments.add(&block, self.kernel);
        moments.fit()
    }
}

#[cfg(test)]
#[expect(clippy::single_range_in_vec_init, reason = "one range of candidates is meant")]
mod tests {
    use super::*;
    use crate::surface::shapes::{sample_fingertip, sample_sphere};
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    /// Worst zero-set error over positions on the unit sphere, in spacings: (plane, hermite, mean), and worst normal angle.
    fn sphere_errors(n: usize) -> (Real, [Real; 3], Real) {
        let surface = sample_sphere(1.0, n).unwrap();
        let (s, kernel) = (surface.spacing(), Kernel::for_spacing(surface.spacing()).unwrap());
        let all = [0..n as u32];
        let cloud = Cloud { points: surface.points(), normals: surface.normals(), ranges: &all, kernel: &kernel, facing: None };
        let (mut worst, mut angle) = ([0.0 as Real; 3], 0.0 as Real);
        for x in sample_sphere(1.0, 2000).unwrap().normals() {
            let (nearest, _) = cloud.nearest(x).unwrap();
            let fit = cloud.fit(x, nearest).unwrap();
            for (w, e) in worst.iter_mut().zip([fit.plane, fit.hermite, fit.distance()]) {
                *w = w.max(e.abs() / s);
            }
            angle = angle.max(fit.normal.angle(x));
        }
        (1.0 / s, worst, angle)
    }

    #[test]
    fn mean_of_plane_and_hermite_distance_cancels_the_curvature_error_on_spheres() {
        let mut coarsest: Option<(Real, [Real; 3])> = None;
        for n in [300, 1200, 4800, 19200] {
            let (radius, [plane, hermite, mean], angle) = sphere_errors(n);
            println!("/// | {radius:.1} | {plane:.1e} | {hermite:.1e} | {mean:.1e} | {angle:.1e} |");
            assert!(mean < 0.1 * plane, "mean {mean:e} against plane {plane:e} at R/s = {radius}");
            let (r, [p, _, m]) = *coarsest.get_or_insert((radius, [plane, hermite, mean]));
            if n == 19200 {
                // Errors in spacings fall one order slower than errors in metres.
                let order = |a: Real, b: Real| (a / b).ln() / (radius / r).ln() + 1.0;
                println!("    order of the plane {:.2}, of the mean {:.2}", order(p, plane), order(m, mean));
                assert!(order(m, mean) > 2.0, "order of convergence {:.2}", order(m, mean));
            }
        }
    }

    #[test]
    fn too_few_points_no_points_and_wrong_ranges_give_none() {
        let points = [Vec3::zeros(), Vec3::x(), Vec3::y()];
        let normals = [Vec3::z(); 3];
        let kernel = Kernel::for_spacing(1.0).unwrap();
        let run = |ranges: &[Range<u32>], facing: Option<&Vec3>| {
            project(&Vec3::new(0.3, 0.3, 0.5), &Cloud { points: &points, normals: &normals, ranges, kernel: &kernel, facing }, 1e-12, 20)
        };
        assert_eq!(run(&[], None), None);
        assert_eq!(run(&[0..2], None), None);
        assert_eq!(run(&[7..9], None), None);
        assert_eq!(run(&[0..3], Some(&Vec3::z())), None);
        let found = run(&[0..1, 1..9], Some(&-Vec3::z())).unwrap();
        assert!((found.point - Vec3::new(0.3, 0.3, 0.0)).norm() < 1e-12 && found.normal == Vec3::z() && found.nearest == 0);
    }

    #[test]
    fn a_far_position_lands_under_itself() {
        let surface = sample_sphere(1.0, 2000).unwrap();
        let (s, n) = (surface.spacing(), surface.len() as u32);
        let (kernel, all) = (Kernel::for_spacing(s).unwrap(), [0..n]);
        let cloud = Cloud { points: surface.points(), normals: surface.normals(), ranges: &all, kernel: &kernel, facing: None };
        let mut worst = [0.0 as Real; 2];
        for direction in sample_sphere(1.0, 500).unwrap().normals() {
            for (i, radius) in [0.5, 0.75, 0.9, 1.05, 1.2, 1.5].into_iter().enumerate() {
                let p = project(&(direction * radius), &cloud, 1e-9 * s, 30).unwrap();
                let error = (p.point - direction).norm() / s;
                worst[usize::from((2..4).contains(&i))] = worst[usize::from((2..4).contains(&i))].max(error);
            }
        }
        println!("landing error in spacings: far {:.1e}, near {:.1e}", worst[0], worst[1]);
        assert!(worst[0] < 0.05 && worst[1] < 0.01, "landing error in spacings: far {:.1e}, near {:.1e}", worst[0], worst[1]);
    }

    proptest! {
        #[test]
        fn projection_is_idempotent_and_turns_with_the_surface(
            x in prop::array::uniform3(-1.0..1.0f64), height in -1.0..1.0f64, turn in prop::array::uniform3(-3.0..3.0f64),
            shift in prop::array::uniform3(-0.1..0.1f64),
        ) {
            let surface = sample_fingertip(Vec3::new(0.008, 0.010, 0.007), 600).unwrap();
            let (s, n) = (surface.spacing(), surface.len() as u32);
            let direction = Vec3::new(x[0], x[1], x[2].abs() + 0.1).normalize();
            let x = direction.component_mul(&Vec3::new(0.008, 0.010, 0.007)) + direction * (height * s);
            let kernel = Kernel::for_spacing(s).unwrap();
            let tolerance = 1e-10 * s;
            let cloud = Cloud { points: surface.points(), normals: surface.normals(), ranges: &[0..n], kernel: &kernel, facing: None };
            let once = project(&x, &Cloud { ranges: &[0..n / 2, n / 2..n], ..cloud }, tolerance, 30).unwrap();
            prop_assert!(once.iterations < 30);
            let again = project(&once.point, &cloud, tolerance, 30).unwrap();
            prop_assert!((again.point - once.point).norm() < 10.0 * tolerance, "moved by {:e} m", (again.point - once.point).norm());
            let (value, _) = evaluate(&once.point, &cloud).unwrap();
            prop_assert!(value.abs() < 10.0 * tolerance);

            let (turn, shift) = (UnitQuaternion::from_scaled_axis(Vec3::from(turn)), Vec3::from(shift));
            let points: Vec<Vec3> = surface.points().iter().map(|p| turn * p + shift).collect();
            let normals: Vec<Vec3> = surface.normals().iter().map(|m| turn * m).collect();
            let turned = project(&(turn * x + shift), &Cloud { points: &points, normals: &normals, ..cloud }, tolerance, 30).unwrap();
            prop_assert!((turned.point - (turn * once.point + shift)).norm() < 1e-7 * s);
            prop_assert!((turned.normal - turn * once.normal).norm() < 1e-7);
        }
    }
}
