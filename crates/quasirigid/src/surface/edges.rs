//! Convex edges of a sampled surface, and the control points that stand on them.
//!
//! A face carries as far as its outermost control points reach. In the middle of its leaf a control point stands half a control spacing
//! inside the edge, and a body
//! would tip too early by that much. So the control point of a leaf that reaches an edge is moved onto it, and that of a leaf that
//! reaches two into their corner. Its
//! area is then shared with its neighbours such that a pressure that varies linearly over the face has the same force and moments as
//! before.
//!
//! An edge is where the tangent planes of two neighbouring points meet, if they make an angle and the surface does not bend gradually
//! between them: nothing
//! has to be known but points and normals.

use crate::math::{Real, Vec3, contact_frame};
use crate::surface::rows::Rows;
use crate::surface::search::neighbours::NeighbourGrid;
use crate::surface::sphere_tree::SphereTree;
use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;
use std::ops::Range;

/// Tangent planes that meet in an edge make at least this angle (35 degrees), and at most that of a wedge of 18 degrees: beyond, they
/// are the two sides of a sheet.
const CREASE_COSINE: Real = 0.82;
const SHEET_COSINE: Real = -0.95;
/// Neighbours across an edge are at most this far apart, point spacings ...
const ACROSS: Real = 1.75;
/// ... and each at most this far from the edge.
const ASIDE: Real = 1.0;
/// Normals between those of the two sides by more than this angle (rad): the surface is round there.
const BETWEEN: Real = 0.2;
/// Edges whose directions differ by less than this cosine are one.
const SAME_EDGE: Real = 0.7;
/// Two edges on opposite sides of a leaf: it is all that there is of a face between them.
const OPPOSITE: Real = -0.5;
/// A corner farther from the middle of its leaf than this many times the farther of its edges is none.
const CORNER: Real = 3.0;
/// Angle of the normal on a sharp edge with the direction halfway between its faces, rad: 60 degrees. Of a right-angled edge it is 45
/// degrees.
const SHARP: Real = std::f64::consts::FRAC_PI_3;
/// Edges of one leaf.
const MOST_EDGES: usize = 4;
/// Normals of one face agree by this cosine, and its control points lie within this share of their spacing of one plane.
const ONE_FACE: Real = 0.9;
const ONE_PLANE: Real = 0.5;
/// Points whose normals agree by this cosine make one surface: as the weights of the implicit surface have it.
const SAME_FACE: Real = 0.5;
/// Newton steps of [`shares`], and how near to the first moment they go, control spacings.
const NEWTON_STEPS: usize = 30;
const MOMENT_TOLERANCE: Real = 1e-10;

/// Points and normals (m, -; tree order) among which edges are looked for, and their mean spacing, m.
#[derive(Clone, Copy)]
pub(crate) struct Samples<'a> {
    pub points: &'a [Vec3],
    pub normals: &'a [Vec3],
    pub spacing: Real,
}

/// An edge as the tangent plane at the middle of a leaf sees it: the line `out . (x - middle) = distance`. `other`: normal of the face
/// beyond it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Edge {
    out: Vec3,
    distance: Real,
    other: Vec3,
}

/// Where the control point of a leaf may stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Place {
    /// In the middle of its leaf.
    Middle,
    /// On an edge or in a corner, and the normal there.
    Edge(Vec3, Vec3),
    /// On either side of a face that is one leaf wide.
    EitherSide([Vec3; 2]),
}

