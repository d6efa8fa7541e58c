//! The surface of a body as it is now: material, elastic displacement, deformed points and the spheres around them.
//!
//! Displacements of control points follow in every step. Points and spheres are computed when
//! they are needed: the spheres when the trees of a pair are traversed again, the points on request.
//! In between [`Skin::travel`] bounds how far any point has moved.

mod stored;

pub(crate) use stored::StoredSkin;

use crate::collider::material::{ComplianceModel, LARGEST_LAYER_POISSON_RATIO, Material};
use crate::error::Result;
use crate::math::{Real, Vec3};
use crate::surface::implicit::{Cloud, evaluate};
use crate::surface::sphere_tree::sphere_around;
use crate::surface::{Compliance, GreensFunction, LocalCompliance, Surface};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A bounding sphere, body frame, m.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Sphere {
    /// Centre.
    pub center: Vec3,
    /// Radius.
    pub radius: Real,
}

/// A surface on a body.
#[derive(Debug, Clone)]
pub struct Skin {
    /// The undeformed surface; shared between bodies of one shape.
    pub surface: Arc<Surface>,
    /// What it is made of.
    pub material: Material,
    /// Static compliance between its control points.
    pub compliance: Compliance,
    /// How often the compliance has been replaced: what was computed from another revision no longer holds.
    pub compliance_revision: u64,
    /// Elastic displacement of each control point, all patches together, body frame, m.
    pub displacement: Vec<Vec3>,
    /// Spheres of the tree's nodes, around the deformed points as of the last [`Skin::refit`].
    pub spheres: Vec<Sphere>,
    displaced: Vec<u32>,
    dirty_leaves: Vec<u32>,
    /// Displacements that the deformed points show: they follow when one changes by more than the threshold.
    shown: Vec<Vec3>,
    shown_list: Vec<u32>,
    is_shown: Vec<bool>,
    /// Control points whose shown displacement has changed since the last refit.
    changed: Vec<u32>,
    is_changed: Vec<bool>,
    leaf_points: Vec<Vec3>,
    leaf_mark: Vec<u64>,
    node_mark: Vec<u64>,
    dirty_nodes: Vec<u32>,
    mark: u64,
    inflation: (Real, u32),
    /// Sum over all steps of the farthest that any point moved, m: what remembers where the surface was compares with this.
    pub travel: Real,
    /// `travel` at the last refit.
    fitted: Real,
}

impl Skin {
    /// An undeformed skin.
    ///
    /// # Errors
    /// See [`Material::check_for`].
    pub fn new(surface: Arc<Surface>, material: Material) -> Result<Self> {
        let compliance = compliance_of(&surface, &material)?;
        Ok(Self::with_compliance(surface, material, compliance))
    }

    /// An undeformed skin whose compliance is known to be that of the material.
    fn with_compliance(surface: Arc<Surface>, material: Material, compliance: Compliance) -> Self {
        let spheres = surface.tree.nodes.iter().map(|n| Sphere { center: n.center, radius: n.radius }).collect();
        let leaves = surface.tree.leaves.len();
        Self {
            compliance,
            compliance_revision: 0,
            displacement: vec![Vec3::zeros(); surface.control.len()],
            spheres,
            displaced: Vec::with_capacity(leaves),
            dirty_leaves: Vec::with_capacity(leaves),
            shown: vec![Vec3::zeros(); leaves],
            shown_list: Vec::with_capacity(leaves),
            is_shown: vec![false; leaves],
            changed: Vec::with_capacity(leaves),
            is_changed: vec![false; leaves],
            leaf_points: Vec::with_capacity(
                surface.tree.nodes.iter().filter(|n| n.children.is_none()).map(|n| n.point_count as usize).max().unwrap_or(0),
            ),
            leaf_mark: vec![0; leaves],
            node_mark: vec![0; surface.tree.nodes.len()],
            dirty_nodes: Vec::with_capacity(surface.tree.nodes.len()),
            mark: 0,
            inflation: (0.0, 0),
            travel: 0.0,
            fitted: 0.0,
            surface,
            material,
        }
    }

    /// Makes it of another material; the displacement stays what it is. Returns whether the compliance changed.
    ///
    /// # Errors
    /// See [`Material::check_for`].
    pub fn set_material(&mut self, material: Material) -> Result<bool> {
        let elastic = |m: &Material| (m.model.clone(), m.young_modulus, m.poisson_ratio);
        let changed = elastic(&self.material) != elastic(&material);
        if changed {
            self.compliance = compliance_of(&self.surface, &material)?;
            self.compliance_revision += 1;
        }
        self.material = material;
        Ok(changed)
    }

