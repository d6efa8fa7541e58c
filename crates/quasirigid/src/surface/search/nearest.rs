//! The nearest neighbours of every point of a set, found for all points together.
//!
//! The points are sorted by the cells of a grid, the cells along a curve that fills space (Morton, *A computer oriented
//! geodetic data base*, 1966). So what is near in space is near in memory, for whatever comes after too, and the
//! candidates of a cell (its own points and those of the 26 cells around it) are gathered once for all of its points.
//! The size of the cells comes from the distances to the neighbours of a few of the points.
//!
//! For single queries at any place there is [`crate::surface::NeighbourGrid`].

use super::candidates::{Candidate, Candidates};
use super::cells::{Cell, Grid, Table, cell_with, key_of};
use crate::interrupt::Interrupt;
use crate::math::{Real, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Points per cell of the first grid, were the set the faces of its bounding box.
const FIRST_LOAD: Real = 5.0;
/// Points from which the distance of neighbours is estimated.
const SAMPLE: usize = 64;
/// Edge of a cell over the distance within which nine of ten of them have their neighbours:
/// enough for nearly every point to have its neighbours in the 27 cells around it.
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
        // A set that fills its box badly, two bodies far apart say, takes a second
        // attempt or two: the first grid is far too coarse to judge by.
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
    /// Once `interrupt` is raised the lists stay empty.
    pub fn nearest(&self, k: usize, interrupt: &Interrupt) -> Nearest {
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
                .filter(|_| !interrupt.raised())
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
                // The neighbours of the next point of the cell are about as far.
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
            let place = |p: &[Real; 3]| Vec3::new(p[0].powi(2 * stretch + 1), p[1], if flat { 0.25 } else { p[2] });
            let mut points: Vec<Vec3> = raw.iter().map(place).collect();
            if twice {
                points.extend_from_within(..);
            }
            let sorted = SortedPoints::new(&points, k);
            for (i, &caller) in sorted.order.iter().enumerate() {
                prop_assert_eq!(sorted.points[i], points[caller as usize]);
            }
            let nearest = sorted.nearest(k, &Interrupt::default());
            prop_assert_eq!(nearest.k, k.min(points.len() - 1));
            for i in 0..points.len() {
                prop_assert_eq!(nearest.of(i), &brute(&sorted, i, nearest.k)[..], "point {}", i);
            }
        }
    }

    #[test]
    fn empty_single_coincident_and_far_sets_are_sorted() {
        let never = &Interrupt::default();
        assert_eq!(SortedPoints::new(&[], 8).nearest(8, never).k, 0);
        assert_eq!(SortedPoints::new(&[Vec3::x()], 8).nearest(8, never).k, 0);
        let same = SortedPoints::new(&[Vec3::repeat(2.0); 12], 4);
        assert_eq!(same.nearest(4, never).of(0), [1, 2, 3, 4]);
        let mut far: Vec<Vec3> = (0..40).map(|i| Vec3::new((i % 7) as Real, (i / 7) as Real, 0.0)).collect();
        far.extend_from_within(..);
        far[40..].iter_mut().for_each(|p| p.x += 1e9);
        let sorted = SortedPoints::new(&far, 5);
        for i in 0..80 {
            assert_eq!(sorted.nearest(5, never).of(i), brute(&sorted, i, 5));
        }
        let back = sorted.hand_back(&sorted.pick(&(0..80u32).collect::<Vec<_>>()));
        assert_eq!(back, (0..80).collect::<Vec<u32>>());
    }
}
