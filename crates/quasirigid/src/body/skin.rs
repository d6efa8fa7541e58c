//! The surface of a body as it is now: material, elastic displacement, deformed points and the spheres around them.

use crate::body::material::{ComplianceModel, Material};
use crate::error::Result;
use crate::math::{Real, Vec3};
use crate::params::Parameters;
use crate::surface::moving_least_squares::evaluate;
use crate::surface::sphere_tree::sphere_around;
use crate::surface::{Compliance, HalfSpaceCompliance, LocalCompliance, Surface};
use std::sync::Arc;

/// A bounding sphere, body frame, m.
#[derive(Debug, Clone, Copy)]
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
    /// Elastic displacement of each control point, all patches together, body frame, m.
    pub displacement: Vec<Vec3>,
    /// Deformed points, tree order, body frame, m.
    pub deformed: Vec<Vec3>,
    /// Spheres of the tree's nodes, around the deformed points.
    pub spheres: Vec<Sphere>,
    displaced: Vec<u32>,
    dirty_leaves: Vec<u32>,
    /// Displacements that the deformed points show: they follow when one changes by more than the threshold.
    shown: Vec<Vec3>,
    shown_list: Vec<u32>,
    is_shown: Vec<bool>,
    changed: Vec<u32>,
    leaf_mark: Vec<u64>,
    node_mark: Vec<u64>,
    dirty_nodes: Vec<u32>,
    mark: u64,
    inflation: Real,
    /// Sum over all steps of the farthest that any leaf's sphere moved or grew, m: what remembers where spheres were compares with this.
    pub travel: Real,
}

