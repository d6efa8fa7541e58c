//! The contacts of a step: control points whose last projection no longer holds are projected again, in
//! parallel; the others keep what was found (design 3.2, points 3 to 5).

use super::cache::{CachedProjection, Coupled, Found, PairCache};
use super::projection::{Due, PairGeometry, SLACK, StepGeometry};
use super::separation::STRIDE;
use super::traversal::have_penetrated;
use crate::math::{Real, Vec3};
use crate::objects::Objects;
use crate::pair::{Contact, Pair};
use rayon::prelude::*;
use std::ops::Range;

/// Least cosine between the normal of a contact and the sum of all normals, where contacts
/// agree on how to push an overlap apart. At a corner of a box it is 0.58.
const LEAST_AGREEMENT: Real = 0.3;

/// Projections of one chunk of parallel work.
const CHUNK: usize = 8;

#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Control points that have to be projected again.
    due: Vec<Due>,
    projected: Vec<CachedProjection>,
    stack: Vec<u32>,
}

/// Finds the contacts. Every control point with a coupled leaf becomes one if it is near enough. Where its last projection
/// no longer holds it is projected again first, once, from the leaf that holds the nearest point that faces it.
pub(super) fn find_contacts(
    scratch: &mut Scratch,
    pairs: &[Pair],
    caches: &mut [PairCache],
    now: StepGeometry<'_>,
    contacts: &mut Vec<Contact>,
) {
    let StepGeometry { objects, reach, params, .. } = now;
    // Between two such steps a foot and its tangent plane move along with `b`, for motions up to the contact margin.
    let least_reach = if now.refresh { -1.0 } else { params.contact_margin };
    // Room for every control point that is coupled: that many may be due at once in some later step.
    let room = caches.iter().map(|cache| cache.coupling.coupled.capacity()).sum();
    scratch.due.clear();
    scratch.due.reserve(room);
    scratch.projected.reserve(room);
    for (index, (pair, cache)) in pairs.iter().zip(caches.iter_mut()).enumerate().filter(|(_, (pair, _))| pair.near) {
        let PairCache { coupling, projections } = cache;
        let approach = reach[pair.a as usize] + reach[pair.b as usize];
        if coupling.coupled.is_empty() || coupling.is_still_asleep(pair, objects, approach) {
            continue;
        }
        let Some(geometry) = PairGeometry::of(pair, now) else { continue };
        let slack = SLACK * geometry.skin_b.surface.spacing;
        let first = scratch.due.len();
        let mut asleep_for = Real::INFINITY;
        for coupled in groups(&coupling.coupled) {
            let control_point = coupling.coupled[coupled.start].control_point as usize;
            let (x, approach) = geometry.locate(pair, control_point);
            let known = &projections[control_point];
            let (moved, approach) = ((x - known.x).norm(), approach.norm());
            let left_at_edge = known.at_edge.map_or(Real::INFINITY, |rest| slack - (geometry.at_rest(control_point) - rest).norm());
            let (left, has_foot) = match known.surface {
                Found::Foot { .. } => (known.holds_for.max(least_reach) - moved, true),
                Found::Nothing => (known.holds_for.max(least_reach) - moved, false),
                Found::Separated => (known.holds_for - moved - approach, false),
            };
            if left_at_edge < 0.0 || left.is_nan() || left < 0.0 {
                scratch.due.push(Due { pair: index as u32, coupled: coupled.start as u32..coupled.end as u32, x, approach });
            }
            asleep_for = if has_foot { -1.0 } else { asleep_for.min(left).min(left_at_edge) };
        }
        if scratch.due.len() == first && asleep_for > 0.0 && pair.side_a.active.is_empty() {
            coupling.fall_asleep(asleep_for, pair, objects);
        }
    }
    scratch.projected.clear();
    scratch.projected.resize(scratch.due.len(), CachedProjection::default());
    let known: &[PairCache] = caches;
    let work = |(due, projected): (&[Due], &mut [CachedProjection])| {
        let mut geometry: Option<(u32, PairGeometry)> = None;
        for (due, projected) in due.iter().zip(projected) {
            let (pair, cache) = (&pairs[due.pair as usize], &known[due.pair as usize]);
            if geometry.as_ref().is_none_or(|(index, _)| *index != due.pair) {
                geometry = PairGeometry::of(pair, now).map(|geometry| (due.pair, geometry));
            }
            if let Some((_, geometry)) = &geometry {
                *projected = geometry.project(pair, &cache.coupling, due);
            }
        }
    };
    // Without threads of its own a world uses none: rayon's global pool is not safe to use in a process that was forked.
    if params.threads > 1 && rayon::current_thread_index().is_some() && scratch.due.len() > CHUNK {
        scratch.due.par_chunks(CHUNK).zip(scratch.projected.par_chunks_mut(CHUNK)).for_each(work);
    } else {
        work((&scratch.due, &mut scratch.projected));
    }
    contacts.clear();
    let mut projected = scratch.due.iter().zip(scratch.projected.drain(..)).peekable();
    for (index, (pair, cache)) in pairs.iter().zip(caches).enumerate().filter(|(_, (pair, _))| pair.near) {
        let PairCache { coupling, projections } = cache;
        // A pair with elastic memory touches, or did so just now: what lies inside a body at rest may lie outside the deformed one.
        let unexamined = pair.is_idle() && !coupling.examined && !coupling.penetrated;
        if coupling.coupled.is_empty() || coupling.is_asleep() {
            if unexamined {
                coupling.examined = true;
                coupling.suspected = are_deep_inside(&mut scratch.stack, pair, objects);
            }
            continue;
        }
        let first = contacts.len();
        let Some(geometry) = PairGeometry::of(pair, now) else { continue };
        for coupled in groups(&coupling.coupled) {
            let (start, control_point) = (coupled.start as u32, coupling.coupled[coupled.start].control_point as usize);
            let new = projected.next_if(|(due, _)| due.pair == index as u32 && due.coupled.start == start);
            let projected = new.is_some();
            if let Some((_, new)) = new {
                coupling.deep |= new.deep;
                let known = &mut projections[control_point];
                *known = CachedProjection { leaves: known.leaves, ..new };
            }
            contacts.extend(geometry.contact(pair, index as u32, &coupling.coupled[coupled], &projections[control_point], projected));
        }
        // Judged at the poses at which the contacts were found: bodies moved into each other since then may push in the next step.
        let unloaded = unexamined && contacts[first..].iter().all(|contact| contact.gap > 0.0);
        let conflict = coupling.deep && !coupling.penetrated && are_in_conflict(&contacts[first..]);
        coupling.examined |= unloaded;
        if (unloaded || conflict) && are_deep_inside(&mut scratch.stack, pair, objects) {
            // Contacts in conflict would only squeeze each other out, or rotate the two by force.
            contacts.truncate(first);
            coupling.suspected = true;
        }
    }
}

