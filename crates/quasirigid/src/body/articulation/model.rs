//! The constant part of a finger: joints and links, checked.

use crate::body::mass_properties::MassProperties;
use crate::body::pose::check_pose;
use crate::error::{Error, Result, check_finite, check_non_negative, check_positive};
use crate::math::{MAX_DOF, Pose, Real, Vec3, Vec6};
use serde::{Deserialize, Serialize};

/// One revolute joint and the link beyond it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointModel {
    /// What it is called.
    pub name: String,
    /// Joint frame in the frame of the parent link (the finger's base for the first joint).
    pub origin: Pose,
    /// Axis in the joint frame; any length but zero.
    pub axis: Vec3,
    /// Lower limit of the joint position (rad).
    pub lower: Real,
    /// Upper limit of the joint position (rad).
    pub upper: Real,
    /// Passive viscosity (N m s/rad). A quasi-static finger needs it > 0.
    pub viscosity: Real,
    /// Inertia of the motor seen at the joint (kg m^2).
    pub armature: Real,
    /// Stiffness of the position controller (N m/rad).
    pub stiffness: Real,
    /// Damping of the position controller (N m s/rad).
    pub damping: Real,
    /// Largest torque of the motor (N m).
    pub torque_limit: Real,
    /// Mass properties of the link, in the link frame: the joint frame turned by the joint position.
    pub link: MassProperties,
}

impl JointModel {
    fn check(&self) -> Result<()> {
        let name = &self.name;
        check_pose(&format!("origin of joint '{name}'"), &self.origin)?;
        check_finite(&format!("axis of joint '{name}'"), self.axis.iter())?;
        check_positive(&format!("length of the axis of joint '{name}'"), self.axis.norm(), "-")?;
        check_finite(&format!("limits of joint '{name}'"), [self.lower, self.upper].iter())?;
        if self.lower >= self.upper {
            return Err(Error::value(
                format!("limits of joint '{name}'"),
                "lower < upper (rad)",
                format!("lower {}, upper {}", self.lower, self.upper),
                "swap the limits",
            ));
        }
        check_non_negative(&format!("viscosity of joint '{name}'"), self.viscosity, "N m s/rad")?;
        check_non_negative(&format!("armature of joint '{name}'"), self.armature, "kg m^2")?;
        check_non_negative(&format!("stiffness of joint '{name}'"), self.stiffness, "N m/rad")?;
        check_non_negative(&format!("damping of joint '{name}'"), self.damping, "N m s/rad")?;
        check_positive(&format!("torque limit of joint '{name}'"), self.torque_limit, "N m")
    }
}

/// The constant part of a finger, checked. Link `i` is the one beyond joint `i`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct FingerModel {
    name: String,
    base: Pose,
    joints: Vec<JointModel>,
}

/// What is read where a finger is expected, before it is checked.
#[derive(Deserialize)]
struct Unchecked {
    name: String,
    base: Pose,
    joints: Vec<JointModel>,
}

impl TryFrom<Unchecked> for FingerModel {
    type Error = Error;

    fn try_from(read: Unchecked) -> Result<Self> {
        Self::new(read.name, read.base, read.joints)
    }
}

impl FingerModel {
    /// A finger whose base frame has the pose `base` in the hand frame, with 1 to 6 joints from the base outwards.
    ///
    /// # Errors
    /// No joint or more than six; non-finite numbers; crossed limits; negative gains; a zero axis; a torque limit <= 0.
    pub fn new(name: impl Into<String>, base: Pose, mut joints: Vec<JointModel>) -> Result<Self> {
        check_pose("base of the finger", &base)?;
        if joints.is_empty() || joints.len() > MAX_DOF {
            return Err(Error::shape("joints of a finger", "1 to 6", joints.len(), "split a longer chain, or merge fixed joints"));
        }
        for joint in &mut joints {
            joint.check()?;
            // A unit vector is left alone, so that a finger that is made twice has the same bits.
            if (joint.axis.norm() - 1.0).abs() > 1e-15 {
                joint.axis.normalize_mut();
            }
        }
        Ok(Self { name: name.into(), base, joints })
    }

    /// The same finger with the stiffness and the damping of its position controllers multiplied by these factors.
    ///
    /// # Errors
    /// A factor that is negative or not finite.
    pub fn with_gains(&self, stiffness: Real, damping: Real) -> Result<Self> {
        check_non_negative("factor of the joints' stiffness", stiffness, "-")?;
        check_non_negative("factor of the joints' damping", damping, "-")?;
        let scaled =
            |joint: &JointModel| JointModel { stiffness: stiffness * joint.stiffness, damping: damping * joint.damping, ..joint.clone() };
        Self::new(self.name.clone(), self.base, self.joints.iter().map(scaled).collect())
    }

    /// What the finger is called.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Base frame of the finger in the hand frame.
    pub fn base(&self) -> &Pose {
        &self.base
    }

    /// The joints, from the base outwards.
    pub fn joints(&self) -> &[JointModel] {
        &self.joints
    }

    /// Number of joints, and of links.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// `values` padded with zeros.
    pub(crate) fn joint_vector(&self, what: &str, values: &[Real]) -> Result<Vec6> {
        if values.len() != self.dof() {
            return Err(Error::shape(
                format!("{what} of finger '{}'", self.name),
                format!("{} values, one per joint", self.dof()),
                values.len(),
                "give one value per joint, from the base outwards",
            ));
        }
        check_finite(what, values)?;
        Ok(Vec6::from_fn(|i, _| values.get(i).copied().unwrap_or(0.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::HandModel;

    #[test]
    fn bad_models_are_refused() {
        let good = HandModel::three_finger().unwrap().fingers()[0].joints().to_vec();
        let with = |change: fn(&mut JointModel)| {
            let mut joints = good.clone();
            change(&mut joints[1]);
            FingerModel::new("finger", Pose::identity(), joints)
        };
        assert!(with(|_| {}).is_ok());
        assert!(with(|j| j.axis = Vec3::zeros()).is_err());
        assert!(with(|j| j.lower = 9.0).unwrap_err().to_string().contains("lower < upper"));
        assert!(with(|j| j.upper = Real::NAN).is_err());
        assert!(with(|j| j.viscosity = -1.0).is_err());
        assert!(with(|j| j.stiffness = Real::INFINITY).is_err());
        assert!(with(|j| j.torque_limit = 0.0).is_err());
        assert!(with(|j| j.origin.translation.x = Real::NAN).is_err());
        assert!(FingerModel::new("finger", Pose::identity(), vec![]).is_err());
        assert!(FingerModel::new("finger", Pose::identity(), vec![good[0].clone(); 7]).is_err());
    }
}
