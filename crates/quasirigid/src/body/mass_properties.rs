//! Mass, centre of mass and inertia of a body.

use crate::error::{Error, Result, check_finite, check_positive};
use crate::math::{Mat3, Pose, Real, Rot, Vec3};
use nalgebra::Translation3;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// How much matter there is: a density, or the mass itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Amount {
    /// Density (kg/m^3).
    Density(Real),
    /// Mass (kg).
    Mass(Real),
}

impl Amount {
    /// Mass (kg) of a solid of `volume` (m^3).
    fn mass(self, volume: Real) -> Result<Real> {
        match self {
            Amount::Density(density) => check_positive("density", density, "kg/m^3").map(|()| density * volume),
            Amount::Mass(mass) => check_positive("mass", mass, "kg").map(|()| mass),
        }
    }
}

/// Mass properties of one rigid body, checked: mass > 0, inertia symmetric, positive definite, triangle inequality.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct MassProperties {
    mass: Real,
    center_of_mass: Vec3,
    inertia: Mat3,
}

/// What is read where mass properties are expected, before it is checked.
#[derive(Deserialize)]
struct Unchecked {
    mass: Real,
    center_of_mass: Vec3,
    inertia: Mat3,
}

impl TryFrom<Unchecked> for MassProperties {
    type Error = Error;

    fn try_from(read: Unchecked) -> Result<Self> {
        Self::new(read.mass, read.center_of_mass, read.inertia)
    }
}

/// An inertia may fail symmetry and the triangle inequality by this share of its largest moment: room for rounding and for
/// inertias integrated over a mesh, far below what would show in a motion.
const INERTIA_TOLERANCE: Real = 1e-9;

impl MassProperties {
    /// From mass (kg), centre of mass (m, body frame) and inertia about the centre of mass (kg m^2, body axes).
    ///
    /// # Errors
    /// Non-finite numbers, mass <= 0, an inertia that no solid body can have: not symmetric, not positive definite, or with
    /// a principal moment greater than the sum of the two others.
    pub fn new(mass: Real, center_of_mass: Vec3, inertia: Mat3) -> Result<Self> {
        check_positive("mass", mass, "kg")?;
        check_finite("centre of mass", center_of_mass.iter())?;
        check_finite("inertia", inertia.iter())?;
        let asymmetry = (inertia - inertia.transpose()).amax();
        if asymmetry > INERTIA_TOLERANCE * inertia.amax() {
            return Err(Error::value(
                "inertia",
                "a symmetric 3x3 matrix (kg m^2)",
                format!("an asymmetry of {asymmetry:e}"),
                "give the inertia about the centre of mass, in body axes",
            ));
        }
        let inertia = (inertia + inertia.transpose()) * 0.5;
        let moments = inertia.symmetric_eigenvalues();
        let (small, large) = (moments.min(), moments.max());
        let middle = moments.sum() - small - large;
        if small <= 0.0 {
            return Err(Error::value(
                "inertia",
                "a positive definite matrix (kg m^2)",
                format!("principal moments {small:e}, {middle:e}, {large:e}"),
                "a solid has positive principal moments: check the units and the volume of the shape",
            ));
        }
        if large > (small + middle) * (1.0 + INERTIA_TOLERANCE) {
            return Err(Error::value(
                "inertia",
                "no principal moment greater than the sum of the two others",
                format!("principal moments {small:e}, {middle:e}, {large:e}"),
                "no solid has this inertia: give it about the centre of mass, not about another point",
            ));
        }
        Ok(Self { mass, center_of_mass, inertia })
    }

    /// A solid box of edge lengths `size` (m), centred on the origin.
    ///
    /// # Errors
    /// A size, density or mass that is not a finite number > 0.
    pub fn cuboid(size: Vec3, amount: Amount) -> Result<Self> {
        for edge in size.iter() {
            check_positive("box size", *edge, "m")?;
        }
        let mass = amount.mass(size.x * size.y * size.z)?;
        let square = size.component_mul(&size) * (mass / 12.0);
        Self::new(mass, Vec3::zeros(), diagonal(square.y + square.z, square.z + square.x, square.x + square.y))
    }

