//! Control points so deep in the other body that no leaves overlap there: bodies that were put into each other.
//!
//! The trees find what is near a surface. Of a fingertip that stands half in a box they find a ring of leaves around the place
//! where the two surfaces cross, whose normals lie along the face: nothing that could push it out. When control points
//! near the surface overlap by more than in ordinary contact, all others are tested for being inside. Ordinary contact
//! never causes that: its gaps, elastic displacement included, are zero to rounding.

use super::cache::Coupled;
use crate::math::{Real, Vec3};
use crate::surface::Surface;
use crate::surface::implicit::FACING_COSINE;

/// A face that the control point faces is its way out if it is no farther than this many times the nearest
/// face of all. Half way into a box the sides of a fingertip would otherwise choose the far walls.
const DETOUR: Real = 1.5;

/// Least share of the way to the nearest point that goes along that point's normal: beyond the rim of an open surface there is no inside.
const UNDER: Real = 0.7;

/// Couples every control point that lies inside `b` and is not coupled yet with the leaf that holds its way out.
/// `place` gives a control point in the frame of `b` and its normal there. Returns whether there was any.
pub(super) fn couple_points_inside(
    stack: &mut Vec<u32>,
    coupled: &mut Vec<Coupled>,
    leaves_a: &[u32],
    surface_b: &Surface,
    place: impl Fn(usize) -> (Vec3, Vec3),
) -> bool {
    let known = coupled.len();
    let mut any_inside = false;
    for (control_point, &node_a) in leaves_a.iter().enumerate() {
        let control_point = control_point as u32;
        let (x, normal_a) = place(control_point as usize);
        let Some(depth) = depth_inside(stack, surface_b, &x) else { continue };
        any_inside = true;
        if coupled[..known].binary_search_by_key(&control_point, |c| c.control_point).is_ok() {
            continue;
        }
        if let Some((node_b, _, _)) = nearest(stack, surface_b, &x, DETOUR * depth, |normal| normal.dot(&normal_a) < FACING_COSINE) {
            coupled.push(Coupled { control_point, node_a, node_b });
        }
    }
    coupled.sort_unstable_by_key(|c| (c.control_point, c.node_a, c.node_b));
    any_inside
}

/// How far inside the surface `x` lies, to the nearest point, m; `None` outside.
pub(super) fn depth_inside(stack: &mut Vec<u32>, surface: &Surface, x: &Vec3) -> Option<Real> {
    let (_, point, distance) = nearest(stack, surface, x, Real::INFINITY, |_| true)?;
    let under = surface.normals[point].dot(&(surface.points[point] - x));
    (under > UNDER * distance).then_some(distance)
}

/// The nearest point within `reach` (m) whose normal is accepted: its leaf's node, its index, its distance. Undeformed, frame of the body.
pub(super) fn nearest(
    stack: &mut Vec<u32>,
    surface: &Surface,
    x: &Vec3,
    reach: Real,
    accepts: impl Fn(&Vec3) -> bool,
) -> Option<(u32, usize, Real)> {
    let nodes = &surface.tree.nodes;
    let clear = |index: u32| (nodes[index as usize].center - x).norm() - nodes[index as usize].radius;
    let (mut best, mut least) = (None, reach);
    stack.clear();
    stack.push(0);
    while let Some(index) = stack.pop() {
        if clear(index) > least {
            continue;
        }
        let node = &nodes[index as usize];
        if let Some([left, right]) = node.children {
            // The nearer child is visited first.
            let swap = clear(left) < clear(right);
            stack.extend(if swap { [right, left] } else { [left, right] });
            continue;
        }
        for k in node.points() {
            let distance = (surface.points[k] - x).norm();
            if distance < least && accepts(&surface.normals[k]) {
                (best, least) = (Some((index, k)), distance);
            }
        }
    }
    best.map(|(node, point)| (node, point, least))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::shapes;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inside_and_outside_of_a_box_are_distinguished_and_the_nearest_point_is_that_of_a_search_of_all(
            x in prop::array::uniform3(-0.04..0.04f64),
        ) {
            let surface = Surface::build(shapes::sample_box(Vec3::new(0.05, 0.04, 0.03), 2_400).unwrap(), None).unwrap();
            let x = Vec3::from(x);
            let mut stack = Vec::new();
            let (_, _, distance) = nearest(&mut stack, &surface, &x, Real::INFINITY, |_| true).unwrap();
            let truth = surface.points.iter().map(|p| (p - x).norm()).fold(Real::INFINITY, Real::min);
            prop_assert_eq!(distance, truth);
            let height = (x.abs() - Vec3::new(0.025, 0.02, 0.015)).max();
            // Nearer than the points lie to each other the sign is that of a plane, and a matter of the projection.
            if height.abs() > 1.5 * surface.spacing {
                prop_assert_eq!(depth_inside(&mut stack, &surface, &x).is_some(), height < 0.0, "{} m under the nearest face", -height);
            }
            if let Some(depth) = depth_inside(&mut stack, &surface, &x) {
                prop_assert!((depth + height).abs() < surface.spacing, "{} m inside, {} m to the nearest point", -height, depth);
            }
        }
    }
}
