//! `W_deform = sum over surfaces of H C H^T` of one patch, row by row (design 3.3, paper
//! eqs. 7 to 9 and 13). `H` and `C` are defined in [`super::elastic_operator`].
//!
//! `H` is the identity on the side `a` that carries the control points. On side `b` it interpolates from
//! its control points (eq. 8): contact `i` gives weights `h_ik`, its force goes to them by the same
//! weights, so the compliance between contacts `i` and `j` is `sum_kl h_ik C_kl h_jl`.
//!
//! An elastic continuum (half-space or layer) on side `b` needs no interpolation, its Green's function holds between
//! any two places: `H` is the identity there too, with the feet of the contacts in place of control points.
//! Interpolated from the coarser side, `W` would be nearly singular: pressure in jags, and a sphere on a flat 4 % too
//! stiff.

use super::ElasticRows;
use super::elastic_operator::{Node, Side, SideOperator};
use crate::math::{Mat3, Real};
use crate::pair::Contact;
use crate::surface::{Compliance, Loaded};
use std::cmp::Ordering;
use std::ops::Range;

const NONE: u32 = u32::MAX;

/// The transpose of `H` of either side, and the row being summed.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    nodes: [Nodes; 2],
    /// The isotropic part of the row: value of each contact, and which are not zero.
    row: Vec<Real>,
    touched: Vec<u32>,
    tensor: Vec<Mat3>,
}

/// The nodes of one side.
#[derive(Debug, Default)]
struct Nodes {
    /// Control points in use, and where each is in that list.
    used: Vec<u32>,
    place: Vec<u32>,
    /// For each used control point its contacts: (contact, weight), flat.
    starts: Vec<u32>,
    contacts: Vec<(u32, Real)>,
    /// Row of `C` under way: value of each used control point, and which are not zero.
    sum: Vec<Real>,
    touched: Vec<u32>,
    /// Where they are, if the side is an elastic continuum, frame of its link.
    places: Vec<Loaded>,
}

