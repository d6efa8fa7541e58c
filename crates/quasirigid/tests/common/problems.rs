//! Contact problems built by hand, for the solver's tests and its bench. No engine needed: bodies are a mass and a lever arm.

#![allow(dead_code)]

use quasirigid::delassus::{ContactStatus, MatrixFree, NO_BODY};
use quasirigid::gauss_seidel::{Scratch, SolveReport, SolverParameters, solve};
use quasirigid::math::{Mat3, Mat3x6, Real, Vec3, contact_frame, skew};

/// Time step of all problems, s.
pub const DT: Real = 1e-3;

/// An operator, the free displacements (m) and the friction coefficients.
#[derive(Clone)]
pub struct Problem {
    pub w: MatrixFree,
    pub delta_free: Vec<Vec3>,
    pub mu: Vec<Real>,
}

/// Reactions (N), what every contact does, and the report.
pub struct Solution {
    pub f: Vec<Vec3>,
    pub status: Vec<ContactStatus>,
    pub report: SolveReport,
}

impl Problem {
    pub fn solve(&mut self, parameters: &SolverParameters) -> Solution {
        self.solve_from(vec![Vec3::zeros(); self.mu.len()], parameters)
    }

    pub fn solve_from(&mut self, mut f: Vec<Vec3>, parameters: &SolverParameters) -> Solution {
        let mut status = vec![ContactStatus::Open; f.len()];
        let report = solve(&mut self.w, &self.delta_free, &self.mu, &mut f, &mut status, parameters, &mut Scratch::default());
        Solution { f, status, report }
    }
}

/// Compliance of a pad.
#[derive(Clone, Copy)]
pub enum Pad {
    /// Foundation modulus (N/m^3), width of the Gaussian (m), share of the Gaussian.
    Local { modulus: Real, sigma: Real, beta: Real },
    /// Young's modulus (Pa), Poisson's ratio.
    HalfSpace { young: Real, poisson: Real },
}

/// The paper's local model on a soft pad.
pub const SOFT: Pad = Pad::Local { modulus: 3e7, sigma: 3e-3, beta: 0.7 };

/// Numbers in (-1, 1) from a seed: a linear congruential generator, the same everywhere.
pub fn numbers(seed: u64) -> impl FnMut() -> Real {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as Real / (1u64 << 52) as Real - 1.0
    }
}

/// `J S` of a free body of `mass` (kg) and principal `inertia` (kg m^2) for a contact at `arm` (m) from its centre, in contact frame `e`.
pub fn free_body_rows(mass: Real, inertia: &Vec3, arm: &Vec3, e: &Mat3, sign: Real) -> Mat3x6 {
    // A = M / dt^2, so S = dt / sqrt(M).
    let mut rows = Mat3x6::zeros();
    rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&(e.transpose() * (sign * DT / mass.sqrt())));
    let turn = Mat3::from_diagonal(&inertia.map(|i| sign * DT / i.sqrt()));
    rows.fixed_view_mut::<3, 3>(0, 3).copy_from(&(e.transpose() * -skew(arm) * turn));
    rows
}

/// A box of `mass` (kg) and `size` (m) held by three pads of 4-joint fingers, two on the one side
/// and one on the other, each pad a sphere of radius 10 mm pressed in by `depth` (m) over a disc of
/// `contacts[k]` points. The box has sunk by `sink` (m) and turned a little.
pub fn grasp(contacts: [usize; 3], pad: Pad, depth: Real, sink: Real) -> Problem {
    let (mass, half) = (0.2, 0.03);
    let inertia = Vec3::repeat(mass * half * half * 2.0 / 3.0);
    let mut next = numbers(7);
    let mut problem = Problem { w: MatrixFree::new(), delta_free: Vec::new(), mu: Vec::new() };
    problem.w.clear(4);
    let pads = [Vec3::new(half, 0.015, 0.0), Vec3::new(half, -0.015, 0.002), Vec3::new(-half, 0.0, 0.001)];
    let mut first = 0;
    for (k, centre) in pads.iter().enumerate() {
        let normal = Vec3::new(centre.x.signum(), 0.0, 0.0);
        let patch = contact_frame(&normal, &Vec3::y());
        // Joint axes through points up the finger, with the stiffness of a position controller and the inertia of the phalanges (N m/rad).
        let joints: Vec<(Vec3, Vec3, Real)> = (0..4)
            .map(|j| {
                let axis = if j == 0 { normal } else { Vec3::y() };
                (axis, centre + Vec3::new(0.02 * centre.x.signum(), 0.0, 0.1 - 0.025 * j as Real), 30.0 / (1.0 + j as Real))
            })
            .collect();
        let n = contacts[k];
        let area = 1.2e-6;
        let places: Vec<Vec3> = (0..n)
            .map(|i| {
                let (r, angle) = ((area * (i as Real + 0.5) / std::f64::consts::PI).sqrt(), 2.399_963 * i as Real);
                Vec3::new(0.0, r * angle.cos(), r * angle.sin())
            })
            .collect();
        for i in 0..n {
            let tilt = normal - places[i] * 20.0;
            let e = contact_frame(&tilt.normalize(), &Vec3::from_fn(|_, _| next()));
            let point = centre + places[i];
            let mut finger = Mat3x6::zeros();
            for (j, (axis, origin, stiffness)) in joints.iter().enumerate() {
                finger.set_column(j, &(e.transpose() * axis.cross(&(point - origin)) / stiffness.sqrt()));
            }
            let body = free_body_rows(mass, &inertia, &point, &e, -1.0);
            problem.w.push_contact(k as u32, &finger, 3, &body, &(patch.transpose() * e));
            for j in 0..n {
                push_pad_entry(&mut problem.w, &pad, first + j, &(patch.transpose() * (places[i] - places[j])), area);
            }
            let gap = places[i].norm_squared() / (2.0 * 0.01) - depth;
            let slide = Vec3::new(0.0, 0.0, sink) + Vec3::new(0.002 * sink / 0.03, 0.3 * sink, 0.1 * sink).cross(&(places[i] * 30.0));
            problem.delta_free.push(Vec3::new(gap, 0.0, 0.0) + e.transpose() * slide);
            problem.mu.push(0.8);
        }
        first += n;
    }
    problem.w.finish().expect("a pad makes every block positive definite");
    problem
}

