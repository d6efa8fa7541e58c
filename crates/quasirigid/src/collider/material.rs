//! What a body is made of: density, friction, and how its surface deforms.

use crate::collider::Friction;
use crate::error::{Error, Result, check_non_negative, check_positive};
use crate::math::Real;
use crate::surface::{ComplianceMatrix, ControlPoints};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How a surface deforms under load. Which one suits is a choice per material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum ComplianceModel {
    /// [`ComplianceModel::Layer`] of which
    /// the coupling of normal and tangential displacements is left out: nearly as right, at a fraction of the
    /// time. Above a Poisson's ratio of 0.499 that is taken.
    Local,
    /// The paper's model: every control point is a spring, and a share of its displacement
    /// spreads to its neighbours as a Gaussian; the same in all directions.
    Gaussian {
        /// Pressure per displacement (N/m^3).
        foundation_modulus: Real,
        /// Width sigma of the Gaussian (m).
        width: Real,
        /// Share beta of the Gaussian part (0: independent springs, below 1: pure Gaussian is ill-conditioned).
        share: Real,
    },
    /// An elastic half-space (Boussinesq and Cerruti) with the material's Young's modulus and Poisson's ratio.
    HalfSpace,
    /// An elastic layer bonded to a rigid backing, with the material's Young's modulus, Poisson's ratio (at most
    /// 0.499) and layer thickness: the half-space close to the load, a foundation far from it.
    Layer,
    /// A compliance of the user's own over the control points of one surface: a material with it is good for that
    /// surface only. The material's Young's modulus, Poisson's ratio and layer thickness then have no effect; its
    /// relaxation time has.
    Matrix(Arc<ComplianceMatrix>),
}

/// Above this Poisson's ratio the layer is treated as if it had it; see [`ComplianceModel::gaussian`].
const CONFINED_POISSON_RATIO: Real = 0.3;

/// Above it the compliance of a bonded layer is no longer known to be positive definite.
pub(crate) const LARGEST_LAYER_POISSON_RATIO: Real = 0.499;

/// Share of the displacement that spreads to the neighbours, in models made by [`ComplianceModel::gaussian`].
/// A modelling choice: half. The solver's sweeps grow steeply above 0.7.
const DEFAULT_SHARE: Real = 0.5;

impl ComplianceModel {
    /// The paper's model of an elastic layer bonded to a rigid core, as version 0.1 had it for every material.
    ///
    /// Foundation modulus (K. L. Johnson, *Contact Mechanics*, 1985, section 4.3, elastic foundation; confined compression of a
    /// layer that is thin against the contact):
    ///
    /// ```text
    ///     k = E (1 - nu) / ((1 + nu) (1 - 2 nu)) / h       E (Pa), nu (-), h: thickness (m), k (N/m^3)
    /// ```
    ///
    /// It grows without bound as nu -> 1/2, because a thin bonded incompressible layer has no way out sideways. A fingertip's
    /// patch is about as wide as its layer is thick, so its matter does escape. nu is therefore capped at 0.3, which gives
    /// k = 1.35 E / h. Check: Johnson (same section) matches a foundation to Hertz with k = 1.70 E* / a; for a fingertip at
    /// 2 N (E* = 144 kPa, a = 5.4 mm) that is 4.5e7 N/m^3, and the capped formula gives 3.9e7.
    ///
    /// The width of the Gaussian is half the thickness (a modelling choice: a point load spreads over about the depth of the
    /// layer), its share 0.5.
    ///
    /// # Errors
    /// E or h not finite and > 0, nu outside [0, 0.5].
    pub fn gaussian(young_modulus: Real, poisson_ratio: Real, thickness: Real) -> Result<Self> {
        check_positive("Young's modulus", young_modulus, "Pa")?;
        check_poisson(poisson_ratio)?;
        check_positive("layer thickness", thickness, "m")?;
        let nu = poisson_ratio.min(CONFINED_POISSON_RATIO);
        let confinement = (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu));
        Ok(Self::Gaussian { foundation_modulus: young_modulus * confinement / thickness, width: 0.5 * thickness, share: DEFAULT_SHARE })
    }

    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// Foundation modulus or width not finite and > 0, share outside [0, 1).
    pub fn check(&self) -> Result<()> {
        let Self::Gaussian { foundation_modulus, width, share } = *self else { return Ok(()) };
        check_positive("foundation modulus", foundation_modulus, "N/m^3")?;
        check_positive("width of the Gaussian compliance", width, "m")?;
        if (0.0..1.0).contains(&share) {
            return Ok(());
        }
        Err(Error::value("share of the Gaussian part", "0 <= share < 1", share, "0.5 is usual; above 0.7 the solver needs many sweeps"))
    }
}

