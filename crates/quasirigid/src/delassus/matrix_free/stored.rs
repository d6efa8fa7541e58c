//! What is refused of an operator that is read.

use super::{MatrixFree, NO_BODY};

impl MatrixFree {
    /// Refuses an operator whose parts do not fit together, or that is for another number of `contacts`.
    pub(crate) fn check(&self, contacts: usize) -> Result<(), String> {
        let starts = [&self.isotropic_starts, &self.axial_starts, &self.tensor_starts];
        let [isotropic, axial, tensor] = starts.map(Vec::len);
        let forces = [self.forces.len(), self.split_forces.len()];
        let lengths = [self.contacts.len(), self.blocks.len(), forces[0], forces[1], isotropic, axial, tensor];
        if lengths != [contacts; 7] {
            return Err(format!("an operator with {lengths:?} parts of {contacts} contacts"));
        }
        let slots = self.contacts.iter().flat_map(|contact| [contact.a, contact.b]);
        if slots.filter(|&slot| slot != NO_BODY).any(|slot| slot as usize >= self.bodies.len()) {
            return Err("a contact of a body that is not there".into());
        }
        let rise = |starts: &[u32], end: usize| {
            starts.is_sorted() && starts.first().is_none_or(|&first| first == 0) && starts.last().is_none_or(|&last| last as usize <= end)
        };
        let columns = [&self.isotropic_columns, &self.axial_columns, &self.tensor_columns];
        let values = [self.isotropic_values.len(), self.axial_values.len(), self.tensor_values.len()];
        if columns.map(Vec::len) != values || !starts.iter().zip(values).all(|(starts, end)| rise(starts, end)) {
            return Err("elastic rows that do not fit together".into());
        }
        if columns.into_iter().flatten().any(|&j| j as usize >= contacts) {
            return Err("an elastic row with a contact that is not there".into());
        }
        if self.drags.iter().any(|&(i, _)| i as usize >= contacts) {
            return Err("a drag of a contact that is not there".into());
        }
        Ok(())
    }
}
