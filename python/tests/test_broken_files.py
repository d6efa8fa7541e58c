"""Files that are not quite what their format says: what is there is read, with a warning; or an error names the line or the element."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from test_objects import BOX, quiet

from quasirigid.cli.app import main
from quasirigid.errors import DegenerateSurfaceError, InvalidShapeError, InvalidValueError, ObjectFileError, QuasirigidError
from quasirigid.objects import load_object
from quasirigid.objects.raw import strip_triangles

VOLUME = math.prod(BOX)


def box_stl() -> bytes:
    data = trimesh.creation.box(BOX).export(file_type="stl")
    assert isinstance(data, bytes)
    return data


def box_text_stl() -> str:
    text = trimesh.creation.box(BOX).export(file_type="stl_ascii")
    assert isinstance(text, str)
    return text


# STL ----------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda data: data + b"made by some program", "20 bytes behind the last triangle left out"),
        (lambda data: data + bytes(3), "3 bytes behind"),
        (lambda data: data[:80] + struct.pack("<I", 0) + data[84:], "counts 0 triangles, the file has 12"),
        (lambda data: data[:80] + struct.pack("<I", 2**32 - 1) + data[84:], "the file has 12"),
        (lambda data: data[:80] + struct.pack("<I", 7) + data[84:], "counts 7 triangles, the file has 12"),
        (lambda data: b"solid of a program" + data[18:] + b"\n", "1 bytes behind"),
    ],
    ids=["trailing text", "trailing zeros", "count 0", "count of all ones", "count too small", "binary that begins with solid"],
)
def test_binary_stl_whose_length_does_not_fit_is_read_with_a_warning(tmp_path: Path, spoil: Callable[[bytes], bytes], words: str) -> None:
    (tmp_path / "box.stl").write_bytes(spoil(box_stl()))
    box = quiet(tmp_path / "box.stl", points=100)
    assert box.watertight
    assert box.volume == pytest.approx(VOLUME, rel=1e-5)
    assert any(words in note for note in box.warnings), box.warnings


def test_stl_that_is_cut_off_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    (tmp_path / "cut.stl").write_bytes(box_stl()[:-70])
    (tmp_path / "cut_text.stl").write_text(box_text_stl()[:-200])
    for name, words in (("cut.stl", "counts 12 triangles, the file has 10"), ("cut_text.stl", "cut off")):
        box = quiet(tmp_path / name, points=100)
        assert not box.watertight
        assert any(words in note for note in box.warnings), box.warnings


def test_a_short_vertex_of_a_text_stl_is_an_error_with_its_line(tmp_path: Path) -> None:
    lines = box_text_stl().splitlines()
    at = next(k for k, line in enumerate(lines) if "vertex" in line)
    lines[at] = "vertex 1.0 2.0"
    (tmp_path / "short.stl").write_text("\n".join(lines))
    with pytest.raises(ObjectFileError, match=f"line {at + 1} of short.stl"):
        load_object(tmp_path / "short.stl")


# PLY ----------------------------------------------------------------------------------------------------------------------------------


def ply(layout: str, elements: list[tuple[str, list[str], list[list[float | list[int]]]]]) -> bytes:
    """A PLY file from (name, properties, rows); lists are of int with a count of uchar."""
    head = ["ply", f"format {layout} 1.0", "comment made by hand"]
    for name, properties, rows in elements:
        head += [f"element {name} {len(rows)}", *(f"property {prop}" for prop in properties)]
    body = b""
    for _, _, rows in elements:
        for row in rows:
            if layout == "ascii":
                words = [f"{len(v)} {' '.join(map(str, v))}" if isinstance(v, list) else f"{v:.9g}" for v in row]
                body += (" ".join(words) + "\n").encode()
            else:
                order = "<" if "little" in layout else ">"
                for value in row:
                    listed = isinstance(value, list)
                    body += struct.pack(f"{order}B{len(value)}i", len(value), *value) if listed else struct.pack(f"{order}f", value)  # type: ignore[arg-type, misc]
    return ("\n".join([*head, "end_header"]) + "\n").encode() + body


MESH = trimesh.creation.box(BOX)
POSITIONS = ["float x", "float y", "float z"]
CORNERS = "list uchar int vertex_indices"
VERTICES: list[list[float | list[int]]] = [list(map(float, row)) for row in MESH.vertices]
TRIANGLES = [[int(i) for i in face] for face in MESH.faces]
LAYOUTS = ["ascii", "binary_little_endian", "binary_big_endian"]
STRIP = [i for face in TRIANGLES for i in (*face, -1)]
LONG_STRIP = [0, 1, 2, 3, -1, 4, 5, 6]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_triangle_strips_are_faces(tmp_path: Path, layout: str) -> None:
    (tmp_path / "strips.ply").write_bytes(ply(layout, [("vertex", POSITIONS, VERTICES), ("tristrips", [CORNERS], [[STRIP]])]))
    box = load_object(tmp_path / "strips.ply", points=200)
    assert (box.kind, box.watertight, box.warnings) == ("mesh", True, ())
    assert box.volume == pytest.approx(VOLUME, rel=1e-6)


def test_every_second_triangle_of_a_strip_is_wound_the_other_way() -> None:
    expected = [[0, 1, 2], [2, 1, 3], [4, 5, 6]]
    assert strip_triangles(np.array(LONG_STRIP)).tolist() == expected
    assert strip_triangles(np.array([-1, -1, 7, 8, 9, 9, 10, 11, -1, 1, 2])).tolist() == [[7, 8, 9], [10, 9, 11]]
    assert strip_triangles(np.array([1, 2])).shape == (0, 3)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("element", ["face", "polygons"])
def test_faces_of_any_number_of_corners_in_any_element_are_read(tmp_path: Path, layout: str, element: str) -> None:
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4]]
    faces: list[list[float | list[int]]] = [[face] for face in [*quads, [1, 5, 7], [1, 7, 3], [4, 5]]]
    corners = [[x, y, z] for x in (-0.03, 0.03) for y in (-0.025, 0.025) for z in (-0.04, 0.04)]
    (tmp_path / "mixed.ply").write_bytes(ply(layout, [("vertex", POSITIONS, list(map(list, corners))), (element, [CORNERS], faces)]))
    box = quiet(tmp_path / "mixed.ply", points=200)
    assert (box.kind, box.watertight) == ("mesh", True)
    assert box.volume == pytest.approx(VOLUME, rel=1e-6)
    assert "1 faces with fewer than three corners left out" in box.warnings
    assert (element == "face") == ("faces taken from element polygons" not in box.warnings)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_ply_that_is_cut_off_says_which_element(tmp_path: Path, layout: str) -> None:
    content = ply(layout, [("vertex", POSITIONS, VERTICES), ("face", [CORNERS], [[face] for face in TRIANGLES])])
    vertices = ply(layout, [("vertex", POSITIONS, VERTICES), ("face", [CORNERS], [[face] for face in TRIANGLES])]).split(b"end_header\n")
    (tmp_path / "faces.ply").write_bytes(content[: -15 if layout != "ascii" else -8])
    box = quiet(tmp_path / "faces.ply", points=100)
    assert any("element face ends early" in note for note in box.warnings), box.warnings
    (tmp_path / "vertices.ply").write_bytes(vertices[0] + b"end_header\n" + vertices[1][:50])
    with pytest.raises(ObjectFileError, match=r"line|element vertex"):
        load_object(tmp_path / "vertices.ply")


# All formats: an error with its place -------------------------------------------------------------------------------------------------

CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
HEAD = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"

BROKEN: list[tuple[str, str, type[QuasirigidError], str]] = [
    ("two.obj", "v 0 0\nf 1 1 1\n", ObjectFileError, "line 1 of two.obj"),
    ("word.obj", CUBE + "v 1 two 3\nf 1 2 3\n", ObjectFileError, "line 5 of word.obj"),
    ("zero.obj", CUBE + "f 0 1 2\n", ObjectFileError, "line 5 of zero.obj"),
    ("back.obj", CUBE + "f -1 -2 -9\n", ObjectFileError, "line 5 of back.obj"),
    ("beyond.obj", CUBE + "f 1 2 9\n", ObjectFileError, "beyond.obj"),
    ("short.obj", CUBE + "f 1 2\n", ObjectFileError, "line 5 of short.obj"),
    ("short.ply", HEAD + "end_header\n0 0 0\n1 0\n0 1 0\n", ObjectFileError, "line 9 of short.ply"),
    ("word.ply", HEAD + "end_header\n0 0 0\n1 x 0\n0 1 0\n", ObjectFileError, "line 9 of word.ply"),
    ("type.ply", HEAD.replace("float y", "real y") + "end_header\n", ObjectFileError, "line 5 of type.ply"),
    ("endless.ply", HEAD, ObjectFileError, "end_header"),
    ("minus.ply", HEAD.replace("vertex 3", "vertex -3") + "end_header\n", ObjectFileError, "line 3 of minus.ply"),
    ("flat.ply", HEAD.replace("property float z\n", "") + "end_header\n0 0\n1 0\n1 1\n", ObjectFileError, "element vertex of flat.ply"),
    ("none.ply", "ply\nformat ascii 1.0\nend_header\n", ObjectFileError, "element vertex"),
    (
        "list.ply",
        HEAD + f"element face 1\nproperty {CORNERS}\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n",
        ObjectFileError,
        "line 13 of list.ply",
    ),
    (
        "index.ply",
        HEAD + f"element face 1\nproperty {CORNERS}\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
        ObjectFileError,
        "vertex number 7",
    ),
    ("short.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n0 1\n0 0 1\n3 0 1 2\n", ObjectFileError, "short.off"),
    ("ragged.xyz", "1 2 3\n4 5\n", InvalidShapeError, "line 2"),
]


@pytest.mark.parametrize(("name", "text", "error", "words"), BROKEN, ids=[case[0] for case in BROKEN])
def test_what_cannot_be_read_is_an_error_with_its_line_or_element_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, text: str, error: type[QuasirigidError], words: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(error) as caught:
        load_object(tmp_path / name)
    assert words in str(caught.value), str(caught.value)
    assert main(["grasp", "--object", str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said


@pytest.mark.parametrize("shape", [(0, 3), (0, 6), (0,), (3, 0), (1, 6)])
def test_an_empty_array_is_an_error_of_ours(tmp_path: Path, shape: tuple[int, ...]) -> None:
    np.save(tmp_path / "empty.npy", np.zeros(shape))
    with pytest.raises((ObjectFileError, InvalidShapeError, DegenerateSurfaceError)):
        load_object(tmp_path / "empty.npy")


def test_an_array_that_is_larger_than_its_file_or_complex_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "small.npy", np.zeros((100, 3)))
    content = (tmp_path / "small.npy").read_bytes().replace(b"(100, 3)", b"(10**9,)")
    (tmp_path / "bomb.npy").write_bytes(content.replace(b"(10**9,)", b"(9999999999, 3)".ljust(8))[: len(content)])
    np.save(tmp_path / "complex.npy", np.zeros((100, 3), dtype=complex))
    for name in ("bomb.npy", "complex.npy"):
        with pytest.raises(ObjectFileError, match=name):
            load_object(tmp_path / name)


def test_triangle_fans_of_gltf_are_named(tmp_path: Path) -> None:
    for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box(BOX))).items():
        text = data.replace(b'"mode": 4', b'"mode": 6').replace(b'"mode":4', b'"mode":6') if name.endswith(".gltf") else data
        (tmp_path / name).write_bytes(text)
    with pytest.raises(ObjectFileError, match="fans"):
        load_object(tmp_path / "model.gltf")


def test_mutated_files_end_in_a_surface_or_an_error_of_ours(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    seeds = [
        ("stl", box_stl()),
        ("stl", box_text_stl().encode()),
        *(
            ("ply", ply(layout, [("vertex", POSITIONS, VERTICES), ("face", [CORNERS], [[face] for face in TRIANGLES])]))
            for layout in LAYOUTS
        ),
        (
            "obj",
            b"".join(b"v %f %f %f\n" % tuple(row) for row in MESH.vertices)
            + b"".join(b"f %d %d %d\n" % tuple(row + 1) for row in MESH.faces),
        ),
        ("off", trimesh.creation.box(BOX).export(file_type="off").encode()),
        ("glb", trimesh.creation.box(BOX).export(file_type="glb")),
    ]
    for turn in range(240):
        kind, content = seeds[turn % len(seeds)]
        data = bytearray(content)
        for _ in range(rng.integers(1, 5)):
            at = int(rng.integers(len(data)))
            way = rng.integers(4)
            if way == 0:
                data[at] = int(rng.integers(256))
            elif way == 1:
                del data[at : at + int(rng.integers(1, 40))]
            elif way == 2:
                data[at:at] = data[at // 2 : at // 2 + 20]
            else:
                data[at : at + 4] = bytes(rng.choice([0, 255, 45, 57], 4).tolist())
        file = tmp_path / f"{turn}.{kind}"
        file.write_bytes(data)
        try:
            quiet(file, points=60)
        except (QuasirigidError, InvalidValueError):
            continue
        finally:
            file.unlink()
