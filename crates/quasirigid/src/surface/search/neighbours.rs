//! Neighbours of a point in a point set: a uniform grid, hashed, built by one counting sort.
//!
//! Points are stored bucket by bucket, so a query walks through contiguous memory; memory is linear in the number of points
//! whatever the extent of the set. Nothing depends on a random hash seed: the same points give the same order.

use crate::math::{Real, Vec3};

/// Cells per axis that fit in a packed key: 21 bits for each axis.
const CELLS_PER_AXIS: Real = 2_097_000.0;
/// Points per occupied cell that [`NeighbourGrid::build_auto`] aims for.
const POINTS_PER_CELL: Real = 4.0;

/// Uniform grid over a point set, for radius and k-nearest searches. Indices are those of the point slice it was built from.
#[derive(Debug, Clone)]
pub struct NeighbourGrid {
    entries: Vec<Entry>,
    /// `entries[starts[b]..starts[b + 1]]` is bucket `b`; the number of buckets is a power of two.
    starts: Vec<u32>,
    origin: Vec3,
    cell: Real,
    /// Number of cells along x, y, z.
    dims: [i64; 3],
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    point: Vec3,
    key: u64,
    index: u32,
}

fn pack(cell: [i64; 3]) -> u64 {
    (cell[0] as u64) | (cell[1] as u64) << 21 | (cell[2] as u64) << 42
}

/// Buckets of a block of 4 x 4 x 4 cells.
const BLOCK: usize = 64;

/// Blocks of cells are hashed, multiplicatively (Fibonacci: top bits of key times 2^64 / golden ratio); the cells
/// of a block lie side by side. So a search around one place stays in a few stretches of memory.
fn bucket_of(key: u64, buckets: usize) -> usize {
    const WITHIN: u64 = 3 | 3 << 21 | 3 << 42;
    let cell = (key & 3) | (key >> 21 & 3) << 2 | (key >> 42 & 3) << 4;
    let block = (key & !WITHIN).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32;
    (block as usize & (buckets / BLOCK - 1)) * BLOCK + cell as usize
}

impl NeighbourGrid {
    /// Builds the grid with cubic cells of edge `cell` (m; about the search radius is best). A cell that is not positive, or
    /// too small for the extent of the points, is enlarged. Points must be finite and fewer than 2^32.
    pub fn build(points: &[Vec3], cell: Real) -> Self {
        let mut low = Vec3::repeat(Real::INFINITY);
        let mut high = Vec3::repeat(Real::NEG_INFINITY);
        for p in points {
            low = low.inf(p);
            high = high.sup(p);
        }
        let extent = if points.is_empty() { 0.0 } else { (high - low).max() };
        let floor = (extent / CELLS_PER_AXIS).max(Real::MIN_POSITIVE);
        let cell = if cell > floor { cell } else { floor };
        let mut grid = Self { entries: Vec::new(), starts: Vec::new(), origin: low, cell, dims: [1; 3] };
        if points.is_empty() {
            grid.origin = Vec3::zeros();
            grid.starts = vec![0; BLOCK + 1];
            return grid;
        }
        for (axis, dim) in grid.dims.iter_mut().enumerate() {
            *dim = ((high[axis] - low[axis]) / cell) as i64 + 1;
        }
        let buckets = points.len().next_power_of_two().max(BLOCK);
        let mut starts = vec![0u32; buckets + 1];
        let keys: Vec<u64> = points.iter().map(|p| pack(grid.cell_of(p))).collect();
        for key in &keys {
            starts[bucket_of(*key, buckets) + 1] += 1;
        }
        for b in 0..buckets {
            starts[b + 1] += starts[b];
        }
        let mut next = starts.clone();
        let mut entries = vec![Entry { point: Vec3::zeros(), key: 0, index: 0 }; points.len()];
        for (index, (point, key)) in points.iter().zip(&keys).enumerate() {
            let slot = &mut next[bucket_of(*key, buckets)];
            entries[*slot as usize] = Entry { point: *point, key: *key, index: index as u32 };
            *slot += 1;
        }
        grid.starts = starts;
        grid.entries = entries;
        grid
    }

