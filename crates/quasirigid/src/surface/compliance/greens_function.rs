//! Green's function of an elastic continuum at its surface: a half-space, or a layer bonded to a rigid backing.

use super::AxialCompliance;
use super::bonded_layer::LayerTable;
use super::influence::Influence;
use crate::math::{Mat3, Real, Vec3};
use crate::surface::control_points::{CLOSEST_OVER_RADII, ControlPoints, MOST_OVER_DISC};
use std::f64::consts::PI;
use std::sync::Arc;

/// A point of a layer may not be stiffer than the disc that it stands for, by this factor where points are farther
/// apart than the layer is thick.
const LEAST_OVER_DISC_WHERE_SPARSE: Real = 1.1;

/// Displacement of the surface under a force at one of its points, `C_ij` of [`GreensFunction::block`].
#[derive(Debug, Clone)]
pub struct GreensFunction {
    /// Shear modulus G = E / (2 (1 + nu)), Pa.
    pub shear_modulus: Real,
    /// Poisson's ratio nu.
    pub poisson_ratio: Real,
    /// Thickness h (m) of a layer with its table; `None` for a half-space.
    layer: Option<(Real, Arc<LayerTable>)>,
}

/// A place on an elastic continuum that carries load.
#[derive(Debug, Clone, Copy)]
pub struct Loaded {
    /// Where it is on the undeformed surface, m.
    pub point: Vec3,
    /// Outward unit normal there.
    pub normal: Vec3,
    /// Area that the load is spread over, m^2.
    pub area: Real,
}

/// The plane that two places share.
struct SharedPlane {
    /// Its unit normal, the mean of the two, and the length of their sum.
    m: Vec3,
    length: Real,
    /// `(1 + n_i . n_j) / 2`.
    taper: Real,
    /// From `j` to `i` in the plane, and how long that is, m.
    flat: Vec3,
    distance: Real,
    /// Distance below which loads over their areas are not told apart, m.
    closest: Real,
}

impl SharedPlane {
    /// `None` of places that look away from each other.
    #[inline]
    fn of(i: &Loaded, j: &Loaded) -> Option<Self> {
        let mean = i.normal + j.normal;
        let length = mean.norm();
        if length < 1e-6 {
            return None;
        }
        let m = mean / length;
        let between = i.point - j.point;
        let flat = between - m * m.dot(&between);
        let closest = CLOSEST_OVER_RADII * ((i.area / PI).sqrt() + (j.area / PI).sqrt());
        Some(Self { m, length, taper: 0.25 * length * length, flat, distance: flat.norm(), closest })
    }
}

impl GreensFunction {
    /// Of a half-space, from Young's modulus (Pa) and Poisson's ratio.
    pub fn half_space(young_modulus: Real, poisson_ratio: Real) -> Self {
        Self { shear_modulus: young_modulus / (2.0 * (1.0 + poisson_ratio)), poisson_ratio, layer: None }
    }

    /// Of a layer bonded to a rigid backing, from Young's modulus (Pa), Poisson's ratio and thickness (m).
    pub fn layer(young_modulus: Real, poisson_ratio: Real, thickness: Real) -> Self {
        let table = Arc::new(LayerTable::new(poisson_ratio));
        Self { layer: Some((thickness, table)), ..Self::half_space(young_modulus, poisson_ratio) }
    }

    /// How far a patch of `area` (m^2) sinks in under a uniform pressure, m/Pa: the centre of a disc on a half-space,
    /// or a layer confined by its backing, one after the other. A figure to compare surfaces by.
    pub fn patch_compliance(&self, area: Real) -> Real {
        let nu = self.poisson_ratio;
        let half_space = (1.0 - nu) * (area / PI).sqrt() / self.shear_modulus;
        self.layer.as_ref().map_or(half_space, |(h, _)| {
            let confined = h * (1.0 - 2.0 * nu) / (2.0 * self.shear_modulus * (1.0 - nu));
            // Either bounds the displacement from above; thin layers of matter that keeps its volume are stiffer still.
            1.0 / (1.0 / half_space + 1.0 / confined.max(1e-3 * half_space))
        })
    }

    /// Displacement at control point `i` for a unit force at `j`, body axes, m/N.
    ///
    /// With the load at distance r in direction e (from load to observer, in the tangent plane) and outward normal n:
    ///
    /// ```text
    /// C_ij = 1/(2 pi G) [ (A - B) (I - n n^T) + 2 B e e^T + N n n^T + X (e n^T - n e^T) ]
    /// ```
    ///
    /// Half-space: `N = (1 - nu)/r`, `X = (1/2 - nu)/r`, `A = (1 - nu/2)/r`, `B = nu/(2 r)`: Boussinesq for the
    /// normal and Cerruti for the tangential load (Johnson,
    /// *Contact Mechanics*, eqs. 3.18, 3.19 and 3.75). Layer: [`super::bonded_layer`].
    ///
    /// Bent surfaces: this is the block on the plane that the pair shares, whose normal m is the mean of the two. A
    /// half-space is left there: what presses on it has flattened it to that plane. The block of a layer is turned on to
    /// either point's own tangent plane by the least rotation, `R_i C_ij R_j^T` with `R_i m = n_i`: without that, a
    /// layer that hardly changes its volume and is about as thick as its body is wide has negative eigenvalues, as its
    /// normal and tangential displacements are far from alike. (The price, seen on a half-space where a patch spans 0.35
    /// rad of the body: 7 % more resistance to twist without slip. A half-space has no need to pay it.)
    /// The factor (1 + n_i . n_j)/2 lets the two sides of a
    /// body leave each other alone; it is 1 within a flat patch.
    pub fn block(&self, control: &ControlPoints, i: usize, j: usize) -> Mat3 {
        let at = |i: usize| Loaded { point: control.points[i], normal: control.normals[i], area: control.areas[i] };
        if i == j { self.self_block(&at(i), control.inverse_distances[i]) } else { self.block_between(&at(i), &at(j)) }
    }

