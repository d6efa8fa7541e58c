//! `W_deform = sum over surfaces of H C H^T` of one patch, row by row (design 3.3, paper eqs. 7 to 9 and 13).
//!
//! `H` is the identity on the side `a` that carries the control points. On side `b` it interpolates from its control points (eq. 8): contact `i` gives
//! weights `h_ik`, its force goes to them by the same weights, so the compliance between contacts `i` and `j` is `sum_kl h_ik C_kl h_jl`.
//!
//! A half-space on side `b` needs no interpolation, its Green's function holds between any two places: `H` is the identity there too, with the feet of the contacts in
//! place of control points. Interpolated from the coarser side, `W` would be nearly singular: pressure in jags, and a sphere on a flat 4 % too stiff.

use super::ElasticRows;
use crate::body::Skin;
use crate::collision::Contact;
use crate::math::{Mat3, Real};
use crate::surface::{Compliance, Loaded};
use std::cmp::Ordering;

const NONE: u32 = u32::MAX;

/// Maps between contacts and control points of one patch, and the row being summed.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// `C = K^-1 (1 - alpha)`: shares of the static compliance over this step.
    share_a: Real,
    share_b: Real,
    /// Contact of each control point of `a`, counted within the patch.
    contact_of_a: Vec<u32>,
    /// Control points of `b` in use, and where each is in that list.
    used_b: Vec<u32>,
    place_of_b: Vec<u32>,
    /// For each used control point of `b` its contacts: (contact, weight), flat.
    starts_b: Vec<u32>,
    contacts_b: Vec<(u32, Real)>,
    /// Half-space on side `b`: the feet, frame of the link of `b`, and the rotation from there to the elastic axes.
    feet: Vec<Loaded>,
    turn: Mat3,
    sum_b: Vec<Real>,
    touched_b: Vec<u32>,
    /// The row: isotropic value of each contact, and which are not zero.
    row: Vec<Real>,
    touched: Vec<u32>,
    tensor: Vec<Mat3>,
}

impl Scratch {
    /// Fills the rows of a patch. `turn`: rotation from the link of `b` to that of `a`, whose axes are the elastic axes of the patch; `to_link_b`: from the world
    /// to the link of `b`; `shares`: `1 - alpha` of either side.
    pub fn fill_rows(
        &mut self,
        rows: &mut ElasticRows,
        patch: &[Contact],
        skins: [&Skin; 2],
        turn: &Mat3,
        to_link_b: &Mat3,
        shares: [Real; 2],
    ) {
        [self.share_a, self.share_b] = shares;
        self.prepare(patch, skins, turn, to_link_b);
        for i in 0..patch.len() {
            self.fill_row(rows, i, patch, skins);
        }
        for contact in patch {
            self.contact_of_a[contact.control_point as usize] = NONE;
        }
        for &k in &self.used_b {
            self.place_of_b[k as usize] = NONE;
        }
    }

    /// Indexes the contacts of a patch.
    fn prepare(&mut self, patch: &[Contact], [skin_a, skin_b]: [&Skin; 2], turn: &Mat3, to_link_b: &Mat3) {
        resize_at_least(&mut self.contact_of_a, skin_a.surface.control.len(), NONE);
        resize_at_least(&mut self.place_of_b, skin_b.surface.control.len(), NONE);
        for (i, contact) in patch.iter().enumerate() {
            self.contact_of_a[contact.control_point as usize] = i as u32;
        }
        self.index_b(patch);
        resize_at_least(&mut self.row, patch.len(), 0.0);
        resize_at_least(&mut self.sum_b, self.used_b.len(), 0.0);
        self.touched.clear();
        self.touched_b.clear();
        self.feet.clear();
        self.feet.extend(patch.iter().map(|contact| contact.foot_on_b(to_link_b)));
        self.turn = *turn;
        self.tensor.clear();
        self.tensor.resize(patch.len(), Mat3::zeros());
    }

    /// For each control point of `b` its contacts, by counting.
    fn index_b(&mut self, patch: &[Contact]) {
        self.used_b.clear();
        self.starts_b.clear();
        for contact in patch {
            for (k, _) in contact.weights_b.iter() {
                if self.place_of_b[k] == NONE {
                    self.place_of_b[k] = self.used_b.len() as u32;
                    self.used_b.push(k as u32);
                    self.starts_b.push(0);
                }
                self.starts_b[self.place_of_b[k] as usize] += 1;
            }
        }
        let mut total = 0;
        for start in &mut self.starts_b {
            (*start, total) = (total, total + *start);
        }
        self.contacts_b.clear();
        self.contacts_b.resize(total as usize, (0, 0.0));
        for (i, contact) in patch.iter().enumerate() {
            for (k, weight) in contact.weights_b.iter() {
                let start = &mut self.starts_b[self.place_of_b[k] as usize];
                self.contacts_b[*start as usize] = (i as u32, weight);
                *start += 1;
            }
        }
        // The starts have moved to the ends: shift them back.
        self.starts_b.insert(0, 0);
    }

