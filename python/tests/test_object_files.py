"""Files and arguments that cannot be used: a typed error that says what was expected, what came, and what to do."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from test_objects import BOX, save

from quasirigid.errors import DegenerateSurfaceError, InvalidShapeError, InvalidValueError, ObjectFileError, QuasirigidError
from quasirigid.objects import load_object


def _text(text: str) -> Callable[[Path], None]:
    return lambda path: path.write_text(text) and None


GARBAGE = "\x00\x01garbage" * 20

BAD_FILES: list[tuple[str, Callable[[Path], object], type[QuasirigidError], str]] = [
    ("missing.obj", lambda path: None, ObjectFileError, "no such file"),
    ("folder.obj", lambda path: path.mkdir(), ObjectFileError, "a directory"),
    ("thing.step", _text("x"), ObjectFileError, ".obj, .ply, .stl, .off, .glb, .gltf, .xyz, .npy"),
    ("thing", _text("x"), ObjectFileError, "no extension"),
    ("empty.obj", _text(""), ObjectFileError, "empty file"),
    ("comment.obj", _text("# nothing\n"), ObjectFileError, "neither"),
    ("garbage.glb", _text(GARBAGE), ObjectFileError, "readable .glb"),
    ("garbage.ply", _text(GARBAGE), ObjectFileError, "got"),
    ("garbage.stl", _text(GARBAGE), ObjectFileError, "got"),
    ("garbage.npy", _text(GARBAGE), ObjectFileError, "NumPy"),
    ("words.xyz", _text("1 2 3\n4 five 6\n"), ObjectFileError, "line 2"),
    ("ragged.xyz", _text("1 2 3\n4 5\n"), InvalidShapeError, "line 2"),
    ("none.xyz", _text("# x y z\n"), ObjectFileError, "no line of numbers"),
    ("binary.xyz", lambda path: path.write_bytes(b"\xff\xfe\x00\xd8"), ObjectFileError, "text file"),
    ("range.obj", _text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"), ObjectFileError, "range.obj"),
    ("nan.obj", _text("v 0 0 nan\nv 1 0 inf\nv 0 1 0\nf 1 2 3\n"), InvalidValueError, "2 of 3 vertices"),
    ("few.xyz", _text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n"), DegenerateSurfaceError, "at least 50"),
    ("line.obj", _text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), DegenerateSurfaceError, "area"),
    ("sheet.obj", _text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n"), DegenerateSurfaceError, "thickness"),
    ("spot.npy", lambda path: np.save(path, np.ones((60, 3))), DegenerateSurfaceError, "one place"),
    ("flat.npy", lambda path: np.save(path, np.random.default_rng(0).random((60, 3)) * (1, 1, 0)), DegenerateSurfaceError, "sheet"),
    ("wide.npy", lambda path: np.save(path, np.ones((60, 4))), InvalidShapeError, "(60, 4)"),
    ("nan.npy", lambda path: np.save(path, np.full((60, 3), np.nan)), InvalidValueError, "60 of 60"),
    ("none.npy", lambda path: np.save(path, np.zeros((0, 3))), ObjectFileError, "neither"),
    ("words.npy", lambda path: np.save(path, np.array(["a", "b"])), ObjectFileError, "array of numbers"),
    ("millimetres.stl", lambda path: save(trimesh.creation.box((60, 50, 80)), path), InvalidValueError, "pass scale=0.001"),
    ("tiny.stl", lambda path: save(trimesh.creation.box((6e-5, 5e-5, 8e-5)), path), InvalidValueError, "size=0.08"),
]


@pytest.mark.parametrize(("name", "make", "error", "words"), BAD_FILES, ids=[case[0] for case in BAD_FILES])
def test_unusable_file_is_a_typed_error_with_expected_got_hint(
    tmp_path: Path, name: str, make: Callable[[Path], object], error: type[QuasirigidError], words: str
) -> None:
    file = tmp_path / name
    make(file)
    with pytest.raises(error) as caught:
        load_object(file)
    assert words in str(caught.value), str(caught.value)
    assert name in ("missing.obj", "folder.obj") or str(tmp_path) not in str(caught.value), "the way there means nothing to who uploads it"
    assert all((caught.value.what, caught.value.expected, caught.value.got, caught.value.hint))
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize(
    ("keyword", "value"),
    [(name, value) for name in ("scale", "size", "density", "mass") for value in (0.0, -1.0, math.nan, math.inf, "1", True)]
    + [("points", 0), ("points", 49), ("points", 1e4), ("points", -5), ("points", 10**9), ("points", 2**70), ("seed", -1), ("seed", 0.5)],
)
def test_bad_argument_is_a_typed_error(tmp_path: Path, keyword: str, value: object) -> None:
    file = save(trimesh.creation.box(BOX), tmp_path / "box.stl")
    with pytest.raises(InvalidValueError, match=keyword):
        load_object(file, **{keyword: value})  # type: ignore[arg-type]


def test_scale_with_size_and_a_scale_that_spoils_are_refused(tmp_path: Path) -> None:
    file = save(trimesh.creation.box(BOX), tmp_path / "box.stl")
    with pytest.raises(InvalidValueError, match="one of the two"):
        load_object(file, scale=1.0, size=0.1)
    with pytest.raises(InvalidValueError, match="leave out scale"):
        load_object(file, scale=0.001)
    with pytest.raises(InvalidValueError, match="extent"):
        load_object(file, size=3.0)


def test_file_errors_are_caught_as_os_errors_and_as_ours(tmp_path: Path) -> None:
    for kind in (OSError, QuasirigidError):
        with pytest.raises(kind):
            load_object(tmp_path / "missing.obj")
