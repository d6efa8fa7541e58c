//! What is refused of a search cache that is read.

use super::cache::{Found, PairCache};
use crate::pair::check_indices;
use crate::surface::Surface;

impl PairCache {
    /// Refuses what is no cache of a pair of these surfaces.
    pub(crate) fn check(&self, surface_a: &Surface, surface_b: &Surface) -> Result<(), String> {
        let (nodes_a, nodes_b) = (&surface_a.tree.nodes, &surface_b.tree.nodes);
        if self.projections.len() != surface_a.control.len() {
            return Err(format!("{} projections of {} control points", self.projections.len(), surface_a.control.len()));
        }
        for projection in &self.projections {
            if let Found::Foot { weights, .. } = &projection.surface {
                check_indices(weights.iter().map(|(c, _)| c as u32), surface_b.control.len())?;
            }
        }
        let mut last = 0;
        for coupled in &self.coupling.coupled {
            let node_a = nodes_a.get(coupled.node_a as usize).ok_or("a coupled node that is not there")?;
            let node_b = nodes_b.get(coupled.node_b as usize).ok_or("a coupled node that is not there")?;
            let below = node_a.first_leaf..node_a.first_leaf + node_a.leaf_count;
            if !below.contains(&coupled.control_point) || node_b.children.is_some() {
                return Err("a coupled node of another control point".into());
            }
            if coupled.control_point < last {
                return Err("coupled nodes out of order".into());
            }
            last = coupled.control_point;
        }
        Ok(())
    }
}

#[cfg(test)]
impl super::Collision {
    /// Scratch as it is in a new world.
    pub(crate) fn drop_scratch(&mut self, which: usize) {
        match which {
            0 => self.bounds = Default::default(),
            1 => self.near = Vec::new(),
            2 => self.traversal = super::traversal::Traversal::default(),
            3 => self.projection = super::contacts::Scratch::default(),
            _ => self.penetrated = Vec::new(),
        }
    }
}
