//! Normals of bare points: the flattest direction of each neighbourhood, then one consistent orientation per connected part.
//!
//! After Hoppe, DeRose, Duchamp, McDonald, Stuetzle, *Surface reconstruction from unorganized points* (1992): the orientation
//! spreads along a minimum spanning tree of the neighbour graph, so that it crosses the safest edges. Two things differ:
//! - whether a neighbour is flipped is judged, as in Xie, Wang, Hua, Qin, Kaufman, *Piecewise C1 continuous surface reconstruction of
//!   noisy point clouds* (2003), against the normal *reflected* at the plane halfway between both points. On an arc that is exactly
//!   the neighbour's normal, across a box edge too, where the plain product of two perpendicular normals says nothing;
//! - an edge that leaves along a normal instead of along the surface costs more: it may cross a thin wall or noise.

use crate::math::{Mat3, Real, Vec3};
use crate::surface::eigenvector::smallest_eigenvector;
use crate::surface::neighbours::{NeighbourGrid, all_nearest};
use rayon::prelude::*;

/// Neighbours in the plane fit and in the graph.
const NORMAL_NEIGHBOURS: usize = 12;
/// Neighbours looked at where the nearest are on one line or in one place.
const WIDE_NEIGHBOURS: usize = 96;
/// Steps of the cost of an edge, for the counting sort: costs from 0 to 2.
const COST_STEPS: Real = 4096.0;

/// Unit normals of `points` (m): outward for a closed surface. Each connected part of the neighbour graph starts at its highest
/// point (largest z), whose normal points up; an open surface therefore has its normals up where it is highest. Cost is
/// O(n log n) at worst; the fits use all threads, the result does not depend on their number.
pub fn estimate_normals(points: &[Vec3]) -> Vec<Vec3> {
    let (k, nearest) = all_nearest(points, NORMAL_NEIGHBOURS);
    if k == 0 {
        return vec![Vec3::z(); points.len()];
    }
    let wide = std::sync::OnceLock::new();
    let mut normals = vec![Vec3::zeros(); points.len()];
    normals.par_iter_mut().zip(nearest.par_chunks(k)).enumerate().for_each(|(i, (normal, list))| {
        let fit = smallest_eigenvector(&scatter(&points[i], list.iter().map(|&j| points[j as usize])));
        *normal = fit.unwrap_or_else(|| {
            let grid = wide.get_or_init(|| NeighbourGrid::build_auto(points));
            let mut near = Vec::new();
            grid.k_nearest(&points[i], WIDE_NEIGHBOURS, &mut near);
            smallest_eigenvector(&scatter(&points[i], near.iter().map(|n| points[n.0 as usize]))).unwrap_or(Vec3::z())
        });
    });
    orient(points, &mut normals, k, &nearest);
    normals
}

/// Scatter about their mean of a point and its neighbours, over the square of the largest distance.
fn scatter(p: &Vec3, neighbours: impl Iterator<Item = Vec3> + Clone) -> Mat3 {
    let reach = neighbours.clone().map(|q| (q - p).amax()).fold(0.0, Real::max);
    if reach == 0.0 {
        return Mat3::zeros();
    }
    let (mut count, mut sum, mut moment) = (1.0, Vec3::zeros(), Mat3::zeros());
    for q in neighbours {
        let d = (q - p) / reach;
        count += 1.0;
        sum += d;
        moment += d * d.transpose();
    }
    moment - sum * sum.transpose() / count
}

/// The normal that `p`'s normal suggests for a neighbour in direction `d` (unit).
fn reflected(normal: &Vec3, d: &Vec3) -> Vec3 {
    normal - d * (2.0 * d.dot(normal))
}

fn direction(from: &Vec3, to: &Vec3) -> Vec3 {
    (to - from).try_normalize(0.0).unwrap_or(Vec3::zeros())
}

