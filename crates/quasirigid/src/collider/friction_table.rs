//! Friction of a pair: a rule that combines two materials, and a table of pairs that were measured.

use crate::collider::Material;
use crate::collider::friction::{Friction, stribeck};
use crate::math::{Mat3, Real, Vec3, contact_frame};
use serde::{Deserialize, Serialize};

/// How the coefficients of two materials make that of their pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum FrictionRule {
    /// `sqrt(mu_a mu_b)`: a material against itself has its own coefficient, a frictionless partner makes a frictionless pair.
    #[default]
    GeometricMean,
    /// The smaller of the two.
    Minimum,
    /// The larger of the two.
    Maximum,
    /// `(mu_a + mu_b)/2`.
    Mean,
    /// `mu_a mu_b`: one partner keeps a coefficient, others modify it.
    Product,
}

impl FrictionRule {
    /// The coefficient of the pair (-).
    pub fn combine(self, a: Real, b: Real) -> Real {
        match self {
            Self::GeometricMean => (a * b).sqrt(),
            Self::Minimum => a.min(b),
            Self::Maximum => a.max(b),
            Self::Mean => 0.5 * (a + b),
            Self::Product => a * b,
        }
    }
}

/// Friction of two bodies, as the contacts between them need it. Made once for a pair, by [`FrictionTable::pair`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PairFriction {
    /// The law without its anisotropy.
    law: Friction,
    /// Both materials, if at least one is anisotropic. A side without an entry does not count.
    anisotropic: Option<([Option<Friction>; 2], FrictionRule)>,
}

impl PairFriction {
    /// Of two materials, `a` being the one whose control points are used.
    pub fn of(a: &Friction, b: &Friction, rule: FrictionRule) -> Self {
        // A film on either side drags, and only velocity-weakening friction has a Stribeck velocity.
        let stribeck_velocity = match (a.is_velocity_weakening(), b.is_velocity_weakening()) {
            (true, true) => (a.stribeck_velocity * b.stribeck_velocity).sqrt(),
            (false, true) => b.stribeck_velocity,
            _ => a.stribeck_velocity,
        };
        let law = Friction {
            static_coefficient: rule.combine(a.static_coefficient, b.static_coefficient),
            kinetic_coefficient: rule.combine(a.kinetic_coefficient, b.kinetic_coefficient),
            stribeck_velocity,
            viscous_coefficient: a.viscous_coefficient.max(b.viscous_coefficient),
            anisotropy: None,
        };
        let anisotropic = (a.anisotropy.is_some() || b.anisotropy.is_some()).then_some(([Some(*a), Some(*b)], rule));
        Self { law, anisotropic }
    }

    /// As measured for this pair; a direction lies in the frame of `a` if `on_a`, else of `b`.
    fn given(friction: &Friction, on_a: bool) -> Self {
        let sides = if on_a { [Some(*friction), None] } else { [None, Some(*friction)] };
        Self { law: *friction, anisotropic: friction.anisotropy.map(|_| (sides, FrictionRule::default())) }
    }

    /// The coefficient, if it is the same for all contacts, in all directions, at all speeds.
    pub fn constant(&self) -> Option<Real> {
        (self.anisotropic.is_none() && !self.law.is_velocity_weakening()).then_some(self.law.static_coefficient)
    }

    /// Whether it is velocity-weakening, so that slip speeds have to be remembered.
    pub fn is_velocity_weakening(&self) -> bool {
        self.law.is_velocity_weakening()
            || self.anisotropic.is_some_and(|(sides, _)| sides.iter().flatten().any(Friction::is_velocity_weakening))
    }

    /// `c`, Pa s/m.
    pub fn viscous_coefficient(&self) -> Real {
        self.law.viscous_coefficient
    }

