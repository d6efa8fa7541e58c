//! Samplings of simple shapes: exactly `n` nearly evenly spaced points, exact normals, areas that add up to the shape's area.
//!
//! Curved shapes are sampled on Fibonacci spirals: point `i` of `n` takes the middle of the `i`-th
//! of `n` bands of equal area and turns by the golden angle. Flat and rolled-up faces are sampled in
//! rows, discs in rings. Every sampling is a pure function of its arguments.

use crate::error::{Error, Result, check_positive};
use crate::math::{Real, Vec3};
use crate::surface::sampling::memory::check_memory;
use crate::surface::sampling::point_surface::PointSurface;
use std::f64::consts::PI;

/// Turn between successive points of a Fibonacci spiral, rad: pi (3 - sqrt 5).
const GOLDEN_ANGLE: Real = 2.399_963_229_728_653;
/// Cosine of the polar angle down to which a fingertip pad reaches: a little past the equator of the ellipsoid.
const FINGERTIP_RIM_COSINE: Real = -0.2;

/// The surface of a box of edge lengths `size` (m), centred at the origin: `n` points (>= 6), normals exact and never averaged at
/// edges.
///
/// Layout: faces in the order +x, -x, +y, -y, +z, -z, each with a share of the points in proportion to its area. One that is narrower
/// than the points are apart
/// gets a row of them as far apart as elsewhere, and at least one.
/// The plane coordinates of a face are the two other axes in cyclic order. A face of sides a, b and m points has about sqrt(m b/a)
/// rows along a, as tall as their share of the m points, and each row's points stand in the middle of equal rectangles. So every
/// point of a face has the same area, and edge points stand half a spacing from the edge.
///
/// # Errors
/// [`Error::InvalidValue`] if a size is not finite and positive or `n` is under 6.
pub fn sample_box(size: Vec3, n: usize) -> Result<PointSurface> {
    for (name, value) in ["box size x", "box size y", "box size z"].iter().zip(size.iter()) {
        check_positive(name, *value, "m")?;
    }
    check_count(n, 6)?;
    let sides = [[size.y, size.z], [size.z, size.x], [size.x, size.y]].map(|face| [face, face]).concat();
    let counts = apportion(n, &with_rows(n, &sides), 1);
    let mut sampling = Sampling::with_capacity(n);
    for (face, &m) in counts.iter().enumerate() {
        let (axis, sign) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut normal = Vec3::zeros();
        normal[axis] = sign;
        for_each_in_rectangle(size[u], size[v], m, |pu, pv, area| {
            let mut p = Vec3::zeros();
            p[axis] = sign * 0.5 * size[axis];
            p[u] = pu;
            p[v] = pv;
            sampling.push(p, normal, area);
        });
    }
    sampling.finish()
}

/// A sphere of `radius` (m) about the origin: `n` points (>= 4) on a Fibonacci spiral from the north pole (+z) down, equal areas.
///
/// # Errors
/// [`Error::InvalidValue`] if the radius is not finite and positive or `n` is under 4.
pub fn sample_sphere(radius: Real, n: usize) -> Result<PointSurface> {
    check_positive("sphere radius", radius, "m")?;
    check_count(n, 4)?;
    let mut sampling = Sampling::with_capacity(n);
    for i in 0..n {
        let s = spiral_direction(1.0 - (2 * i + 1) as Real / n as Real, i);
        sampling.push(s * radius, s, 4.0 * PI * radius * radius / n as Real);
    }
    sampling.finish()
}

/// The cap of a sphere of `radius` (m) about the origin that lies within `half_angle` (rad, up to pi) of +z: `n` points (>= 4) on a
/// Fibonacci spiral from the pole down, equal areas. A small cap is a fine sampling of what a large sphere touches with.
///
/// # Errors
/// [`Error::InvalidValue`] if the radius is not finite and positive, the angle outside (0, pi], or `n` under 4.
pub fn sample_cap(radius: Real, half_angle: Real, n: usize) -> Result<PointSurface> {
    check_positive("sphere radius", radius, "m")?;
    check_positive("half angle of the cap", half_angle, "rad")?;
    if half_angle > PI {
        return Err(Error::value("half angle of the cap", "at most pi rad", half_angle, "give radians, not degrees"));
    }
    check_count(n, 4)?;
    // 1 - cos without cancellation: a small cap on a large sphere is what this is for.
    let height = 2.0 * (0.5 * half_angle).sin().powi(2);
    let mut sampling = Sampling::with_capacity(n);
    for i in 0..n {
        let s = spiral_direction(1.0 - height * (i as Real + 0.5) / n as Real, i);
        sampling.push(s * radius, s, 2.0 * PI * radius * radius * height / n as Real);
    }
    sampling.finish()
}

