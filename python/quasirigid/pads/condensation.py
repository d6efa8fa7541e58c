"""A mesh, left to itself but for where it is bonded and where it is touched, is a compliance between the places where it is touched."""

from __future__ import annotations

from itertools import product
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy import linalg, sparse

from quasirigid._quasirigid import ComplianceMatrix, Surface
from quasirigid.arrays.types import BoolArray, FloatArray, IntArray
from quasirigid.errors import InvalidValueError
from quasirigid.pads.elements import stiffness
from quasirigid.pads.mesh import PadMesh, pad_mesh
from quasirigid.pads.readings import cells, interpolation

__all__ = ["condense"]


def condense(
    points: npt.ArrayLike,
    elements: npt.ArrayLike,
    *,
    young_modulus: float,
    poisson_ratio: float,
    fixed: npt.ArrayLike,
    surface: Surface,
    mirrors: str = "",
    load: Literal["area", "point"] = "area",
    within: float | None = None,
) -> ComplianceMatrix:
    """The compliance of a pad, from a mesh of it, over the control points of its surface: linear elasticity, small strains.

    With ``K`` the stiffness of the mesh and ``N`` the displacements that are read at the control points, ``C = N K^-1 N^T``, so it is
    symmetric and positive semidefinite whatever the mesh. ``K`` is eliminated from the back: layer by layer of nodes, counted from those
    that are touched; time goes with the cube of the nodes in the largest layer (1,000: seconds), memory with their square.

    >>> import numpy as np
    >>> import quasirigid as qr
    >>> x, y, z = np.meshgrid(np.linspace(-0.01, 0.01, 9), np.linspace(-0.01, 0.01, 9), np.linspace(-0.005, 0, 4), indexing="ij")
    >>> number = np.arange(x.size).reshape(x.shape)
    >>> around = [(0, 0), (1, 0), (1, 1), (0, 1)]  # of a brick, below and then above
    >>> bricks = np.stack([number[i : i + 8, j : j + 8, k : k + 3].ravel() for k in (0, 1) for i, j in around], axis=1)
    >>> pad = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    >>> surface = qr.Surface.half_space(0.02, points=400, control_points=64)
    >>> matrix = qr.pads.condense(pad, bricks, young_modulus=1e6, poisson_ratio=0.45, fixed=pad[:, 2] < -0.0049, surface=surface)
    >>> material = qr.Material.preset("silicone").replace(compliance=matrix)
    >>> len(matrix)
    64

    Args:
        points: (n, 3) m, nodes, in the frame of the surface.
        elements: (m, 4) tetrahedra, in any order, or (m, 8) bricks: four corners around a face and the four opposite in the same order
            (as in VTK, Gmsh and Abaqus). Tetrahedra are made quadratic, with a node in the middle of every edge: as linear ones they lock.
        young_modulus: Pa.
        poisson_ratio: from -1 to 0.5; good up to about 0.49.
        fixed: nodes bonded to the backing: a mask (n,), or indices.
        surface: what touches; its points and control points lie on the boundary of the mesh.
        mirrors: ``"x"``, ``"y"``, ``"xy"`` and so on: the mesh is the half, quarter or eighth of the pad where these coordinates are >= 0,
            and the pad its own mirror image in each of these planes. Four to sixteen times as fast.
        load: what the force on a control point is. ``"area"``: a pressure on all of its area (that of the surface points nearest to
            it), and the mean displacement of that area; what comes out hardly depends on how fine the mesh is. ``"point"``: a force on the one point, for control points that are nodes of the mesh, as far apart as
            these: the finer, the deeper it sinks in.
        within: how far off the boundary of the mesh a control point or a surface point may be, m; without it half the spacing of the
            control points.

    Returns:
        The matrix (3m, 3m) m/N over the m control points. A control point on a fixed face does not give way.

    Raises:
        InvalidShapeError: arrays that do not fit together.
        InvalidValueError: NaN, indices out of range, elements without volume or inside out, a surface that is not on the mesh, a mesh that
            is not held in place by ``fixed``, figures that are no elastic material.
    """
    mesh = pad_mesh(points, elements, fixed)
    axes = _mirrored(mirrors, mesh)
    if load not in ("area", "point"):
        raise InvalidValueError("load", '"area" or "point"', repr(load), "see the documentation of condense")
    K = stiffness(mesh, young_modulus, poisson_ratio)
    if load == "area":
        read, share = cells(mesh, surface)
    else:
        read, share = surface.control_points, sparse.identity(len(surface.control_points), format="csr")
    tolerance = np.full(3, -1.0)
    tolerance[axes] = 1e-9 * np.ptp(mesh.points, axis=0).max()
    places = read.copy()
    places[:, axes] = abs(places[:, axes])
    weights, distance = interpolation(mesh, places, tolerance)
    limit = np.sqrt(surface.area / len(surface.control_points)) / 2 if within is None else within
    if distance.max() > limit:
        k = int(distance.argmax())
        got = (
            f"{np.count_nonzero(distance > limit)} of {len(read)} further off, up to {distance[k]:.3g} m at {np.round(read[k], 6).tolist()}"
        )
        hint = "give mesh and surface in the same frame and in m, or say within="
        raise InvalidValueError("surface", f"points within {limit:.3g} m of the boundary of the mesh", got, hint)
    layers = _layers(mesh, np.unique(weights.indices[weights.data != 0]))
    on_mirror = abs(mesh.points) <= tolerance
    compliance = np.zeros((3 * share.shape[0],) * 2)
    for parity in product((1, -1), repeat=len(axes)):
        free = ~np.repeat(mesh.fixed[:, None], 3, axis=1)
        sign = np.ones((len(read), 3))
        # Even in x: u_y and u_z are the same on both sides and u_x is opposite, so u_x = 0 on the mirror. Odd in x: the other way round.
        for axis, even in zip(axes, parity, strict=True):
            for k in range(3):
                same = even if k != axis else -even
                free[on_mirror[:, axis] & (same < 0), k] = False
                sign[read[:, axis] < 0, k] *= same
        _check_held(mesh, np.concatenate(layers), free)
        N = [share @ sparse.diags(sign[:, k]) @ weights for k in range(3)]
        compliance += _touched_compliance(K, layers, free, N) / 2 ** len(axes)
    return ComplianceMatrix((compliance + compliance.T) / 2)


