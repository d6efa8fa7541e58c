"""Volume, centre of mass and inertia of a closed surface or, failing that, of the convex hull."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.errors import DegenerateSurfaceError

FLAT = 1e-4
"""A hull thinner than this share of its extent is a sheet: it has no volume to give a mass to."""


MOST_HULL_POINTS = 50_000
"""Of more points the hull is that of the outermost: on a sphere of a million, where all are on the hull, Qhull takes ten seconds."""

HULL_BINS = 64
"""Directions along each edge of the cube around the points, for `outermost`."""


@dataclass(frozen=True, eq=False)
class Solid:
    """Mass properties at density 1.

    Attributes:
        volume: m^3.
        centre: centre of mass (3,), m.
        inertia: about the centre of mass (3, 3), m^5; times the density it is in kg m^2.
    """

    volume: float
    centre: FloatArray
    inertia: FloatArray


def solid_of_mesh(vertices: FloatArray, faces: IntArray) -> Solid:
    """Mass properties of a closed, outward-wound mesh of density 1.

    Each triangle with the origin makes a tetrahedron; with corners a, b, c, determinant d = a . (b x c) and s = a + b + c:
    volume d/6, first moment d s / 24, second moment d (a a^T + b b^T + c c^T + s s^T) / 120. (F. Tonon, Explicit exact formulas for the 3-D
    tetrahedron inertia tensor, 2004, with one corner at the origin.)
    """
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    corners = (vertices - middle)[faces]
    d = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    s = corners.sum(axis=1)
    volume = float(d.sum()) / 6.0
    centre = (d @ s) / 24.0 / volume if volume != 0.0 else np.zeros(3)
    second = (np.einsum("i,ikx,iky->xy", d, corners, corners) + np.einsum("i,ix,iy->xy", d, s, s)) / 120.0
    second -= volume * np.outer(centre, centre)
    inertia = np.trace(second) * np.eye(3) - second
    return Solid(volume, centre + middle, 0.5 * (inertia + inertia.T))


def solid_of_hull(points: FloatArray, what: str) -> Solid:
    """Mass properties of the convex hull of points, density 1.

    Raises:
        DegenerateSurfaceError: all points lie in one plane, on one line or in one place.
    """
    hint = "a flat sheet has no volume and cannot be a rigid body; give it a thickness"
    if len(points) > MOST_HULL_POINTS:
        points = outermost(points)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise DegenerateSurfaceError(
            what, "points that span a volume", f"{len(points)} points in one plane, line or place", hint
        ) from error
    extent = float(np.ptp(points, axis=0).max())
    thickness = 2.0 * float(hull.volume) / float(hull.area)
    if thickness < FLAT * extent:
        raise DegenerateSurfaceError(what, "points that span a volume", f"a sheet about {thickness:.3g} m thick, {extent:.3g} m wide", hint)
    faces = np.asarray(hull.simplices, dtype=np.int64)
    # Qhull gives outward plane equations but triangles in any direction.
    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return solid_of_mesh(points, faces)


def outermost(points: FloatArray) -> FloatArray:
    """Of many points those that are farthest out as seen from their middle, one for each of `6 * HULL_BINS**2` directions: their hull
    stands for that of all.

    A hull goes with its points when they are stretched, so that directions are taken where the points are as long as they are wide and
    thick. Of a round body the hull loses 3e-4 of its volume. Corners are kept, but above `4 * MOST_HULL_POINTS` points one in some is
    looked at, and a corner can be cut off by the few spacings to the next of these.
    """
    points = points[:: max(1, len(points) // (4 * MOST_HULL_POINTS))]
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1]
    turned = centred @ axes
    reach = np.maximum(np.abs(turned).max(axis=0), np.finfo(float).tiny)
    turned /= reach
    size = np.abs(turned)
    axis = size.argmax(axis=1)
    rows = np.arange(len(points))
    longest = np.maximum(turned[rows, axis], 0.0) + np.maximum(-turned[rows, axis], 0.0)
    longest[longest == 0.0] = 1.0
    bins = 2 * axis + (turned[rows, axis] < 0.0)
    for other in (1, 2):
        share = turned[rows, (axis + other) % 3] / longest
        bins = bins * HULL_BINS + np.minimum(((share + 1.0) * (0.5 * HULL_BINS)).astype(np.int64), HULL_BINS - 1)
    # As seen from the middle of stretched points, "far" is how far out along the bin's own axis.
    radius = np.einsum("ij,ij->i", turned, turned)
    farthest = np.zeros(6 * HULL_BINS**2)
    np.maximum.at(farthest, bins, radius)
    kept: FloatArray = points[radius == farthest[bins]]
    return kept


def is_physical(solid: Solid) -> bool:
    """Whether a rigid body can have these figures: positive volume, positive moments, none larger than the sum of the other two."""
    if not (np.isfinite(solid.volume) and solid.volume > 0.0 and np.isfinite(solid.inertia).all()):
        return False
    moments = np.linalg.eigvalsh(solid.inertia)
    return bool(moments[0] > 0.0 and moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-9))
