//! Of the coupled leaves: which faces they lie on, the point nearest to a control
//! point, and the points that decide where the surface is there.

use super::cache::Coupled;
use crate::collider::Skin;
use crate::math::{Real, Vec3};
use crate::surface::implicit::FACING_COSINE;
use std::ops::Range;

/// Coupled leaves whose mean normals make more than 60 degrees lie on different faces.
pub(super) const SAME_FACE: Real = 0.5;

/// Whether not all of the coupled leaves lie on one face.
pub(super) fn faces_meet(coupled: &[Coupled], skin_b: &Skin) -> bool {
    let normal = |c: &Coupled| &skin_b.surface.tree.nodes[c.node_b as usize].mean_normal;
    coupled.iter().any(|c| normal(c).dot(normal(&coupled[0])) < SAME_FACE)
}

/// Of the coupled nodes, the one with the point nearest to `x` among those that face the control point. Of the leaves that are
/// coupled with a control point the nearest keeps it; comparing points alone finds it without projecting on each.
pub(super) fn nearest_node(coupled: &[Coupled], skin_b: &Skin, x: &Vec3, normal_a: &Vec3) -> Option<(u32, usize)> {
    nearest_facing(coupled, skin_b, x, normal_a, FACING_COSINE)
}

/// Whether some point of the coupled nodes faces the control point, or will when the two have turned by at most `angle` (rad) against
/// each other.
pub(super) fn may_face(coupled: &[Coupled], skin_b: &Skin, x: &Vec3, normal_a: &Vec3, angle: Real) -> bool {
    // A cosine changes by no more than the angle does.
    nearest_facing(coupled, skin_b, x, normal_a, FACING_COSINE + angle).is_some()
}

/// [`nearest_node`] among points whose normals have less than the product `faces` with that of the control point.
fn nearest_facing(coupled: &[Coupled], skin_b: &Skin, x: &Vec3, normal_a: &Vec3, faces: Real) -> Option<(u32, usize)> {
    let surface = &skin_b.surface;
    let mut best: Option<(Real, u32, usize)> = None;
    for c in coupled {
        let node = &surface.tree.nodes[c.node_b as usize];
        // No point of the node is nearer than its sphere.
        let clear = (node.center - x).norm() - node.radius;
        if clear > 0.0 && best.is_some_and(|(least, ..)| clear * clear > least) {
            continue;
        }
        let mut look = |k: usize| {
            let distance2 = (surface.points[k] - x).norm_squared();
            if best.is_none_or(|(least, ..)| distance2 < least) && surface.normals[k].dot(normal_a) < faces {
                best = Some((distance2, c.node_b, k));
            }
        };
        node.points().for_each(&mut look);
    }
    best.map(|(_, node, point)| (node, point))
}

/// Whether `x` lies outside, by the normal of the nearest point of all coupled nodes, facing or not.
pub(super) fn is_outside(coupled: &[Coupled], skin_b: &Skin, x: &Vec3) -> bool {
    height_over_nearest(coupled, skin_b, x).is_some_and(|height| height > 0.0)
}

/// Height of `x` over the tangent plane of the nearest point of all coupled nodes, facing or not, m.
pub(super) fn height_over_nearest(coupled: &[Coupled], skin_b: &Skin, x: &Vec3) -> Option<Real> {
    let surface = &skin_b.surface;
    let points = coupled.iter().flat_map(|c| surface.tree.nodes[c.node_b as usize].points());
    let distance2 = |k: &usize| (surface.points[*k] - x).norm_squared();
    let nearest = points.min_by(|i, j| distance2(i).total_cmp(&distance2(j)));
    nearest.map(|k| surface.normals[k].dot(&(x - surface.points[k])))
}

/// Points that decide where the surface is: those of the coupled leaf and of its border.
pub(super) struct Border {
    count: usize,
    list: [Range<u32>; Border::MOST],
    /// Leaf gap, m.
    pub gap: Real,
}

impl Border {
    const MOST: usize = 64;

    pub fn of(skin: &Skin, index: u32, x: &Vec3) -> Self {
        let surface = &skin.surface;
        let node = &surface.tree.nodes[index as usize];
        let leaf = node.first_leaf as usize;
        let mut border = Self { count: 0, list: [const { 0..0 }; Self::MOST], gap: surface.leaf_gaps[leaf] };
        border.push(node.first_point..node.first_point + node.point_count);
        for &other in surface.leaf_neighbours.row(leaf) {
            let other = surface.tree.leaf(other as usize);
            let reach = other.radius + surface.kernel.cutoff();
            if (other.center - x).norm_squared() < reach * reach {
                border.push(other.first_point..other.first_point + other.point_count);
            }
        }
        border
    }

    /// The leaf's own points first, then those of others in rising order. Where there is no room for so many pieces the
    /// last one grows: the points in between are too far away to have weight, but none that has is left out.
    fn push(&mut self, range: Range<u32>) {
        if self.count > 0 && self.list[self.count - 1].end == range.start {
            self.list[self.count - 1].end = range.end;
        } else if self.count < Self::MOST {
            self.list[self.count] = range;
            self.count += 1;
        } else {
            let [own, .., last] = &mut self.list;
            last.end = range.end;
            // Its own points are counted once.
            if last.contains(&own.start) {
                *own = 0..0;
            }
        }
    }

    pub fn ranges(&self) -> &[Range<u32>] {
        &self.list[..self.count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Leaves of three points, every other one in the border, more than there is room for; and their neighbours, which are one piece.
    #[test]
    fn no_point_of_a_border_is_left_out_or_counted_twice() {
        for (own, stride) in [(0u32, 6u32), (150, 6), (600, 6), (906, 6), (300, 3)] {
            let mut border = Border { count: 0, list: [const { 0..0 }; Border::MOST], gap: 0.0 };
            let leaves: Vec<u32> = (0..180).map(|k| stride * k).filter(|&first| first != own).collect();
            border.push(own..own + 3);
            leaves.iter().for_each(|&first| border.push(first..first + 3));
            let mut seen = vec![0; 1200];
            border.ranges().iter().flat_map(Clone::clone).for_each(|k| seen[k as usize] += 1);
            let wanted = leaves.iter().chain([&own]).flat_map(|&first| first..first + 3);
            assert!(wanted.into_iter().all(|k| seen[k as usize] == 1), "own leaf at {own}, leaves {stride} stride");
            assert!(seen.iter().all(|&count| count <= 1), "own leaf at {own}, leaves {stride} stride");
        }
    }
}