/// A capsule about the z axis: a cylinder of `radius` and `length` (m, the cylindrical part alone; 0 gives a sphere) with
/// hemispherical ends, centred at the origin. `n` points (>= 4) on one spiral from the top down, equal areas.
///
/// # Errors
/// [`Error::InvalidValue`] if the radius is not finite and positive, the length negative or not finite, or `n` under 4.
pub fn sample_capsule(radius: Real, length: Real, n: usize) -> Result<PointSurface> {
    check_positive("capsule radius", radius, "m")?;
    crate::error::check_non_negative("capsule length", length, "m")?;
    check_count(n, 4)?;
    // Archimedes: a sphere and its enclosing cylinder have the same area between two heights, so the area of the whole capsule is
    // uniform in z.
    let height = length + 2.0 * radius;
    let mut sampling = Sampling::with_capacity(n);
    for i in 0..n {
        let z = height * (0.5 - (i as Real + 0.5) / n as Real);
        let centre = Vec3::new(0.0, 0.0, z.clamp(-0.5 * length, 0.5 * length));
        let s = spiral_direction((z - centre.z) / radius, i);
        sampling.push(centre + s * radius, s, 2.0 * PI * radius * height / n as Real);
    }
    sampling.finish()
}

/// A closed cylinder about the z axis, of `radius` and `length` (m), centred at the origin, `n` points (>= 6): the side, then the top
/// and the bottom disc, each with a share of the points in proportion to its area, but a ring of them at least on the side. The side is
/// a face of [`sample_box`] rolled up
/// (rings from the bottom up), the discs are concentric rings from the middle out, so that points stand half a spacing from the two
/// rims. Equal areas within each of the three.
///
/// # Errors
/// [`Error::InvalidValue`] if the radius or the length is not finite and positive or `n` is under 6.
pub fn sample_cylinder(radius: Real, length: Real, n: usize) -> Result<PointSurface> {
    check_positive("cylinder radius", radius, "m")?;
    check_positive("cylinder length", length, "m")?;
    check_count(n, 6)?;
    let (side, disc) = ([2.0 * PI * radius, length], [PI.sqrt() * radius; 2]);
    let counts = apportion(n, &with_rows(n, &[side, disc, disc]), 1);
    let mut sampling = Sampling::with_capacity(n);
    for_each_in_rectangle(2.0 * PI * radius, length, counts[0], |arc, z, area| {
        let (sin, cos) = (arc / radius).sin_cos();
        sampling.push(Vec3::new(radius * cos, radius * sin, z), Vec3::new(cos, sin, 0.0), area);
    });
    for (&m, sign) in counts[1..].iter().zip([1.0, -1.0]) {
        for_each_in_disc(radius, m, |x, y, area| {
            sampling.push(Vec3::new(x, y, sign * 0.5 * length), Vec3::new(0.0, 0.0, sign), area);
        });
    }
    sampling.finish()
}

/// A square patch of the half-space z <= 0: z = 0, |x| and |y| up to `side`/2 (m), outward +z, `n` points (>= 4) in rows along x as
/// on a face of [`sample_box`], equal areas.
///
/// # Errors
/// [`Error::InvalidValue`] if the side is not finite and positive or `n` is under 4.
pub fn sample_half_space(side: Real, n: usize) -> Result<PointSurface> {
    check_positive("half-space side", side, "m")?;
    check_count(n, 4)?;
    let mut sampling = Sampling::with_capacity(n);
    for_each_in_rectangle(side, side, n, |x, y, area| sampling.push(Vec3::new(x, y, 0.0), Vec3::z(), area));
    sampling.finish()
}