    /// The points that are displaced, in the caller's numbering, and where they are, body frame, m.
    pub fn moved_points(&self) -> (Vec<u32>, Vec<Vec3>) {
        let surface = &self.surface;
        let points = self.moved_leaves().into_iter().flat_map(|leaf| surface.tree.leaf(leaf as usize).points());
        points
            .map(|k| (k, surface.points[k] + self.displacement_of(k)))
            .filter(|(k, p)| *p != surface.points[*k])
            .map(|(k, p)| (surface.order[k], p))
            .unzip()
    }

    /// Where the points are, tree order, body frame, m (eq. 8).
    pub fn deformed_points(&self) -> Vec<Vec3> {
        let mut points = self.surface.points.clone();
        for leaf in self.moved_leaves() {
            for k in self.surface.tree.leaf(leaf as usize).points() {
                points[k] += self.displacement_of(k);
            }
        }
        points
    }

    /// Leaves some of whose points may be displaced, in order.
    fn moved_leaves(&self) -> Vec<u32> {
        let neighbours = &self.surface.leaf_neighbours;
        let mut leaves: Vec<u32> =
            self.shown_list.iter().flat_map(|c| std::iter::once(c).chain(neighbours.row(*c as usize))).copied().collect();
        leaves.sort_unstable();
        leaves.dedup();
        leaves
    }

    /// Elastic displacement of a point, tree order: `u = sum theta_k u_k` over control
    /// points near it, with weights that are positive and add up to 1 (eq. 8).
    #[inline]
    fn displacement_of(&self, point: usize) -> Vec3 {
        let entries = self.surface.interpolation.range(point);
        let weights = &self.surface.interpolation_weights[entries.clone()];
        let mut u = Vec3::zeros();
        for (&control_point, &weight) in self.surface.interpolation.index[entries].iter().zip(weights) {
            u += self.shown[control_point as usize] * Real::from(weight);
        }
        u
    }

    /// A sphere around the whole surface as it is now, refitted or not.
    pub fn bounding_sphere(&self) -> Sphere {
        let root = self.spheres[0];
        Sphere { radius: root.radius + (self.travel - self.fitted), ..root }
    }

    /// Share of the elastic displacement that is left after one step without force: `alpha = tau/(tau + dt)`.
    pub fn memory(&self, dt: Real) -> Real {
        self.material.relaxation_time / (self.material.relaxation_time + dt)
    }

    /// Forgets the displacements of the last step, to be summed again over the patches with [`Skin::add_displacement`].
    pub fn clear_displacement(&mut self) {
        for c in self.displaced.drain(..) {
            self.displacement[c as usize] = Vec3::zeros();
        }
    }

    /// Adds one patch's displacement of a control point.
    pub fn add_displacement(&mut self, control_point: u32, u: &Vec3) {
        let total = &mut self.displacement[control_point as usize];
        if *total == Vec3::zeros() {
            self.displaced.push(control_point);
        }
        *total += u;
    }

    /// Takes over the displacements, where they have changed by more than the threshold. Points and spheres follow when they are needed.
    pub fn deform(&mut self, threshold: Real) {
        self.travel += self.show_changed(threshold);
    }

    /// Refits the spheres around the surface points that displaced control points reach (eq. 8), bottom-up, to `refit_level`.
    pub fn refit(&mut self, refit_level: u32) {
        if self.changed.is_empty() {
            return;
        }
        self.fitted = self.travel;
        self.mark += 1;
        self.dirty_leaves.clear();
        for c in self.changed.drain(..) {
            self.is_changed[c as usize] = false;
            for &leaf in std::iter::once(&c).chain(self.surface.leaf_neighbours.row(c as usize)) {
                if self.leaf_mark[leaf as usize] != self.mark {
                    self.leaf_mark[leaf as usize] = self.mark;
                    self.dirty_leaves.push(leaf);
                }
            }
        }
        self.dirty_nodes.clear();
        let mut points = std::mem::take(&mut self.leaf_points);
        for i in 0..self.dirty_leaves.len() {
            let leaf = self.dirty_leaves[i];
            let index = self.surface.tree.leaves[leaf as usize];
            let node = &self.surface.tree.nodes[index as usize];
            let mut shift = Vec3::zeros();
            points.clear();
            for k in node.points() {
                let u = self.displacement_of(k);
                points.push(self.surface.points[k] + u);
                shift += u;
            }
            let center = node.center + shift / node.point_count as Real;
            let spread2 = points.iter().map(|p| (p - center).norm_squared()).fold(0.0, Real::max);
            let radius = spread2.sqrt() + self.surface.leaf_gaps[leaf as usize];
            self.spheres[index as usize] = Sphere { center, radius };
            mark_up(&self.surface, index, self.mark, refit_level, &mut self.node_mark, &mut self.dirty_nodes);
        }
        self.leaf_points = points;
        let largest = self.shown_list.iter().map(|&c| self.shown[c as usize].norm_squared()).fold(0.0, Real::max).sqrt();
        self.refit_above(largest, refit_level);
    }

