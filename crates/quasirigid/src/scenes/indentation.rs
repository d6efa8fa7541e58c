//! A ball pressed on a flat: the scene of Hertz, Cattaneo, Mindlin and Lubkin, whose answers are known in closed form.

use crate::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use crate::collider::Material;
use crate::error::{Result, check_positive};
use crate::math::{Pose, Real, Rot, Vec3};
use crate::params::Parameters;
use crate::surface::{PointSurface, Surface, shapes};
use crate::world::{BodyHandle, World};
use std::sync::Arc;

/// Stiffness that holds the flat: translation N/m, rotation N m/rad. Two fixed bodies do not meet,
/// so the flat is a free body on a spring so stiff that its deflection is negligible.
const HOLD: [Real; 2] = [1e12, 1e10];

/// What is pressed on what.
#[derive(Debug, Clone)]
pub struct IndentationOptions {
    /// Parameters of the world; gravity is switched off.
    pub params: Parameters,
    /// Radius R of the ball, m.
    pub radius: Real,
    /// Radius of the piece of either surface that is sampled, m: it must hold all that comes near contact, about 1.5 contact radii.
    pub reach: Real,
    /// Control points of the cap of the ball; each has 8 points.
    pub ball_control_points: usize,
    /// Control points of the flat; each has 8 points. The side with more of them carries the contacts.
    pub flat_control_points: usize,
    /// Material of the ball.
    pub ball: Material,
    /// Material of the flat.
    pub flat: Material,
}

/// The scene. The ball comes from above, its lowest point at the origin when `depth` is 0.
#[derive(Debug)]
pub struct Indentation {
    /// The world.
    pub world: World,
    /// The ball: a fixed body that is moved.
    pub ball: BodyHandle,
    /// The flat, z <= 0.
    pub flat: BodyHandle,
    radius: Real,
}

impl Indentation {
    /// The ball just touching.
    ///
    /// # Errors
    /// Whatever the constructors refuse.
    pub fn new(options: &IndentationOptions) -> Result<Self> {
        check_positive("radius of the ball", options.radius, "m")?;
        check_positive("reach", options.reach, "m")?;
        let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..options.params.clone() })?;
        let surface = |points: PointSurface, control: usize| Surface::build(points, Some(control)).map(Arc::new);
        let half_angle = (options.reach / options.radius).min(1.0).asin();
        let cap = shapes::sample_cap(options.radius, half_angle, 8 * options.ball_control_points)?;
        // The cap's pole is +z; turned about x it looks down.
        let cap = cap.transformed(&Pose::from_parts(Vec3::zeros().into(), Rot::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI)))?;
        let above = Pose::translation(0.0, 0.0, options.radius);
        let ball = RigidBody::fixed("ball", above)?;
        let ball = world.add_body(ball, Some((surface(cap, options.ball_control_points)?, options.ball.clone())))?;

        let points = shapes::sample_half_space(2.0 * options.reach, 8 * options.flat_control_points)?;
        let mass = MassProperties::sphere(options.reach, Amount::Mass(1.0))?;
        let mut flat = RigidBody::free("flat", mass, Motion::Inertial, Pose::identity())?;
        flat.set_drive(Some(PoseDrive::new(Pose::identity(), HOLD, [0.0, 0.0])?))?;
        let flat = world.add_body(flat, Some((surface(points, options.flat_control_points)?, options.flat.clone())))?;
        Ok(Self { world, ball, flat, radius: options.radius })
    }

    /// Moves the ball to `depth` below first contact, `shift` sideways (m, x and y) and turned by `twist` about z (rad), in one step.
    ///
    /// # Errors
    /// [`crate::Error::InvalidValue`] for a number that is not finite.
    pub fn move_to(&mut self, depth: Real, shift: [Real; 2], twist: Real) -> Result<crate::StepReport> {
        let rotation = Rot::from_axis_angle(&Vec3::z_axis(), twist);
        let place = Vec3::new(shift[0], shift[1], self.radius - depth);
        self.world.body_mut(self.ball)?.move_to(Pose::from_parts(place.into(), rotation))?;
        Ok(self.world.step())
    }

    /// Force of the flat on the ball, N: (tangential x, tangential y, normal z).
    ///
    /// # Errors
    /// [`crate::Error::InvalidHandle`] if the ball was removed.
    pub fn force(&self) -> Result<Vec3> {
        self.world.contact_force_on(self.ball)
    }

    /// Moment of the flat on the ball about the vertical through the ball's centre, N m.
    ///
    /// # Errors
    /// [`crate::Error::InvalidHandle`] if the ball was removed.
    pub fn moment(&self) -> Result<Real> {
        let ball = self.ball.slot();
        let axis = self.world.body(self.ball)?.pose().translation.vector;
        let moments = self.world.contacts().iter().zip(&self.world.contact_problem().reactions).map(|(contact, f)| {
            let sign = if contact.body_a == ball { 1.0 } else { -1.0 };
            (contact.acts_at - axis).cross(&(contact.acts_along * f * sign)).z
        });
        Ok(moments.sum())
    }
}
