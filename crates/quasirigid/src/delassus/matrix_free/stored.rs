//! What is refused of an operator that is read.

use super::{MatrixFree, NO_BODY};

impl MatrixFree {
    /// Refuses an operator whose parts do not fit together, or that is for another number of `contacts`.
    pub(crate) fn check(&self, contacts: usize) -> Result<(), String> {
        let lengths = [self.contacts.len(), self.blocks.len(), self.forces.len(), self.isotropic_starts.len(), self.tensor_starts.len()];
        if lengths != [contacts; 5] {
            return Err(format!("an operator with {lengths:?} parts of {contacts} contacts"));
        }
        let slots = self.contacts.iter().flat_map(|contact| [contact.a, contact.b]);
        if slots.filter(|&slot| slot != NO_BODY).any(|slot| slot as usize >= self.bodies.len()) {
            return Err("a contact of a body that is not there".into());
        }
        let rise = |starts: &[u32], end: usize| {
            starts.is_sorted() && starts.first().is_none_or(|&first| first == 0) && starts.last().is_none_or(|&last| last as usize <= end)
        };
        let isotropic = (self.isotropic_columns.len(), self.isotropic_values.len());
        let tensor = (self.tensor_columns.len(), self.tensor_values.len());
        if isotropic.0 != isotropic.1
            || tensor.0 != tensor.1
            || !rise(&self.isotropic_starts, isotropic.0)
            || !rise(&self.tensor_starts, tensor.0)
        {
            return Err("elastic rows that do not fit together".into());
        }
        if self.isotropic_columns.iter().chain(&self.tensor_columns).any(|&j| j as usize >= contacts) {
            return Err("an elastic row with a contact that is not there".into());
        }
        if self.drags.iter().any(|&(i, _)| i as usize >= contacts) {
            return Err("a drag of a contact that is not there".into());
        }
        Ok(())
    }
}
