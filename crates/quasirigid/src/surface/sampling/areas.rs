//! The area that each point of a surface stands for: its Voronoi cell among its neighbours, unfolded into its tangent plane.
//!
//! Two refinements keep the cells right where a plain projection on the tangent plane would not:
//! - *Unfolding.* A neighbour whose normal makes an angle phi with ours is `c` away across the crease between the two tangent planes
//!   (c: length of the chord, perpendicular to the crease). Over the crease the way is `c / cos(phi/2)`, exact for a box edge halfway
//!   between both points, and right to second order on a round surface. So a point beside a box edge keeps its whole cell.
//! - *Open borders.* Where no neighbour lies within a wide angle, the neighbours opposite are mirrored into the gap: the cell ends as
//!   far outside the point as it does inside, half a spacing.

use crate::error::Result;
use crate::interrupt::Interrupt;
use crate::math::{Real, Vec3, contact_frame};
use crate::surface::search::nearest::{Nearest, SortedPoints};
use crate::threads::in_parallel;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Neighbours that may bound a cell.
pub(crate) const AREA_NEIGHBOURS: usize = 16;
/// Neighbours whose normals differ by more than this angle (cosine) are on another sheet, not around an edge.
const OTHER_SHEET_COSINE: Real = -0.5;
/// An angle without neighbours wider than this (rad) is a border. An evenly sampled interior has none above 1.1.
const BORDER_GAP: Real = 2.0 * PI / 3.0;
/// A cell reaches at most this many times the distance of the sixth neighbour: a cap for outliers, far outside regular cells.
const REACH: Real = 1.5;

/// Area of every point (m^2, > 0 unless its neighbours all coincide with it), for `points` (m)
/// with unit `normals`. Uses all threads; the result does not depend on their number.
///
/// # Errors
/// [`crate::Error::InvalidValue`] if the system has no threads to give.
pub fn estimate_areas(points: &[Vec3], normals: &[Vec3]) -> Result<Vec<Real>> {
    in_parallel(|| {
        let sorted = SortedPoints::new(points, AREA_NEIGHBOURS);
        let never = &Interrupt::default();
        let areas = areas_among(&sorted.points, &sorted.pick(normals), &sorted.nearest(AREA_NEIGHBOURS, never), never);
        sorted.hand_back(&areas)
    })
}

/// [`estimate_areas`] of points whose neighbours (at best [`AREA_NEIGHBOURS`] of each) are known.
pub(crate) fn areas_among(points: &[Vec3], normals: &[Vec3], nearest: &Nearest, interrupt: &Interrupt) -> Vec<Real> {
    let area = |cell: &mut Cell, i| if interrupt.raised() { 0.0 } else { cell.area(i, nearest.of(i), points, normals) };
    (0..points.len()).into_par_iter().with_min_len(1024).map_init(Cell::default, area).collect()
}

/// A place in the tangent plane of the cell's point, seen from it.
#[derive(Debug, Clone, Copy)]
struct Flat {
    x: Real,
    y: Real,
    distance2: Real,
}

impl Flat {
    fn new(x: Real, y: Real) -> Self {
        Self { x, y, distance2: x * x + y * y }
    }
}

/// Scratch for one cell.
#[derive(Default)]
struct Cell {
    neighbours: Vec<Flat>,
    angles: Vec<Real>,
    polygon: Vec<Flat>,
    clipped: Vec<Flat>,
}

impl Cell {
    fn area(&mut self, i: usize, list: &[u32], points: &[Vec3], normals: &[Vec3]) -> Real {
        let frame = contact_frame(&normals[i], &Vec3::x());
        self.neighbours.clear();
        for &j in list {
            let j = j as usize;
            if let Some(d) = unfold(&(points[j] - points[i]), &normals[i], &normals[j]) {
                let flat = Flat::new(frame.column(1).dot(&d), frame.column(2).dot(&d));
                if flat.x != 0.0 || flat.y != 0.0 {
                    self.neighbours.push(flat);
                }
            }
        }
        self.neighbours.sort_by(|a, b| a.distance2.total_cmp(&b.distance2));
        let Some(sixth) = self.neighbours.get(5).or(self.neighbours.last()) else { return 0.0 };
        let reach = REACH * sixth.distance2.sqrt();
        self.mirror_into_gap();
        self.polygon.clear();
        self.polygon.extend([[-reach, -reach], [reach, -reach], [reach, reach], [-reach, reach]].map(|[x, y]| Flat::new(x, y)));
        let mut farthest2 = 2.0 * reach * reach;
        for d in &self.neighbours {
            // The line halfway to a neighbour twice as far as the farthest corner cuts nothing off.
            if d.distance2 < 4.0 * farthest2 {
                clip(&self.polygon, d, &mut self.clipped);
                std::mem::swap(&mut self.polygon, &mut self.clipped);
                farthest2 = self.polygon.iter().map(|p| p.distance2).fold(0.0, Real::max);
            }
        }
        let Some(mut p) = self.polygon.last() else { return 0.0 };
        let mut twice = 0.0;
        for q in &self.polygon {
            twice += p.x * q.y - p.y * q.x;
            p = q;
        }
        0.5 * twice
    }

