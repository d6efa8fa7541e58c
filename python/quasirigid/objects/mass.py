"""Volume, centre of mass and inertia of a closed surface or, failing that, of the convex hull."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from quasirigid.errors import DegenerateSurfaceError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

FLAT = 1e-4
"""A hull thinner than this share of its extent is a sheet: it has no volume to give a mass to."""


@dataclass(frozen=True, eq=False)
class Solid:
    """Mass properties at density 1.

    Attributes:
        volume: m^3.
        centre: centre of mass (3,), m.
        inertia: about the centre of mass (3, 3), m^5; times the density it is in kg m^2.
    """

    volume: float
    centre: Array
    inertia: Array


def solid_of_mesh(vertices: Array, faces: IntArray) -> Solid:
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


def solid_of_hull(points: Array, what: str) -> Solid:
    """Mass properties of the convex hull of points, density 1.

    Raises:
        DegenerateSurfaceError: all points lie in one plane, on one line or in one place.
    """
    hint = "a flat sheet has no volume and cannot be a rigid body; give it a thickness"
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


def is_physical(solid: Solid) -> bool:
    """Whether a rigid body can have these figures: positive volume, positive moments, none larger than the sum of the other two."""
    if not (np.isfinite(solid.volume) and solid.volume > 0.0 and np.isfinite(solid.inertia).all()):
        return False
    moments = np.linalg.eigvalsh(solid.inertia)
    return bool(moments[0] > 0.0 and moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-9))