/// A material. Fields are plain data; [`Material::check`] is called wherever one enters a world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// What it is called.
    pub name: String,
    /// Density (kg/m^3).
    pub density: Real,
    /// Friction of this material against itself; [`crate::collider::PairFriction`] makes that of a pair.
    pub friction: Friction,
    /// Young's modulus E (Pa).
    pub young_modulus: Real,
    /// Poisson's ratio nu (-).
    pub poisson_ratio: Real,
    /// Thickness of the layer that deforms, over a core taken as rigid (m).
    pub layer_thickness: Real,
    /// Relaxation time tau of the surface (s): `K u + tau K udot = f`.
    pub relaxation_time: Real,
    /// How the surface deforms.
    pub model: ComplianceModel,
}

/// One line of the table below: name, density (kg/m^3), friction (-), E (Pa), nu (-), thickness (m), relaxation time (s).
type Preset = (&'static str, Real, Real, Real, Real, Real, Real);

// Hard materials: E, nu and density from M. F. Ashby, Materials Selection in Mechanical Design (appendix of material
// properties) and the CRC Handbook of Chemistry and Physics; mid-range values of the class.
//
// Three columns are modelling choices, not measurements:
// - friction: against itself, set so that the geometric mean with fingertip pulp falls in the 0.3 to 1 that is measured for
//   skin on dry solids (S. E. Tomlinson, R. Lewis, M. J. Carre, Review of the frictional properties of finger-object contact
//   when gripping, Proc. IMechE J, 2007). Measure your pair and use `with_friction` where it matters.
// - thickness: a fingertip's is anatomy; others are the depth over which a wall or a solid of hand-held size deforms.
// - relaxation time of hard materials: 1 ms, a numerical damping of their contact, far above their real one.
#[rustfmt::skip]
const PRESETS: &[Preset] = &[
    // Pulp of a human fingertip. Density of soft tissue. One elastic modulus for a pulp that stiffens as it is pressed: E is
    // fitted so that a pad of semi-axes 12 x 8.5 x 7 mm pressed on a flat at 2 N is indented by 1 to 2 mm over 80 to 150 mm^2, as
    // measured by E. R. Serina, C. D. Mote, D. Rempel (J. Biomech. 30, 1997) and E. R. Serina, E. Mockensturm, C. D. Mote,
    // D. Rempel (J. Biomech. 31, 1998); tests below hold the Gaussian and the half-space to it. (As a layer it is as soft with 0.06 MPa:
    // tests/pulp.rs.) nu: nearly incompressible tissue (choice).
    // Relaxation: D. T. V. Pawluk, R. D. Howe (J. Biomech. Eng. 121, 1999) fit decays of 4 ms, 70 ms and 1.4 s to the pad;
    // the engine has one, and 10 ms, between the two fast ones, is a modelling choice.
    ("fingertip_pulp", 1100.0, 1.0,  0.115e6, 0.45, 4e-3,  10e-3),
    // Silicones: makers give the stress at 100 % strain. A neo-Hookean of modulus E stretched to twice its length pulls with E/3 (2 - 1/4) =
    // 0.583 E, so that the modulus at small strains is 1.714 times the maker's figure. Relaxation times and thicknesses: choices.
    // Dragon Skin 10 (22 psi at 100 %, specific gravity 1.07: Smooth-On, technical bulletin).
    ("silicone",       1070.0, 1.0,  0.260e6, 0.49, 5e-3,  5e-3),
    // Dragon Skin 30 (86 psi at 100 %, specific gravity 1.08: Smooth-On, technical bulletin).
    ("dragon_skin_30", 1080.0, 1.0,  1.016e6, 0.49, 5e-3,  5e-3),
    // Ecoflex 00-30 (10 psi at 100 %, specific gravity 1.07: Smooth-On, technical bulletin).
    ("ecoflex",        1070.0, 1.0,  0.118e6, 0.49, 5e-3,  5e-3),
    // Gel of a GelSight Mini: neo-Hookean with C10 = 0.0725 MPa, as the FEATS project fitted it (E = 6 C10), nearly incompressible.
    // Thickness: choice.
    ("gelsight_mini",  1070.0, 1.0,  0.435e6, 0.49, 4e-3,  5e-3),
    // Natural rubber, unfilled (Ashby: 1.5 to 2.5 MPa, 0.93 Mg/m^3).
    ("rubber",          930.0, 1.0,  2.0e6,   0.49, 5e-3,  2e-3),
    // Wood pressed across the grain (Ashby: 0.5 to 3 GPa; along the grain it is ten times stiffer).
    ("wood",            600.0, 0.5,  1.0e9,   0.35, 10e-3, 1e-3),
    // Solid board pressed through its thickness: two orders softer than the 2 to 8 GPa in its plane
    // (K. Niskanen, ed., Mechanics of Paper Products, 2012). The density is that of the board, not of the empty box.
    ("cardboard",       690.0, 0.4,  30e6,    0.1,  2e-3,  1e-3),
    ("abs_plastic",    1050.0, 0.4,  2.2e9,   0.38, 5e-3,  1e-3),
    ("glass",          2500.0, 0.4,  70e9,    0.22, 5e-3,  1e-3),
    ("steel",          7850.0, 0.35, 205e9,   0.29, 10e-3, 1e-3),
    ("aluminium",      2700.0, 0.4,  69e9,    0.33, 10e-3, 1e-3),
    // Porcelain and stoneware, as of a mug.
    ("ceramic",        2400.0, 0.4,  70e9,    0.2,  5e-3,  1e-3),
    // Banana in its peel. Density: pulp at 0.99 to 1.11 of water (R. P. Kachru, N. Kotwaliwale, D. Balasubramanian, J. Food
    // Eng. 26, 1995), peel lighter. E: order of soft fruit tissue, below the few MPa of apple flesh (A. A. Khan, J. F. V.
    // Vincent, J. Texture Studies 24, 1993); a modelling choice, ripeness changes it tenfold. Thickness: half the fruit's.
    ("banana",          980.0, 0.5,  1.0e6,   0.4,  15e-3, 5e-3),
];

/// Version 0.1's figures of the presets that have others now: name, E (Pa). Silicones had their makers' stress at 100 % strain.
const YOUNG_MODULI_OF_0_1: [(&str, Real); 2] = [("silicone", 0.151e6), ("ecoflex", 0.069e6)];
/// Presets that version 0.1 did not have.
const NEW_SINCE_0_1: [&str; 2] = ["dragon_skin_30", "gelsight_mini"];

impl Material {
    /// The material itself, checked: `Material { name: ..., density: ..., ... }.checked()` makes one of figures of your own.
    ///
    /// # Errors
    /// See [`Material::check`].
    pub fn checked(self) -> Result<Self> {
        self.check()?;
        Ok(self)
    }

    /// A material of the built-in table, with the paper's compliance model.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn preset(name: &str) -> Result<Self> {
        let Some(&(_, density, friction, young_modulus, poisson_ratio, layer_thickness, relaxation_time)) =
            PRESETS.iter().find(|row| row.0 == name)
        else {
            return Err(Error::unknown(
                "material",
                format!("one of {}", Self::preset_names().collect::<Vec<_>>().join(", ")),
                format!("'{name}'"),
                "pick a name from the list, or make a material with figures of your own",
            ));
        };
        let (name, friction) = (name.to_string(), Friction::from(friction));
        let model = ComplianceModel::gaussian(young_modulus, poisson_ratio, layer_thickness)?;
        Self { name, density, friction, young_modulus, poisson_ratio, layer_thickness, relaxation_time, model }.checked()
    }

    /// A material of the built-in table as a version of this crate had it: `"0.1"`, with the paper's compliance model.
    ///
    /// # Errors
    /// An unknown name or version; the message lists the known ones.
    pub fn preset_of(name: &str, version: &str) -> Result<Self> {
        if version != "0.1" {
            let hint = "leave the version out for the figures of today";
            return Err(Error::unknown("version of the presets", "\"0.1\"", format!("{version:?}"), hint));
        }
        if NEW_SINCE_0_1.contains(&name) {
            return Err(Error::unknown("material of version 0.1", "a preset that is older", format!("{name:?}"), "leave the version out"));
        }
        let mut material = Self::preset(name)?;
        if let Some((_, young_modulus)) = YOUNG_MODULI_OF_0_1.iter().find(|(changed, _)| *changed == name) {
            material.young_modulus = *young_modulus;
        }
        material.model = material.gaussian()?;
        material.checked()
    }

    /// The names that [`Material::preset`] knows.
    pub fn preset_names() -> impl Iterator<Item = &'static str> {
        PRESETS.iter().map(|row| row.0)
    }

    /// The same material with another compliance model.
    ///
    /// # Errors
    /// See [`ComplianceModel::check`].
    pub fn with_model(self, model: ComplianceModel) -> Result<Self> {
        model.check()?;
        Ok(Self { model, ..self })
    }

    /// The same material with another friction against itself: a Coulomb coefficient (-), or a [`Friction`].
    ///
    /// # Errors
    /// See [`Friction::check`].
    pub fn with_friction(self, friction: impl Into<Friction>) -> Result<Self> {
        let friction = friction.into();
        friction.check()?;
        Ok(Self { friction, ..self })
    }

    /// The same material with another density (kg/m^3).
    ///
    /// # Errors
    /// A density that is not finite and > 0.
    pub fn with_density(self, density: Real) -> Result<Self> {
        check_positive("density", density, "kg/m^3")?;
        Ok(Self { density, ..self })
    }

    /// The same material with another relaxation time (s).
    ///
    /// # Errors
    /// A time that is not finite and >= 0.
    pub fn with_relaxation_time(self, relaxation_time: Real) -> Result<Self> {
        check_non_negative("relaxation time", relaxation_time, "s")?;
        Ok(Self { relaxation_time, ..self })
    }

    /// The same material with other elastic figures: E (Pa), nu (-), layer thickness (m). A Gaussian model is computed again from
    /// them; a matrix does not know them.
    ///
    /// # Errors
    /// E or thickness not finite and > 0, nu outside [0, 0.5].
    pub fn with_elasticity(self, young_modulus: Real, poisson_ratio: Real, layer_thickness: Real) -> Result<Self> {
        let gaussian = ComplianceModel::gaussian(young_modulus, poisson_ratio, layer_thickness)?;
        let model = if matches!(self.model, ComplianceModel::Gaussian { .. }) { gaussian } else { self.model };
        Ok(Self { young_modulus, poisson_ratio, layer_thickness, model, ..self })
    }

    /// The paper's model of this material's layer.
    ///
    /// # Errors
    /// See [`ComplianceModel::gaussian`].
    pub fn gaussian(&self) -> Result<ComplianceModel> {
        ComplianceModel::gaussian(self.young_modulus, self.poisson_ratio, self.layer_thickness)
    }

    /// Thickness (m) of the layer that yields, where the compliance model knows one: an indentation of more than about half of it is beyond small strains.
    pub fn yielding_thickness(&self) -> Option<Real> {
        (!matches!(self.model, ComplianceModel::HalfSpace | ComplianceModel::Matrix(_))).then_some(self.layer_thickness)
    }

    /// [`Material::check`], and that a compliance matrix is one for the control points of the surface that shall be made of it.
    ///
    /// # Errors
    /// See [`Material::check`] and [`ComplianceMatrix::check_for`].
    pub fn check_for(&self, control: &ControlPoints) -> Result<()> {
        self.check()?;
        if let ComplianceModel::Matrix(matrix) = &self.model { matrix.check_for(control) } else { Ok(()) }
    }

    /// Refuses figures that no material has.
    ///
    /// # Errors
    /// Non-finite numbers; density, E or thickness <= 0; relaxation time < 0; a friction that [`Friction::check`]
    /// refuses; nu outside [0, 0.5], or above
    /// 0.499 with [`ComplianceModel::Layer`]; a compliance model out of range.
    pub fn check(&self) -> Result<()> {
        check_positive("density", self.density, "kg/m^3")?;
        self.friction.check()?;
        check_positive("Young's modulus", self.young_modulus, "Pa")?;
        check_poisson(self.poisson_ratio)?;
        check_positive("layer thickness", self.layer_thickness, "m")?;
        check_non_negative("relaxation time", self.relaxation_time, "s")?;
        if matches!(self.model, ComplianceModel::Layer) && self.poisson_ratio > LARGEST_LAYER_POISSON_RATIO {
            let expected = format!("nu <= {LARGEST_LAYER_POISSON_RATIO} for a layer");
            return Err(Error::value("Poisson's ratio", expected, self.poisson_ratio, "0.499 is as good as incompressible"));
        }
        self.model.check()
    }
}