    /// `mu(v)` (-) of a contact with this frame, along its tangent1. `speed`: m/s; `rotations`:
    /// rotations from the frames of the surfaces `a` and `b` to the world.
    pub fn coefficient(&self, frame: &Mat3, speed: Real, rotations: [&Mat3; 2]) -> Real {
        let Some(anisotropic) = &self.anisotropic else { return self.law.coefficient(speed) };
        let [static_coefficient, kinetic_coefficient] = along(anisotropic, &frame.column(1).into_owned(), rotations);
        stribeck(static_coefficient, kinetic_coefficient, self.law.stribeck_velocity, speed)
    }

    /// Contact frame of a pair whose friction depends on the direction of slip, and
    /// `mu_2/mu_1` in it; `None` if friction is the same in all directions.
    ///
    /// Columns (normal, tangent1, tangent2) in world axes, orthonormal. tangent1 lies along the
    /// direction: of the side whose ellipse is farther from a circle, if both have one.
    pub fn frame(&self, normal: &Vec3, rotations: [&Mat3; 2]) -> Option<(Mat3, Real)> {
        let anisotropic = self.anisotropic.as_ref()?;
        let anisotropy = |side: usize| anisotropic.0[side].and_then(|friction| friction.anisotropy);
        let eccentricity = |side: usize| anisotropy(side).map_or(-1.0, |anisotropy| anisotropy.ratio.ln().abs());
        let leading = usize::from(eccentricity(1) > eccentricity(0));
        let frame = contact_frame(normal, &(rotations[leading] * anisotropy(leading)?.direction));
        let [mu_1, mu_2] = [1, 2].map(|axis| along(anisotropic, &frame.column(axis).into_owned(), rotations)[0]);
        Some((frame, if mu_1 > 0.0 { mu_2 / mu_1 } else { 1.0 }))
    }
}

/// Static and kinetic coefficient (-) against slip along the unit tangent `t` (world).
fn along((sides, rule): &([Option<Friction>; 2], FrictionRule), t: &Vec3, rotations: [&Mat3; 2]) -> [Real; 2] {
    let of = |side: usize| {
        sides[side].map(|friction| {
            let share = friction.share_along(&rotations[side].tr_mul(t));
            [friction.static_coefficient * share, friction.kinetic_coefficient * share]
        })
    };
    match (of(0), of(1)) {
        (Some(a), Some(b)) => [rule.combine(a[0], b[0]), rule.combine(a[1], b[1])],
        (a, b) => a.or(b).unwrap_or([0.0; 2]),
    }
}

/// What an entry of the table is about.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum FrictionKey {
    /// All bodies of a material, by its name.
    Material(String),
    /// One body, by its slot.
    Body(u32),
}

impl FrictionKey {
    fn covers(&self, slot: u32, material: &Material) -> bool {
        match self {
            Self::Material(name) => *name == material.name,
            Self::Body(body) => *body == slot,
        }
    }

    /// How narrow an entry is: one about a body goes before one about a material.
    fn rank(&self) -> u32 {
        u32::from(matches!(self, Self::Body(_)))
    }
}

/// Pairs whose friction is known, instead of being combined from two materials.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct FrictionTable {
    entries: Vec<(FrictionKey, FrictionKey, Friction)>,
}

impl FrictionTable {
    /// Sets, replaces or (`None`) removes the entry of a pair, named in either order.
    pub(crate) fn set(&mut self, a: FrictionKey, b: FrictionKey, friction: Option<Friction>) {
        self.entries.retain(|(x, y, _)| !((*x == a && *y == b) || (*x == b && *y == a)));
        if let Some(friction) = friction {
            self.entries.push((a, b, friction));
        }
    }

    /// Names of the materials in it, some perhaps more than once.
    pub(crate) fn materials(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().flat_map(|(x, y, _)| [x, y]).filter_map(|key| match key {
            FrictionKey::Material(name) => Some(name.as_str()),
            FrictionKey::Body(_) => None,
        })
    }