    /// Adds the mirror images, through the point, of the neighbours opposite to the widest angle without neighbours.
    fn mirror_into_gap(&mut self) {
        if surrounded(&self.neighbours) {
            return;
        }
        self.angles.clear();
        self.angles.extend(self.neighbours.iter().map(|d| d.y.atan2(d.x)));
        self.angles.sort_by(Real::total_cmp);
        let m = self.angles.len();
        let (mut widest, mut start) = (0.0, 0.0);
        for a in 0..m {
            let next = if a + 1 < m { self.angles[a + 1] } else { self.angles[0] + 2.0 * PI };
            if next - self.angles[a] > widest {
                (widest, start) = (next - self.angles[a], self.angles[a]);
            }
        }
        if widest <= BORDER_GAP {
            return;
        }
        for a in 0..m {
            let Flat { x, y, .. } = self.neighbours[a];
            let into_gap = ((-y).atan2(-x) - start).rem_euclid(2.0 * PI);
            if into_gap < widest {
                self.neighbours.push(Flat::new(-x, -y));
            }
        }
    }
}

/// Whether there is a neighbour in each of six sectors of 60 degrees: then no angle
/// without one is as wide as [`BORDER_GAP`]. Spares most cells the angles.
fn surrounded(neighbours: &[Flat]) -> bool {
    // Bit = which sides of the lines at 0, 60 and 120 degrees; two of the eight combinations do not exist.
    const ALL: u32 = 0b1110_0111;
    let root3 = 3.0_f64.sqrt();
    let sector = |d: &Flat| u32::from(d.y >= 0.0) | u32::from(root3 * d.x >= d.y) << 1 | u32::from(root3 * d.x >= -d.y) << 2;
    neighbours.iter().fold(0, |seen, d| seen | 1 << sector(d)) & ALL == ALL
}

/// The neighbour at `d`, with normal `m`, laid out in the tangent plane of the normal `n`; `None` if it is on another sheet.
fn unfold(d: &Vec3, n: &Vec3, m: &Vec3) -> Option<Vec3> {
    let cosine = n.dot(m);
    if cosine < OTHER_SHEET_COSINE {
        return None;
    }
    let in_plane = d - n * n.dot(d);
    let crease = n.cross(m);
    let sine = crease.norm();
    if sine < 1e-9 {
        return Some(in_plane);
    }
    let crease = crease / sine;
    let along = crease.dot(d);
    let across_chord = (d.norm_squared() - along * along).max(0.0).sqrt();
    let across = across_chord / (0.5 * (1.0 + cosine)).sqrt();
    let direction = n.cross(&crease);
    Some(crease * along + direction * across.copysign(direction.dot(d)))
}

/// Keeps the part of a convex polygon that is nearer to the origin than to `d`.
fn clip(polygon: &[Flat], d: &Flat, out: &mut Vec<Flat>) {
    out.clear();
    let beyond = |p: &Flat| p.x * d.x + p.y * d.y - 0.5 * d.distance2;
    let Some(mut p) = polygon.last() else { return };
    let mut side_p = beyond(p);
    for q in polygon {
        let side_q = beyond(q);
        if (side_p < 0.0 && side_q > 0.0) || (side_p > 0.0 && side_q < 0.0) {
            let t = side_p / (side_p - side_q);
            out.push(Flat::new(p.x + t * (q.x - p.x), p.y + t * (q.y - p.y)));
        }
        if side_q <= 0.0 {
            out.push(*q);
        }
        (p, side_p) = (q, side_q);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::shapes::*;

    /// Worst relative error of a single area, and of their sum.
    fn errors(surface: &crate::surface::PointSurface) -> (Real, Real) {
        let estimated = estimate_areas(surface.points(), surface.normals()).unwrap();
        let worst = estimated.iter().zip(surface.areas()).map(|(e, a)| (e / a - 1.0).abs()).fold(0.0, Real::max);
        (worst, estimated.iter().sum::<Real>() / surface.total_area() - 1.0)
    }

    #[test]
    fn estimated_areas_match_the_exact_ones() {
        let cases = [
            ("sphere", sample_sphere(0.01, 2400).unwrap(), 0.08, 0.003),
            ("coarse sphere", sample_sphere(0.01, 200).unwrap(), 0.1, 0.02),
            ("box with its edges", sample_box(Vec3::new(0.06, 0.05, 0.08), 3600).unwrap(), 0.05, 0.002),
            ("open patch with its border", sample_half_space(0.1, 900).unwrap(), 1e-9, 1e-9),
            ("uneven open patch", sample_half_space(0.1, 950).unwrap(), 0.05, 0.002),
            ("open fingertip", sample_fingertip(Vec3::new(0.008, 0.009, 0.007), 2400).unwrap(), 0.1, 0.003),
            ("cylinder", sample_cylinder(0.01, 0.04, 2400).unwrap(), 0.15, 0.003),
        ];
        for (name, surface, each, sum) in cases {
            let (worst, total) = errors(&surface);
            println!("{name}: worst area off by {worst:.4}, sum by {total:.5}");
            assert!(worst < each && total.abs() < sum, "{name}: worst area off by {worst:.4}, sum by {total:.5}");
        }
    }
}
