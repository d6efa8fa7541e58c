"""Pads with all their triangles where they yield, and with few elsewhere: a page that draws in software pays for every triangle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from quasirigid.view.meshes import few_points, in_bands, open_mesh
from quasirigid.view.scene import BodyView, IntArray, Moved

FAR = 1e-4
"""How far the triangles may be from a part of the pad that does not yield, m: half a pixel."""
YIELDS = 6e-6
"""A point that has moved by more has all its triangles, m: what the view promises, less what changes unsent (``SHAPE_TOLERANCE``)."""
FINE, SAFE = 1.5e-3, 1.0e-3
"""Points nearer than ``FINE`` to such a point get theirs too, m: the patch may grow by ``SAFE`` before the triangles are made anew."""
SHRUNK = 0.5
"""They are also made anew, to save triangles, when no more than this share of the points that yielded then does so now."""


class PadDetail:
    """Which triangles a pad is drawn with. Their corners are points of the pad."""

    def __init__(self, body: BodyView) -> None:
        self._rest, self._normals = body.points, body.normals
        self._few = few_points(body.points, body.normals, FAR)
        self._safe: npt.NDArray[np.bool_] = np.zeros(len(body.points), dtype=bool)
        self._yielded = 0
        self.faces: IntArray = body.faces
        """(m, 3) triangles of points."""
        self._all = body.faces
        self._build(self._safe)

    def follow(self, moved: Moved | None) -> bool:
        """The pad has yielded so; says whether ``faces`` are others now."""
        yielding = np.zeros(len(self._rest), dtype=bool)
        if moved is not None:
            way = moved.points - self._rest[moved.indices]
            yielding[moved.indices] = np.einsum("ij,ij->i", way, way) > YIELDS**2
        if not (yielding & ~self._safe).any() and np.count_nonzero(yielding) >= SHRUNK * self._yielded:
            return False
        self._build(yielding)
        return True

    def _near(self, chosen: npt.NDArray[np.bool_], distance: float) -> npt.NDArray[np.bool_]:
        if not chosen.any():
            return chosen
        gap, _ = cKDTree(self._rest[chosen]).query(self._rest, distance_upper_bound=distance)
        near: npt.NDArray[np.bool_] = np.isfinite(gap)
        return near

    def _build(self, yielding: npt.NDArray[np.bool_]) -> None:
        self._yielded, self._safe = int(np.count_nonzero(yielding)), self._near(yielding, SAFE)
        kept = np.union1d(self._few, np.flatnonzero(self._near(yielding, FINE)))
        faces = open_mesh(self._rest, self._normals, kept)
        self.faces = self._all if faces is None else in_bands(self._rest, faces)
