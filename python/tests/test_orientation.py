"""Which way is up: axes and rotations in words, in Python and on the command line, and what the planner suggests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from test_objects import quiet, save

from quasirigid.cli.app import main
from quasirigid.errors import InvalidValueError, UnknownNameError
from quasirigid.grasp.plan import plan_grasp
from quasirigid.objects import load_object
from quasirigid.objects.orientation import SIDES, rotation_of, suggestion

AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}


@pytest.mark.parametrize("up", SIDES)
def test_the_axis_that_is_named_points_up_and_nothing_is_mirrored(tmp_path: Path, up: str) -> None:
    rotation = rotation_of(up)
    assert np.array_equal(rotation @ AXES[up], (0.0, 0.0, 1.0))
    assert np.linalg.det(rotation) == 1.0
    cone = trimesh.creation.cone(0.02, 0.06)  # the tip is at +z
    file = save(cone, tmp_path / "cone.ply")
    turned = quiet(file, points=500, up=up)
    plain = quiet(file, points=500)
    np.testing.assert_allclose(turned.inertia, rotation @ plain.inertia @ rotation.T, atol=1e-12)
    np.testing.assert_allclose(sorted(turned.extents), sorted(plain.extents), atol=1e-12)
    assert turned.mass == pytest.approx(plain.mass, rel=1e-12)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("90 about x", [("x", 90)]),
        ("x 90", [("x", 90)]),
        ("-45 degrees about y", [("y", -45)]),
        ("90 about x, 30.5° about z", [("x", 90), ("z", 30.5)]),
        ("about z 1e1", [("z", 10)]),
    ],
)
def test_rotations_in_words_are_about_the_axes_of_the_world_one_after_the_other(words: str, expected: list[tuple[str, float]]) -> None:
    total = Rotation.identity()
    for axis, degrees in expected:
        total = Rotation.from_euler(axis, degrees, degrees=True) * total
    np.testing.assert_allclose(rotation_of("z", words), total.as_matrix(), atol=1e-15)


@pytest.mark.parametrize(
    "words", ["", " ", "90", "x", "90 about w", "x 90 y", "nan about x", "1.2.3 about x", "90 about x,", "upside down"]
)
def test_words_that_are_no_rotation_are_refused(words: str) -> None:
    with pytest.raises(InvalidValueError, match="90 about x"):
        rotation_of("z", words)


def test_an_axis_that_is_none_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = save(trimesh.creation.box((0.06, 0.05, 0.08)), tmp_path / "box.stl")
    with pytest.raises(UnknownNameError, match="up"):
        load_object(file, up="Y")  # type: ignore[arg-type]
    for options in (["--up", "w"], ["--rotate", "askew"]):
        assert main(["grasp", "--object", str(file), *options]) == 2
    assert main(["grasp", "--up", "y"]) == 2
    assert "add --object FILE" in capsys.readouterr().err


def test_a_refusal_says_with_which_side_up_it_could_be_taken_and_that_is_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = save(trimesh.creation.box((0.16, 0.12, 0.03)), tmp_path / "plate.stl")
    run = ["grasp", "--object", str(file), "--points", "4000", "--out", str(tmp_path / "out")]
    assert main(run) == 2
    said = capsys.readouterr().err
    assert "--up y" in said, said
    plate = quiet(file, points=4000, up="y")
    assert plan_grasp(plate.points, plate.normals).score > 0.0
    # Of one that was turned already the suggestion is about the axes of its file all the same.
    assert suggestion(rotation_of("y"), "y") == '--up -z, in Python load_object(..., up="-z")'
    assert "90 about x" in suggestion(rotation_of("z", "45 about x"), "y")
