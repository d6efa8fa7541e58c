//! The local surface as seen from a position: weighted moments of the points around it, four points at a time.

use crate::math::{Mat3, Real, Vec3};
use crate::surface::implicit::eigenvector::smallest_eigenvector;
use crate::surface::implicit::kernel::Kernel;
use crate::surface::search::lane::{LANES, Lane, Lane3};

/// Points whose normals differ from the reference by less than 30 degrees have full weight, by more than 60 none (cosines).
const FULL_AGREEMENT: Real = 0.866_025_403_784_438_6;
const NO_AGREEMENT: Real = 0.5;
/// Fewest weighted points that make a plane.
const MIN_POINTS: Real = 3.0;

/// Four points (m) with their unit normals. An empty place has a zero normal: it agrees with nothing, so it has no weight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block {
    points: Lane3,
    normals: Lane3,
    /// 0 for a point that may be the reference, infinity for one that may not, or an empty place.
    penalty: Lane,
}

impl Block {
    pub const EMPTY: Self = Self { points: Lane3::ZERO, normals: Lane3::ZERO, penalty: Lane([Real::INFINITY; LANES]) };

    #[inline(always)]
    pub fn set(&mut self, lane: usize, point: &Vec3, normal: &Vec3, may_be_reference: bool) {
        self.points.set(lane, point);
        self.normals.set(lane, normal);
        self.penalty.0[lane] = if may_be_reference { 0.0 } else { Real::INFINITY };
    }
}

/// Place in the blocks (block times 4 plus lane) of the point nearest to `x` that may be the reference, the first of equals.
#[inline]
pub(crate) fn nearest_in(blocks: &[Block], x: &Vec3) -> Option<usize> {
    let x = Lane3::splat(x);
    let mut best = [Real::INFINITY; LANES];
    let mut place = [usize::MAX; LANES];
    for (b, block) in blocks.iter().enumerate() {
        let d = block.points - x;
        let r2 = (d.dot(d) + block.penalty).0;
        for lane in 0..LANES {
            if r2[lane] < best[lane] {
                best[lane] = r2[lane];
                place[lane] = b * LANES + lane;
            }
        }
    }
    let mut winner = 0;
    for lane in 1..LANES {
        if best[lane] < best[winner] || (best[lane] == best[winner] && place[lane] < place[winner]) {
            winner = lane;
        }
    }
    (place[winner] != usize::MAX).then_some(place[winner])
}

/// Weighted sums over points at `d = p - x` with normals `n`.
pub(crate) struct Moments {
    x: Lane3,
    reference: Lane3,
    count: Lane,
    weight: Lane,
    first: Lane3,
    normal: Lane3,
    hermite: Lane,
    /// Sums of w d_i d_j: xx, yy, zz, then xy, xz, yz.
    square: Lane3,
    mixed: Lane3,
}

impl Moments {
    #[inline(always)]
    pub fn about(x: &Vec3, reference: &Vec3) -> Self {
        let (zero, zeros) = (Lane::ZERO, Lane3::ZERO);
        let (x, reference) = (Lane3::splat(x), Lane3::splat(reference));
        Self { x, reference, count: zero, weight: zero, first: zeros, normal: zeros, hermite: zero, square: zeros, mixed: zeros }
    }

    #[inline(always)]
    pub fn add(&mut self, block: &Block, kernel: &Kernel) {
        let d = block.points - self.x;
        let n = block.normals;
        let w = kernel.weights(d.dot(d)) * agreement(n.dot(self.reference));
        self.count += Lane(w.0.map(|w| if w > 0.0 { 1.0 } else { 0.0 }));
        self.weight += w;
        let wd = d.scale(w);
        self.first += wd;
        self.normal += n.scale(w);
        self.hermite += n.dot(wd);
        self.square += Lane3 { x: wd.x * d.x, y: wd.y * d.y, z: wd.z * d.z };
        self.mixed += Lane3 { x: wd.x * d.y, y: wd.x * d.z, z: wd.y * d.z };
    }

    /// `None` for under 3 points with weight, or points without a common side.
    #[inline]
    pub fn fit(&self) -> Option<Fit> {
        if self.count.sum() < MIN_POINTS {
            return None;
        }
        let (weight, first, square, mixed) = (self.weight.sum(), self.first.sum(), self.square.sum(), self.mixed.sum());
        let moment = Mat3::new(square.x, mixed.x, mixed.y, mixed.x, square.y, mixed.z, mixed.y, mixed.z, square.z);
        let scatter = moment - first * first.transpose() / weight;
        let normals = self.normal.sum();
        let mean_normal = normals.try_normalize(0.1 * weight)?;
        // Too few or badly placed points can make a plane that stands across the stored normals: then those know better.
        let normal = match smallest_eigenvector(&scatter).map(|n| (n, n.dot(&mean_normal))) {
            Some((n, along)) if along > 0.5 => n,
            Some((n, along)) if along < -0.5 => -n,
            _ => mean_normal,
        };
        let spread = (1.0 - normals.norm() / weight).max(0.0);
        Some(Fit { plane: -normal.dot(&first) / weight, hermite: -self.hermite.sum() / weight, normal, spread })
    }
}

/// Both distances of a position from the local surface (m, positive outside), and the unit normal there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    pub plane: Real,
    pub hermite: Real,
    pub normal: Vec3,
    /// By how much the mean of the normals is shorter than they are: 0 for a plane.
    pub spread: Real,
}

impl Fit {
    /// The mean of the two, m: see [`crate::surface::implicit`].
    #[inline]
    pub fn distance(&self) -> Real {
        0.5 * (self.plane + self.hermite)
    }
}

/// Agreement of two normals with this cosine: 1 within 30 degrees, 0 beyond 60, smooth between.
#[inline(always)]
fn agreement(cosine: Lane) -> Lane {
    let s = (cosine - Lane::splat(NO_AGREEMENT)) * Lane::splat(1.0 / (FULL_AGREEMENT - NO_AGREEMENT));
    let s = s.max(Lane::ZERO).min(Lane::splat(1.0));
    s * s * (Lane::splat(3.0) - Lane::splat(2.0) * s)
}
