//! Control points of coupled leaves, projected on the other surface (design 3.2, points 3 to 5).

use super::traversal::{Coupled, Traversal};
use super::{Contact, Pair};
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

#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Ranges of `coupled`, one for each control point with a coupled leaf.
    groups: Vec<Range<u32>>,
    found: Vec<Option<Contact>>,
}

/// Every control point with a coupled leaf is projected once, from the leaf that holds the nearest point that faces it.
pub(super) fn project_control_points(
    scratch: &mut Scratch,
    traversal: &Traversal,
    pairs: &[Pair],
    bodies: &[BodyEntry],
    free: &[FreeMotion],
    params: &Parameters,
    contacts: &mut Vec<Contact>,
) {
    let coupled = &traversal.coupled;
    scratch.groups.clear();
    let mut first = 0;
    for end in 1..=coupled.len() {
        if end == coupled.len() || (coupled[end].pair, coupled[end].control_point) != (coupled[first].pair, coupled[first].control_point) {
            scratch.groups.push(first as u32..end as u32);
            first = end;
        }
    }
    scratch.found.clear();
    scratch.found.resize(scratch.groups.len(), None);
    let work = |(groups, found): (&[Range<u32>], &mut [Option<Contact>])| {
        for (group, slot) in groups.iter().zip(found) {
            *slot = project_control_point(&coupled[group.start as usize..group.end as usize], pairs, bodies, free, params);
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
    coupled: &[Coupled],
    pairs: &[Pair],
    bodies: &[BodyEntry],
    free: &[FreeMotion],
    params: &Parameters,
) -> Option<Contact> {
    let (index, control_point) = (coupled[0].pair, coupled[0].control_point as usize);
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

    let node_b = nearest_node(coupled, skin_b, &x, &normal_a)?;
    let border = Border::of(skin_b, node_b, &x);
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
    let point = (pose_b * Point3::from(x)).coords;
    let normal = pose_b * q.normal;
    let motion_a = entry_a.free_displacement(&free[pair.a as usize], &point);
    let motion_b = entry_b.free_displacement(&free[pair.b as usize], &point);
    // Enters if it touches now or would after the free motion: nothing fast slips through a step.
    if gap + normal.dot(&(motion_a - motion_b)).min(0.0) > params.contact_margin {
        return None;
    }
    let frame: Mat3 = contact_frame(&normal, &(pose_a * control.tangents[control_point]));
    let area = coupled.iter().map(|c| skin_a.surface.tree.nodes[c.node_a as usize].area).fold(0.0, Real::max);
    Some(Contact {
        pair: index,
        body_a: pair.a,
        body_b: pair.b,
        control_point: control_point as u32,
        point,
        frame,
        gap,
        area,
        weights_b,
    })
}

/// Of the coupled nodes, the one with the point nearest to `x` among those that face the control point. Of the leaves that claim a control point the
/// nearest keeps it; looking at points alone finds it without projecting on each.
fn nearest_node(coupled: &[Coupled], skin_b: &Skin, x: &Vec3, normal_a: &Vec3) -> Option<u32> {
    let surface = &skin_b.surface;
    let mut best: Option<(Real, u32)> = None;
    let mut look = |k: usize, node: u32| {
        if surface.normals[k].dot(normal_a) < 0.0 {
            let distance2 = (surface.points[k] - x).norm_squared();
            if best.is_none_or(|(least, _)| distance2 < least) {
                best = Some((distance2, node));
            }
        }
    };
    for c in coupled {
        let node = &surface.tree.nodes[c.node_b as usize];
        if node.children.is_none() {
            node.points().for_each(|k| look(k, c.node_b));
        } else {
            (0..node.sample_len()).for_each(|k| look(node.sample(k), c.node_b));
        }
    }
    best.map(|(_, node)| node)
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