/// Where the control point of a leaf with the given `own` points may stand. `middle` (m) and `normal`: that of its leaf, on the
/// surface. `ranges`: its points and those around it.
pub(crate) fn place(samples: Samples, own: Range<usize>, middle: &Vec3, normal: &Vec3, ranges: &[Range<u32>]) -> Place {
    let Samples { points, normals, spacing } = samples;
    let around = || ranges.iter().flat_map(|range| range.start as usize..range.end as usize);
    let turns = |cosine: Real| cosine < CREASE_COSINE && cosine > SHEET_COSINE;
    if !around().any(|k| turns(normal.dot(&normals[k]))) {
        return Place::Middle;
    }
    let across2 = (ACROSS * spacing) * (ACROSS * spacing);
    // Nearest to the middle first: of a curved edge the piece that is nearest counts.
    let mut beyond: Vec<(Real, usize)> = around()
        .filter(|&k| turns(normal.dot(&normals[k])) && normal.dot(&(points[k] - middle)) < 0.0)
        .map(|k| ((points[k] - middle).norm_squared(), k))
        .collect();
    beyond.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut edges: Vec<Edge> = Vec::new();
    for (_, q) in beyond {
        let Some(edge) = edge_between(middle, normal, &points[q], &normals[q]) else { continue };
        if edges.iter().any(|other| other.out.dot(&edge.out) > SAME_EDGE) {
            continue;
        }
        let reaches = own.clone().any(|p| {
            let is_near = |from: usize, to: usize| {
                edge_between(&points[from], &normals[from], &points[to], &normals[to])
                    .is_some_and(|edge| edge.distance >= 0.0 && edge.distance <= ASIDE * spacing)
            };
            normals[p].dot(normal) > ONE_FACE
                && turns(normals[p].dot(&normals[q]))
                && (points[p] - points[q]).norm_squared() < across2
                && is_near(p, q)
                && is_near(q, p)
                && !is_round(samples, p, q, around())
        });
        if reaches {
            edges.push(edge);
        }
    }
    place_on(middle, normal, &edges)
}

/// The edge in which the tangent plane at `q` (normal `m`) meets that at `p` (normal `n`), as seen from `p`; None of parallel planes.
fn edge_between(p: &Vec3, n: &Vec3, q: &Vec3, m: &Vec3) -> Option<Edge> {
    let out = (m - n * n.dot(m)).try_normalize(1e-6)?;
    Some(Edge { out, distance: m.dot(&(q - p)) / m.dot(&out), other: *m })
}

/// Whether the surface bends gradually from `p` to `q`: some point near both has a normal between theirs.
fn is_round(Samples { points, normals, spacing }: Samples, p: usize, q: usize, mut around: impl Iterator<Item = usize>) -> bool {
    let reach2 = (ACROSS * spacing) * (ACROSS * spacing);
    let near = |k: usize, other: usize| (points[k] - points[other]).norm_squared() < reach2;
    let angle = |k: usize, other: usize| normals[k].dot(&normals[other]).clamp(-1.0, 1.0).acos();
    let between = angle(p, q) - BETWEEN;
    around.any(|k| near(k, p) && near(k, q) && angle(k, p) < between && angle(k, q) < between)
}

fn place_on(middle: &Vec3, normal: &Vec3, edges: &[Edge]) -> Place {
    let corner = |i: usize, j: usize| {
        // x = a t_i + b t_j with t_i . x = s_i, t_j . x = s_j
        let (first, second) = (edges[i], edges[j]);
        let c = first.out.dot(&second.out);
        let (a, b) = ((first.distance - c * second.distance) / (1.0 - c * c), (second.distance - c * first.distance) / (1.0 - c * c));
        let x = first.out * a + second.out * b;
        (x.norm() <= CORNER * first.distance.max(second.distance)).then(|| middle + x)
    };
    let on = |i: usize| middle + edges[i].out * edges[i].distance;
    let opposite = (0..edges.len()).flat_map(|i| (0..i).map(move |j| (j, i))).find(|&(i, j)| edges[i].out.dot(&edges[j].out) < OPPOSITE);
    match (edges.len(), opposite) {
        (0, _) | (MOST_EDGES.., _) => Place::Middle,
        (1, _) => Place::Edge(on(0), lean(normal, edges)),
        (2, Some(_)) => Place::EitherSide([on(0), on(1)]),
        (_, Some((i, j))) => {
            let end = 3 - i - j;
            Place::EitherSide([i, j].map(|side| corner(side, end).unwrap_or_else(|| on(side))))
        }
        (_, None) => Place::Edge(corner(0, 1).unwrap_or_else(|| on(0)), lean(normal, edges)),
    }
}