def _mirrored(mirrors: str, mesh: PadMesh) -> list[int]:
    """Axes of the mirrors; none of the mesh is beyond them."""
    axes = ["xyz".find(letter) for letter in mirrors]
    if -1 in axes or len(set(axes)) < len(axes):
        raise InvalidValueError("mirrors", 'axes, such as "x" or "xy"', repr(mirrors), 'leave it out, "", where the mesh is all of the pad')
    for axis in axes:
        least, size = mesh.points[:, axis].min(), np.ptp(mesh.points, axis=0).max()
        if abs(least) > 1e-9 * size:
            hint = "give the part of the mesh on the positive side of the mirror, with nodes on it"
            raise InvalidValueError("mirrors", f"points with {'xyz'[axis]} >= 0, from 0", f"{least:.3g} m", hint)
    return axes


def _layers(mesh: PadMesh, touched: IntArray) -> list[IntArray]:
    """Nodes by how many elements they are away from the touched ones. No element joins a layer to other than itself and its neighbours."""
    rows = np.repeat(np.arange(len(mesh.elements)), mesh.elements.shape[1])
    incidence = sparse.csr_matrix((np.ones(len(rows)), (rows, mesh.elements.ravel())), shape=(len(mesh.elements), len(mesh.points)))
    seen = np.zeros(len(mesh.points), dtype=np.bool_)
    seen[touched] = True
    layers = [touched]
    while len(layers[-1]):
        edge = np.zeros(len(mesh.points))
        edge[layers[-1]] = 1
        new = (incidence.T @ (incidence @ edge) > 0) & ~seen
        seen |= new
        layers.append(np.flatnonzero(new))
    return layers[:-1]


def _check_held(mesh: PadMesh, nodes: IntArray, free: BoolArray) -> None:
    """Raises ``InvalidValueError`` if some motion as a whole leaves alone all that is held."""
    x = (mesh.points[nodes] - mesh.points[nodes].mean(axis=0)) / np.ptp(mesh.points[nodes], axis=0).max()
    turns = [np.cross(axis, x) for axis in np.eye(3)]
    motions = np.stack([*(np.broadcast_to(axis, x.shape) for axis in np.eye(3)), *turns], axis=-1)  # (nodes, 3, 6)
    held = motions[~free[nodes]]
    if len(held) < 6 or np.linalg.matrix_rank(held, tol=1e-6) < 6:
        got = f"{np.count_nonzero(mesh.fixed[nodes])} of {len(nodes)} nodes, which leave it a motion as a whole"
        hint = "give three nodes or more that are not on a line, on the part of the mesh that is touched"
        raise InvalidValueError("fixed", "nodes that hold the mesh in place", got, hint)


def _touched_compliance(K: sparse.csr_matrix, layers: list[IntArray], free: BoolArray, N: list[sparse.csr_matrix]) -> FloatArray:
    """``N K^-1 N^T`` (3m, 3m) m/N; ``N`` are the displacements along x, y and z of the m control points, by nodes, nodes of the first layer
    only.

    What lies behind layer k gives it the stiffness ``S_k = K_kk - K_k,k+1 S_k+1^-1 K_k+1,k``, from the last to the first.
    """
    unknowns = [(3 * layer[:, None] + np.arange(3))[free[layer]] for layer in layers]
    stiff = np.zeros((0, 0))
    behind: IntArray = np.zeros(0, dtype=np.int64)
    for here in reversed(unknowns):
        own = K[here][:, here].toarray()
        if len(behind):
            across = K[behind][:, here]
            used = np.unique(across.indices)  # a layer need not be joined by all of its unknowns
            half = _half(stiff, across[:, used].toarray())
            own[np.ix_(used, used)] -= half.T @ half
        stiff, behind = own, here
    m = N[0].shape[0]
    readings = np.zeros((m, 3, len(layers[0]), 3))
    for k in range(3):
        readings[:, k, :, k] = N[k][:, layers[0]].toarray()
    picked = readings.reshape(3 * m, -1)[:, free[layers[0]].ravel()]
    half = _half(stiff, picked.T)
    return np.asarray(half.T @ half)


def _half(stiff: FloatArray, right: FloatArray) -> FloatArray:
    """``L^-1 right`` for ``stiff = L L^T``, so that ``half^T half = right^T stiff^-1 right``."""
    try:
        lower = linalg.cholesky(stiff, lower=True, check_finite=False)
    except linalg.LinAlgError as error:
        got = "a piece of it that hangs on a point or an edge"
        raise InvalidValueError("elements", "a mesh whose elements are joined by faces", got, "merge nodes that coincide") from error
    return np.asarray(linalg.solve_triangular(lower, right, lower=True, check_finite=False))
