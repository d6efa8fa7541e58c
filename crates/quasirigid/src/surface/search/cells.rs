//! Cells of a grid along a curve that fills space (Morton, *A computer oriented geodetic
//! data base*, 1966), and where each is in a list of those that hold points.

use crate::math::{Real, Vec3};

/// Cells per axis that fit in a key: 21 bits for each.
const CELLS_PER_AXIS: Real = 2_097_000.0;

/// A cell that holds points: its key, its first point and the one after its last.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    pub key: u64,
    pub start: u32,
    pub end: u32,
}

/// Where a grid lies.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    origin: Vec3,
    pub edge: Real,
    /// Cells along x, y and z.
    pub dims: [i64; 3],
}

impl Grid {
    /// Cells of `edge` (m), enlarged if their number would not fit in a key.
    pub fn new(low: Vec3, high: Vec3, edge: Real) -> Self {
        let least = ((high - low).max() / CELLS_PER_AXIS).max(Real::MIN_POSITIVE);
        let edge = if edge > least { edge } else { least };
        Self { origin: low, edge, dims: std::array::from_fn(|axis| ((high[axis] - low[axis]) / edge) as i64 + 1) }
    }

    pub fn cell_of(&self, x: &Vec3) -> [i64; 3] {
        std::array::from_fn(|axis| (((x[axis] - self.origin[axis]) / self.edge) as i64).clamp(0, self.dims[axis] - 1))
    }

    /// Distance from `x` to the nearest wall of a block of cells `rings` around
    /// `home` that has cells behind it, m: what is nearer has been seen.
    pub fn seen_to(&self, x: &Vec3, home: [i64; 3], rings: i64) -> Real {
        let mut seen = Real::INFINITY;
        for axis in 0..3 {
            if home[axis] - rings > 0 {
                seen = seen.min(x[axis] - self.origin[axis] - (home[axis] - rings) as Real * self.edge);
            }
            if home[axis] + rings < self.dims[axis] - 1 {
                seen = seen.min(self.origin[axis] + (home[axis] + rings + 1) as Real * self.edge - x[axis]);
            }
        }
        seen.max(0.0)
    }
}

/// Spreads the lower 21 bits of `x`, two zeros after each.
fn spread(x: u64) -> u64 {
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// The other way round.
fn gather_bits(x: u64) -> u64 {
    let x = x & 0x1249_2492_4924_9249;
    let x = (x | x >> 2) & 0x10c3_0c30_c30c_30c3;
    let x = (x | x >> 4) & 0x100f_00f0_0f00_f00f;
    let x = (x | x >> 8) & 0x001f_0000_ff00_00ff;
    let x = (x | x >> 16) & 0x001f_0000_0000_ffff;
    (x | x >> 32) & 0x001f_ffff
}

pub fn key_of(cell: [i64; 3]) -> u64 {
    spread(cell[0] as u64) | spread(cell[1] as u64) << 1 | spread(cell[2] as u64) << 2
}

pub fn cell_with(key: u64) -> [i64; 3] {
    [gather_bits(key) as i64, gather_bits(key >> 1) as i64, gather_bits(key >> 2) as i64]
}

/// Where a cell is in the list of cells: an open hash table, at most half full.
#[derive(Debug, Clone)]
pub struct Table {
    slots: Vec<u32>,
    shift: u32,
}

impl Table {
    const EMPTY: u32 = u32::MAX;

    pub fn new(cells: &[Cell]) -> Self {
        let size = (2 * cells.len()).next_power_of_two().max(2);
        let mut table = Self { slots: vec![Self::EMPTY; size], shift: 64 - size.trailing_zeros() };
        for (i, cell) in cells.iter().enumerate() {
            let mut at = table.home(cell.key);
            while table.slots[at] != Self::EMPTY {
                at = (at + 1) & (size - 1);
            }
            table.slots[at] = i as u32;
        }
        table
    }

    /// Fibonacci hashing of blocks of 4 x 4 x 4 cells, which stay together: neighbours are then mostly on a few cache lines.
    fn home(&self, key: u64) -> usize {
        let block = (key >> 6).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> self.shift;
        (block as usize ^ (key & 63) as usize) & (self.slots.len() - 1)
    }

    pub fn find(&self, cells: &[Cell], key: u64) -> Option<Cell> {
        let mut at = self.home(key);
        loop {
            let slot = self.slots[at];
            if slot == Self::EMPTY {
                return None;
            }
            if cells[slot as usize].key == key {
                return Some(cells[slot as usize]);
            }
            at = (at + 1) & (self.slots.len() - 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_key_gives_back_its_cell(cell in prop::array::uniform3(0i64..2_097_152)) {
            prop_assert_eq!(cell_with(key_of(cell)), cell);
        }
    }
}