    /// Of a body of which only the mass (kg) is known: a solid box, the bounding box of its surface points (m), axes of the body's frame.
    ///
    /// # Errors
    /// A mass that is not a finite number > 0; no point, or points that lie in a plane along two axes: such a box has no volume.
    pub fn of_bounding_box(points: &[Vec3], mass: Real) -> Result<Self> {
        let start = Vec3::repeat(Real::INFINITY);
        let (low, high) = points.iter().fold((start, -start), |(low, high), p| (low.inf(p), high.sup(p)));
        Self::cuboid(high - low, Amount::Mass(mass))?
            .transformed(&Pose::from_parts(Translation3::from((low + high) * 0.5), Rot::identity()))
    }

    /// A solid sphere of `radius` (m), centred on the origin.
    ///
    /// # Errors
    /// A radius, density or mass that is not a finite number > 0.
    pub fn sphere(radius: Real, amount: Amount) -> Result<Self> {
        check_positive("sphere radius", radius, "m")?;
        let mass = amount.mass(4.0 / 3.0 * PI * radius.powi(3))?;
        let moment = 0.4 * mass * radius * radius;
        Self::new(mass, Vec3::zeros(), diagonal(moment, moment, moment))
    }

    /// A solid ellipsoid of semi-axes `semi_axes` (m) along x, y, z, centred on the origin.
    ///
    /// # Errors
    /// A semi-axis, density or mass that is not a finite number > 0.
    pub fn ellipsoid(semi_axes: Vec3, amount: Amount) -> Result<Self> {
        for axis in semi_axes.iter() {
            check_positive("ellipsoid semi-axis", *axis, "m")?;
        }
        let mass = amount.mass(4.0 / 3.0 * PI * semi_axes.x * semi_axes.y * semi_axes.z)?;
        let square = semi_axes.component_mul(&semi_axes) * (mass / 5.0);
        Self::new(mass, Vec3::zeros(), diagonal(square.y + square.z, square.z + square.x, square.x + square.y))
    }

    /// A solid cylinder of `radius` and `length` (m), axis z, centred on the origin.
    ///
    /// # Errors
    /// A radius, length, density or mass that is not a finite number > 0.
    pub fn cylinder(radius: Real, length: Real, amount: Amount) -> Result<Self> {
        check_positive("cylinder radius", radius, "m")?;
        check_positive("cylinder length", length, "m")?;
        let mass = amount.mass(PI * radius * radius * length)?;
        let (axial, radial) = (0.5 * mass * radius * radius, mass * (3.0 * radius * radius + length * length) / 12.0);
        Self::new(mass, Vec3::zeros(), diagonal(radial, radial, axial))
    }

    /// A solid capsule: a cylinder of `radius` and `length` (m, without the caps), axis z, with two half-spheres, centred on
    /// the origin.
    ///
    /// # Errors
    /// A radius, length, density or mass that is not a finite number > 0.
    pub fn capsule(radius: Real, length: Real, amount: Amount) -> Result<Self> {
        check_positive("capsule radius", radius, "m")?;
        check_positive("capsule length", length, "m")?;
        let (r, l) = (radius, length);
        let (cylinder_volume, caps_volume) = (PI * r * r * l, 4.0 / 3.0 * PI * r.powi(3));
        let mass = amount.mass(cylinder_volume + caps_volume)?;
        let cylinder = mass * cylinder_volume / (cylinder_volume + caps_volume);
        let caps = mass - cylinder;
        // Both caps together: 2/5 m r^2 about the axis; about a diameter, each cap 83/320 m r^2 about its own centre of mass,
        // which lies 3 r / 8 beyond the end of the cylinder.
        let axial = 0.5 * cylinder * r * r + 0.4 * caps * r * r;
        let arm = 0.5 * l + 0.375 * r;
        let radial = cylinder * (3.0 * r * r + l * l) / 12.0 + caps * (83.0 / 320.0 * r * r + arm * arm);
        Self::new(mass, Vec3::zeros(), diagonal(radial, radial, axial))
    }

    /// Mass (kg).
    pub fn mass(&self) -> Real {
        self.mass
    }

    /// Centre of mass (m, body frame).
    pub fn center_of_mass(&self) -> &Vec3 {
        &self.center_of_mass
    }