fn push_pad_entry(w: &mut MatrixFree, pad: &Pad, j: usize, r: &Vec3, area: Real) {
    use std::f64::consts::PI;
    let own = r.norm() == 0.0;
    match *pad {
        Pad::Local { modulus, sigma, beta } => {
            let gaussian = beta * (-r.norm_squared() / (sigma * sigma)).exp() / (PI * sigma * sigma * modulus);
            w.push_isotropic(j, gaussian + if own { (1.0 - beta) / (modulus * area) } else { 0.0 });
        }
        Pad::HalfSpace { young, poisson: nu } => {
            // Elastic axes (normal, t1, t2); normal: Boussinesq, tangential: Cerruti. The coupling of normal and tangent is left out.
            let scale = (1.0 + nu) / (PI * young);
            let k = if own {
                let disc = 16.0 / (3.0 * PI * (area / PI).sqrt());
                Mat3::from_diagonal(&Vec3::new(1.0 - nu, 1.0 - 0.5 * nu, 1.0 - 0.5 * nu)) * (scale * disc)
            } else {
                let (d, x, y) = (r.norm(), r.y, r.z);
                let tangent = |a: Real, b: Real| nu * a * b / (d * d);
                Mat3::new(1.0 - nu, 0.0, 0.0, 0.0, 1.0 - nu + tangent(x, x), tangent(x, y), 0.0, tangent(x, y), 1.0 - nu + tangent(y, y))
                    * (scale / d)
            };
            w.push_tensor(j, &k);
        }
    }
}

/// A rigid box of 1 kg on `side * side` support points, each with a compliance of
/// `softness` times the rigid one of the box, pushed sideways by
/// `push` (share of its weight). Far more supports than the box has coordinates.
pub fn support(side: usize, softness: Real, push: Real, mu: Real) -> Problem {
    let (mass, half) = (1.0, 0.1);
    let inertia = Vec3::repeat(mass * half * half * 2.0 / 3.0);
    let mut problem = Problem { w: MatrixFree::new(), delta_free: Vec::new(), mu: Vec::new() };
    problem.w.clear(1);
    let e = contact_frame(&Vec3::z(), &Vec3::x());
    let fall = 9.81 * DT * DT;
    for i in 0..side * side {
        let place = |k: usize| if side == 1 { 0.0 } else { half * (2.0 * k as Real / (side - 1) as Real - 1.0) };
        let arm = Vec3::new(place(i % side), place(i / side), -half);
        problem.w.push_contact(0, &free_body_rows(mass, &inertia, &arm, &e, 1.0), NO_BODY, &Mat3x6::zeros(), &Mat3::identity());
        problem.w.push_isotropic(i, softness * DT * DT / mass);
        problem.delta_free.push(Vec3::new(-fall, push * fall, 0.0));
        problem.mu.push(mu);
    }
    problem.w.finish().expect("every support has a compliance");
    problem
}

/// A block of `mass` (kg) on a plane inclined by `angle` (rad), four corners, frames with tangent1 down the slope.
pub fn incline(mass: Real, angle: Real, mu: Real) -> Problem {
    let half = 0.05;
    let inertia = Vec3::repeat(mass * half * half * 2.0 / 3.0);
    let mut problem = Problem { w: MatrixFree::new(), delta_free: Vec::new(), mu: Vec::new() };
    problem.w.clear(1);
    let e = contact_frame(&Vec3::z(), &Vec3::x());
    let g = 9.81 * DT * DT;
    for (x, y) in [(-half, -half), (half, -half), (half, half), (-half, half)] {
        // The arm has no height: the block does not tip, so the closed form is that of a point mass.
        problem.w.push_contact(
            0,
            &free_body_rows(mass, &inertia, &Vec3::new(x, y, 0.0), &e, 1.0),
            NO_BODY,
            &Mat3x6::zeros(),
            &Mat3::identity(),
        );
        problem.w.push_isotropic(problem.mu.len(), 0.1 * DT * DT / mass);
        problem.delta_free.push(Vec3::new(-g * angle.cos(), g * angle.sin(), 0.0));
        problem.mu.push(mu);
    }
    problem.w.finish().expect("every corner has a compliance");
    problem
}
