//! From the room of the tracker to the world of the simulation: a rigid transform, kept in a TOML file or found by touching known points.

use crate::error::{Error, Result, check_within};
use crate::{Pose, Rot, Vec3};
use nalgebra::{Matrix3, Rotation3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Touched points must span at least this, m: closer ones say nothing about directions.
const LEAST_SPREAD: f64 = 0.01;
/// Farthest that a room may be from the world, m.
const FARTHEST: f64 = 1e3;

/// Rigid transform from tracker to world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// `x_world = world_from_tracker * x_tracker`, m.
    pub world_from_tracker: Pose,
    /// Root mean square distance of the touched points after the fit, m; None if it was not fitted.
    pub residual: Option<f64>,
}

impl Default for Calibration {
    /// The room is the world.
    fn default() -> Self {
        Self { world_from_tracker: Pose::identity(), residual: None }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// m, world.
    translation: [f64; 3],
    /// (w, x, y, z).
    quaternion: [f64; 4],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    residual: Option<f64>,
}

/// A rotation from (w, x, y, z), of any length but zero.
pub(crate) fn quaternion([w, x, y, z]: [f64; 4]) -> Result<Rot> {
    let q = nalgebra::Quaternion::new(w, x, y, z);
    let norm = q.norm();
    if norm.is_finite() && norm > 1e-6 {
        return Ok(Rot::from_quaternion(q));
    }
    Err(Error::value("quaternion", "(w, x, y, z) that is finite and not zero", format!("{:?}", [w, x, y, z]), "(1, 0, 0, 0) does not turn"))
}

impl Calibration {
    /// From the text of a calibration file: `translation = [x, y, z]` (m) and `quaternion = [w, x, y, z]`, tracker to world.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] with what is missing, misspelt or no number.
    pub fn from_toml(text: &str) -> Result<Self> {
        let hint = "write translation = [x, y, z] in m and quaternion = [w, x, y, z]";
        let file: File =
            toml::from_str(text).map_err(|e| Error::value("calibration", "TOML with translation and quaternion", e.message(), hint))?;
        for x in file.translation {
            check_within("translation", x, -FARTHEST, FARTHEST, "m")?;
        }
        if let Some(residual) = file.residual {
            check_within("residual", residual, 0.0, FARTHEST, "m")?;
        }
        let world_from_tracker = Pose::from_parts(Vec3::from(file.translation).into(), quaternion(file.quaternion)?);
        Ok(Self { world_from_tracker, residual: file.residual })
    }

    /// The text of a calibration file.
    pub fn to_toml(&self) -> String {
        let (t, q) = (&self.world_from_tracker.translation.vector, &self.world_from_tracker.rotation);
        let residual = self.residual.map_or(String::new(), |r| format!("residual = {r:?} # m, root mean square\n"));
        let header = "# x_world = R(quaternion) x_tracker + translation; m, quaternion (w, x, y, z)\n";
        format!(
            "{header}translation = [{:?}, {:?}, {:?}]\nquaternion = [{:?}, {:?}, {:?}, {:?}]\n{residual}",
            t.x, t.y, t.z, q.w, q.i, q.j, q.k
        )
    }

    /// Reads a calibration file.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, [`Error::InvalidValue`] as [`Calibration::from_toml`].
    pub fn read(path: &Path) -> Result<Self> {
        let hint = "make one with `quasirigid mocap calibrate`";
        let text = std::fs::read_to_string(path).map_err(|e| Error::file(path.display(), "a readable calibration file", e, hint))?;
        Self::from_toml(&text)
    }

    /// Writes a calibration file.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn write(&self, path: &Path) -> Result<()> {
        std::fs::write(path, self.to_toml()).map_err(|e| Error::file(path.display(), "a place to write to", e, "choose another place"))
    }

