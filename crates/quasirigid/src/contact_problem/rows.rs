//! Elastic rows of one patch, kept from step to step while its contacts stay the same: the
//! paper expects "substantial speedups by reusing parts of the computation".

use crate::delassus::MatrixFree;
use crate::math::{Mat3, Real};
use crate::pair::Contact;
use crate::surface::AxialCompliance;
use serde::{Deserialize, Serialize};

/// Rows are kept while the two bodies have rotated against each other by less than this, rad. The operator of the solver and that of
/// [`crate::constrained_motion`] must be the same: a difference is a creep, here below 1e-13 m in a step.
const SAME_ROTATION: Real = 1e-10;

/// What the elastic rows of a pair are made of, but for its contacts: the two colliders, and which compliance either has.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Origin {
    /// Slots of the colliders `a` and `b`.
    pub colliders: (u32, u32),
    /// [`crate::collider::Skin::compliance_revision`] of either.
    pub revisions: [u64; 2],
    /// Whether `b` counts as rigid.
    pub rigid_b: bool,
}

/// The elastic part of `W` over the contacts of one pair, in the axes of the link of `a`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct ElasticRows {
    pub(super) origin: Origin,
    /// Whether the two touched in this step.
    #[serde(skip)]
    pub(super) in_touch: bool,
    pub(super) contacts: Vec<(u32, Real)>,
    rotation_ab: Mat3,
    /// `1 - alpha` of either side: what the rows are of the static compliance.
    shares: [Real; 2],
    /// Ends of the rows in `columns`.
    pub(super) ends: Vec<u32>,
    pub(super) columns: Vec<u32>,
    pub(super) values: Vec<Real>,
    /// Ends of the rows in `axial_columns`: entries of side `a` that differ along the normals and across them.
    pub(super) axial_ends: Vec<u32>,
    pub(super) axial_columns: Vec<u32>,
    pub(super) axial_values: Vec<AxialCompliance>,
    /// Tensors of either side, all rows of all contacts, dense, in the axes of the
    /// link of `a`; empty for a side that is isotropic or rigid.
    pub(super) tensors: [Vec<Mat3>; 2],
    /// Changes whenever the rows are filled again.
    #[serde(skip)]
    pub(super) serial: u64,
}

impl ElasticRows {
    /// No rows yet.
    pub(super) fn of(origin: Origin) -> Self {
        Self { origin, ..Self::default() }
    }

    /// Whether the rows are those of `patch`: of the same origin, the same control points with
    /// the same projections and areas, the same shares of the static compliance.
    pub(super) fn hold_for(&self, origin: &Origin, patch: &[Contact], rotation_ab: &Mat3, shares: [Real; 2]) -> bool {
        let same = |(contact, kept): (&Contact, &(u32, Real))| !contact.projected && (contact.control_point, contact.area) == *kept;
        self.origin == *origin
            && self.shares == shares
            && self.contacts.len() == patch.len()
            && self.ends.len() == patch.len()
            && patch.iter().zip(&self.contacts).all(same)
            && (self.tensors.iter().all(Vec::is_empty) || (self.rotation_ab - rotation_ab).amax() < SAME_ROTATION)
    }

    /// Holds for no patch until it is filled again.
    pub(super) fn forget(&mut self) {
        self.contacts.clear();
        self.ends.clear();
    }

    /// Empties the rows, to be filled for `patch`; `serial` is a number that was never used before. The tensors of side `a` stay where they
    /// are those of `patch`: they know nothing of side `b`, nor of the poses, and to fill them is most of the work where the two bodies turn
    /// against each other. Returns whether they do.
    pub(super) fn start(&mut self, origin: Origin, patch: &[Contact], rotation_ab: &Mat3, shares: [Real; 2], serial: u64) -> bool {
        let of_a = |rows: &Origin| (rows.colliders, rows.revisions[0]);
        let same = |(contact, kept): (&Contact, &(u32, Real))| (contact.control_point, contact.area) == *kept;
        let keeps_a = of_a(&self.origin) == of_a(&origin)
            && self.shares[0] == shares[0]
            && self.contacts.len() == patch.len()
            && patch.iter().zip(&self.contacts).all(same)
            && self.tensors[0].len() == patch.len().pow(2);
        (self.origin, self.serial) = (origin, serial);
        self.contacts.clear();
        self.contacts.extend(patch.iter().map(|contact| (contact.control_point, contact.area)));
        (self.rotation_ab, self.shares) = (*rotation_ab, shares);
        self.ends.clear();
        self.columns.clear();
        self.values.clear();
        self.axial_ends.clear();
        self.axial_columns.clear();
        self.axial_values.clear();
        let first = usize::from(keeps_a);
        self.tensors[first..].iter_mut().for_each(Vec::clear);
        keeps_a
    }

    pub(super) fn add_isotropic(&mut self, j: u32, value: Real) {
        self.columns.push(j);
        self.values.push(value);
    }

    pub(super) fn add_axial(&mut self, j: u32, value: AxialCompliance) {
        self.axial_columns.push(j);
        self.axial_values.push(value);
    }

    /// A row of side `a` (0) or `b` (1).
    pub(super) fn add_tensors(&mut self, side: usize, row: &[Mat3]) {
        self.tensors[side].extend_from_slice(row);
    }

    /// Transpose of the block in row `j` and column `i` of a side whose row `j` was added already.
    pub(super) fn mirrored(&self, side: usize, i: usize, j: usize) -> Mat3 {
        self.tensors[side][j * self.contacts.len() + i].transpose()
    }

    /// The number that [`ElasticRows::start`] was given.
    pub(super) fn serial(&self) -> u64 {
        self.serial
    }

    /// Rotation from the link of `b` to that of `a` when the rows were filled.
    pub fn rotation_ab(&self) -> &Mat3 {
        &self.rotation_ab
    }

    /// Row `i` of the compliance over the step of side `a` (0) or `b` (1) between the contacts of the
    /// patch, in the axes of the link of `a`, m/N; `None` if that side is isotropic or rigid.
    pub fn tensor_row(&self, side: usize, i: usize) -> Option<&[Mat3]> {
        let count = self.contacts.len();
        self.tensors[side].get(i * count..(i + 1) * count).filter(|row| !row.is_empty())
    }

    pub(super) fn end_row(&mut self) {
        self.ends.push(self.columns.len() as u32);
        self.axial_ends.push(self.axial_columns.len() as u32);
    }

    /// Hands row `i` to the operator; `first` is the number of the patch's first contact in the whole problem.
    pub(super) fn push_row(&self, w: &mut MatrixFree, i: usize, first: usize) {
        let start = if i == 0 { 0 } else { self.ends[i - 1] as usize };
        let range = start..self.ends[i] as usize;
        for (j, value) in self.columns[range.clone()].iter().zip(&self.values[range]) {
            w.push_isotropic(first + *j as usize, *value);
        }
        let start = if i == 0 { 0 } else { self.axial_ends[i - 1] as usize };
        let range = start..self.axial_ends[i] as usize;
        for (j, value) in self.axial_columns[range.clone()].iter().zip(&self.axial_values[range]) {
            w.push_axial(first + *j as usize, [value.tangential, value.normal]);
        }
        match (self.tensor_row(0, i), self.tensor_row(1, i)) {
            (Some(a), Some(b)) => a.iter().zip(b).enumerate().for_each(|(j, (a, b))| w.push_tensor(first + j, &(a + b))),
            (Some(row), None) | (None, Some(row)) => row.iter().enumerate().for_each(|(j, block)| w.push_tensor(first + j, block)),
            (None, None) => {}
        }
    }
}
