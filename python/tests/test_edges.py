"""Edges of shapes, meshes and clouds: control points reach them, and what is sampled too thinly is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from quasirigid import Surface, load_object
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import SurfaceWarning

SIZE = np.array([0.02, 0.03, 0.06])


def shortfall(surface: Surface, size: FloatArray = SIZE) -> float:
    """By how much the outermost control points of any face of a box end inside its edge, over the half width of the face; the largest of all."""
    worst = 0.0
    points, normals = surface.control_points, surface.control_normals
    for axis in range(3):
        for sign in (1.0, -1.0):
            on_face = points[sign * normals[:, axis] > 0.9]
            across = [k for k in range(3) if k != axis]
            worst = max(worst, float((1.0 - np.abs(on_face[:, across]).max(axis=0) / (0.5 * size[across])).max()))
    return worst


@pytest.mark.parametrize("points", [2_000, 4_000, 9_000])
def test_control_points_of_a_box_reach_its_edges_whatever_it_is_made_of(points: int, tmp_path: Path) -> None:
    mesh = trimesh.creation.box(SIZE)
    mesh.export(tmp_path / "box.obj")
    loaded = load_object(tmp_path / "box.obj", points=points)
    middle = 0.5 * (loaded.points.min(axis=0) + loaded.points.max(axis=0))
    assert np.abs(middle).max() < 1e-3
    surfaces = {
        "shape": Surface.box(SIZE, points=points),
        "mesh": Surface.from_points(loaded.points, loaded.normals, loaded.areas),
        "cloud with normals": Surface.from_points(loaded.points, loaded.normals),
    }
    found = {name: shortfall(surface) for name, surface in surfaces.items()}
    print(f"{points} points: the base ends inside the edge by", {name: f"{share:.2%}" for name, share in found.items()})
    assert max(found.values()) < 0.01, found


def test_a_face_too_narrow_for_its_sampling_is_said() -> None:
    with pytest.warns(SurfaceWarning, match="too narrow"):
        surface = Surface.box((1e-3, 0.06, 0.06), points=3_000, control_points=2)
    assert surface.unresolved > 100
    assert Surface.box((1e-3, 0.06, 0.06), points=3_000).unresolved == 0