    /// Outward unit normals of the deformed points, tree order, body frame: where points have moved, those of the implicit surface through
    /// the deformed points (design 3.5, paper section 3.4); elsewhere those of rest.
    ///
    /// For pictures and exports; no step needs them, so none computes them.
    pub fn deformed_normals(&self) -> Vec<Vec3> {
        let surface = &self.surface;
        let (mut normals, points) = (surface.normals.clone(), self.deformed_points());
        let mut ranges = Vec::new();
        for leaf in self.moved_leaves() {
            ranges.clear();
            surface.border_ranges(leaf as usize, &mut ranges);
            for k in surface.tree.leaf(leaf as usize).points() {
                let facing = -surface.normals[k];
                let cloud =
                    Cloud { points: &points, normals: &surface.normals, ranges: &ranges, kernel: &surface.kernel, facing: Some(&facing) };
                if let Some((_, normal)) = evaluate(&points[k], &cloud) {
                    normals[k] = normal;
                }
            }
        }
        normals
    }

    /// Shows the displacements that differ from those shown by more than the
    /// threshold. Returns how far any point has moved by that at most, m.
    fn show_changed(&mut self, threshold: Real) -> Real {
        let Self { displacement, displaced, shown, shown_list, is_shown, changed, is_changed, .. } = self;
        let mut farthest2: Real = 0.0;
        let already = shown_list.len();
        for i in 0..displaced.len() + already {
            let c = if i < displaced.len() { displaced[i] } else { shown_list[i - displaced.len()] };
            let (u, before) = (displacement[c as usize], shown[c as usize]);
            if (u - before).norm_squared() <= threshold * threshold {
                continue;
            }
            // What has come back within the threshold of rest comes back all the way.
            let now = if u.norm_squared() > threshold * threshold { u } else { Vec3::zeros() };
            shown[c as usize] = now;
            farthest2 = farthest2.max((now - before).norm_squared());
            if !is_changed[c as usize] {
                is_changed[c as usize] = true;
                changed.push(c);
            }
            if !is_shown[c as usize] {
                is_shown[c as usize] = true;
                shown_list.push(c);
            }
        }
        shown_list.retain(|&c| {
            is_shown[c as usize] = shown[c as usize] != Vec3::zeros();
            is_shown[c as usize]
        });
        farthest2.sqrt()
    }

    fn refit_above(&mut self, largest: Real, refit_level: u32) {
        // Breadth-first order: children come after their parent, so from the largest index upwards is bottom-up.
        self.dirty_nodes.sort_unstable();
        for &index in self.dirty_nodes.iter().rev() {
            if let Some([l, r]) = self.surface.tree.nodes[index as usize].children {
                let (left, right) = (self.spheres[l as usize], self.spheres[r as usize]);
                let (center, radius) = sphere_around(&left.center, left.radius, &right.center, right.radius);
                self.spheres[index as usize] = Sphere { center, radius };
            }
        }
        if (largest, refit_level) != self.inflation {
            self.inflation = (largest, refit_level);
            let tree = &self.surface.tree;
            for (node, sphere) in tree.nodes.iter().zip(&mut self.spheres).take_while(|(n, _)| n.level < refit_level) {
                if node.children.is_some() {
                    *sphere = Sphere { center: node.center, radius: node.radius + largest };
                }
            }
        }
    }
}

/// The compliance of a surface of a material.
pub(crate) fn compliance_of(surface: &Surface, material: &Material) -> Result<Compliance> {
    material.check_for(&surface.control)?;
    let Material { young_modulus, poisson_ratio, layer_thickness, .. } = *material;
    let local = |local: LocalCompliance| Compliance::Local(Arc::new(local));
    Ok(match &material.model {
        ComplianceModel::Local => {
            let nu = poisson_ratio.min(LARGEST_LAYER_POISSON_RATIO);
            local(LocalCompliance::layer(&surface.control, young_modulus, nu, layer_thickness))
        }
        &ComplianceModel::Gaussian { foundation_modulus, width, share } => {
            local(LocalCompliance::gaussian(&surface.control, foundation_modulus, width, share))
        }
        ComplianceModel::HalfSpace => Compliance::GreensFunction(GreensFunction::half_space(young_modulus, poisson_ratio)),
        ComplianceModel::Layer => Compliance::GreensFunction(GreensFunction::layer(young_modulus, poisson_ratio, layer_thickness)),
        ComplianceModel::Matrix(matrix) => Compliance::Matrix(matrix.clone()),
    })
}