    /// From three touched points, m in the tracker's room: the world's origin, a point on its +x axis, and a point of the half plane y > 0,
    /// z = 0.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] if they are not finite, closer than 1 cm, or nearly on one line (less than 1 cm beside it).
    pub fn from_three_points(origin: Vec3, on_x: Vec3, in_plane: Vec3) -> Result<Self> {
        finite(&[origin, on_x, in_plane])?;
        let far = |distance: f64, what: &str, hint: &str| {
            let expected = format!("at least {LEAST_SPREAD} m away");
            if distance >= LEAST_SPREAD { Ok(()) } else { Err(Error::value(what, expected, format!("{distance:.4} m"), hint)) }
        };
        let along = on_x - origin;
        far(along.norm(), "second point", "touch a point on the +x axis, as far from the origin as you can reach")?;
        let x = along.normalize();
        let aside = in_plane - origin;
        let beside = aside - x * x.dot(&aside);
        far(beside.norm(), "third point", "touch a point of the plane z = 0 on the side of +y, well beside the x axis")?;
        let y = beside.normalize();
        // Rows of the rotation from tracker to world are the world's axes in the tracker's room.
        let axes = Matrix3::from_rows(&[x.transpose(), y.transpose(), x.cross(&y).transpose()]);
        let rotation = Rot::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let world_from_tracker = Pose::from_parts((-(rotation * origin)).into(), rotation);
        Ok(Self { world_from_tracker, residual: None })
    }

    /// From three or more points touched in the tracker's room and their places in the world, m: least squares.
    ///
    /// Source: S. Umeyama, Least-squares estimation of transformation parameters between two point patterns, PAMI 13 (1991), eq. 40 to 42,
    /// without scale.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] for fewer than three points, lists of unequal length, numbers that are not finite, and points (nearly) on
    /// one line.
    pub fn from_points(tracker: &[Vec3], world: &[Vec3]) -> Result<Self> {
        finite(tracker)?;
        finite(world)?;
        if tracker.len() != world.len() || tracker.len() < 3 {
            let got = format!("{} in the tracker's room and {} in the world", tracker.len(), world.len());
            return Err(Error::value("points", "three or more pairs", got, "touch known points, not all on one line"));
        }
        let count = tracker.len() as f64;
        let mean = |points: &[Vec3]| points.iter().sum::<Vec3>() / count;
        let (from, to) = (mean(tracker), mean(world));
        for (what, points, middle) in [("points in the tracker's room", tracker, from), ("points in the world", world, to)] {
            let spread: Matrix3<f64> = points.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
            let mut extents = spread.symmetric_eigenvalues();
            extents.as_mut_slice().sort_by(f64::total_cmp);
            let second = extents[1].max(0.0).sqrt();
            if second < LEAST_SPREAD {
                let expected = format!("at least {LEAST_SPREAD} m beside a line");
                return Err(Error::value(what, expected, format!("{second:.4} m"), "touch points that make a wide triangle"));
            }
        }
        let covariance: Matrix3<f64> = tracker.iter().zip(world).map(|(a, b)| (b - to) * (a - from).transpose()).sum();
        let svd = covariance.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
            return Err(Error::value("points", "points that fix a rotation", "a fit without solution", "touch other points"));
        };
        let sign = (u.determinant() * v_t.determinant()).signum();
        // The column of the smallest singular value turns a mirror image into a rotation.
        let smallest = svd.singular_values.imin();
        let mut flip = Matrix3::identity();
        flip[(smallest, smallest)] = sign;
        let rotation = Rot::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * flip * v_t));
        let world_from_tracker = Pose::from_parts((to - rotation * from).into(), rotation);
        let square: f64 = tracker
            .iter()
            .zip(world)
            .map(|(a, b)| (world_from_tracker * nalgebra::Point3::from(*a) - nalgebra::Point3::from(*b)).norm_squared())
            .sum();
        Ok(Self { world_from_tracker, residual: Some((square / count).sqrt()) })
    }
}