impl Skin {
    /// An undeformed skin.
    ///
    /// # Errors
    /// See [`Material::check_for`].
    pub fn new(surface: Arc<Surface>, material: Material) -> Result<Self> {
        let compliance = compliance_of(&surface, &material)?;
        let spheres = surface.tree.nodes.iter().map(|n| Sphere { center: n.center, radius: n.radius }).collect();
        let leaves = surface.tree.leaves.len();
        Ok(Self {
            compliance,
            displacement: vec![Vec3::zeros(); surface.control.len()],
            deformed: surface.points.clone(),
            spheres,
            displaced: Vec::with_capacity(leaves),
            dirty_leaves: Vec::with_capacity(leaves),
            shown: vec![Vec3::zeros(); leaves],
            shown_list: Vec::with_capacity(leaves),
            is_shown: vec![false; leaves],
            changed: Vec::with_capacity(2 * leaves),
            leaf_mark: vec![0; leaves],
            node_mark: vec![0; surface.tree.nodes.len()],
            dirty_nodes: Vec::with_capacity(surface.tree.nodes.len()),
            mark: 0,
            inflation: 0.0,
            travel: 0.0,
            surface,
            material,
        })
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
        }
        self.material = material;
        Ok(changed)
    }

    /// The points that are displaced, in the caller's numbering, and where they are, body frame, m.
    pub fn moved_points(&self) -> (Vec<u32>, Vec<Vec3>) {
        let surface = &self.surface;
        let leaves = self.shown_list.iter().flat_map(|c| std::iter::once(c).chain(surface.leaf_neighbours.row(*c as usize)));
        let mut leaves: Vec<u32> = leaves.copied().collect();
        leaves.sort_unstable();
        leaves.dedup();
        let points = leaves.iter().flat_map(|&leaf| surface.tree.leaf(leaf as usize).points());
        points.filter(|&k| self.deformed[k] != surface.points[k]).map(|k| (surface.order[k], self.deformed[k])).unzip()
    }

    /// Share of the elastic displacement that is left after one step without force: `alpha = tau/(tau + dt)`.
    pub fn memory(&self, dt: Real) -> Real {
        self.material.relaxation_time / (self.material.relaxation_time + dt)
    }

    /// Forgets the displacements of the last step, to be summed anew over the patches with [`Skin::add_displacement`].
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

    /// Moves the surface points that displaced control points reach (eq. 8) and refits the spheres above them, bottom-up, to `params.refit_level`.
    pub fn deform(&mut self, params: &Parameters) {
        self.mark += 1;
        let largest = self.find_changed(params.deformation_threshold);
        self.dirty_leaves.clear();
        for &c in &self.changed {
            for &leaf in std::iter::once(&c).chain(self.surface.leaf_neighbours.row(c as usize)) {
                if self.leaf_mark[leaf as usize] != self.mark {
                    self.leaf_mark[leaf as usize] = self.mark;
                    self.dirty_leaves.push(leaf);
                }
            }
        }
        self.dirty_nodes.clear();
        let mut farthest: Real = 0.0;
        for &leaf in &self.dirty_leaves {
            let index = self.surface.tree.leaves[leaf as usize];
            let node = &self.surface.tree.nodes[index as usize];
            let (mut shift, mut spread2): (Vec3, Real) = (Vec3::zeros(), 0.0);
            for k in node.points() {
                let mut u = Vec3::zeros();
                let entries = self.surface.interpolation.range(k);
                let weights = &self.surface.interpolation_weights[entries.clone()];
                for (&control_point, &weight) in self.surface.interpolation.index[entries].iter().zip(weights) {
                    u += self.shown[control_point as usize] * Real::from(weight);
                }
                self.deformed[k] = self.surface.points[k] + u;
                shift += u;
            }
            let center = node.center + shift / node.point_count as Real;
            for p in &self.deformed[node.points()] {
                spread2 = spread2.max((p - center).norm_squared());
            }
            let radius = spread2.sqrt() + self.surface.leaf_gaps[leaf as usize];
            let before = std::mem::replace(&mut self.spheres[index as usize], Sphere { center, radius });
            farthest = farthest.max((center - before.center).norm() + (radius - before.radius).max(0.0));
            mark_up(&self.surface, index, self.mark, params.refit_level, &mut self.node_mark, &mut self.dirty_nodes);
        }
        self.travel += farthest;
        self.refit(largest, params.refit_level);
    }

    /// Outward unit normals of the deformed points, tree order, body frame: where points have moved, those of the implicit surface through
    /// the deformed points (design 3.5, paper section 3.4); elsewhere those of rest.
    ///
    /// For whoever looks at the surface; nothing in a step needs them, so a step does not pay for them.
    pub fn deformed_normals(&self) -> Vec<Vec3> {
        let surface = &self.surface;
        let mut normals = surface.normals.clone();
        let mut moved = vec![false; surface.tree.leaves.len()];
        for &c in &self.shown_list {
            for &leaf in std::iter::once(&c).chain(surface.leaf_neighbours.row(c as usize)) {
                moved[leaf as usize] = true;
            }
        }
        let mut ranges = Vec::new();
        for (leaf, _) in moved.iter().enumerate().filter(|(_, moved)| **moved) {
            ranges.clear();
            surface.border_ranges(leaf, &mut ranges);
            for k in surface.tree.leaf(leaf).points() {
                let facing = -surface.normals[k];
                let here = evaluate(&self.deformed[k], &self.deformed, &surface.normals, &ranges, &surface.kernel, Some(&facing));
                if let Some((_, normal)) = here {
                    normals[k] = normal;
                }
            }
        }
        normals
    }

    /// Control points whose displacement differs from the one shown by more than the threshold; shows them. Returns the largest displacement shown.
    fn find_changed(&mut self, threshold: Real) -> Real {
        let Self { displacement, displaced, shown, shown_list, is_shown, changed, .. } = self;
        changed.clear();
        for &c in displaced.iter().chain(shown_list.iter()) {
            let u = displacement[c as usize];
            if (u - shown[c as usize]).norm_squared() > threshold * threshold {
                // What has come back within the threshold of rest comes back all the way.
                shown[c as usize] = if u.norm_squared() > threshold * threshold { u } else { Vec3::zeros() };
                changed.push(c);
            }
        }
        for &c in changed.iter() {
            if !is_shown[c as usize] {
                is_shown[c as usize] = true;
                shown_list.push(c);
            }
        }
        shown_list.retain(|&c| {
            is_shown[c as usize] = shown[c as usize] != Vec3::zeros();
            is_shown[c as usize]
        });
        shown_list.iter().map(|&c| shown[c as usize].norm_squared()).fold(0.0, Real::max).sqrt()
    }

    fn refit(&mut self, largest: Real, refit_level: u32) {
        // Breadth-first order: children come after their parent, so from the largest index upwards is bottom-up.
        self.dirty_nodes.sort_unstable();
        for &index in self.dirty_nodes.iter().rev() {
            if let Some([l, r]) = self.surface.tree.nodes[index as usize].children {
                let (left, right) = (self.spheres[l as usize], self.spheres[r as usize]);
                let (center, radius) = sphere_around(&left.center, left.radius, &right.center, right.radius);
                self.spheres[index as usize] = Sphere { center, radius };
            }
        }
        if largest != self.inflation {
            self.inflation = largest;
            let tree = &self.surface.tree;
            for (node, sphere) in tree.nodes.iter().zip(&mut self.spheres).take_while(|(n, _)| n.level < refit_level) {
                if node.children.is_some() {
                    *sphere = Sphere { center: node.center, radius: node.radius + largest };
                }
            }
        }
    }
}

fn compliance_of(surface: &Surface, material: &Material) -> Result<Compliance> {
    material.check_for(&surface.control)?;
    Ok(match &material.model {
        &ComplianceModel::Local { foundation_modulus, width, share } => {
            Compliance::Local(LocalCompliance::build(&surface.control, foundation_modulus, width, share))
        }
        ComplianceModel::HalfSpace => Compliance::HalfSpace(HalfSpaceCompliance::new(material.young_modulus, material.poisson_ratio)),
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
