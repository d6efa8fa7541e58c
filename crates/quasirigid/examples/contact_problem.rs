//! The solver on a problem of your own: no bodies, no meshes. A block on an incline that gets steeper, as one contact.
//!
//! The block is a point mass that the contact alone supports. Over a step `dt` it answers to a force with `W = dt^2/m` in every
//! direction, and without force gravity moves it by `delta_free = dt^2 g`, seen in the contact frame (normal, tangent1, tangent2).

use quasirigid::delassus::{Assembled, ContactStatus};
use quasirigid::gauss_seidel::{Scratch, SolverParameters, check_problem, solve};
use quasirigid::math::{Mat3, Real, Vec3};

fn main() -> quasirigid::Result<()> {
    let (mass, dt, gravity, mu): (Real, Real, Real, Real) = (0.1, 1e-3, 9.81, 0.5);
    println!("mu = {mu}: the friction angle is {:.2} degrees", mu.atan().to_degrees());
    let mut w = Assembled::from_dense(1, &[Mat3::identity() * (dt * dt / mass)])?;
    for degrees in [0.0, 20.0, 26.0, 26.5, 27.0, 40.0] {
        let angle = Real::to_radians(degrees);
        let delta_free = [Vec3::new(-angle.cos(), angle.sin(), 0.0) * (gravity * dt * dt)];
        check_problem(1, &delta_free, &[mu])?;
        let (mut f, mut status) = ([Vec3::zeros()], [ContactStatus::Open]);
        let report = solve(&mut w, &delta_free, &[mu], &mut f, &mut status, &SolverParameters::default(), &mut Scratch::default());
        println!(
            "{degrees:4} degrees: {:?}, normal {:.3} N, friction {:.3} N, residual {:.0e}",
            status[0],
            f[0].x,
            f[0].y.abs(),
            report.residual
        );
    }
    Ok(())
}