fn check_poisson(nu: Real) -> Result<()> {
    if (0.0..=0.5).contains(&nu) {
        return Ok(());
    }
    Err(Error::value("Poisson's ratio", "0 <= nu <= 0.5", nu, "rubber and tissue are near 0.5, metals near 0.3"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Indentation (m) and contact area (m^2) of the built-in pad on a rigid flat under `force` (N).
    fn pressed_pad(model: ComplianceModel, pulp: &Material, force: Real) -> (Real, Real) {
        // Principal radii of an ellipsoid (12, 8.5, 7) mm at the end of its shortest axis; a patch of modest eccentricity is
        // close to the circular one of their geometric mean (Johnson, section 4.1).
        let radius = (12e-3 * 12e-3 / 7e-3 * 8.5e-3 * 8.5e-3 / 7e-3 as Real).sqrt();
        match model {
            // Foundation: F = pi k R d^2, area 2 pi R d. The Gaussian part leaves the mean compliance of a wide patch as it is.
            ComplianceModel::Gaussian { foundation_modulus, .. } => {
                let d = (force / (PI * foundation_modulus * radius)).sqrt();
                (d, 2.0 * PI * radius * d)
            }
            // Hertz: F = 4/3 E* sqrt(R) d^(3/2), area pi R d.
            ComplianceModel::HalfSpace => {
                let stiffness = pulp.young_modulus / (1.0 - pulp.poisson_ratio.powi(2));
                let d = (0.75 * force / (stiffness * radius.sqrt())).powf(2.0 / 3.0);
                (d, PI * radius * d)
            }
            _ => unreachable!(),
        }
    }

    #[test]
    fn fingertip_at_2_newton_is_indented_as_measured_on_people() {
        let pulp = Material::preset("fingertip_pulp").unwrap();
        for model in [pulp.gaussian().unwrap(), ComplianceModel::HalfSpace] {
            let (d, area) = pressed_pad(model.clone(), &pulp, 2.0);
            assert!((1e-3..=2e-3).contains(&d), "{model:?}: indentation {:.2} mm", d * 1e3);
            assert!((80e-6..=150e-6).contains(&area), "{model:?}: area {:.0} mm^2", area * 1e6);
        }
    }

    #[test]
    fn gaussian_has_the_confined_modulus_and_a_cap() {
        let modulus = |nu| match ComplianceModel::gaussian(1e6, nu, 1e-2).unwrap() {
            ComplianceModel::Gaussian { foundation_modulus, .. } => foundation_modulus,
            _ => unreachable!(),
        };
        assert_eq!(modulus(0.0), 1e8);
        assert!((modulus(0.25) - 1.2e8).abs() < 1.0, "{}", modulus(0.25));
        assert_eq!(modulus(0.3), modulus(0.5));
    }

    #[test]
    fn every_preset_is_sound_and_unknown_names_list_the_known() {
        for name in Material::preset_names() {
            let material = Material::preset(name).unwrap();
            material.check().unwrap();
            material.with_model(ComplianceModel::HalfSpace).unwrap();
        }
        let message = Material::preset("cheese").unwrap_err().to_string();
        assert!(message.contains("fingertip_pulp") && message.contains("'cheese'"), "{message}");
    }

    #[test]
    fn impossible_figures_are_refused() {
        let wood = || Material::preset("wood").unwrap();
        assert!(wood().with_friction(-0.1).is_err());
        assert!(wood().with_friction(Real::NAN).is_err());
        assert!(wood().with_density(0.0).is_err());
        assert!(wood().with_relaxation_time(Real::INFINITY).is_err());
        assert!(wood().with_elasticity(1e9, 0.6, 1e-2).unwrap_err().to_string().contains("Poisson"));
        let gaussian = |width, share| ComplianceModel::Gaussian { foundation_modulus: 1e8, width, share };
        assert!(wood().with_model(gaussian(1e-3, 1.0)).is_err());
        assert!(wood().with_model(gaussian(Real::NAN, 0.5)).is_err());
        assert!(wood().with_model(gaussian(1e-3, 0.0)).is_ok());
    }
}