    fn contacts_of_b(&self, place: usize) -> std::ops::Range<usize> {
        self.starts_b[place] as usize..self.starts_b[place + 1] as usize
    }

    fn fill_row(&mut self, rows: &mut ElasticRows, i: usize, patch: &[Contact], [skin_a, skin_b]: [&Skin; 2]) {
        let control_point = patch[i].control_point as usize;
        match &skin_a.compliance {
            Compliance::Local(local) => {
                for e in local.neighbours.range(control_point) {
                    let j = self.contact_of_a[local.neighbours.index[e] as usize];
                    if j != NONE {
                        self.add(j, self.share_a * local.values[e]);
                    }
                }
                let change = local.change_for_area(&skin_a.surface.control, control_point, patch[i].area);
                if change != 0.0 {
                    self.add(i as u32, self.share_a * change);
                }
            }
            Compliance::HalfSpace(half_space) => {
                let control = &skin_a.surface.control;
                for (j, other) in patch.iter().enumerate() {
                    // A half-space is reciprocal: what lies left of the diagonal is known.
                    self.tensor[j] = match j.cmp(&i) {
                        Ordering::Less => rows.mirrored(0, i, j),
                        Ordering::Equal => {
                            half_space.self_block(&control.normals[control_point], patch[i].inverse_distance(skin_a)) * self.share_a
                        }
                        Ordering::Greater => half_space.block(control, control_point, other.control_point as usize) * self.share_a,
                    };
                }
                rows.add_tensors(0, &self.tensor);
            }
            Compliance::Matrix(matrix) => {
                for (j, other) in patch.iter().enumerate() {
                    self.tensor[j] = matrix.block(control_point, other.control_point as usize) * self.share_a;
                }
                self.tensor[i] = matrix.self_block(&skin_a.surface.tree, control_point, patch[i].area) * self.share_a;
                rows.add_tensors(0, &self.tensor);
            }
        }
        match &skin_b.compliance {
            Compliance::Local(local) => {
                for (k, weight) in patch[i].weights_b.iter() {
                    for e in local.neighbours.range(k) {
                        let place = self.place_of_b[local.neighbours.index[e] as usize];
                        if place != NONE {
                            if self.sum_b[place as usize] == 0.0 {
                                self.touched_b.push(place);
                            }
                            self.sum_b[place as usize] += weight * self.share_b * local.values[e];
                        }
                    }
                }
                for t in 0..self.touched_b.len() {
                    let place = self.touched_b[t] as usize;
                    let value = std::mem::take(&mut self.sum_b[place]);
                    for c in self.contacts_of_b(place) {
                        let (j, weight) = self.contacts_b[c];
                        self.add(j, value * weight);
                    }
                }
                self.touched_b.clear();
            }
            Compliance::HalfSpace(_) | Compliance::Matrix(_) if self.used_b.is_empty() => {}
            Compliance::HalfSpace(half_space) => {
                let foot = &self.feet[i];
                for (j, other) in self.feet.iter().enumerate() {
                    let turned = |block: Mat3| self.turn * block * self.turn.transpose() * self.share_b;
                    self.tensor[j] = match j.cmp(&i) {
                        Ordering::Less => rows.mirrored(1, i, j),
                        Ordering::Equal => turned(half_space.self_block(&foot.normal, patch[i].inverse_distance(skin_a))),
                        Ordering::Greater => turned(half_space.block_between(foot, other)),
                    };
                }
                rows.add_tensors(1, &self.tensor);
            }
            Compliance::Matrix(matrix) => {
                self.tensor.fill(Mat3::zeros());
                for (place, &l) in self.used_b.iter().enumerate() {
                    let moved: Mat3 = patch[i].weights_b.iter().map(|(k, weight)| matrix.block(k, l as usize) * weight).sum();
                    let moved = self.turn * moved * self.turn.transpose() * self.share_b;
                    for &(j, weight) in &self.contacts_b[self.contacts_of_b(place)] {
                        self.tensor[j as usize] += moved * weight;
                    }
                }
                rows.add_tensors(1, &self.tensor);
            }
        }
        self.touched.sort_unstable();
        for &j in &self.touched {
            rows.add_isotropic(j, std::mem::take(&mut self.row[j as usize]));
        }
        self.touched.clear();
        rows.end_row();
    }

    fn add(&mut self, j: u32, value: Real) {
        if self.row[j as usize] == 0.0 {
            self.touched.push(j);
        }
        self.row[j as usize] += value;
    }
}

fn resize_at_least<T: Copy>(values: &mut Vec<T>, len: usize, fill: T) {
    if values.len() < len {
        values.resize(len, fill);
    }
}
