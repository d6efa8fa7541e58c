//! Control points of coupled leaves, projected on the other surface (design 3.2, points 3 to 5).

use super::{Contact, Coupled, Pair};
use crate::body::{BodyEntry, Skin};
use crate::free_motion::FreeMotion;
use crate::math::{Mat3, Pose, Real, Vec3, contact_frame};
use crate::params::Parameters;
use crate::surface::moving_least_squares::{Kernel, project};
use nalgebra::Point3;
use rayon::prelude::*;
use std::ops::Range;

/// A projection farther from the nearest sample than this many leaf gaps (half the distance to a close neighbour) has left the border of its leaf.
const BORDER_GAPS: Real = 1.5;

/// Control points of one chunk of parallel work.
const CHUNK: usize = 32;

/// One control point with a coupled leaf: its pair, and the range of its coupled nodes there.
type Group = (u32, Range<u32>);

#[derive(Debug, Default)]
pub(super) struct Scratch {
    groups: Vec<Group>,
    found: Vec<Option<Contact>>,
}

/// Every control point with a coupled leaf is projected once, from the leaf that holds the nearest point that faces it.
pub(super) fn project_control_points(
    scratch: &mut Scratch,
    pairs: &[Pair],
    bodies: &[BodyEntry],
    free: &[FreeMotion],
    params: &Parameters,
    contacts: &mut Vec<Contact>,
) {
    scratch.groups.clear();
    for (index, pair) in pairs.iter().enumerate().filter(|(_, pair)| pair.near) {
        let coupled = &pair.coupling.coupled;
        let mut first = 0;
        for end in 1..=coupled.len() {
            if end == coupled.len() || coupled[end].control_point != coupled[first].control_point {
                scratch.groups.push((index as u32, first as u32..end as u32));
                first = end;
            }
        }
    }
    scratch.found.clear();
    scratch.found.resize(scratch.groups.len(), None);
    let work = |(groups, found): (&[Group], &mut [Option<Contact>])| {
        for ((index, group), slot) in groups.iter().zip(found) {
            let coupled = &pairs[*index as usize].coupling.coupled[group.start as usize..group.end as usize];
            *slot = project_control_point(*index, coupled, pairs, bodies, free, params);
        }
    };
    if params.threads > 1 {
        scratch.groups.par_chunks(CHUNK).zip(scratch.found.par_chunks_mut(CHUNK)).for_each(work);
    } else {
        work((&scratch.groups, &mut scratch.found));
    }
    contacts.clear();
    contacts.extend(scratch.found.iter_mut().filter_map(Option::take));
}