/// Marks the ancestors of a leaf down from `refit_level`.
fn mark_up(surface: &Surface, leaf: u32, mark: u64, refit_level: u32, node_mark: &mut [u64], dirty: &mut Vec<u32>) {
    let mut index = surface.tree.nodes[leaf as usize].parent;
    while surface.tree.nodes[index as usize].level >= refit_level && node_mark[index as usize] != mark {
        node_mark[index as usize] = mark;
        dirty.push(index);
        let parent = surface.tree.nodes[index as usize].parent;
        if parent == index {
            break;
        }
        index = parent;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::shapes;
    use proptest::prelude::*;
    use std::sync::LazyLock;

    static SURFACES: LazyLock<[Arc<Surface>; 2]> = LazyLock::new(|| {
        let plate = shapes::sample_box(Vec3::new(0.03, 0.02, 0.002), 700).unwrap();
        let tip = shapes::sample_fingertip(Vec3::new(0.012, 0.0085, 0.007), 700).unwrap();
        [plate, tip].map(|points| Arc::new(Surface::build(points, Some(100)).unwrap()))
    });

    /// What is done to a skin.
    #[derive(Debug, Clone)]
    enum Change {
        /// New displacements (m) of some control points, by two patches each; all others are at rest.
        Deform(Vec<(usize, [Real; 3])>, Real),
        Refit(u32),
    }

    fn change() -> impl Strategy<Value = Change> {
        let displacement = (0..100usize, prop::array::uniform3(-2e-3..2e-3f64));
        // Now and then far below the threshold.
        let scale = prop_oneof![3 => Just(1.0), 1 => Just(1e-5)];
        prop_oneof![
            2 => (prop::collection::vec(displacement, 0..8), scale).prop_map(|(moved, scale)| Change::Deform(moved, scale)),
            1 => (0..9u32).prop_map(Change::Refit),
        ]
    }

    /// How far a point of the nodes that `of` picks sticks out of its sphere at most, m.
    fn worst_outside(skin: &Skin, points: &[Vec3], of: impl Fn(usize) -> Option<Sphere>) -> Real {
        let nodes = skin.surface.tree.nodes.iter().enumerate();
        let out = nodes.filter_map(|(index, node)| {
            let sphere = of(index)?;
            node.points().map(|k| (points[k] - sphere.center).norm() - sphere.radius).reduce(Real::max)
        });
        out.fold(Real::NEG_INFINITY, Real::max)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn spheres_hold_deformed_points_and_travel_bounds_their_way(which in 0..2usize, changes in prop::collection::vec(change(), 1..12)) {
            let threshold = 1e-7;
            let mut skin = Skin::new(SURFACES[which].clone(), Material::preset("fingertip_pulp").unwrap()).unwrap();
            let mut before = skin.deformed_points();
            for change in changes {
                let travelled = skin.travel;
                match change {
                    Change::Deform(moved, scale) => {
                        skin.clear_displacement();
                        let control_points = skin.surface.control.len();
                        for (c, u) in moved {
                            let (c, u) = ((c % control_points) as u32, Vec3::from(u) * scale);
                            skin.add_displacement(c, &(u * 0.25));
                            skin.add_displacement(c, &(u * 0.75));
                        }
                        skin.deform(threshold);
                    }
                    Change::Refit(level) => {
                        skin.refit(level);
                        let points = skin.deformed_points();
                        let out = worst_outside(&skin, &points, |index| Some(skin.spheres[index]));
                        prop_assert!(out < 1e-12, "refitted down to level {level}: a point sticks out of its sphere by {out:e} m");
                    }
                }
                let points = skin.deformed_points();
                let farthest = points.iter().zip(&before).map(|(p, q)| (p - q).norm()).fold(0.0, Real::max);
                let bound = skin.travel - travelled;
                prop_assert!(farthest <= bound + 1e-12, "a point moved by {farthest:e} m, travel says {bound:e} m");
                // Nobody has refitted since, yet the sphere around all of it holds them.
                let out = worst_outside(&skin, &points, |index| (index == 0).then(|| skin.bounding_sphere()));
                prop_assert!(out < 1e-12, "a point sticks out of the bounding sphere by {out:e} m");
                before = points;
            }
        }
    }
}