/// The pad of a fingertip: the part of the ellipsoid of `semi_axes` (m, along x, y, z) with z >= -0.2 times its z semi-axis, palmar
/// side outward +z, open at the back. `n` points (>= 4) from the pole (+z) down.
///
/// Points `s` of a Fibonacci spiral on the unit sphere are stretched by `D = diag(a, b, c)`. The normal is `D^-1 s`, normalised, and
/// an area on the sphere grows by `det(D) |D^-1 s|` (Nanson's formula).
///
/// # Errors
/// [`Error::InvalidValue`] if a semi-axis is not finite and positive or `n` is under 4.
pub fn sample_fingertip(semi_axes: Vec3, n: usize) -> Result<PointSurface> {
    for (name, value) in ["fingertip semi-axis x", "fingertip semi-axis y", "fingertip semi-axis z"].iter().zip(semi_axes.iter()) {
        check_positive(name, *value, "m")?;
    }
    check_count(n, 4)?;
    let sphere_area = 2.0 * PI * (1.0 - FINGERTIP_RIM_COSINE) / n as Real;
    let mut sampling = Sampling::with_capacity(n);
    for i in 0..n {
        let s = spiral_direction(1.0 - (1.0 - FINGERTIP_RIM_COSINE) * (i as Real + 0.5) / n as Real, i);
        let stretched = s.component_div(&semi_axes);
        let stretch = semi_axes.product() * stretched.norm();
        sampling.push(s.component_mul(&semi_axes), stretched.normalize(), sphere_area * stretch);
    }
    sampling.finish()
}

/// Unit vector at polar cosine `cosine` (about +z), turned by `i` golden angles.
fn spiral_direction(cosine: Real, i: usize) -> Vec3 {
    let cosine = cosine.clamp(-1.0, 1.0);
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (i as Real * GOLDEN_ANGLE).sin_cos();
    Vec3::new(sine * cos_phi, sine * sin_phi, cosine)
}

/// Calls `visit(u, v, area)` for `m` points in rows on the rectangle `a` x `b` (m) centred at zero; the layout is that of
/// [`sample_box`].
fn for_each_in_rectangle(a: Real, b: Real, m: usize, mut visit: impl FnMut(Real, Real, Real)) {
    let rows = ((m as Real * b / a).sqrt().round() as usize).clamp(1, m.max(1));
    let mut done = 0;
    for row in 0..rows {
        // Points before the end of this row if the m points are spread over the rows as evenly as whole numbers allow.
        let end = (row + 1) * m / rows;
        let v = b * (0.5 * (done + end) as Real / m as Real - 0.5);
        let count = end - done;
        for i in 0..count {
            visit(a * ((i as Real + 0.5) / count as Real - 0.5), v, a * b / m as Real);
        }
        done = end;
    }
}

/// Calls `visit(x, y, area)` for `m` points in concentric rings on the disc of `radius` (m) about zero: sqrt(m/pi) rings, each as
/// wide as its whole number of points asks for at equal areas, points on the circle that halves the area of the ring.
fn for_each_in_disc(radius: Real, m: usize, mut visit: impl FnMut(Real, Real, Real)) {
    let rings = ((m as Real / PI).sqrt().round() as usize).max(1);
    let mut done = 0;
    for ring in 0..rings {
        // The share of the area within ring k of K is (k/K)^2.
        let end = (m * (ring + 1) * (ring + 1) + rings * rings / 2) / (rings * rings);
        let r = radius * (0.5 * (done + end) as Real / m as Real).sqrt();
        let count = end - done;
        // A ring of one is the middle itself.
        let r = if count == 1 && done == 0 { 0.0 } else { r };
        for i in 0..count {
            let (sin, cos) = (2.0 * PI * i as Real / count as Real + ring as Real * GOLDEN_ANGLE).sin_cos();
            visit(r * cos, r * sin, PI * radius * radius / m as Real);
        }
        done = end;
    }
}

/// Weights of rectangular faces of sides (a, b) in `n` points: their areas, but a row of points along those that are narrower than the
/// spacing s of the points.
///
/// ```text
/// weight = max(a b, max(a, b) s),   s such that sum weight / s^2 = n
/// ```
fn with_rows(n: usize, sides: &[[Real; 2]]) -> Vec<Real> {
    let weight = |s: Real| sides.iter().map(move |&[a, b]| (a * b).max(a.max(b) * s));
    let count = |s: Real| weight(s).map(|w| w / s / s).sum::<Real>();
    let mut low = (sides.iter().map(|[a, b]| a * b / n as Real).sum::<Real>()).sqrt();
    if sides.iter().all(|[a, b]| a.min(*b) >= low) {
        return weight(0.0).collect();
    }
    // Counts fall with the spacing.
    let mut high = 2.0 * low;
    while count(high) > n as Real && high.is_finite() {
        (low, high) = (high, 2.0 * high);
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if count(middle) > n as Real { low = middle } else { high = middle }
    }
    weight(high).collect()
}

