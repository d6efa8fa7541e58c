//! The elastic displacement of one side of a pair.

use crate::math::Vec3;
use serde::{Deserialize, Serialize, Serializer};
use std::borrow::Cow;

/// Elastic displacement of one side of a pair, at the control points of its surface.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(try_from = "StoredSide")]
pub struct PatchSide {
    /// Displacement `u` of each control point, m, in the frame of the link that carries the surface.
    pub displacement: Vec<Vec3>,
    /// Control points whose displacement is not zero.
    pub active: Vec<u32>,
    /// Whether a control point is in `active`.
    pub is_active: Vec<bool>,
    /// Static displacement of the control points that forces at others move.
    pub unloaded: Unloaded,
}

/// Control points that forces at others displace but that are in no contact themselves: their displacement is seen,
/// and counts as soon as they come into contact. Their static displacement under the present forces is kept, and found
/// again only when those have changed by more than the solver's last digits: a patch at rest costs nothing.
#[derive(Debug, Clone, Default)]
pub struct Unloaded {
    /// `K^-1 f` of each control point, m, valid where its `found_at` is the present `revision`.
    pub static_displacement: Vec<Vec3>,
    /// Revision of the forces that it was found for.
    pub found_at: Vec<u64>,
    /// How often the forces have changed.
    pub revision: u64,
    /// The forces of this revision, N: control point and force.
    pub forces: Vec<(u32, Vec3)>,
}

impl PatchSide {
    /// No displacement of any of `control_points` control points.
    pub fn new(control_points: usize) -> Self {
        Self {
            displacement: vec![Vec3::zeros(); control_points],
            active: Vec::with_capacity(control_points.min(512)),
            is_active: vec![false; control_points],
            unloaded: Unloaded {
                static_displacement: vec![Vec3::zeros(); control_points],
                found_at: vec![0; control_points],
                revision: 0,
                forces: Vec::with_capacity(control_points.min(512)),
            },
        }
    }

    /// Forgets all displacements.
    pub fn clear(&mut self) {
        for c in self.active.drain(..) {
            (self.displacement[c as usize], self.is_active[c as usize]) = (Vec3::zeros(), false);
        }
    }

    /// Marks a control point as displaced.
    pub fn touch(&mut self, control_point: usize) {
        if !self.is_active[control_point] {
            self.is_active[control_point] = true;
            self.active.push(control_point as u32);
        }
    }
}

/// A [`PatchSide`] without what follows from the rest, and without displacements of unloaded control points that no longer hold.
#[derive(Serialize, Deserialize)]
struct StoredSide<'a> {
    displacement: Cow<'a, [Vec3]>,
    active: Cow<'a, [u32]>,
    forces: Cow<'a, [(u32, Vec3)]>,
    /// [`Unloaded::static_displacement`] of the control points where it holds for these forces; `None` before there were any.
    unloaded: Option<Vec<(u32, Vec3)>>,
}

impl Serialize for PatchSide {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Unloaded { static_displacement, found_at, revision, forces } = &self.unloaded;
        let holds = |i: &usize| found_at[*i] == *revision;
        let unloaded = (*revision > 0).then(|| (0..found_at.len()).filter(holds).map(|i| (i as u32, static_displacement[i])).collect());
        StoredSide {
            displacement: Cow::Borrowed(&self.displacement),
            active: Cow::Borrowed(&self.active),
            forces: Cow::Borrowed(forces),
            unloaded,
        }
        .serialize(serializer)
    }
}

impl TryFrom<StoredSide<'_>> for PatchSide {
    type Error = String;

    fn try_from(stored: StoredSide) -> Result<Self, String> {
        let control_points = stored.displacement.len();
        let mut side = Self { displacement: stored.displacement.into_owned(), ..Self::new(control_points) };
        for &c in stored.active.iter() {
            let place = side.is_active.get_mut(c as usize).ok_or_else(|| no_control_point(c, control_points))?;
            if std::mem::replace(place, true) {
                return Err(format!("control point {c} active twice"));
            }
        }
        side.active.extend_from_slice(&stored.active);
        check_indices(stored.forces.iter().map(|(c, _)| *c), control_points)?;
        side.unloaded.forces.extend_from_slice(&stored.forces);
        if let Some(unloaded) = stored.unloaded {
            side.unloaded.revision = 1;
            check_indices(unloaded.iter().map(|(c, _)| *c), control_points)?;
            for (c, u) in unloaded {
                (side.unloaded.found_at[c as usize], side.unloaded.static_displacement[c as usize]) = (1, u);
            }
        }
        Ok(side)
    }
}

/// Refuses the number of a control point that a surface does not have.
pub(crate) fn check_indices(indices: impl IntoIterator<Item = u32>, control_points: usize) -> Result<(), String> {
    let wrong = indices.into_iter().find(|&c| c as usize >= control_points);
    wrong.map_or(Ok(()), |c| Err(no_control_point(c, control_points)))
}

fn no_control_point(c: u32, control_points: usize) -> String {
    format!("control point {c} of {control_points}")
}
