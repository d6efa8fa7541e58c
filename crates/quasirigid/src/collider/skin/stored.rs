//! What is stored of a skin, and what is refused when it is read. Surface and material are stored separately, once each.

use super::{Skin, Sphere};
use crate::collider::Material;
use crate::math::{Real, Vec3};
use crate::surface::{Compliance, Surface};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::sync::Arc;

/// A [`Skin`] without surface and material, without what follows from the rest, and without scratch.
#[derive(Serialize, Deserialize)]
pub(crate) struct StoredSkin<'a> {
    compliance_revision: u64,
    displacement: Cow<'a, [Vec3]>,
    displaced: Cow<'a, [u32]>,
    spheres: Cow<'a, [Sphere]>,
    shown: Cow<'a, [Vec3]>,
    shown_list: Cow<'a, [u32]>,
    changed: Cow<'a, [u32]>,
    inflation: (Real, u32),
    travel: Real,
    fitted: Real,
}

impl Skin {
    /// What is stored.
    pub(crate) fn stored(&self) -> StoredSkin<'_> {
        StoredSkin {
            compliance_revision: self.compliance_revision,
            displacement: Cow::Borrowed(&self.displacement),
            displaced: Cow::Borrowed(&self.displaced),
            spheres: Cow::Borrowed(&self.spheres),
            shown: Cow::Borrowed(&self.shown),
            shown_list: Cow::Borrowed(&self.shown_list),
            changed: Cow::Borrowed(&self.changed),
            inflation: self.inflation,
            travel: self.travel,
            fitted: self.fitted,
        }
    }

    /// The skin that was stored, refused if it is none of this surface. `compliance` is that of the material.
    pub(crate) fn of_stored(surface: Arc<Surface>, material: Material, compliance: Compliance, stored: StoredSkin) -> Result<Self, String> {
        let (leaves, nodes) = (surface.control.len(), surface.tree.nodes.len());
        if [stored.displacement.len(), stored.shown.len(), stored.spheres.len()] != [leaves, leaves, nodes] {
            return Err(format!("a body of another surface than the one with {leaves} control points"));
        }
        if stored.spheres.iter().any(|sphere| sphere.radius < 0.0) {
            return Err("a sphere with a negative radius".into());
        }
        if stored.travel < stored.fitted || stored.fitted < 0.0 {
            return Err("spheres that were fitted to a surface that had not moved so far".into());
        }
        let mut skin = Self::with_compliance(surface, material, compliance);
        skin.is_shown = marked(&stored.shown_list, leaves)?;
        skin.is_changed = marked(&stored.changed, leaves)?;
        marked(&stored.displaced, leaves)?;
        skin.displaced.extend_from_slice(&stored.displaced);
        skin.shown_list.extend_from_slice(&stored.shown_list);
        skin.changed.extend_from_slice(&stored.changed);
        skin.compliance_revision = stored.compliance_revision;
        skin.displacement = stored.displacement.into_owned();
        skin.spheres = stored.spheres.into_owned();
        skin.shown = stored.shown.into_owned();
        (skin.inflation, skin.travel, skin.fitted) = (stored.inflation, stored.travel, stored.fitted);
        Ok(skin)
    }
}

/// Marks for the control points in a list, which names each once at most.
fn marked(list: &[u32], control_points: usize) -> Result<Vec<bool>, String> {
    let mut marks = vec![false; control_points];
    for &c in list {
        let mark = marks.get_mut(c as usize).ok_or_else(|| format!("control point {c} of {control_points}"))?;
        if std::mem::replace(mark, true) {
            return Err(format!("control point {c} listed twice"));
        }
    }
    Ok(marks)
}

#[cfg(test)]
impl Skin {
    /// Scratch as it is in a new skin.
    pub(crate) fn drop_scratch(&mut self, which: usize) {
        match which {
            0 => self.dirty_leaves = Vec::new(),
            1 => self.leaf_points = Vec::new(),
            2 => self.dirty_nodes = Vec::new(),
            _ => {
                self.leaf_mark.fill(0);
                self.node_mark.fill(0);
                self.mark = 0;
            }
        }
    }
}
