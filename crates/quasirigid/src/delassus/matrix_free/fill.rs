//! Filling the operator, contact by contact; and taking contacts out of it.
//!
//! [`MatrixFree::clear`], then for each contact [`MatrixFree::push_contact`] followed by the entries of its elastic
//! row ([`MatrixFree::push_isotropic`], [`MatrixFree::push_axial`], [`MatrixFree::push_tensor`]), then [`MatrixFree::finish`]. The memory is kept
//! from one step to the next.

use super::{Contact, MatrixFree, NO_BODY, Rows};
use crate::delassus::{ContactBlock, Delassus};
use crate::math::{Mat3, Mat3x6, Real, Vec3};

impl MatrixFree {
    /// Forgets all contacts but keeps their elastic rows: for the same contacts in the same
    /// order, given by [`MatrixFree::push_contact`] alone, whose rigid part is new.
    pub fn clear_rigid(&mut self, bodies: usize) {
        self.contacts.clear();
        self.blocks.clear();
        self.bodies.clear();
        self.bodies.resize(bodies, [0.0; 6]);
        self.forces.clear();
        self.split_forces.clear();
        self.drags.clear();
        self.rows_kept = true;
    }

    /// Forgets all contacts and keeps the memory. `bodies` is the number of body slots that the contacts will use.
    pub fn clear(&mut self, bodies: usize) {
        self.clear_rigid(bodies);
        self.rows_kept = false;
        self.isotropic_starts.clear();
        self.isotropic_columns.clear();
        self.isotropic_values.clear();
        self.axial_starts.clear();
        self.axial_columns.clear();
        self.axial_values.clear();
        self.tensor_starts.clear();
        self.tensor_columns.clear();
        self.tensor_values.clear();
    }

    /// Adds a contact between body slots `a` and `b` ([`NO_BODY`] for a side that does not move).
    ///
    /// `ja`, `jb`: `J S` of each side in the contact frame, with the sign that makes `ja y_a + jb y_b` the relative displacement (m).
    /// `axes`: from the contact frame to the elastic axes of the patch, a rotation (with a
    /// column scaled where friction is anisotropic); any if there is no elastic row.
    pub fn push_contact(&mut self, a: u32, ja: &Mat3x6, b: u32, jb: &Mat3x6, axes: &Mat3) {
        if !self.rows_kept {
            self.isotropic_starts.push(self.isotropic_columns.len() as u32);
            self.axial_starts.push(self.axial_columns.len() as u32);
            self.tensor_starts.push(self.tensor_columns.len() as u32);
        }
        self.contacts.push(Contact { a, b, ja: rows(ja), jb: rows(jb), axes: *axes, normal: Vec3::x() });
    }

    /// Gives the contact pushed last the unit normal of its surface in elastic axes, for [`MatrixFree::push_axial`].
    pub fn set_normal(&mut self, normal: &Vec3) {
        if let Some(last) = self.contacts.last_mut() {
            last.normal = *normal;
        }
    }

    /// Gives the contact pushed last a viscous drag, N/m; see [`ContactBlock::set_drag`].
    pub fn set_drag(&mut self, drag: Real) {
        if let Some(last) = self.contacts.len().checked_sub(1) {
            self.drags.push((last as u32, drag));
        }
    }

    /// Entry of the row of the contact pushed last: `g` (m/N) times the force of contact `j`, the same in all directions.
    #[inline]
    pub fn push_isotropic(&mut self, j: usize, g: Real) {
        self.isotropic_columns.push(j as u32);
        self.isotropic_values.push(g);
    }

    /// Entry of the row of the contact pushed last: `t P_i P_j + n m_i m_j^T` times the force of contact `j`, with `m` the normals of
    /// [`MatrixFree::set_normal`] and `P = I - m m^T`. `t`, `n`: compliance across the normals and along them, m/N.
    #[inline]
    pub fn push_axial(&mut self, j: usize, [t, n]: [Real; 2]) {
        self.axial_columns.push(j as u32);
        self.axial_values.push([t, n]);
    }

    /// Entry of the row of the contact pushed last: `k` (m/N, in elastic axes) times the force of contact `j`.
    #[inline]
    pub fn push_tensor(&mut self, j: usize, k: &Mat3) {
        self.tensor_columns.push(j as u32);
        self.tensor_values.push(*k);
    }