/// Flips normals so that neighbours agree.
fn orient(points: &[Vec3], normals: &mut [Vec3], k: usize, nearest: &[u32]) {
    let tree = spanning_tree(points, normals, k, nearest);
    let n = points.len();
    // Neighbours in the tree, in rows.
    let mut starts = vec![0u32; n + 1];
    for &(i, j) in &tree {
        starts[i as usize + 1] += 1;
        starts[j as usize + 1] += 1;
    }
    for i in 0..n {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut adjacent = vec![0u32; 2 * tree.len()];
    for &(i, j) in &tree {
        for (from, to) in [(i, j), (j, i)] {
            adjacent[next[from as usize] as usize] = to;
            next[from as usize] += 1;
        }
    }
    // From the highest point down: the first point met of a part is its highest. Among equally high ones the most level.
    let mut seeds: Vec<u32> = (0..n as u32).collect();
    seeds.par_sort_unstable_by(|&i, &j| {
        let (a, b) = (i as usize, j as usize);
        points[b].z.total_cmp(&points[a].z).then(normals[b].z.abs().total_cmp(&normals[a].z.abs())).then(i.cmp(&j))
    });
    let mut done = vec![false; n];
    let mut stack = Vec::new();
    for seed in seeds {
        if done[seed as usize] {
            continue;
        }
        done[seed as usize] = true;
        if normals[seed as usize].z < 0.0 {
            normals[seed as usize] = -normals[seed as usize];
        }
        stack.push(seed as usize);
        while let Some(i) = stack.pop() {
            for &j in &adjacent[starts[i] as usize..starts[i + 1] as usize] {
                let j = j as usize;
                if !done[j] {
                    done[j] = true;
                    if reflected(&normals[i], &direction(&points[i], &points[j])).dot(&normals[j]) < 0.0 {
                        normals[j] = -normals[j];
                    }
                    stack.push(j);
                }
            }
        }
    }
}

/// Minimum spanning forest of the neighbour graph (Kruskal), as edges (i, j).
fn spanning_tree(points: &[Vec3], normals: &[Vec3], k: usize, nearest: &[u32]) -> Vec<(u32, u32)> {
    let list = |i: usize| &nearest[i * k..(i + 1) * k];
    // Each edge once, with its cost in steps.
    let edges: Vec<(u32, u32, u16)> = (0..points.len())
        .into_par_iter()
        .flat_map_iter(|i| {
            list(i).iter().map(|&j| j as usize).filter(move |&j| i < j || !list(j).contains(&(i as u32))).map(move |j| {
                let d = direction(&points[i], &points[j]);
                let disagreement = 1.0 - reflected(&normals[i], &d).dot(&normals[j]).abs();
                let leaving = 0.5 * (d.dot(&normals[i]).abs() + d.dot(&normals[j]).abs());
                (i as u32, j as u32, ((disagreement + leaving) * 0.5 * COST_STEPS) as u16)
            })
        })
        .collect();
    let mut starts = vec![0u32; COST_STEPS as usize + 3];
    for e in &edges {
        starts[e.2 as usize + 1] += 1;
    }
    for c in 1..starts.len() {
        starts[c] += starts[c - 1];
    }
    let mut order = vec![(0u32, 0u32); edges.len()];
    for &(i, j, cost) in &edges {
        order[starts[cost as usize] as usize] = (i, j);
        starts[cost as usize] += 1;
    }
    drop(edges);
    let mut parent: Vec<u32> = (0..points.len() as u32).collect();
    order.retain(|&(i, j)| {
        let (a, b) = (root(&mut parent, i), root(&mut parent, j));
        parent[a.max(b) as usize] = a.min(b);
        a != b
    });
    order
}

/// Root of `i` in a union-find forest, halving the path.
fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        let above = parent[parent[i as usize] as usize];
        parent[i as usize] = above;
        i = above;
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::shapes::{sample_box, sample_capsule, sample_half_space, sample_sphere};
    use nalgebra::UnitQuaternion;
    use std::f64::consts::TAU;

    /// Share of normals on the outer side, and the worst angle to the exact normal in degrees.
    fn compare(points: &[Vec3], exact: &[Vec3]) -> (Real, Real) {
        let normals = estimate_normals(points);
        let outward = normals.iter().zip(exact).filter(|(a, b)| a.dot(b) > 0.0).count();
        let worst = normals.iter().zip(exact).map(|(a, b)| a.angle(b).to_degrees()).fold(0.0, Real::max);
        (outward as Real / points.len() as Real, worst)
    }

    #[test]
    fn closed_surfaces_come_out_outward() {
        let mut cases = Vec::new();
        for (name, surface, bound) in [
            ("sphere", sample_sphere(0.03, 3000).unwrap(), 2.0),
            ("capsule", sample_capsule(0.01, 0.1, 3000).unwrap(), 10.0),
            // The fit rounds edges and corners off: 45 degrees at an edge, 55 at a corner.
            ("box", sample_box(Vec3::new(0.06, 0.06, 0.06), 3600).unwrap(), 60.0),
            ("thin plate", sample_box(Vec3::new(0.1, 0.1, 0.008), 3600).unwrap(), 60.0),
        ] {
            let (points, normals, _) = surface.into_parts();
            cases.push((name, points, normals, bound));
        }
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        for i in 0..4000 {
            // A torus with its axis along x, so that the highest point is on the outer rim and the hole is seen from the side.
            let (u, v) = (TAU * ((i as Real + 0.5) / 4000.0), TAU * (i as Real * 0.618_033_988_749_895).fract());
            let n = Vec3::new(v.sin(), v.cos() * u.cos(), v.cos() * u.sin());
            points.push(Vec3::new(0.0, 0.05 * u.cos(), 0.05 * u.sin()) + n * 0.02);
            normals.push(n);
        }
        cases.push(("torus", points, normals, 4.0));
        let (mut points, mut normals, _) = sample_sphere(0.02, 1500).unwrap().into_parts();
        points.extend_from_within(..);
        normals.extend_from_within(..);
        points[1500..].iter_mut().for_each(|p| *p += Vec3::new(0.05, 0.01, -0.02));
        cases.push(("two separate spheres", points, normals, 3.0));
        for (name, points, exact, bound) in cases {
            for turn in [UnitQuaternion::identity(), UnitQuaternion::from_euler_angles(0.3, 1.1, -2.0)] {
                let points: Vec<Vec3> = points.iter().map(|p| turn * p).collect();
                let exact: Vec<Vec3> = exact.iter().map(|n| turn * n).collect();
                let (outward, worst) = compare(&points, &exact);
                println!("{name}: {:.2} % outward, worst angle {worst:.2} degrees", 100.0 * outward);
                assert!(outward >= 0.999 && worst < bound, "{name}: {:.2} % outward, worst angle {worst:.2} degrees", 100.0 * outward);
            }
        }
    }

    #[test]
    fn an_open_patch_points_up() {
        let surface = sample_half_space(0.1, 500).unwrap();
        assert_eq!(compare(surface.points(), surface.normals()).0, 1.0);
    }

    #[test]
    fn odd_sets_still_give_unit_normals() {
        for points in [vec![], vec![Vec3::zeros()], vec![Vec3::repeat(1.0); 40], (0..40).map(|i| Vec3::repeat(i as Real)).collect()] {
            assert!(estimate_normals(&points).iter().all(|n| (n.norm() - 1.0).abs() < 1e-12));
        }
    }
}
