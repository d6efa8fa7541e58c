"""What the readers of the formats hand on, and the errors that they share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.errors import ObjectFileError

EXPORT_HINT = "export the object again, or convert it with another program"


@dataclass(frozen=True, eq=False)
class RawGeometry:
    """What a file holds, in the file's own units and frame.

    Attributes:
        vertices: (n, 3).
        faces: (m, 3) vertex numbers, or None for a bare point cloud.
        normals: (n, 3), for a point cloud that stores them; not normalised yet.
        warnings: what was met and left out or mended.
    """

    vertices: FloatArray
    faces: IntArray | None
    normals: FloatArray | None
    warnings: tuple[str, ...] = ()


def unreadable(file: Path, place: str, expected: str, got: object, hint: str = EXPORT_HINT) -> ObjectFileError:
    """The error for something wrong at a ``place`` of a file, such as "line 7"; it names the file without its folder."""
    return ObjectFileError(f"{place} of {file.name}", expected, got, hint)


def fans(polygons: list[IntArray]) -> IntArray:
    """Triangles of polygons with at least three corners each, (m, 3). Each array is (k, corners): polygons with equally many."""
    parts = [polygon[:, [0, i, i + 1]] for polygon in polygons for i in range(1, polygon.shape[1] - 1)]
    return np.concatenate(parts).astype(np.int64) if parts else np.zeros((0, 3), dtype=np.int64)


def strip_triangles(strip: IntArray) -> IntArray:
    """Triangles of triangle strips, (m, 3). -1 begins a new strip; every second triangle of one is wound the other way round.

    Triangles with two equal corners are left out: they lead from one piece of a strip to the next.
    """
    triangles = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1) if len(strip) > 2 else np.zeros((0, 3), dtype=np.int64)
    places = np.arange(len(triangles))
    begins = np.maximum.accumulate(np.where(strip < 0, np.arange(1, len(strip) + 1), 0))[: len(triangles)]
    odd = (places - begins) % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    inside = (triangles >= 0).all(axis=1)
    different = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    kept: IntArray = triangles[inside & different].astype(np.int64)
    return kept