    /// Refuses a table with entries about a body that is not there, or with an invalid friction.
    pub(crate) fn check(&self, is_body: impl Fn(u32) -> bool) -> Result<(), String> {
        for (x, y, friction) in &self.entries {
            friction.check().map_err(|error| error.to_string())?;
            if [x, y].iter().any(|key| matches!(key, FrictionKey::Body(body) if !is_body(*body))) {
                return Err("friction of a body that is not there".into());
            }
        }
        Ok(())
    }

    /// Forgets a body.
    pub(crate) fn remove_body(&mut self, gone: u32) {
        let is_gone = |key: &FrictionKey| *key == FrictionKey::Body(gone);
        self.entries.retain(|(x, y, _)| !is_gone(x) && !is_gone(y));
    }

    /// Friction between surfaces of the bodies in slots `a` and `b`: the narrowest entry about them (two bodies, then a body and
    /// a material, then two materials; of equals the one set last), else what the rule makes of their materials.
    ///
    /// A direction in an entry lies in the frame of the body named first; where the names do
    /// not distinguish the two, of `a` if `a_first`: of the body added first.
    pub(crate) fn pair(&self, [a, b]: [u32; 2], a_first: bool, [of_a, of_b]: [&Material; 2], rule: FrictionRule) -> PairFriction {
        let mut best: Option<(u32, PairFriction)> = None;
        for (x, y, friction) in &self.entries {
            let (forward, backward) = (x.covers(a, of_a) && y.covers(b, of_b), x.covers(b, of_b) && y.covers(a, of_a));
            let rank = x.rank() + y.rank();
            if (forward || backward) && best.is_none_or(|(least, _)| rank >= least) {
                let on_a = if forward && backward { a_first } else { forward };
                best = Some((rank, PairFriction::given(friction, on_a)));
            }
        }
        best.map_or_else(|| PairFriction::of(&of_a.friction, &of_b.friction, rule), |(_, friction)| friction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RULES: [FrictionRule; 5] =
        [FrictionRule::GeometricMean, FrictionRule::Minimum, FrictionRule::Maximum, FrictionRule::Mean, FrictionRule::Product];

    fn coulomb(mu: Real) -> Friction {
        Friction::coulomb(mu).unwrap()
    }

    #[test]
    fn rules_combine_as_they_are_called() {
        let combined = RULES.map(|rule| PairFriction::of(&coulomb(0.2), &coulomb(0.8), rule).constant().unwrap());
        for (got, expected) in combined.iter().zip([0.4, 0.2, 0.8, 0.5, 0.16]) {
            assert!((got - expected).abs() < 1e-15, "{combined:?}");
        }
        // Coulomb's pairs are the same bits as ever.
        assert_eq!(combined[0], (0.2_f64 * 0.8).sqrt());
    }

    #[test]
    fn stribeck_velocity_and_film_come_from_the_side_that_has_them() {
        let weakening = coulomb(0.8).with_kinetic(0.5, 4e-3).unwrap().with_viscous(3.0).unwrap();
        for (a, b) in [(weakening, coulomb(0.2)), (coulomb(0.2), weakening)] {
            let pair = PairFriction::of(&a, &b, FrictionRule::GeometricMean);
            assert!(pair.is_velocity_weakening() && pair.constant().is_none());
            assert_eq!((pair.law.stribeck_velocity, pair.viscous_coefficient()), (4e-3, 3.0));
            assert_eq!(pair.law.kinetic_coefficient, (0.5_f64 * 0.2).sqrt());
        }
        let both = PairFriction::of(&weakening, &coulomb(0.2).with_kinetic(0.1, 1e-3).unwrap(), FrictionRule::Mean);
        assert!((both.law.stribeck_velocity - 2e-3).abs() < 1e-18);
    }

    proptest! {
        #[test]
        fn frame_turns_the_ellipse_into_a_circle(
            n in prop::array::uniform3(-1.0..1.0f64), d in prop::array::uniform3(-1.0..1.0f64), ratio in 0.1..10.0f64, angle in 0.0..6.3f64,
        ) {
            let (n, d) = (Vec3::from(n), Vec3::from(d));
            prop_assume!(n.norm() > 0.1 && d.norm() > 0.1);
            let n = n.normalize();
            let friction = coulomb(0.5).with_anisotropy(d, ratio).unwrap();
            let pair = PairFriction::given(&friction, true);
            let rotations = [&Mat3::identity(), &Mat3::identity()];
            let (frame, ratio) = pair.frame(&n, rotations).unwrap();
            let mu = pair.coefficient(&frame, 0.0, rotations);
            // Resistance against any slip direction: mu |D t|, D = diag(1, 1, mu_2/mu_1), must be that of the friction tensor.
            let plain = contact_frame(&n, &Vec3::x());
            let t = plain.column(1) * angle.cos() + plain.column(2) * angle.sin();
            let slip = frame.tr_mul(&t);
            let (got, expected) = (mu * slip.y.hypot(ratio * slip.z), 0.5 * friction.share_along(&t));
            prop_assert!((got - expected).abs() < 1e-6 * expected.max(1.0), "{got} against {expected}");
        }

        #[test]
        fn two_directions_that_lie_square_combine_axis_by_axis(
            a in 0.2..5.0f64, b in 0.2..5.0f64, mu_a in 0.1..1.0f64, mu_b in 0.1..1.0f64,
        ) {
            let on_a = coulomb(mu_a).with_anisotropy(Vec3::x(), a).unwrap();
            let on_b = coulomb(mu_b).with_anisotropy(Vec3::y(), b).unwrap();
            let rotations = [&Mat3::identity(), &Mat3::identity()];
            for rule in RULES {
                let pair = PairFriction::of(&on_a, &on_b, rule);
                let (frame, ratio) = pair.frame(&Vec3::z(), rotations).unwrap();
                let mu = pair.coefficient(&frame, 0.0, rotations);
                for (t, expected) in [(Vec3::x(), rule.combine(mu_a, b * mu_b)), (Vec3::y(), rule.combine(a * mu_a, mu_b))] {
                    let slip = frame.tr_mul(&t);
                    let got = mu * slip.y.hypot(ratio * slip.z);
                    prop_assert!((got - expected).abs() < 1e-12, "{rule:?} along {t}: {got} against {expected}");
                }
            }
        }
    }

    #[test]
    fn a_direction_normal_to_the_surface_leaves_a_circle() {
        let friction = coulomb(0.5).with_anisotropy(Vec3::z(), 0.4).unwrap();
        let rotations = [&Mat3::identity(), &Mat3::identity()];
        let pair = PairFriction::given(&friction, true);
        let (frame, ratio) = pair.frame(&Vec3::z(), rotations).unwrap();
        assert!((ratio - 1.0).abs() < 1e-12, "mu_2/mu_1 = {ratio}");
        assert!((pair.coefficient(&frame, 0.0, rotations) - 0.2).abs() < 1e-12);
    }

    #[test]
    fn removed_bodies_take_their_entries_along() {
        let mut table = FrictionTable::default();
        table.set(FrictionKey::Body(0), FrictionKey::Body(2), Some(coulomb(0.1)));
        table.set(FrictionKey::Body(1), FrictionKey::Material("wood".into()), Some(coulomb(0.2)));
        table.set(FrictionKey::Body(2), FrictionKey::Body(0), Some(coulomb(0.3)));
        assert_eq!(table.entries.len(), 2, "either order is the same pair");
        table.remove_body(1);
        assert_eq!(table.entries, vec![(FrictionKey::Body(2), FrictionKey::Body(0), coulomb(0.3))]);
        table.set(FrictionKey::Body(0), FrictionKey::Body(2), None);
        assert!(table.entries.is_empty());
    }
}
