//! What the solver needs to know of the Delassus operator `W` (m/N): a diagonal block, a row, and a place to put a changed reaction.

mod assembled;
mod contact_block;
mod contact_slope;
mod matrix_free;
mod residual;

pub use assembled::Assembled;
pub use contact_block::{ContactBlock, ContactStatus};
pub(crate) use contact_slope::slope;
pub use matrix_free::{MatrixFree, NO_BODY};
pub(crate) use residual::{AsGiven, relative};
pub use residual::{natural_map, natural_map_residual, project_on_cone, residual_as_given};

use crate::math::{Mat3, Vec3};

/// The Delassus operator with the reactions it is applied to. It maps contact forces to relative displacements at the contacts,
/// all in contact frames (normal, tangent1, tangent2).
///
/// The operator holds a copy of the reactions in whatever form makes a row cheap: as they are ([`crate::delassus::Assembled`]),
/// or already summed body by body and turned to the axes of the elastic patches ([`crate::delassus::MatrixFree`]).
pub trait Delassus {
    /// Number of contacts.
    fn len(&self) -> usize;

    /// Whether there is no contact.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// `W_ii`, prepared for the exact solve of contact `i`.
    fn diagonal_block(&self, i: usize) -> &ContactBlock;

    /// Replaces all reactions; `f` in N, one per contact.
    fn set_reactions(&mut self, f: &[Vec3]);

    /// Row `i` of `W f` with the reactions now held, m.
    fn displacement(&self, i: usize) -> Vec3;

    /// `f_i += change`, N.
    fn add_reaction(&mut self, i: usize, change: &Vec3);

    /// Replaces `b` (N) by the `d` with `left_i (W d)_i + diagonal_i d_i = b_i`, if this
    /// operator has factors for that and they are cheap; says whether it did.
    /// `late` is asked while that goes on, and ends it.
    /// `left` in N/m, `diagonal` without unit. Newton's method falls back on products with `W` otherwise.
    fn solve_directly(&self, left: &[Mat3], diagonal: &[Mat3], b: &mut [Vec3], late: &dyn Fn() -> bool) -> bool {
        let _ = (left, diagonal, b, late);
        false
    }
}