fn finite(points: &[Vec3]) -> Result<()> {
    points.iter().flat_map(|p| p.iter()).try_for_each(|&x| check_within("point", x, -FARTHEST, FARTHEST, "m"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose> {
        (prop::array::uniform3(-5.0..5.0f64), -3.0..3.0f64, -1.5..1.5f64, -3.0..3.0f64)
            .prop_map(|(t, a, b, c)| Pose::from_parts(Vec3::from(t).into(), Rot::from_euler_angles(a, b, c)))
    }

    fn distance(a: &Pose, b: &Pose) -> f64 {
        (a.translation.vector - b.translation.vector).norm() + a.rotation.angle_to(&b.rotation)
    }

    proptest! {
        #[test]
        fn a_file_is_read_back_exactly(pose in pose(), residual in prop::option::of(0.0..0.01f64)) {
            let calibration = Calibration { world_from_tracker: pose, residual };
            let read = Calibration::from_toml(&calibration.to_toml()).unwrap();
            prop_assert!(distance(&read.world_from_tracker, &pose) < 1e-15 && read.residual == residual);
        }

        #[test]
        fn three_points_give_the_transform(world_from_tracker in pose(), x in 0.05..1.0f64, aside in -1.0..1.0f64, y in 0.05..1.0f64) {
            let touch = |p: Vec3| world_from_tracker.inverse_transform_point(&p.into()).coords;
            let touched = [Vec3::zeros(), Vec3::new(x, 0.0, 0.0), Vec3::new(aside, y, 0.0)].map(touch);
            let found = Calibration::from_three_points(touched[0], touched[1], touched[2]).unwrap();
            let error = distance(&found.world_from_tracker, &world_from_tracker);
            prop_assert!(error < 1e-7, "{error}");
        }

        #[test]
        fn least_squares_gives_the_transform_and_the_residual(world_from_tracker in pose(), seed in 0..1000u64) {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut point = |size: f64| Vec3::from_fn(|_, _| size * (random.f64() - 0.5));
            let world: Vec<Vec3> = (0..8).map(|_| point(0.6)).collect();
            let tracker: Vec<Vec3> = world.iter().map(|p| world_from_tracker.inverse_transform_point(&(*p).into()).coords).collect();
            let found = Calibration::from_points(&tracker, &world).unwrap();
            prop_assert!(distance(&found.world_from_tracker, &world_from_tracker) < 1e-7);
            prop_assert!(found.residual.unwrap() < 1e-12);
            let shaken: Vec<Vec3> = tracker.iter().map(|p| p + point(0.002)).collect();
            let found = Calibration::from_points(&shaken, &world).unwrap();
            let residual = found.residual.unwrap();
            prop_assert!(residual > 1e-4 && residual < 1.8e-3, "{residual}");
            prop_assert!(distance(&found.world_from_tracker, &world_from_tracker) < 0.1);
        }
    }

    #[test]
    fn a_flat_triangle_is_enough_and_a_line_is_not() {
        let (a, b, c) = (Vec3::zeros(), Vec3::new(0.2, 0.0, 0.0), Vec3::new(0.0, 0.1, 0.0));
        let found = Calibration::from_points(&[a, b, c], &[a, b, c]).unwrap();
        assert!(distance(&found.world_from_tracker, &Pose::identity()) < 1e-7);
        let line = [a, b, b * 2.0, b * 3.0];
        assert!(Calibration::from_points(&line, &line).unwrap_err().to_string().contains("wide triangle"));
        assert!(Calibration::from_points(&[a, b], &[a, b]).is_err());
        assert!(Calibration::from_three_points(a, a, c).unwrap_err().to_string().starts_with("second point"));
        assert!(Calibration::from_three_points(a, b, b * 0.5).unwrap_err().to_string().starts_with("third point"));
        assert!(Calibration::from_three_points(a, b, Vec3::new(f64::NAN, 0.0, 0.0)).is_err());
    }

    #[test]
    fn bad_files_say_what_is_wrong() {
        let fine = "translation = [0.0, 0.0, 0.0]\nquaternion = [1.0, 0.0, 0.0, 0.0]\n";
        assert_eq!(Calibration::from_toml(fine), Ok(Calibration::default()));
        assert_eq!(
            Calibration::from_toml("translation = [0, 0, 0]\nquaternion = [1, 0, 0, 0]\n"),
            Ok(Calibration::default()),
            "whole numbers"
        );
        let error = |text: &str| Calibration::from_toml(text).unwrap_err().to_string();
        assert!(error("translation = [0.0, 0.0]\nquaternion = [1.0, 0.0, 0.0, 0.0]").starts_with("calibration: expected TOML"));
        assert!(error("translation = [0.0, 0.0, nan]\nquaternion = [1.0, 0.0, 0.0, 0.0]").starts_with("translation"));
        assert!(error("translation = [0.0, 0.0, 0.0]\nquaternion = [0.0, 0.0, 0.0, 0.0]").starts_with("quaternion"));
        assert!(error("rotation = 1").contains("rotation"));
        assert!(Calibration::read(Path::new("/nowhere/at/all.toml")).unwrap_err().to_string().contains("mocap calibrate"));
    }
}