    /// Inertia about the centre of mass (kg m^2, body axes).
    pub fn inertia(&self) -> &Mat3 {
        &self.inertia
    }

    /// The same shape with another mass (kg): the inertia grows in proportion.
    ///
    /// # Errors
    /// A mass that is not a finite number > 0.
    pub fn scaled_to_mass(&self, mass: Real) -> Result<Self> {
        check_positive("mass", mass, "kg")?;
        Self::new(mass, self.center_of_mass, self.inertia * (mass / self.mass))
    }

    /// The same solid seen from a frame in which its own frame has the pose `pose`.
    ///
    /// # Errors
    /// A pose that is not finite.
    pub fn transformed(&self, pose: &Pose) -> Result<Self> {
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let center = (pose * nalgebra::Point3::from(self.center_of_mass)).coords;
        Self::new(self.mass, center, rotation * self.inertia * rotation.transpose())
    }

    /// Several solids, all given in one frame, as one body.
    ///
    /// # Errors
    /// An empty list.
    pub fn combined(parts: &[MassProperties]) -> Result<Self> {
        if parts.is_empty() {
            return Err(Error::shape("parts of a body", "at least one", 0, "give the mass properties of every part"));
        }
        let mass: Real = parts.iter().map(|part| part.mass).sum();
        let center = parts.iter().map(|part| part.center_of_mass * part.mass).sum::<Vec3>() / mass;
        // Steiner: I = sum I_k + m_k (|d|^2 1 - d d^T), d from the common centre to the part's centre.
        let inertia = parts
            .iter()
            .map(|part| {
                let d = part.center_of_mass - center;
                part.inertia + (Mat3::identity() * d.norm_squared() - d * d.transpose()) * part.mass
            })
            .sum();
        Self::new(mass, center, inertia)
    }
}