    /// Prepares the diagonal blocks and sets all reactions to zero.
    ///
    /// # Errors
    /// The first contact that cannot be solved: its block is not finite and positive
    /// definite, or it names a body or a contact that does not exist.
    pub fn finish(&mut self) -> Result<(), usize> {
        let n = self.contacts.len();
        if self.isotropic_starts.len() != n {
            return Err(self.isotropic_starts.len().min(n.saturating_sub(1)));
        }
        self.blocks.clear();
        for forces in [&mut self.forces, &mut self.split_forces] {
            forces.clear();
            forces.resize(n, [0.0; 4]);
        }
        for body in &mut self.bodies {
            *body = [0.0; 6];
        }
        for i in 0..n {
            let block = self.sound_block(i).ok_or(i)?;
            self.blocks.push(block);
        }
        for &(i, drag) in &self.drags {
            self.blocks[i as usize].set_drag(drag);
        }
        Ok(())
    }

    /// Takes out the contacts for which `keep` is false, with their reactions; all reactions of a patch
    /// go or stay. What others do stays the same bits, but at bodies that lose a reaction.
    pub(crate) fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let n = self.contacts.len();
        let mut places = vec![0; n];
        let mut left = 0;
        for (i, place) in places.iter_mut().enumerate() {
            *place = left;
            left += u32::from(keep(i));
        }
        for i in (0..n).filter(|&i| !keep(i)) {
            let [x, y, z, _] = self.forces[i];
            // With axes that are stretched where friction has a direction the inverse is no transpose.
            let force = self.contacts[i].axes.try_inverse().map_or_else(Vec3::zeros, |inverse| inverse * Vec3::new(x, y, z));
            self.add_reaction(i, &-force);
        }
        let mut rows = Self { bodies: std::mem::take(&mut self.bodies), ..Self::default() };
        for i in (0..n).filter(|&i| keep(i)) {
            rows.isotropic_starts.push(rows.isotropic_columns.len() as u32);
            let (columns, values) = self.isotropic_row(i);
            for (&j, g) in columns.iter().zip(values).filter(|(j, _)| keep(**j as usize)) {
                rows.push_isotropic(places[j as usize] as usize, *g);
            }
            rows.axial_starts.push(rows.axial_columns.len() as u32);
            let (columns, values) = self.axial_row(i);
            for (&j, value) in columns.iter().zip(values).filter(|(j, _)| keep(**j as usize)) {
                rows.push_axial(places[j as usize] as usize, *value);
            }
            rows.tensor_starts.push(rows.tensor_columns.len() as u32);
            let (columns, values) = self.tensor_row(i);
            for (&j, k) in columns.iter().zip(values).filter(|(j, _)| keep(**j as usize)) {
                rows.push_tensor(places[j as usize] as usize, k);
            }
            rows.contacts.push(self.contacts[i].clone());
            rows.forces.push(self.forces[i]);
            rows.split_forces.push(self.split_forces[i]);
            rows.blocks.extend(self.blocks.get(i).cloned());
        }
        let drags = self.drags.iter().filter(|(i, _)| keep(*i as usize));
        rows.drags.extend(drags.map(|&(i, drag)| (places[i as usize], drag)));
        *self = rows;
    }

    /// Whether contact `i` can be solved, with whatever others: whether [`MatrixFree::finish`] would not refuse it.
    pub(crate) fn is_well_posed(&self, i: usize) -> bool {
        self.sound_block(i).is_some()
    }

    /// The diagonal block of contact `i`, if it can be solved.
    fn sound_block(&self, i: usize) -> Option<ContactBlock> {
        let contact = &self.contacts[i];
        let bodies_exist = [contact.a, contact.b].iter().all(|&slot| slot == NO_BODY || (slot as usize) < self.bodies.len());
        if bodies_exist && (self.rows_kept || self.row_is_sound(i)) { ContactBlock::new(&self.block(i, i)) } else { None }
    }

    /// Whether the elastic row of contact `i` is finite and names contacts that exist.
    fn row_is_sound(&self, i: usize) -> bool {
        let (isotropic, axial, tensor) = (self.isotropic_row(i), self.axial_row(i), self.tensor_row(i));
        let columns_exist = isotropic.0.iter().chain(axial.0).chain(tensor.0).all(|&j| (j as usize) < self.contacts.len());
        let mut entries = isotropic.1.iter().chain(axial.1.iter().flatten()).chain(tensor.1.iter().flat_map(|k| k.iter()));
        columns_exist && entries.all(|x| x.is_finite())
    }
}

fn rows(j: &Mat3x6) -> Rows {
    std::array::from_fn(|r| std::array::from_fn(|k| j[(r, k)]))
}
