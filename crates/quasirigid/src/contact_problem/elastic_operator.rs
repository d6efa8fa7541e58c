//! The elastic operator of one side of a patch, written once: the rows that the solver sees ([`super::elastic`])
//! and the displacement after the solve ([`crate::constrained_motion`]) are both made of what is here. If they
//! differed, every step would leave the difference behind, and a held object would creep.
//!
//! ```text
//!     u = alpha u_previous + C H^T f        displacement of the nodes, m
//!     delta = H u                           displacement at the contacts, m        W_deform = H C H^T
//! ```
//!
//! `f`: reactions on this side, N; `C = K^-1 (1 - alpha)`: compliance over the step between the nodes, m/N; `H`:
//! contacts from nodes (paper eq. 8). Nodes are control points. An elastic continuum (half-space or layer) on side
//! `b` is the exception: its nodes are the feet of the contacts, see [`super::elastic`].

use crate::collider::Skin;
use crate::math::{Mat3, Real, Vec3};
use crate::pair::Contact;
use crate::surface::{AxialCompliance, ComplianceMatrix, Loaded, LocalCompliance};

/// Which of the two surfaces of a pair: `a` carries the control points of the contacts, `b` is what they are projected on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Side {
    A,
    B,
}

/// A control point that a contact's force goes to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    pub control_point: usize,
    /// Its entry of `H`, -.
    pub weight: Real,
    /// Area that its own compliance is for, m^2: that of the contact on `a`, which is
    /// larger than the control point's where a traversal stopped early.
    pub area: Real,
}

/// One side of a patch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SideOperator<'a> {
    pub skin: &'a Skin,
    pub side: Side,
    /// Share of the displacement that is left after the step without force, -.
    pub alpha: Real,
}

impl<'a> SideOperator<'a> {
    /// `skins`: of `a` and `b`; `dt`: time step, s.
    pub fn of(skins: [&'a Skin; 2], dt: Real) -> [Self; 2] {
        let [a, b] = skins;
        [(a, Side::A), (b, Side::B)].map(|(skin, side)| Self { skin, side, alpha: skin.memory(dt) })
    }

    /// `1 - alpha`: share of the static compliance over the step.
    pub fn share(&self) -> Real {
        1.0 - self.alpha
    }

    /// The row of `H` of a contact. None on a side that counts as rigid.
    #[inline]
    pub fn nodes<'c>(&'c self, contact: &'c Contact) -> impl Iterator<Item = Node> + 'c {
        let count = if self.side == Side::A { 1 } else { contact.weights_b.len };
        (0..count).map(move |k| match self.side {
            Side::A => Node { control_point: contact.control_point as usize, weight: 1.0, area: contact.area },
            Side::B => {
                let control_point = contact.weights_b.index[k] as usize;
                Node { control_point, weight: contact.weights_b.weight[k], area: self.skin.surface.control.areas[control_point] }
            }
        })
    }

    /// Row `k` of the static compliance of a local model (m/N): `add` gets control points and entries, `k`
    /// itself twice where `area` is not its own. The row is the column, too: `C` is symmetric.
    #[inline]
    pub fn local_row(&self, local: &LocalCompliance, k: usize, area: Real, mut add: impl FnMut(usize, AxialCompliance)) {
        for e in local.neighbours.range(k) {
            add(local.neighbours.index[e] as usize, local.values[e]);
        }
        if area != self.skin.surface.control.areas[k] {
            add(k, local.change_for_area(&self.skin.surface.control, k, area));
        }
    }

    /// Block of the static compliance of a local model between the control points `k` and `l`, m/N; `area`: of node `k`.
    #[inline]
    pub fn local_block(&self, local: &LocalCompliance, k: usize, l: usize, area: Real) -> Mat3 {
        let control = &self.skin.surface.control;
        let own = if k == l && area != control.areas[k] { local.change_for_area(control, k, area) } else { AxialCompliance::default() };
        (local.value(k, l) + own).block(&control.normals[k], &control.normals[l])
    }

    /// Block of the static compliance of a matrix between the control points `k` and `l`, m/N; `area`: of node `k`.
    #[inline]
    pub fn matrix_block(&self, matrix: &ComplianceMatrix, k: usize, l: usize, area: Real) -> Mat3 {
        if k == l && area != self.skin.surface.control.areas[k] {
            return matrix.self_block(&self.skin.surface.tree, k, area);
        }
        *matrix.block(k, l)
    }

    /// The node of a contact on an elastic continuum, frame of the link. `to_link_b`: rotation from the world to the link of `b`.
    pub fn loaded_node(&self, contact: &Contact, to_link_b: &Mat3) -> Loaded {
        let (control, c) = (&self.skin.surface.control, contact.control_point as usize);
        match self.side {
            Side::A => Loaded { point: control.points[c], normal: control.normals[c], area: control.areas[c] },
            Side::B => contact.foot_on_b(to_link_b),
        }
    }

    /// The reaction on this side of a contact, world axes, N. `reaction`: on `a`, contact frame.
    #[inline]
    pub fn force(&self, contact: &Contact, reaction: &Vec3) -> Vec3 {
        let force = contact.frame * reaction;
        if self.side == Side::A { force } else { -force }
    }
}