    /// `C_ij` of [`GreensFunction::block`] between two loaded places anywhere on the surface.
    ///
    /// Loads are not points but spread over areas. Where two of them come closer than 0.7 times the sum of the radii
    /// of discs of these areas (points on a lattice do not), r is taken as that, and what depends on the direction
    /// fades as it does under a smeared load: X with q = r over that distance, B with q^2. With points at random
    /// places the matrix would not be positive definite otherwise.
    #[inline]
    pub fn block_between(&self, i: &Loaded, j: &Loaded) -> Mat3 {
        let Some(SharedPlane { m, length, taper, flat, distance, closest }) = SharedPlane::of(i, j) else { return Mat3::zeros() };
        let Some(Influence { n, x, a, b }) = self.influence(distance.max(closest)) else { return Mat3::zeros() };
        let q = (distance / closest).min(1.0);
        let (x, b) = (x * q, b * q * q);
        let e: Vec3 = if distance > 1e-9 * closest { flat / distance } else { Vec3::zeros() };
        let [n_i, n_j] = if self.layer.is_some() { [i.normal, j.normal] } else { [m, m] };
        // R_i e and R_j e: e has no part along m, and n_j . e = -n_i . e.
        let lean = n_i.dot(&e) / (1.0 + 0.5 * length);
        let (e_i, e_j) = (e - (n_i + m) * lean, e + (n_j + m) * lean);
        // R_i R_j^T, the least rotation from n_j to n_i.
        let sum = n_i + n_j;
        let turn = Mat3::identity() - sum * (sum * (2.0 / sum.norm_squared())).transpose() + n_i * (n_j * 2.0).transpose();
        let normal_part = n_i * (n_j * (n - a + b) - e_j * x).transpose();
        let radial_part = e_i * (e_j * (2.0 * b) + n_j * x).transpose();
        let block = turn * (a - b) + normal_part + radial_part;
        block * (self.scale() * taper)
    }

    /// `C_ij` of [`GreensFunction::block`] between two loaded places without what couples normal and tangential displacements, and with the
    /// mean of the tangential ones over all directions: N along the normal, A across it. `None` where that is nothing.
    pub fn uncoupled(&self, i: &Loaded, j: &Loaded) -> Option<AxialCompliance> {
        let SharedPlane { taper, distance, closest, .. } = SharedPlane::of(i, j)?;
        let Influence { n, a, .. } = self.influence(distance.max(closest))?;
        Some(AxialCompliance { normal: n, tangential: a } * (self.scale() * taper))
    }

    /// `C_ii` of [`GreensFunction::block`]: displacement of a place under its own load.
    ///
    /// ```text
    /// C_ii = 1/(2 pi G) [ N_i n n^T + A_i (I - n n^T) ],      N_i = (1 - nu) m_i + N_0/h,     A_i = (1 - nu/2) m_i + A_0/h
    /// ```
    ///
    /// `inverse_distance`, m_i (1/m): mean of 1/r over the loaded area, chosen to make the sum over unevenly placed points right, see
    /// [`ControlPoints::inverse_distances`]. N_0, A_0: what a layer has beyond the half-space at r = 0; smooth as
    /// that is, its sum over points needs no other correction. A place is never stiffer than the disc that it stands
    /// for, which keeps the matrix positive definite.
    pub fn self_block(&self, at: &Loaded, inverse_distance: Real) -> Mat3 {
        self.own(at.area, inverse_distance).block(&at.normal, &at.normal)
    }

    /// N_i and A_i over 2 pi G of [`GreensFunction::self_block`], m/N. `area`: that the load is spread over, m^2.
    pub fn own(&self, area: Real, inverse_distance: Real) -> AxialCompliance {
        let half_space = Influence::half_space(self.poisson_ratio);
        let [mut normal, mut tangential] = [half_space.n, half_space.a].map(|f| f * inverse_distance);
        if let Some((h, table)) = &self.layer {
            let [excess, disc] = [table.excess_at_load(), table.of_disc((area / PI).sqrt() / h)];
            let least = if area <= h * h { 1.0 } else { LEAST_OVER_DISC_WHERE_SPARSE };
            let own = |half_space: Real, k: usize| (half_space + excess[k] / h).clamp(least * disc[k] / h, MOST_OVER_DISC * disc[k] / h);
            (normal, tangential) = (own(normal, 0), own(tangential, 1));
        }
        AxialCompliance { normal, tangential } * self.scale()
    }

    /// `1 / (2 pi G)`, m^2/N.
    fn scale(&self) -> Real {
        1.0 / (2.0 * PI * self.shear_modulus)
    }

    /// The four functions at distance `r` (m), 1/m; `None` where a layer stands still.
    #[inline]
    fn influence(&self, r: Real) -> Option<Influence> {
        let half_space = Influence::half_space(self.poisson_ratio) * (1.0 / r);
        let Some((h, table)) = &self.layer else { return Some(half_space) };
        Some(half_space + table.excess(r / h)? * (1.0 / h))
    }
}