fn project_control_point(
    index: u32,
    coupled: &[Coupled],
    pairs: &[Pair],
    bodies: &[BodyEntry],
    free: &[FreeMotion],
    params: &Parameters,
) -> Option<Contact> {
    let control_point = coupled[0].control_point as usize;
    let pair = &pairs[index as usize];
    let (entry_a, entry_b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
    let (skin_a, skin_b) = (entry_a.active_skin()?, entry_b.active_skin()?);
    let pose_a = entry_a.body.link_pose(entry_a.skin_link);
    let pose_b = entry_b.body.link_pose(entry_b.skin_link);
    let pose_ba: Pose = pose_b.inverse() * pose_a;

    // The control point where the last step left it, in the frame of b.
    let control = &skin_a.surface.control;
    let x = (pose_ba * Point3::from(control.points[control_point] + pair.side_a.displacement[control_point])).coords;
    let normal_a = pose_ba * control.normals[control_point];

    let (node_b, nearest) = nearest_node(coupled, skin_b, &x, &normal_a)?;
    let border = Border::of(skin_b, node_b, &x);
    let point = (pose_b * Point3::from(x)).coords;
    let approach = entry_a.free_displacement(&free[pair.a as usize], &point) - entry_b.free_displacement(&free[pair.b as usize], &point);
    // The plane of the nearest point is off by far less than a leaf gap: most control points can be told to be apart without a projection.
    let plane_normal = skin_b.surface.normals[nearest];
    let plane_gap = plane_normal.dot(&(x - skin_b.surface.points[nearest] - pair_displacement_b(pair, skin_b, node_b)));
    if plane_gap - approach.norm() > params.contact_margin + border.gap {
        return None;
    }
    let tolerance = params.projection_tolerance;
    let surface_b = &skin_b.surface;
    let q = project(&x, &surface_b.points, &surface_b.normals, border.ranges(), &border.kernel, Some(&normal_a), tolerance, 10)?;
    // Artefacts of high curvature: a surface that does not face the control point, or a projection beyond the border of the leaf.
    if q.normal.dot(&normal_a) >= 0.0 {
        return None;
    }
    let aside = surface_b.points[q.nearest] - q.point;
    let aside = aside - q.normal * q.normal.dot(&aside);
    if aside.norm() > BORDER_GAPS * border.gap {
        return None;
    }
    let leaf_b = surface_b.tree.nodes[node_b as usize].representative as usize;
    let weights_b = surface_b.control_weights(&q.point, &q.normal, leaf_b);
    let u_b: Vec3 = weights_b.iter().map(|(c, w)| pair.side_b.displacement[c] * w).sum();
    let gap = q.normal.dot(&(x - q.point - u_b));
    let normal = pose_b * q.normal;
    // Enters if it touches now or would after the free motion: nothing fast slips through a step.
    if gap + normal.dot(&approach).min(0.0) > params.contact_margin {
        return None;
    }
    let frame: Mat3 = contact_frame(&normal, &(pose_a * control.tangents[control_point]));
    let area = coupled.iter().map(|c| skin_a.surface.tree.nodes[c.node_a as usize].area).fold(0.0, Real::max);
    Some(Contact { pair: index, body_a: pair.a, body_b: pair.b, control_point: control_point as u32, point, frame, gap, area, weights_b })
}

/// Elastic displacement of `b` at the control point of a node, frame of `b`.
fn pair_displacement_b(pair: &Pair, skin_b: &Skin, node_b: u32) -> Vec3 {
    pair.side_b.displacement[skin_b.surface.tree.nodes[node_b as usize].representative as usize]
}

/// Of the coupled nodes, the one with the point nearest to `x` among those that face the control point. Of the leaves that claim a control point the
/// nearest keeps it; looking at points alone finds it without projecting on each.
fn nearest_node(coupled: &[Coupled], skin_b: &Skin, x: &Vec3, normal_a: &Vec3) -> Option<(u32, usize)> {
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
            if best.is_none_or(|(least, ..)| distance2 < least) && surface.normals[k].dot(normal_a) < 0.0 {
                best = Some((distance2, c.node_b, k));
            }
        };
        if node.children.is_none() {
            node.points().for_each(look);
        } else {
            (0..node.sample_len()).map(|k| node.sample(k)).for_each(&mut look);
        }
    }
    best.map(|(_, node, point)| (node, point))
}

/// Points that decide where the surface is: those of the coupled leaf and of its border; of an inner node its sample.
struct Border {
    count: usize,
    list: [Range<u32>; Border::MOST],
    kernel: Kernel,
    gap: Real,
}

impl Border {
    const MOST: usize = 64;

    fn of(skin: &Skin, index: u32, x: &Vec3) -> Self {
        let surface = &skin.surface;
        let node = &surface.tree.nodes[index as usize];
        let mut border = Self { count: 0, list: [const { 0..0 }; Self::MOST], kernel: surface.kernel, gap: 0.0 };
        if node.children.is_none() {
            let leaf = node.first_leaf as usize;
            border.gap = surface.leaf_gaps[leaf];
            border.push(node.first_point..node.first_point + node.point_count);
            for &other in surface.leaf_neighbours.row(leaf) {
                let other = surface.tree.leaf(other as usize);
                let reach = other.radius + surface.kernel.cutoff();
                if (other.center - x).norm_squared() < reach * reach {
                    border.push(other.first_point..other.first_point + other.point_count);
                }
            }
        } else {
            let spacing = (node.area / node.sample_len() as Real).sqrt();
            // A node of points has a positive area: the kernel of the leaves is never the one used.
            (border.kernel, border.gap) = (Kernel::for_spacing(spacing).unwrap_or(surface.kernel), spacing);
            for k in 0..node.sample_len() {
                let point = node.sample(k) as u32;
                border.push(point..point + 1);
            }
        }
        border
    }

    fn push(&mut self, range: Range<u32>) {
        if self.count < Self::MOST {
            self.list[self.count] = range;
            self.count += 1;
        }
    }

    fn ranges(&self) -> &[Range<u32>] {
        &self.list[..self.count]
    }
}