impl Scratch {
    /// Fills the rows of a patch. `rotation_ab`: rotation from the link of `b` to that of `a`, whose axes
    /// are the elastic axes of the patch; `to_link_b`: from the world to the link of `b`; `keeps_a`: whether the tensors of side `a` are there.
    pub fn fill_rows(
        &mut self,
        rows: &mut ElasticRows,
        keeps_a: bool,
        patch: &[Contact],
        sides: &[SideOperator<'_>; 2],
        rotation_ab: &Mat3,
        to_link_b: &Mat3,
    ) {
        for (nodes, side) in self.nodes.iter_mut().zip(sides) {
            nodes.index(patch, side);
            nodes.places.clear();
            if matches!(side.skin.compliance, Compliance::GreensFunction(_)) && !nodes.used.is_empty() {
                nodes.places.extend(patch.iter().map(|contact| side.loaded_node(contact, to_link_b)));
            }
        }
        resize_at_least(&mut self.row, patch.len(), 0.0);
        self.touched.clear();
        self.tensor.clear();
        self.tensor.resize(patch.len(), Mat3::zeros());
        for i in 0..patch.len() {
            self.fill_row(rows, keeps_a, i, patch, sides, rotation_ab);
        }
        self.nodes.iter_mut().for_each(Nodes::forget);
    }

    fn fill_row(
        &mut self,
        rows: &mut ElasticRows,
        keeps_a: bool,
        i: usize,
        patch: &[Contact],
        sides: &[SideOperator<'_>; 2],
        rotation_ab: &Mat3,
    ) {
        let Self { nodes, row, touched, tensor } = self;
        let mut add = |j: u32, value: Real| {
            if row[j as usize] == 0.0 {
                touched.push(j);
            }
            row[j as usize] += value;
        };
        for (index, (nodes, side)) in nodes.iter_mut().zip(sides).enumerate() {
            if nodes.used.is_empty() || (keeps_a && side.side == Side::A) {
                continue;
            }
            let rotated =
                |block: Mat3| if side.side == Side::A { block } else { rotation_ab * block * rotation_ab.transpose() } * side.share();
            match &side.skin.compliance {
                Compliance::Local(local) if side.side == Side::A && !local.is_isotropic() => {
                    let Contact { control_point, area, .. } = patch[i];
                    side.local_row(local, control_point as usize, area, |l, value| {
                        for &(j, _) in nodes.contacts_at(l) {
                            rows.add_axial(j, value * side.share());
                        }
                    });
                }
                Compliance::Local(local) if !local.is_isotropic() => {
                    let block = |k: Node, l: usize| side.local_block(local, k.control_point, l, k.area) * k.weight;
                    nodes.interpolate(tensor, |l| rotated(side.nodes(&patch[i]).map(|k| block(k, l)).sum()));
                    rows.add_tensors(index, tensor);
                }
                Compliance::Local(local) => {
                    for k in side.nodes(&patch[i]) {
                        side.local_row(local, k.control_point, k.area, |l, value| nodes.add(l, k.weight * side.share() * value.normal));
                    }
                    for t in 0..nodes.touched.len() {
                        let place = nodes.touched[t] as usize;
                        let value = std::mem::take(&mut nodes.sum[place]);
                        nodes.contacts[nodes.contacts_of(place)].iter().for_each(|&(j, weight)| add(j, value * weight));
                    }
                    nodes.touched.clear();
                }
                Compliance::GreensFunction(greens_function) => {
                    let own = &nodes.places[i];
                    for (j, other) in nodes.places.iter().enumerate() {
                        // The operator is reciprocal: what lies left of the diagonal is known.
                        tensor[j] = match j.cmp(&i) {
                            Ordering::Less => rows.mirrored(index, i, j),
                            Ordering::Equal => {
                                let whole = Loaded { area: patch[i].area, ..*own };
                                rotated(greens_function.self_block(&whole, patch[i].inverse_distance(sides[0].skin)))
                            }
                            Ordering::Greater => rotated(greens_function.block_between(own, other)),
                        };
                    }
                    rows.add_tensors(index, tensor);
                }
                Compliance::Matrix(matrix) => {
                    let block = |k: Node, l: usize| side.matrix_block(matrix, k.control_point, l, k.area) * k.weight;
                    nodes.interpolate(tensor, |l| rotated(side.nodes(&patch[i]).map(|k| block(k, l)).sum()));
                    rows.add_tensors(index, tensor);
                }
            }
        }
        touched.sort_unstable();
        for &j in touched.iter() {
            rows.add_isotropic(j, std::mem::take(&mut row[j as usize]));
        }
        touched.clear();
        rows.end_row();
    }
}

impl Nodes {
    /// For each control point its contacts, by counting.
    fn index(&mut self, patch: &[Contact], side: &SideOperator<'_>) {
        resize_at_least(&mut self.place, side.skin.surface.control.len(), NONE);
        self.used.clear();
        self.starts.clear();
        for k in patch.iter().flat_map(|contact| side.nodes(contact)).map(|node| node.control_point) {
            if self.place[k] == NONE {
                self.place[k] = self.used.len() as u32;
                self.used.push(k as u32);
                self.starts.push(0);
            }
            self.starts[self.place[k] as usize] += 1;
        }
        let mut total = 0;
        for start in &mut self.starts {
            (*start, total) = (total, total + *start);
        }
        self.contacts.clear();
        self.contacts.resize(total as usize, (0, 0.0));
        for (i, contact) in patch.iter().enumerate() {
            for node in side.nodes(contact) {
                let start = &mut self.starts[self.place[node.control_point] as usize];
                self.contacts[*start as usize] = (i as u32, node.weight);
                *start += 1;
            }
        }
        // The starts have moved to the ends: shift them back.
        self.starts.insert(0, 0);
        resize_at_least(&mut self.sum, self.used.len(), 0.0);
        self.touched.clear();
    }

    fn contacts_of(&self, place: usize) -> Range<usize> {
        self.starts[place] as usize..self.starts[place + 1] as usize
    }

    /// Contacts of a control point, with their weights; none of one that has none.
    fn contacts_at(&self, control_point: usize) -> &[(u32, Real)] {
        let place = self.place[control_point];
        if place == NONE { &[] } else { &self.contacts[self.contacts_of(place as usize)] }
    }

    /// `row_j = sum over control points l of block(l) h_jl`.
    fn interpolate(&self, row: &mut [Mat3], block: impl Fn(usize) -> Mat3) {
        row.fill(Mat3::zeros());
        for (place, &l) in self.used.iter().enumerate() {
            let moved = block(l as usize);
            for &(j, weight) in &self.contacts[self.contacts_of(place)] {
                row[j as usize] += moved * weight;
            }
        }
    }

    /// Adds to the row of `C` under way, if the control point is that of any contact.
    #[inline]
    fn add(&mut self, control_point: usize, value: Real) {
        let place = self.place[control_point];
        if place != NONE {
            if self.sum[place as usize] == 0.0 {
                self.touched.push(place);
            }
            self.sum[place as usize] += value;
        }
    }

    fn forget(&mut self) {
        for &k in &self.used {
            self.place[k as usize] = NONE;
        }
    }
}

fn resize_at_least<T: Copy>(values: &mut Vec<T>, len: usize, fill: T) {
    if values.len() < len {
        values.resize(len, fill);
    }
}
