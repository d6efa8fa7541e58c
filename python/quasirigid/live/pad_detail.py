"""Pads with all their triangles where they deform, and with few elsewhere: a page that draws in software pays for every triangle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from quasirigid.arrays.types import IntArray
from quasirigid.scene.meshes import few_points, in_bands, open_mesh
from quasirigid.scene.model import BodyView, Moved

FAR = 1e-4
"""How far the triangles may be from a part of the pad that does not deform, m: half a pixel."""
DEFORMED_BY = 6e-6
"""A point that has moved by more has all its triangles, m: what the view promises, less what changes unsent (``SHAPE_TOLERANCE``)."""
FINE, SAFE = 1.5e-3, 1.0e-3
"""Points nearer than ``FINE`` to such a point get theirs too, m: the patch may grow by ``SAFE`` before the triangles are made again."""
SHRUNK = 0.5
"""They are also made again, to save triangles, when no more than this share of the points that were deformed then is so now."""


class PadDetail:
    """Which triangles a pad is drawn with. Their corners are points of the pad."""

    def __init__(self, body: BodyView) -> None:
        self._rest, self._normals = body.points, body.normals
        self._few = few_points(body.points, body.normals, FAR)
        self._safe: npt.NDArray[np.bool_] = np.zeros(len(body.points), dtype=bool)
        self._deformed = 0
        self.faces: IntArray = body.faces
        """(m, 3) triangles of points."""
        self._all = body.faces
        self._build(self._safe)

    def follow(self, moved: Moved | None) -> bool:
        """Take the pad as deformed; returns whether ``faces`` are others now."""
        deforming = np.zeros(len(self._rest), dtype=bool)
        if moved is not None:
            way = moved.points - self._rest[moved.indices]
            deforming[moved.indices] = np.einsum("ij,ij->i", way, way) > DEFORMED_BY**2
        if not (deforming & ~self._safe).any() and np.count_nonzero(deforming) >= SHRUNK * self._deformed:
            return False
        self._build(deforming)
        return True

    def _near(self, chosen: npt.NDArray[np.bool_], distance: float) -> npt.NDArray[np.bool_]:
        if not chosen.any():
            return chosen
        gap, _ = cKDTree(self._rest[chosen]).query(self._rest, distance_upper_bound=distance)
        near: npt.NDArray[np.bool_] = np.isfinite(gap)
        return near

    def _build(self, deforming: npt.NDArray[np.bool_]) -> None:
        self._deformed, self._safe = int(np.count_nonzero(deforming)), self._near(deforming, SAFE)
        kept = np.union1d(self._few, np.flatnonzero(self._near(deforming, FINE)))
        faces = open_mesh(self._rest, self._normals, kept)
        self.faces = self._all if faces is None else in_bands(self._rest, faces)