fn diagonal(x: Real, y: Real, z: Real) -> Mat3 {
    Mat3::from_diagonal(&Vec3::new(x, y, z))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mass and inertia about the centre by brute force: cells of a fine grid that lie inside the shape.
    fn by_grid(extent: Vec3, inside: impl Fn(&Vec3) -> bool) -> (Real, Mat3) {
        let n = 100;
        let cell = extent * (2.0 / n as Real);
        let dm = cell.x * cell.y * cell.z;
        let (mut mass, mut inertia) = (0.0, Mat3::zeros());
        for i in 0..n {
            for j in 0..n {
                for k in 0..n {
                    let p = Vec3::new(i as Real + 0.5, j as Real + 0.5, k as Real + 0.5).component_mul(&cell) - extent;
                    if inside(&p) {
                        mass += dm;
                        inertia += (Mat3::identity() * p.norm_squared() - p * p.transpose()) * dm;
                    }
                }
            }
        }
        (mass, inertia)
    }

    #[test]
    fn a_mass_alone_gives_the_inertia_of_the_bounding_box_wherever_the_points_lie() {
        let (size, center) = (Vec3::new(0.02, 0.04, 0.06), Vec3::new(0.1, -0.2, 0.3));
        // An octahedron: it touches every side of its bounding box.
        let points: Vec<Vec3> = (0..3).flat_map(|k| [-0.5, 0.5].map(|side| center + Vec3::ith(k, side * size[k]))).collect();
        let made = MassProperties::of_bounding_box(&points, 0.3).unwrap();
        let cuboid = MassProperties::cuboid(size, Amount::Mass(0.3)).unwrap();
        let off = (made.inertia() - cuboid.inertia()).amax() / cuboid.inertia().amax();
        assert!(made.mass() == 0.3 && off < 1e-12, "mass {}, inertia off by {off:e}", made.mass());
        assert!((made.center_of_mass() - center).amax() < 1e-15, "{}", made.center_of_mass());
        for flat in [&points[..1], &[], &[Vec3::zeros(), Vec3::x(), Vec3::y()]] {
            assert!(MassProperties::of_bounding_box(flat, 0.3).is_err());
        }
        assert!(MassProperties::of_bounding_box(&points, -0.3).is_err());
    }

    #[test]
    fn shapes_have_the_inertia_of_their_grid() {
        let density = Amount::Density(1.0);
        let cases: [(&str, MassProperties, (Real, Mat3)); 5] = [
            ("box", MassProperties::cuboid(Vec3::new(0.2, 0.4, 0.6), density).unwrap(), by_grid(Vec3::new(0.1, 0.2, 0.3), |_| true)),
            ("sphere", MassProperties::sphere(0.5, density).unwrap(), by_grid(Vec3::repeat(0.5), |p| p.norm() < 0.5)),
            (
                "ellipsoid",
                MassProperties::ellipsoid(Vec3::new(0.5, 0.3, 0.2), density).unwrap(),
                by_grid(Vec3::new(0.5, 0.3, 0.2), |p| p.component_div(&Vec3::new(0.5, 0.3, 0.2)).norm() < 1.0),
            ),
            ("cylinder", MassProperties::cylinder(0.3, 1.0, density).unwrap(), by_grid(Vec3::new(0.3, 0.3, 0.5), |p| p.xy().norm() < 0.3)),
            (
                "capsule",
                MassProperties::capsule(0.3, 1.0, density).unwrap(),
                by_grid(Vec3::new(0.3, 0.3, 0.8), |p| (p - Vec3::z() * p.z.clamp(-0.5, 0.5)).norm() < 0.3),
            ),
        ];
        for (name, shape, (mass, inertia)) in cases {
            let mass_error = (shape.mass() - mass).abs() / mass;
            let inertia_error = (shape.inertia() - inertia).amax() / inertia.amax();
            assert!(mass_error < 3e-3 && inertia_error < 5e-3, "{name}: mass off by {mass_error:e}, inertia by {inertia_error:e}");
        }
    }

    #[test]
    fn two_half_boxes_make_a_box() {
        let half = MassProperties::cuboid(Vec3::new(0.1, 0.4, 0.6), Amount::Mass(1.0)).unwrap();
        let parts = [0.05, -0.05].map(|x| half.transformed(&Pose::translation(x, 0.0, 0.0)).unwrap());
        let whole = MassProperties::cuboid(Vec3::new(0.2, 0.4, 0.6), Amount::Mass(2.0)).unwrap();
        let sum = MassProperties::combined(&parts).unwrap();
        assert!((sum.inertia() - whole.inertia()).amax() < 1e-15, "{}", sum.inertia() - whole.inertia());
        assert!(sum.center_of_mass().norm() < 1e-15 && sum.mass() == 2.0);
    }

    #[test]
    fn inertia_turns_with_the_body_and_grows_with_its_mass() {
        let shape = MassProperties::cuboid(Vec3::new(0.1, 0.2, 0.3), Amount::Mass(1.0)).unwrap();
        let turned = shape.transformed(&Pose::from_parts(Vec3::x().into(), Rot::from_axis_angle(&Vec3::z_axis(), PI / 2.0))).unwrap();
        assert!((turned.inertia()[(0, 0)] - shape.inertia()[(1, 1)]).abs() < 1e-15);
        assert!((turned.center_of_mass() - Vec3::x()).norm() < 1e-15);
        assert!((shape.scaled_to_mass(3.0).unwrap().inertia() - shape.inertia() * 3.0).amax() < 1e-15);
    }

    #[test]
    fn impossible_inertias_are_refused() {
        let make = |inertia| MassProperties::new(1.0, Vec3::zeros(), inertia);
        assert!(make(diagonal(1.0, 1.0, 2.0)).is_ok(), "a flat plate sits on the triangle inequality");
        assert!(make(diagonal(1.0, 1.0, 2.1)).unwrap_err().to_string().contains("principal moments"));
        assert!(make(diagonal(1.0, 1.0, -1.0)).is_err());
        assert!(make(Mat3::new(1.0, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)).unwrap_err().to_string().contains("symmetric"));
        assert!(make(diagonal(Real::NAN, 1.0, 1.0)).is_err());
        assert!(MassProperties::new(-1.0, Vec3::zeros(), Mat3::identity()).is_err());
        assert!(MassProperties::cuboid(Vec3::new(0.0, 1.0, 1.0), Amount::Mass(1.0)).is_err());
        assert!(MassProperties::sphere(1.0, Amount::Density(Real::INFINITY)).is_err());
        assert!(MassProperties::combined(&[]).is_err());
    }
}
