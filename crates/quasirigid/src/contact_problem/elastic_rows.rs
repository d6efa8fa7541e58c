//! Elastic rows of one patch, kept from step to step while its contacts stay the same: the paper expects "substantial speedups by reusing parts of the computation".

use crate::collision::Contact;
use crate::gauss_seidel::MatrixFree;
use crate::math::{Mat3, Real};

/// Rows are kept while the two bodies have turned against each other by less than this, rad. What the solver sees and what
/// [`crate::constrained_motion`] does must be the same operator: a difference is a creep, here below 1e-13 m in a step.
const SAME_TURN: Real = 1e-10;

/// The elastic part of `W` over the contacts of one pair, in the axes of the link of `a`.
#[derive(Debug, Clone, Default)]
pub struct ElasticRows {
    contacts: Vec<(u32, Real)>,
    turn: Mat3,
    dt: Real,
    /// Ends of the rows in `columns`.
    ends: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<Real>,
    /// All rows of tensors, dense; empty if both sides are isotropic.
    tensors: Vec<Mat3>,
}

impl ElasticRows {
    /// Whether the rows are those of `patch`: the same control points with the same projections and areas, for the same time step.
    pub(super) fn hold_for(&self, patch: &[Contact], turn: &Mat3, dt: Real) -> bool {
        let same = |(contact, kept): (&Contact, &(u32, Real))| !contact.projected && (contact.control_point, contact.area) == *kept;
        self.dt == dt
            && self.contacts.len() == patch.len()
            && self.ends.len() == patch.len()
            && patch.iter().zip(&self.contacts).all(same)
            && (self.tensors.is_empty() || (self.turn - turn).amax() < SAME_TURN)
    }

    /// Holds for no patch until it is filled anew.
    pub(super) fn forget(&mut self) {
        self.contacts.clear();
        self.ends.clear();
    }

    pub(super) fn start(&mut self, patch: &[Contact], turn: &Mat3, dt: Real) {
        self.contacts.clear();
        self.contacts.extend(patch.iter().map(|contact| (contact.control_point, contact.area)));
        (self.turn, self.dt) = (*turn, dt);
        self.ends.clear();
        self.columns.clear();
        self.values.clear();
        self.tensors.clear();
    }

    pub(super) fn add_isotropic(&mut self, j: u32, value: Real) {
        self.columns.push(j);
        self.values.push(value);
    }

    pub(super) fn add_tensors(&mut self, row: &[Mat3]) {
        self.tensors.extend_from_slice(row);
    }

    pub(super) fn end_row(&mut self) {
        self.ends.push(self.columns.len() as u32);
    }

    /// Hands row `i` to the operator; `first` is the number of the patch's first contact in the whole problem.
    pub(super) fn push_row(&self, w: &mut MatrixFree, i: usize, first: usize) {
        let start = if i == 0 { 0 } else { self.ends[i - 1] as usize };
        let range = start..self.ends[i] as usize;
        for (j, value) in self.columns[range.clone()].iter().zip(&self.values[range]) {
            w.push_isotropic(first + *j as usize, *value);
        }
        if !self.tensors.is_empty() {
            let count = self.contacts.len();
            for (j, block) in self.tensors[i * count..(i + 1) * count].iter().enumerate() {
                w.push_tensor(first + j, block);
            }
        }
    }
}
