//! Which bodies are near enough to look closer: bounding spheres, inflated by what the free motion can move.

use crate::body::BodyEntry;
use crate::free_motion::FreeMotion;
use crate::math::{Real, Vec3};
use crate::params::Parameters;

/// How far any surface point of each body may move in this step before contact forces, m.
pub(super) fn reach_of_bodies(bodies: &[BodyEntry], free: &[FreeMotion], reach: &mut Vec<Real>) {
    reach.clear();
    reach.extend(bodies.iter().zip(free).map(|(entry, free)| {
        let Some(skin) = entry.active_skin() else { return 0.0 };
        let pose = entry.body.link_pose(entry.skin_link);
        let root = skin.bounding_sphere();
        let center = pose * nalgebra::Point3::from(root.center);
        // The displacement field is affine in the point, d(c + r) = d(c) + theta x r: |theta|^2 is half the sum over the axes of |theta x e|^2.
        let at = |p: &Vec3| entry.free_displacement(free, p);
        let middle = at(&center.coords);
        let turned: Real =
            [Vec3::x(), Vec3::y(), Vec3::z()].iter().map(|e| (at(&(center.coords + e * root.radius)) - middle).norm_squared()).sum();
        middle.norm() + (0.5 * turned).sqrt()
    }));
}

/// Pairs (i < j) of bodies whose spheres, reach and margin overlap and that may touch.
pub(super) fn near_bodies(bodies: &[BodyEntry], reach: &[Real], params: &Parameters, near: &mut Vec<(u32, u32)>) {
    near.clear();
    for i in 0..bodies.len() {
        let Some((center_i, radius_i)) = bounding_sphere(&bodies[i]) else { continue };
        for j in i + 1..bodies.len() {
            if !may_touch(&bodies[i], &bodies[j]) {
                continue;
            }
            let Some((center_j, radius_j)) = bounding_sphere(&bodies[j]) else { continue };
            if (center_i - center_j).norm() <= radius_i + radius_j + reach[i] + reach[j] + params.contact_margin {
                near.push((i as u32, j as u32));
            }
        }
    }
}

fn bounding_sphere(entry: &BodyEntry) -> Option<(Vec3, Real)> {
    let root = entry.active_skin()?.bounding_sphere();
    let pose = entry.body.link_pose(entry.skin_link);
    Some(((pose * nalgebra::Point3::from(root.center)).coords, root.radius))
}

/// Two fixed bodies have nothing to solve; fingers of one hand pass through each other by choice of the model (their pads never meet around an object).
fn may_touch(a: &BodyEntry, b: &BodyEntry) -> bool {
    (a.body.dof() > 0 || b.body.dof() > 0) && (a.hand.is_none() || a.hand != b.hand)
}