/// The normal of a control point on sharp edges: that of its face, leant over to within [`SHARP`] of the direction halfway between the
/// two faces. The faces of a blade that stands on
/// its edge do not look at the floor; their control points on the edge do.
fn lean(normal: &Vec3, edges: &[Edge]) -> Vec3 {
    edges.iter().fold(*normal, |n, edge| {
        let Some(halfway) = (n + edge.other).try_normalize(1e-6) else { return n };
        let aside = n - halfway * halfway.dot(&n);
        if halfway.dot(&n) >= SHARP.cos() { n } else { halfway * SHARP.cos() + aside.normalize() * SHARP.sin() }
    })
}

/// Decides which side those stand on that may stand on either: away from the nearest of their kind that has been decided on, so that
/// both edges of a narrow face carry.
pub(crate) fn choose_sides(middles: &[Vec3], normals: &[Vec3], places: &mut [Place]) {
    /// Neighbours of their kind that are asked.
    const ASKED: usize = 6;
    let open: Vec<usize> = (0..places.len()).filter(|&leaf| matches!(places[leaf], Place::EitherSide(_))).collect();
    if open.is_empty() {
        return;
    }
    let open_middles: Vec<Vec3> = open.iter().map(|&leaf| middles[leaf]).collect();
    let (grid, mut near) = (NeighbourGrid::build_auto(&open_middles), Vec::new());
    let mut decided: Vec<Option<Vec3>> = vec![None; open.len()];
    for (i, &leaf) in open.iter().enumerate() {
        let Place::EitherSide(sides) = places[leaf] else { continue };
        near.clear();
        grid.k_nearest(&middles[leaf], ASKED, &mut near);
        let side = near.iter().find_map(|&(j, _)| decided[j as usize]).map_or(0, |taken| {
            // Across the face; along it, at its end, it says nothing.
            let way = sides[1] - sides[0];
            usize::from(way.dot(&(taken - (sides[0] + sides[1]) * 0.5)) < 0.0)
        });
        decided[i] = Some(sides[side]);
        places[leaf] = Place::Edge(sides[side], normals[leaf]);
    }
}

/// Areas (m^2) of the control points at `points`: of those that were `moved` the leaf's area is shared with neighbours on the same face
/// such that its first moment stays that of the leaf.
pub(crate) fn share_areas(tree: &SphereTree, points: &[Vec3], normals: &[Vec3], moved: &[bool], neighbours: &Rows) -> Vec<Real> {
    let mut areas: Vec<Real> = (0..points.len()).map(|leaf| if moved[leaf] { 0.0 } else { tree.leaf(leaf).area }).collect();
    let mut candidates: Vec<(u32, Vector2<Real>)> = Vec::new();
    for leaf in (0..points.len()).filter(|&leaf| moved[leaf]) {
        let (node, normal) = (tree.leaf(leaf), &normals[leaf]);
        let (frame, scale) = (contact_frame(normal, &Vec3::x()), node.area.sqrt());
        candidates.clear();
        for &other in std::iter::once(&(leaf as u32)).chain(neighbours.row(leaf)) {
            let d = (points[other as usize] - node.center) / scale;
            if other as usize == leaf || (normals[other as usize].dot(normal) > ONE_FACE && normal.dot(&d).abs() < ONE_PLANE) {
                candidates.push((other, Vector2::new(frame.column(1).dot(&d), frame.column(2).dot(&d))));
            }
        }
        let weights = shares(&candidates);
        let total: Real = weights.iter().sum();
        for ((other, _), weight) in candidates.iter().zip(weights) {
            areas[*other as usize] += node.area * weight / total;
        }
    }
    areas
}

