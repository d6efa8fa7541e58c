//! Points that may be the nearest to a place, and the choice of the nearest among them.

use crate::math::{Real, Vec3};
use std::ops::Range;

/// A point that may be among the nearest: the bits of its squared distance (m^2), which sort as the number does, and its index.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Candidate {
    bits: u64,
    pub index: u32,
}

impl Candidate {
    pub fn distance2(&self) -> Real {
        Real::from_bits(self.bits)
    }
}

/// Points to look through, coordinate by coordinate.
#[derive(Debug, Default)]
pub struct Candidates {
    x: Vec<Real>,
    y: Vec<Real>,
    z: Vec<Real>,
    index: Vec<u32>,
    distance2: Vec<Real>,
}

impl Candidates {
    pub fn clear(&mut self) {
        self.x.clear();
        self.y.clear();
        self.z.clear();
        self.index.clear();
    }

    pub fn extend(&mut self, points: &[Vec3], range: Range<u32>) {
        for (p, i) in points[range.start as usize..range.end as usize].iter().zip(range) {
            self.x.push(p.x);
            self.y.push(p.y);
            self.z.push(p.z);
            self.index.push(i);
        }
    }

    /// Replaces `near` by the `count` nearest to `x`, nearest first and equally near ones by index. False
    /// if they may not be the nearest of all: the last is not nearer than the square root of `seen2` (m^2).
    /// `filter` (m^2) is a guess of what leaves over a few more than are asked for.
    pub fn nearest(&mut self, x: &Vec3, count: usize, filter: Real, seen2: Real, near: &mut Vec<Candidate>) -> bool {
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

    /// Replaces `near` by the candidates up to a squared distance; returns their number.
    /// Without a branch on what is kept, which no processor could predict.
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
