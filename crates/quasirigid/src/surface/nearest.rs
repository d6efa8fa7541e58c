//! The nearest neighbours of every point of a set, found for all points together.
//!
//! The points are sorted by the cells of a grid, the cells along a curve that fills space (Morton, *A computer oriented geodetic data base*, 1966). So what is near in
//! space is near in memory, for whatever comes after too, and the candidates of a cell (its own points and those of the 26 cells around it) are
//! gathered once for all of its points. The size of the cells comes from the distances that a few of the points really see.
//!
//! For single queries at any place there is [`super::NeighbourGrid`].

use crate::math::{Real, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Cells per axis that fit in a key: 21 bits for each.
const CELLS_PER_AXIS: Real = 2_097_000.0;
/// Points per cell of the first grid, were the set the faces of its bounding box.
const FIRST_LOAD: Real = 5.0;
/// Points that tell how far neighbours are.
const SAMPLE: usize = 64;
/// Edge of a cell over what nine of ten of them see: enough for nearly every point to have its neighbours in the 27 cells around it.
const EDGE: Real = 1.1;
/// A first grid within this of what it should be is kept.
const GOOD_ENOUGH: Range<Real> = 0.95..1.4;
/// Squared distance within which neighbours are looked for first, over that of the last neighbour of the point before.
const FILTER: Real = 1.3;
/// Rings of cells that are looked through for the neighbours of one point before all points are.
const MOST_RINGS: i64 = 6;

/// A set of points in the order of cells of a grid. Indices are positions in that order.
#[derive(Debug, Clone)]
pub(crate) struct SortedPoints {
    /// The points, m, in the order of the cells.
    pub points: Vec<Vec3>,
    /// `order[i]` is the caller's index of point `i`.
    pub order: Vec<u32>,
    cells: Vec<Cell>,
    table: Table,
    grid: Grid,
}

/// The nearest other points of every point: those of point `i` are `index[i * k..(i + 1) * k]`, nearest first, equally near ones by index.
#[derive(Debug, Clone)]
pub(crate) struct Nearest {
    /// Neighbours of each point; fewer than asked for if there are not so many points.
    pub k: usize,
    pub index: Vec<u32>,
}

impl Nearest {
    pub fn of(&self, i: usize) -> &[u32] {
        &self.index[i * self.k..(i + 1) * self.k]
    }
}

/// A cell that holds points: its key, its first point and the one after its last.
#[derive(Debug, Clone, Copy)]
struct Cell {
    key: u64,
    start: u32,
    end: u32,
}

/// Where a grid lies.
#[derive(Debug, Clone, Copy)]
struct Grid {
    origin: Vec3,
    edge: Real,
    /// Cells along x, y and z.
    dims: [i64; 3],
}

impl Grid {
    /// Cells of `edge` (m), enlarged if their number would not fit in a key.
    fn new(low: Vec3, high: Vec3, edge: Real) -> Self {
        let least = ((high - low).max() / CELLS_PER_AXIS).max(Real::MIN_POSITIVE);
        let edge = if edge > least { edge } else { least };
        Self { origin: low, edge, dims: std::array::from_fn(|axis| ((high[axis] - low[axis]) / edge) as i64 + 1) }
    }

    fn cell_of(&self, x: &Vec3) -> [i64; 3] {
        std::array::from_fn(|axis| (((x[axis] - self.origin[axis]) / self.edge) as i64).clamp(0, self.dims[axis] - 1))
    }

    /// Distance from `x` to the nearest wall of a block of cells `rings` around `home` that has cells behind it, m: what is nearer has been seen.
    fn seen_to(&self, x: &Vec3, home: [i64; 3], rings: i64) -> Real {
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

fn key_of(cell: [i64; 3]) -> u64 {
    spread(cell[0] as u64) | spread(cell[1] as u64) << 1 | spread(cell[2] as u64) << 2
}

fn cell_with(key: u64) -> [i64; 3] {
    [gather_bits(key) as i64, gather_bits(key >> 1) as i64, gather_bits(key >> 2) as i64]
}

/// Where a cell is in the list of cells: an open hash table, at most half full.
#[derive(Debug, Clone)]
struct Table {
    slots: Vec<u32>,
    shift: u32,
}

impl Table {
    const EMPTY: u32 = u32::MAX;

    fn new(cells: &[Cell]) -> Self {
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

    fn find(&self, cells: &[Cell], key: u64) -> Option<Cell> {
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

impl SortedPoints {
    /// Sorts finite points (m; fewer than 2^32) for searches of `k` neighbours of each.
    pub fn new(points: &[Vec3], k: usize) -> Self {
        let bounds = |(low, high): (Vec3, Vec3), p: &Vec3| (low.inf(p), high.sup(p));
        let (low, high) = points.iter().fold((Vec3::repeat(Real::INFINITY), Vec3::repeat(Real::NEG_INFINITY)), bounds);
        let d = if points.is_empty() { Vec3::zeros() } else { high - low };
        let count = points.len().max(1) as Real;
        let mut edge = (2.0 * (d.x * d.y + d.y * d.z + d.z * d.x) / count * FIRST_LOAD).sqrt();
        if edge.is_nan() || edge <= 0.0 {
            edge = d.max() / count * FIRST_LOAD;
        }
        let mut sorted = Self::with_grid(points, Grid::new(low, high, edge));
        // A set that fills its box badly, two bodies far apart say, takes a second attempt or two: the first grid is far too coarse to judge by.
        for _ in 0..3 {
            let wanted = EDGE * sorted.typical_reach(k);
            if wanted.is_nan() || wanted <= 0.0 || GOOD_ENOUGH.contains(&(sorted.grid.edge / wanted)) {
                break;
            }
            sorted = Self::with_grid(points, Grid::new(low, high, wanted));
        }
        sorted
    }

    fn with_grid(points: &[Vec3], grid: Grid) -> Self {
        let mut keys: Vec<(u64, u32)> = points.par_iter().enumerate().map(|(i, p)| (key_of(grid.cell_of(p)), i as u32)).collect();
        keys.par_sort_unstable();
        let order: Vec<u32> = keys.par_iter().map(|key| key.1).collect();
        let mut cells: Vec<Cell> = Vec::new();
        for (i, &(key, _)) in keys.iter().enumerate() {
            match cells.last_mut() {
                Some(last) if last.key == key => last.end = i as u32 + 1,
                _ => cells.push(Cell { key, start: i as u32, end: i as u32 + 1 }),
            }
        }
        let table = Table::new(&cells);
        Self { points: pick(points, &order), order, cells, table, grid }
    }

    /// Values of the caller's points in the order of the cells.
    pub fn pick<T: Copy + Send + Sync>(&self, values: &[T]) -> Vec<T> {
        pick(values, &self.order)
    }

    /// Values in the order of the cells handed back in the caller's order.
    pub fn hand_back<T: Copy + Default>(&self, values: &[T]) -> Vec<T> {
        let mut out = vec![T::default(); values.len()];
        for (value, &i) in values.iter().zip(&self.order) {
            out[i as usize] = *value;
        }
        out
    }

    /// Distance (m) within which nine of ten of an even sample of the points have `k` neighbours.
    fn typical_reach(&self, k: usize) -> Real {
        let n = self.points.len();
        let k = k.min(n.saturating_sub(1));
        if k == 0 {
            return 0.0;
        }
        let count = n.min(SAMPLE);
        let farthest = |s: usize| {
            let i = (2 * s + 1) * n / (2 * count);
            let (mut block, mut near) = (Candidates::default(), Vec::new());
            self.search(i, k + 1, &mut block, &mut near);
            near.last().map_or(0.0, |last: &Candidate| last.distance2().sqrt())
        };
        let mut reaches: Vec<Real> = (0..count).into_par_iter().map(farthest).collect();
        reaches.sort_by(Real::total_cmp);
        reaches[count * 9 / 10]
    }

    /// The `k` nearest other points of every point. Uses all threads; the result does not depend on their number.
    pub fn nearest(&self, k: usize) -> Nearest {
        let n = self.points.len();
        let k = k.min(n.saturating_sub(1));
        let mut index = vec![0u32; n * k];
        if k > 0 {
            // The lists of each cell's points, handed out.
            let mut rest = index.as_mut_slice();
            let mut work = Vec::with_capacity(self.cells.len());
            for cell in &self.cells {
                let (own, after) = std::mem::take(&mut rest).split_at_mut((cell.end - cell.start) as usize * k);
                work.push((cell, own));
                rest = after;
            }
            work.into_par_iter()
                .with_min_len(64)
                .for_each_init(Scratch::default, |scratch, (cell, lists)| self.fill_cell(cell, k, lists, scratch));
        }
        Nearest { k, index }
    }

    /// The lists of the points of one cell.
    fn fill_cell(&self, cell: &Cell, k: usize, lists: &mut [u32], scratch: &mut Scratch) {
        let Scratch { block, wider, near, filter } = scratch;
        let home = cell_with(cell.key);
        self.gather(home, 1, block);
        for (i, list) in (cell.start as usize..cell.end as usize).zip(lists.chunks_exact_mut(k)) {
            let x = &self.points[i];
            let seen = self.grid.seen_to(x, home, 1);
            if block.nearest(x, k + 1, *filter, seen * seen, near) {
                // The next point of the cell sees about as far.
                *filter = FILTER * near[k].distance2();
            } else {
                self.search(i, k + 1, wider, near);
            }
            // Coincident points may push the point itself out of its own list: then the last of the k + 1 is left out.
            let others = near.iter().map(|c| c.index).filter(|&j| j as usize != i);
            list.iter_mut().zip(others).for_each(|(slot, j)| *slot = j);
        }
    }

    /// The `count` points nearest to point `i`, itself among them, by looking through more and more rings of cells.
    fn search(&self, i: usize, count: usize, block: &mut Candidates, near: &mut Vec<Candidate>) {
        let x = &self.points[i];
        let home = self.grid.cell_of(x);
        for rings in 1..=MOST_RINGS {
            self.gather(home, rings, block);
            let seen = self.grid.seen_to(x, home, rings);
            if block.nearest(x, count, Real::INFINITY, seen * seen, near) {
                return;
            }
        }
        block.clear();
        block.extend(&self.points, 0..self.points.len() as u32);
        block.nearest(x, count, Real::INFINITY, Real::INFINITY, near);
    }

    /// Gathers the points of all cells up to `rings` away from `home`.
    fn gather(&self, home: [i64; 3], rings: i64, block: &mut Candidates) {
        block.clear();
        let range = |axis: usize| (home[axis] - rings).max(0)..(home[axis] + rings + 1).min(self.grid.dims[axis]);
        for cz in range(2) {
            for cy in range(1) {
                for cx in range(0) {
                    if let Some(cell) = self.table.find(&self.cells, key_of([cx, cy, cz])) {
                        block.extend(&self.points, cell.start..cell.end);
                    }
                }
            }
        }
    }
}

/// `values[order[k]]` for every `k`.
pub(crate) fn pick<T: Copy + Send + Sync>(values: &[T], order: &[u32]) -> Vec<T> {
    order.par_iter().with_min_len(4096).map(|&i| values[i as usize]).collect()
}

/// What one thread needs to fill lists.
#[derive(Debug, Default)]
struct Scratch {
    block: Candidates,
    wider: Candidates,
    near: Vec<Candidate>,
    /// Squared distance that is likely to hold enough candidates, m^2.
    filter: Real,
}

/// A point that may be among the nearest: the bits of its squared distance (m^2), which sort as the number does, and its index.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    bits: u64,
    index: u32,
}

impl Candidate {
    fn distance2(&self) -> Real {
        Real::from_bits(self.bits)
    }
}

/// Points to look through, coordinate by coordinate.
#[derive(Debug, Default)]
struct Candidates {
    x: Vec<Real>,
    y: Vec<Real>,
    z: Vec<Real>,
    index: Vec<u32>,
    distance2: Vec<Real>,
}

impl Candidates {
    fn clear(&mut self) {
        self.x.clear();
        self.y.clear();
        self.z.clear();
        self.index.clear();
    }

    fn extend(&mut self, points: &[Vec3], range: Range<u32>) {
        for (p, i) in points[range.start as usize..range.end as usize].iter().zip(range) {
            self.x.push(p.x);
            self.y.push(p.y);
            self.z.push(p.z);
            self.index.push(i);
        }
    }

    /// Replaces `near` by the `count` nearest to `x`, nearest first and equally near ones by index. False if they may not be the nearest of all: the last is not nearer
    /// than the square root of `seen2` (m^2). `filter` (m^2) is a guess of what leaves over a few more than are asked for.
    fn nearest(&mut self, x: &Vec3, count: usize, filter: Real, seen2: Real, near: &mut Vec<Candidate>) -> bool {
        let terms = self.x.iter().zip(&self.y).zip(&self.z);
        self.distance2.clear();
        self.distance2.extend(terms.map(|((a, b), c)| {
            let (a, b, c) = (a - x.x, b - x.y, c - x.z);
            a * a + b * b + c * c
        }));
        if !(self.keep_below(filter, near) >= count || (filter < Real::INFINITY && self.keep_below(Real::INFINITY, near) >= count)) {
            return false;
        }
        if near.len() > 2 * count {
            near.select_nth_unstable(count - 1);
            near.truncate(count);
        }
        near.sort_unstable();
        near.truncate(count);
        seen2 == Real::INFINITY || near[count - 1].distance2() < seen2
    }

    /// Replaces `near` by the candidates up to a squared distance; returns their number. Without a branch on what is kept: no processor could foretell it.
    fn keep_below(&self, filter: Real, near: &mut Vec<Candidate>) -> usize {
        near.resize(self.index.len() + 1, Candidate::default());
        let mut kept = 0;
        for (&distance2, &index) in self.distance2.iter().zip(&self.index) {
            near[kept] = Candidate { bits: distance2.to_bits(), index };
            kept += usize::from(distance2 <= filter);
        }
        near.truncate(kept);
        kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The lists by looking at every point, in the caller's indices and in the order of the cells.
    fn brute(sorted: &SortedPoints, i: usize, k: usize) -> Vec<u32> {
        let x = &sorted.points[i];
        let mut all: Vec<(Real, u32)> = sorted.points.iter().enumerate().map(|(j, p)| ((p - x).norm_squared(), j as u32)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.truncate(k + 1);
        let mut list: Vec<u32> = all.iter().map(|a| a.1).filter(|&j| j as usize != i).collect();
        list.truncate(k);
        list
    }

    proptest! {
        #[test]
        fn lists_agree_with_looking_at_every_point(
            raw in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 1..200), k in 0usize..20, flat in any::<bool>(),
            stretch in 0..8, twice in any::<bool>(),
        ) {
            // Flat, uneven (a power of the coordinates crowds them) and with every point twice: what a grid finds hard.
            let mut points: Vec<Vec3> = raw.iter().map(|p| Vec3::new(p[0].powi(2 * stretch + 1), p[1], if flat { 0.25 } else { p[2] })).collect();
            if twice {
                points.extend_from_within(..);
            }
            let sorted = SortedPoints::new(&points, k);
            for (i, &caller) in sorted.order.iter().enumerate() {
                prop_assert_eq!(sorted.points[i], points[caller as usize]);
            }
            let nearest = sorted.nearest(k);
            prop_assert_eq!(nearest.k, k.min(points.len() - 1));
            for i in 0..points.len() {
                prop_assert_eq!(nearest.of(i), &brute(&sorted, i, nearest.k)[..], "point {}", i);
            }
        }

        #[test]
        fn a_key_gives_back_its_cell(cell in prop::array::uniform3(0i64..2_097_152)) {
            prop_assert_eq!(cell_with(key_of(cell)), cell);
        }
    }

    #[test]
    fn empty_single_coincident_and_far_sets_are_sorted() {
        assert_eq!(SortedPoints::new(&[], 8).nearest(8).k, 0);
        assert_eq!(SortedPoints::new(&[Vec3::x()], 8).nearest(8).k, 0);
        let same = SortedPoints::new(&[Vec3::repeat(2.0); 12], 4);
        assert_eq!(same.nearest(4).of(0), [1, 2, 3, 4]);
        let mut far: Vec<Vec3> = (0..40).map(|i| Vec3::new((i % 7) as Real, (i / 7) as Real, 0.0)).collect();
        far.extend_from_within(..);
        far[40..].iter_mut().for_each(|p| p.x += 1e9);
        let sorted = SortedPoints::new(&far, 5);
        for i in 0..80 {
            assert_eq!(sorted.nearest(5).of(i), brute(&sorted, i, 5));
        }
        let back = sorted.hand_back(&sorted.pick(&(0..80u32).collect::<Vec<_>>()));
        assert_eq!(back, (0..80).collect::<Vec<u32>>());
    }
}