/// Shares `w > 0` of candidates at `x_j` (control spacings) in what stands at 0: local maximum-entropy weights (Arroyo and Ortiz,
/// *Local maximum-entropy approximation schemes*,
/// 2006, eqs. 24 to 28), the smoothest with
///
/// ```text
/// sum w_j = 1,   sum w_j x_j = 0,   w_j = exp(-beta |x_j|^2 + lambda . x_j) / Z(lambda),   beta = 1
/// ```
///
/// `lambda` minimises `log Z`, whose gradient is `sum w_j x_j` and whose Hessian is the scatter of the `x_j` about it. Where 0 is not
/// between the candidates (the end of a strip) the moment cannot
/// be kept and comes as near as the steps bring it.
fn shares(candidates: &[(u32, Vector2<Real>)]) -> Vec<Real> {
    let weights_at = |lambda: &Vector2<Real>| {
        let exponents: Vec<Real> = candidates.iter().map(|(_, x)| lambda.dot(x) - x.norm_squared()).collect();
        let most = exponents.iter().copied().fold(Real::NEG_INFINITY, Real::max);
        let weights: Vec<Real> = exponents.iter().map(|e| (e - most).exp()).collect();
        let sum: Real = weights.iter().sum();
        (most + sum.ln(), weights.into_iter().map(|w| w / sum).collect::<Vec<Real>>())
    };
    let mut lambda = Vector2::zeros();
    let (mut log_z, mut weights) = weights_at(&lambda);
    for _ in 0..NEWTON_STEPS {
        let mean: Vector2<Real> = candidates.iter().zip(&weights).map(|((_, x), w)| x * *w).sum();
        if mean.norm() < MOMENT_TOLERANCE {
            break;
        }
        let scatter: Matrix2<Real> = candidates.iter().zip(&weights).map(|((_, x), w)| (x - mean) * (x - mean).transpose() * *w).sum();
        // Candidates on one line have no scatter across it, and need none.
        let ridge = 1e-9 * scatter.trace().max(1e-9);
        let Some(inverse) = (scatter + Matrix2::identity() * ridge).try_inverse() else { break };
        let step = -(inverse * mean);
        // Halved until log Z falls: it is convex.
        let Some((next, found)) =
            (0..20).map(|k| lambda + step * 0.5_f64.powi(k)).map(|next| (next, weights_at(&next))).find(|(_, (z, _))| *z < log_z)
        else {
            break;
        };
        lambda = next;
        (log_z, weights) = found;
    }
    weights
}