/// Whether some of the control points of one body of a pair lie so deep in the other that they have penetrated each other fully.
fn are_deep_inside(stack: &mut Vec<u32>, pair: &Pair, objects: &Objects) -> bool {
    let [a, b] = pair.sides(objects);
    let (Some(skin_a), Some(skin_b)) = (a.active_skin(), b.active_skin()) else { return false };
    let pose_ba = b.pose().inverse() * a.pose();
    have_penetrated(stack, &pair.side_a.displacement, skin_a, skin_b, &pose_ba, STRIDE, 1.0)
}

/// Whether contacts disagree on how to push an overlap apart: one of them hardly along the sum of all, or against it.
fn are_in_conflict(contacts: &[Contact]) -> bool {
    let pushes = || contacts.iter().filter(|contact| contact.gap < contact.solved_gap).map(|contact| contact.frame.column(0).into_owned());
    let sum: Vec3 = pushes().sum();
    pushes().any(|normal| normal.dot(&sum) < LEAST_AGREEMENT * sum.norm())
}

/// Ranges of a list of coupled nodes that belong to one control point each.
fn groups(coupled: &[Coupled]) -> impl Iterator<Item = Range<usize>> {
    let mut end = 0;
    coupled.chunk_by(|c, d| c.control_point == d.control_point).map(move |group| {
        end += group.len();
        end - group.len()..end
    })
}
