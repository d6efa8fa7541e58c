//! Linear algebra of the contact problem: factors of sparse matrices of 3x3 blocks.

pub(crate) mod block_lu;
pub(crate) mod block_rows;
pub(crate) mod dense_lu;