    /// Builds the grid with a cell chosen for neighbour searches: a few points per occupied cell of a surface.
    pub fn build_auto(points: &[Vec3]) -> Self {
        let mut low = Vec3::repeat(Real::INFINITY);
        let mut high = Vec3::repeat(Real::NEG_INFINITY);
        for p in points {
            low = low.inf(p);
            high = high.sup(p);
        }
        // A first guess from the faces of the bounding box. Sets that fill their box badly (two bodies far apart) get far too
        // many points per cell, so the guess is corrected by what a build really holds.
        let d = if points.is_empty() { Vec3::zeros() } else { high - low };
        let box_area = 2.0 * (d.x * d.y + d.y * d.z + d.z * d.x);
        let mut cell = (box_area / points.len().max(1) as Real * POINTS_PER_CELL).sqrt();
        if cell <= 0.0 {
            cell = d.max() / points.len().max(1) as Real * POINTS_PER_CELL;
        }
        let mut grid = Self::build(points, cell);
        for _ in 0..4 {
            let occupied = grid.occupied_cells().max(1);
            let load = points.len() as Real / occupied as Real / POINTS_PER_CELL;
            if load < 3.0 || occupied * 2 > points.len() {
                break;
            }
            cell = grid.cell / load.sqrt();
            grid = Self::build(points, cell);
        }
        grid
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Edge of a cell, m.
    pub fn cell(&self) -> Real {
        self.cell
    }

    fn occupied_cells(&self) -> usize {
        // Points of one cell are contiguous within a bucket unless two cells share it; counting changes is close enough.
        self.entries.windows(2).filter(|w| w[0].key != w[1].key).count() + usize::from(!self.entries.is_empty())
    }

    /// Cell of a point, clamped into the grid.
    fn cell_of(&self, x: &Vec3) -> [i64; 3] {
        let q = (x - self.origin) / self.cell;
        std::array::from_fn(|axis| (q[axis].floor() as i64).clamp(0, self.dims[axis] - 1))
    }

    fn bucket(&self, cell: [i64; 3]) -> impl Iterator<Item = &Entry> {
        let key = pack(cell);
        let b = bucket_of(key, self.starts.len() - 1);
        self.entries[self.starts[b] as usize..self.starts[b + 1] as usize].iter().filter(move |e| e.key == key)
    }

    /// Calls `visit(index, squared distance in m^2)` for every point within `radius` (m, inclusive) of `x`, each once, in an
    /// order that depends on the points only.
    pub fn for_each_within(&self, x: &Vec3, radius: Real, mut visit: impl FnMut(u32, Real)) {
        let radius2 = radius * radius;
        let low = self.cell_of(&x.add_scalar(-radius));
        let high = self.cell_of(&x.add_scalar(radius));
        let cells: Real = (0..3).map(|a| (high[a] - low[a] + 1) as Real).product();
        let mut check = |e: &Entry| {
            let dist2 = (e.point - x).norm_squared();
            if dist2 <= radius2 {
                visit(e.index, dist2);
            }
        };
        if cells > self.entries.len() as Real {
            self.entries.iter().for_each(check);
            return;
        }
        for cz in low[2]..=high[2] {
            for cy in low[1]..=high[1] {
                for cx in low[0]..=high[0] {
                    self.bucket([cx, cy, cz]).for_each(&mut check);
                }
            }
        }
    }

    /// Replaces `out` by the `k` points nearest to `x` (all of them if there are fewer), as (index, squared distance in m^2),
    /// nearest first, equal distances by index. A point of the set is its own first neighbour.
    pub fn k_nearest(&self, x: &Vec3, k: usize, out: &mut Vec<(u32, Real)>) {
        out.clear();
        let k = k.min(self.entries.len());
        if k == 0 {
            return;
        }
        let home = self.cell_of(x);
        for ring in 0i64.. {
            // Past a dozen empty rings the query is far from the points: looking at all of them is cheaper than more rings.
            if ring > 12 {
                out.clear();
                self.entries.iter().for_each(|e| keep_nearest(out, k, (e.index, (e.point - x).norm_squared())));
                return;
            }
            self.visit_ring(x, home, ring, k, out);
            // Everything nearer than the nearest unvisited cell wall has been seen. (A wall at the end of the grid has nothing
            // behind it.)
            let mut seen = Real::INFINITY;
            for (axis, &home_cell) in home.iter().enumerate() {
                if home_cell - ring > 0 {
                    seen = seen.min(x[axis] - self.origin[axis] - (home_cell - ring) as Real * self.cell);
                }
                if home_cell + ring < self.dims[axis] - 1 {
                    seen = seen.min(self.origin[axis] + (home_cell + ring + 1) as Real * self.cell - x[axis]);
                }
            }
            let seen = seen.max(0.0);
            if out.len() == k && out[k - 1].1 < seen * seen || seen == Real::INFINITY {
                return;
            }
        }
    }

    /// Looks through the cells at Chebyshev distance `ring` of `home` that lie in
    /// the grid, but for those too far to hold one of the `k` nearest.
    fn visit_ring(&self, x: &Vec3, home: [i64; 3], ring: i64, k: usize, out: &mut Vec<(u32, Real)>) {
        let low: [i64; 3] = std::array::from_fn(|a| (home[a] - ring).max(0));
        let high: [i64; 3] = std::array::from_fn(|a| (home[a] + ring).min(self.dims[a] - 1));
        // Squared distance of the query from a slab of cells; a little short, so that rounding never hides a point.
        let slab = |axis: usize, cell: i64| {
            let start = self.origin[axis] + cell as Real * self.cell;
            let outside = (start - x[axis]).max(x[axis] - start - self.cell) - 1e-6 * self.cell;
            outside.max(0.0) * outside.max(0.0)
        };
        let too_far = |distance2: Real, out: &[(u32, Real)]| out.len() == k && distance2 > out[k - 1].1;
        for cz in low[2]..=high[2] {
            let z = slab(2, cz);
            if too_far(z, out) {
                continue;
            }
            for cy in low[1]..=high[1] {
                let yz = z + slab(1, cy);
                if too_far(yz, out) {
                    continue;
                }
                // Inside the slab only the two end cells belong to the shell.
                let shell = (cz - home[2]).abs() == ring || (cy - home[1]).abs() == ring;
                let step = if shell { 1 } else { 2 * ring };
                let mut cx = if shell { low[0] } else { home[0] - ring };
                while cx <= home[0] + ring {
                    if (low[0]..=high[0]).contains(&cx) && !too_far(yz + slab(0, cx), out) {
                        self.bucket([cx, cy, cz]).for_each(|e| keep_nearest(out, k, (e.index, (e.point - x).norm_squared())));
                    }
                    cx += step;
                }
            }
        }
    }
}

/// Inserts into a list kept sorted by (distance, index) and no longer than `k`.
fn keep_nearest(out: &mut Vec<(u32, Real)>, k: usize, candidate: (u32, Real)) {
    let before = |a: &(u32, Real), b: &(u32, Real)| (a.1, a.0) < (b.1, b.0);
    if out.len() == k {
        if !before(&candidate, &out[k - 1]) {
            return;
        }
        out.pop();
    }
    let mut at = out.len();
    out.push(candidate);
    while at > 0 && before(&candidate, &out[at - 1]) {
        out[at] = out[at - 1];
        at -= 1;
    }
    out[at] = candidate;
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute(points: &[Vec3], x: &Vec3) -> Vec<(u32, Real)> {
        let mut all: Vec<_> = points.iter().enumerate().map(|(i, p)| (i as u32, (p - x).norm_squared())).collect();
        all.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        all
    }

    proptest! {
        #[test]
        fn both_searches_agree_with_looking_at_every_point(
            raw in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 1..200),
            x in prop::array::uniform3(-3.0..3.0f64), cell in 0.01..1.0f64, radius in 0.0..1.5f64, k in 0usize..30, flat in any::<bool>(),
        ) {
            let points: Vec<Vec3> = raw.iter().map(|p| Vec3::new(p[0], p[1], if flat { 0.25 } else { p[2] })).collect();
            let x = Vec3::from(x);
            let truth = brute(&points, &x);
            for grid in [NeighbourGrid::build(&points, cell), NeighbourGrid::build_auto(&points)] {
                let mut near = Vec::new();
                grid.k_nearest(&x, k, &mut near);
                prop_assert_eq!(&near[..], &truth[..k.min(points.len())]);
                let mut within = Vec::new();
                grid.for_each_within(&x, radius, |i, d2| within.push((i, d2)));
                within.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
                let expected: Vec<_> = truth.iter().copied().filter(|n| n.1 <= radius * radius).collect();
                prop_assert_eq!(within, expected);
            }
        }
    }

    #[test]
    fn coincident_far_and_empty_sets_are_searched() {
        let points = vec![Vec3::new(1.0, 2.0, 3.0); 10];
        let mut near = Vec::new();
        NeighbourGrid::build_auto(&points).k_nearest(&Vec3::zeros(), 3, &mut near);
        assert_eq!(near.iter().map(|n| n.0).collect::<Vec<_>>(), [0, 1, 2]);
        let two = [Vec3::zeros(), Vec3::new(1e9, 0.0, 0.0)];
        NeighbourGrid::build(&two, 1e-9).k_nearest(&Vec3::new(6e8, 0.0, 0.0), 1, &mut near);
        assert_eq!(near[0].0, 1);
        NeighbourGrid::build(&[], 1.0).k_nearest(&Vec3::zeros(), 3, &mut near);
        assert!(near.is_empty());
    }
}