/// Shares `n` among parts in proportion to `weights` (> 0) by the largest remainder, each part at least `least`; needs
/// `n >= least * parts`.
fn apportion(n: usize, weights: &[Real], least: usize) -> Vec<usize> {
    // Divided by the largest first: the sum of very large weights must not overflow.
    let largest = weights.iter().copied().fold(0.0, Real::max);
    let total: Real = weights.iter().map(|w| w / largest).sum();
    let spare = n - least * weights.len();
    // What a part gets beyond its least share; parts that deserve less than that get nothing more.
    let wish: Vec<Real> = weights.iter().map(|w| (n as Real * (w / largest) / total - least as Real).max(0.0)).collect();
    let wish_total: Real = wish.iter().sum();
    let share: Vec<Real> = wish.iter().map(|w| if wish_total > 0.0 { w * spare as Real / wish_total } else { 0.0 }).collect();
    let mut counts: Vec<usize> = share.iter().map(|s| least + s.floor() as usize).collect();
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by(|&i, &j| (share[j] - share[j].floor()).total_cmp(&(share[i] - share[i].floor())).then(i.cmp(&j)));
    let missing = n.saturating_sub(counts.iter().sum());
    for k in 0..missing {
        counts[order[k % order.len()]] += 1;
    }
    counts
}

fn check_count(n: usize, least: usize) -> Result<()> {
    if n >= least && n < u32::MAX as usize {
        return check_memory(n);
    }
    Err(Error::value("number of points", format!("{least} or more, under 2^32"), n, "ask for a few hundred points at least"))
}

/// The three arrays of a surface while they are filled.
struct Sampling {
    points: Vec<Vec3>,
    normals: Vec<Vec3>,
    areas: Vec<Real>,
}

impl Sampling {
    fn with_capacity(n: usize) -> Self {
        Self { points: Vec::with_capacity(n), normals: Vec::with_capacity(n), areas: Vec::with_capacity(n) }
    }

    fn push(&mut self, point: Vec3, normal: Vec3, area: Real) {
        self.points.push(point);
        self.normals.push(normal);
        self.areas.push(area);
    }