/// How many points at edges cannot be touched: no control point of their own leaf or around it lies on their face
/// (`control_normals`: those of the control points), or fewer than two other points of that face are within `reach`
/// (m), that of the implicit surface, which then has no direction there.
pub(crate) fn unresolved(tree: &SphereTree, samples: Samples, control_normals: &[Vec3], neighbours: &Rows, reach: Real) -> usize {
    let Samples { points, normals, .. } = samples;
    let of_leaf = |leaf: usize| {
        let leaves = || std::iter::once(leaf as u32).chain(neighbours.row(leaf).iter().copied());
        let own = || tree.leaf(leaf).points();
        let bends = |normal: &Vec3| normal.dot(&control_normals[leaf]) < CREASE_COSINE;
        if !leaves().any(|other| bends(&control_normals[other as usize])) && !own().any(|k| bends(&normals[k])) {
            return 0;
        }
        let is_unresolved = |&p: &usize| {
            let same = |normal: &Vec3| normals[p].dot(normal) > SAME_FACE;
            let others = leaves().flat_map(|other| tree.leaf(other as usize).points());
            let near = others.filter(|&k| k != p && same(&normals[k]) && (points[k] - points[p]).norm_squared() < reach * reach);
            !leaves().any(|other| same(&control_normals[other as usize])) || near.take(2).count() < 2
        };
        own().filter(is_unresolved).count()
    };
    (0..control_normals.len()).into_par_iter().map(of_leaf).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{PointSurface, Surface, shapes};

    fn box_of(n: usize) -> (Vec3, Surface) {
        let size = Vec3::new(0.02, 0.03, 0.06);
        (size, Surface::build(shapes::sample_box(size, n).unwrap(), None).unwrap())
    }

    #[test]
    fn control_points_of_a_box_reach_its_edges_and_none_stands_beyond_them() {
        for n in [400, 2_000, 9_001] {
            let (size, surface) = box_of(n);
            let half = size * 0.5;
            let mut reach: [Vec3; 6] = [Vec3::zeros(); 6];
            for (point, normal) in surface.control.points.iter().zip(&surface.control.normals) {
                assert!(
                    point.iter().zip(half.iter()).all(|(x, h)| x.abs() <= h * (1.0 + 1e-9)),
                    "{n} points: a control point at {point:?}"
                );
                let face = 2 * normal.iamax() + usize::from(normal[normal.iamax()] < 0.0);
                reach[face] = reach[face].sup(&point.abs());
            }
            let worst = reach.iter().map(|r| (half - r).amax()).fold(0.0, Real::max);
            println!("{n} points: outermost control points {worst:.1e} m inside the edge");
            assert!(worst < 1e-9, "{n} points: outermost control points {worst:e} m inside the edge");
        }
    }

    #[test]
    fn a_linear_pressure_on_a_face_has_the_force_and_moments_of_its_points() {
        for n in [2_000, 9_001] {
            let (size, surface) = box_of(n);
            let (control, mut worst): (_, Real) = (&surface.control, 0.0);
            for (axis, sign) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
                let on_face = |normal: &Vec3| normal[axis] * sign > 0.9;
                let moments = |points: &[Vec3], normals: &[Vec3], areas: &[Real]| {
                    let face = points.iter().zip(normals).zip(areas).filter(|((_, normal), _)| on_face(normal));
                    face.fold((0.0, Vec3::zeros()), |(area, first), ((p, _), a)| (area + a, first + p * *a))
                };
                let (area, first) = moments(&control.points, &control.normals, &control.areas);
                let (true_area, true_first) = moments(&surface.points, &surface.normals, &surface.areas);
                worst = worst.max((area / true_area - 1.0).abs()).max((first - true_first).norm() / (true_area * size.x));
            }
            println!("{n} points: force and moments off by {worst:.1e}");
            assert!(worst < 1e-9, "{n} points: force or moment off by {worst:e}");
        }
    }

    #[test]
    fn round_and_open_surfaces_have_no_edges() {
        let shapes = [
            ("sphere", shapes::sample_sphere(0.01, 300).unwrap()),
            ("capsule", shapes::sample_capsule(0.01, 0.04, 600).unwrap()),
            ("fingertip", shapes::sample_fingertip(Vec3::new(0.012, 0.0085, 0.007), 2_400).unwrap()),
            ("half-space", shapes::sample_half_space(0.1, 900).unwrap()),
        ];
        for (name, points) in shapes {
            let surface = Surface::build(points, None).unwrap();
            let of_leaves = (0..surface.control.len()).map(|leaf| surface.tree.leaf(leaf).area);
            assert!(surface.control.areas.iter().copied().eq(of_leaves), "{name}: control points were moved");
            assert_eq!(surface.unresolved, 0, "{name}");
        }
    }

    #[test]
    fn an_outer_edge_has_control_points_and_an_inner_one_has_none() {
        // A step: floor z = 0 for x < 0, wall x = 0 up to z = 1, top z = 1 for x > 0. Inner edge at the bottom of the wall,
        // outer edge at its top.
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        let (cells, spacing) = (20, 0.05);
        for i in 0..cells {
            for j in 0..cells {
                let (u, v) = ((i as Real + 0.5) * spacing, (j as Real + 0.5) * spacing);
                points.extend([Vec3::new(-u, v, 0.0), Vec3::new(0.0, v, u), Vec3::new(u, v, 1.0)]);
                normals.extend([Vec3::z(), -Vec3::x(), Vec3::z()]);
            }
        }
        let areas = vec![spacing * spacing; points.len()];
        let surface = Surface::build(PointSurface::new(points, normals, areas).unwrap(), None).unwrap();
        let on_edge = |z: Real| surface.control.points.iter().filter(|p| p.x.hypot(p.z - z) < 1e-9).count();
        let (outer, inner) = (on_edge(1.0), on_edge(0.0));
        println!("{outer} control points on the outer edge, {inner} on the inner one");
        assert!(outer >= 8 && inner == 0, "{outer} control points on the outer edge, {inner} on the inner one");
    }
}