    fn finish(self) -> Result<PointSurface> {
        PointSurface::new(self.points, self.normals, self.areas)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::search::neighbours::NeighbourGrid;
    use proptest::prelude::*;

    /// Smallest and largest distance to the nearest other point, over the spacing.
    fn nearest_range(surface: &PointSurface) -> (Real, Real) {
        let grid = NeighbourGrid::build_auto(surface.points());
        let mut near = Vec::new();
        let (mut low, mut high) = (Real::INFINITY, 0.0 as Real);
        for p in surface.points() {
            grid.k_nearest(p, 2, &mut near);
            let d = near[1].1.sqrt() / surface.spacing();
            (low, high) = (low.min(d), high.max(d));
        }
        (low, high)
    }

    #[test]
    fn areas_add_up_to_the_exact_area_of_the_shape() {
        let (r, l) = (0.01, 0.05);
        let ellipsoid_of_revolution = {
            // Area of z >= -0.2 c of the ellipsoid (a, a, c): integral over the polar cosine, fine midpoint rule.
            let (a, c, m) = (0.008, 0.005, 200_000);
            let dz = 1.2 / m as Real;
            (0..m)
                .map(|i| {
                    let z: Real = -0.2 + dz * (i as Real + 0.5);
                    2.0 * PI * a * a * c * ((1.0 - z * z) / (a * a) + z * z / (c * c)).sqrt() * dz
                })
                .sum::<Real>()
        };
        let cases = [
            ("box", sample_box(Vec3::new(0.06, 0.04, 0.1), 3001).unwrap(), 2.0 * (0.06 * 0.04 + 0.04 * 0.1 + 0.1 * 0.06)),
            ("sphere", sample_sphere(r, 1000).unwrap(), 4.0 * PI * r * r),
            ("cap", sample_cap(r, 0.1, 500).unwrap(), 4.0 * PI * (r * Real::sin(0.05)).powi(2)),
            ("capsule", sample_capsule(r, l, 999).unwrap(), 2.0 * PI * r * (l + 2.0 * r)),
            ("cylinder", sample_cylinder(r, l, 777).unwrap(), 2.0 * PI * r * (l + r)),
            ("half-space", sample_half_space(0.2, 1234).unwrap(), 0.04),
            ("fingertip", sample_fingertip(Vec3::new(0.008, 0.008, 0.005), 2400).unwrap(), ellipsoid_of_revolution),
        ];
        for (name, surface, exact) in cases {
            let error = surface.total_area() / exact - 1.0;
            let bound = if name == "fingertip" { 1e-6 } else { 1e-12 };
            assert!(error.abs() < bound, "{name}: relative area error {error:e}");
        }
    }

    #[test]
    fn points_are_nearly_evenly_spaced() {
        let cases = [
            ("box", sample_box(Vec3::new(0.06, 0.04, 0.1), 3000).unwrap(), 0.65),
            ("sphere", sample_sphere(0.01, 1000).unwrap(), 0.8),
            ("cap", sample_cap(0.01, 0.1, 1000).unwrap(), 0.65),
            ("capsule", sample_capsule(0.01, 0.05, 1000).unwrap(), 0.65),
            ("long capsule", sample_capsule(0.001, 0.1, 1000).unwrap(), 0.65),
            ("cylinder", sample_cylinder(0.01, 0.05, 1000).unwrap(), 0.5),
            ("half-space", sample_half_space(0.2, 1234).unwrap(), 0.8),
            ("fingertip", sample_fingertip(Vec3::new(0.008, 0.010, 0.006), 2400).unwrap(), 0.6),
        ];
        for (name, surface, least) in cases {
            let (low, high) = nearest_range(&surface);
            println!("{name}: nearest neighbour {low:.3} to {high:.3} spacings");
            assert!(low > least && high < 1.3, "{name}: nearest neighbour {low:.3} to {high:.3} spacings");
        }
    }

    #[test]
    fn box_points_stand_half_a_spacing_from_the_edges() {
        let size = Vec3::new(0.06, 0.06, 0.06);
        let surface = sample_box(size, 2400).unwrap();
        let half = 0.5 * surface.spacing();
        for (p, n) in surface.points().iter().zip(surface.normals()) {
            for axis in 0..3 {
                let to_edge = 0.5 * size[axis] - p[axis].abs();
                let expected = if n[axis] != 0.0 { 0.0 } else { half };
                assert!(to_edge >= expected - 0.02 * half, "point {p:?}: {to_edge:e} m from the edge, {expected:e} expected");
            }
        }
    }

    proptest! {
        #[test]
        fn every_box_has_exactly_n_points_on_its_faces(size in prop::array::uniform3(1e-3..1.0f64), n in 6usize..3000) {
            let size = Vec3::from(size);
            let surface = sample_box(size, n).unwrap();
            prop_assert_eq!(surface.len(), n);
            let exact = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
            prop_assert!((surface.total_area() / exact - 1.0).abs() < 1e-12);
            for (p, normal) in surface.points().iter().zip(surface.normals()) {
                prop_assert!((2.0 * normal.dot(p) - size.dot(&normal.abs())).abs() < 1e-15);
                prop_assert!((0..3).all(|a| p[a].abs() <= 0.5 * size[a]));
            }
        }

        #[test]
        fn spirals_lie_on_their_shape(r in 1e-3..1.0f64, l in 0.0..1.0f64, n in 6usize..500) {
            for (p, normal) in sample_capsule(r, l, n).unwrap().points().iter().zip(sample_capsule(r, l, n).unwrap().normals()) {
                let centre = Vec3::new(0.0, 0.0, p.z.clamp(-0.5 * l, 0.5 * l));
                prop_assert!(((p - centre) - normal * r).norm() < 1e-12);
            }
            prop_assert_eq!(sample_cylinder(r, l + 1e-3, n).unwrap().len(), n);
        }
    }

    #[test]
    fn bad_arguments_are_refused() {
        for bad in [Real::NAN, Real::INFINITY, 0.0, -1.0] {
            assert!(sample_box(Vec3::new(1.0, bad, 1.0), 100).is_err());
            assert!(sample_sphere(bad, 100).is_err());
            assert!(sample_cap(bad, 1.0, 100).is_err() && sample_cap(1.0, bad, 100).is_err());
            assert!(sample_capsule(bad, 1.0, 100).is_err());
            assert!(sample_cylinder(1.0, bad, 100).is_err());
            assert!(sample_half_space(bad, 100).is_err());
            assert!(sample_fingertip(Vec3::new(1.0, 1.0, bad), 100).is_err());
        }
        assert!(sample_cap(1.0, 4.0, 100).is_err() && sample_cap(1.0, 1.0, 3).is_err());
        assert!(sample_capsule(1.0, -1.0, 100).is_err() && sample_capsule(1.0, Real::NAN, 100).is_err());
        assert!(sample_sphere(1.0, 0).is_err() && sample_box(Vec3::repeat(1.0), 5).is_err());
    }
}
