"""Files in, raw geometry out: which formats are known, and how each is read.

One rule for all formats: what is there is read, with a warning that names what was left out or mended; or an error names the line or the
element.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.errors import InvalidShapeError, InvalidValueError, ObjectFileError, QuasirigidError
from quasirigid.objects.ply import read_ply
from quasirigid.objects.raw import EXPORT_HINT, RawGeometry, unreadable
from quasirigid.objects.stl import read_stl

__all__ = ["FORMATS", "RawGeometry", "read_file"]

MESH_FORMATS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
POINT_FORMATS = (".xyz", ".npy")
FORMATS = MESH_FORMATS + POINT_FORMATS


def read_file(path: str | os.PathLike[str]) -> RawGeometry:
    """Reads a mesh or a point cloud, chosen by the file's extension.

    Scenes of several meshes are concatenated, with their transforms applied. A scene that holds faces and loose points keeps the faces.
    What is wrong with the content is said with the file's name alone: of an upload the rest of the path means nothing to whoever made it.

    Raises:
        ObjectFileError: missing file, directory, unknown extension, unreadable or empty file.
        InvalidShapeError: an array or a table with another number of columns than 3 or 6.
        InvalidValueError: vertices that are not finite.
    """
    file = Path(path)
    if not file.exists():
        raise ObjectFileError(f"object file {file}", "an existing file", "no such file", "check the path")
    if file.is_dir():
        raise ObjectFileError(f"object file {file}", "a file", "a directory", "give the path of one file in it")
    extension = file.suffix.lower()
    if extension not in FORMATS:
        got = f"extension {file.suffix!r}" if file.suffix else "no extension"
        raise ObjectFileError(f"object file {file.name}", f"one of {', '.join(FORMATS)}", got, "convert the file to one of these formats")
    try:
        size = file.stat().st_size
        with file.open("rb"):
            pass
    except OSError as error:
        raise ObjectFileError(
            f"object file {file}", "a readable file", error.strerror or error, "check the permissions of the file"
        ) from error
    if size == 0:
        raise ObjectFileError(f"object file {file.name}", "a mesh or points", "an empty file (0 bytes)", EXPORT_HINT)

    readers = {
        ".npy": _read_npy,
        ".xyz": _read_xyz,
        ".ply": read_ply,
        ".stl": read_stl,
        ".obj": _read_obj,
        ".glb": _read_gltf,
        ".gltf": _read_gltf,
    }
    try:
        raw = readers.get(extension, _read_mesh)(file)
    except QuasirigidError:
        raise
    except Exception as error:  # the format readers raise whatever they stumble on: IndexError, struct.error, KeyError ...
        got = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise unreadable(file, "content", f"a readable {file.suffix} file", got) from error
    if len(raw.vertices) == 0:
        raise ObjectFileError(f"object file {file.name}", "faces or points", "neither", EXPORT_HINT)
    _check_finite_vertices(file, raw.vertices)
    if raw.faces is not None:
        _check_faces(file, raw.faces, len(raw.vertices))
    return raw


def _check_faces(file: Path, faces: IntArray, count: int) -> None:
    wrong = (faces < 0) | (faces >= count)
    if wrong.any():
        number = int(np.argmax(wrong.any(axis=1)))
        got = f"vertex number {int(faces[wrong][0])} in triangle {number}"
        raise unreadable(file, "faces", f"vertex numbers from 0 to {count - 1}", got)


def _check_finite_vertices(file: Path, vertices: FloatArray) -> None:
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise InvalidValueError(
            f"vertices of {file.name}",
            "finite coordinates only",
            f"{int(bad.sum())} of {len(vertices)} vertices with NaN or infinity, the first at position {int(np.argmax(bad))}",
            "remove or repair these vertices",
        )


def _read_mesh(file: Path) -> RawGeometry:
    """What trimesh reads: OFF, and after checks of our own OBJ and glTF."""
    scene = trimesh.load_scene(file, process=False)
    items = [(scene.graph[node], scene.geometry) for node in scene.graph.nodes_geometry]
    vertices: list[FloatArray] = []
    faces: list[IntArray] = []
    clouds: list[FloatArray] = []
    loose = 0
    offset = 0
    for (transform, name), geometries in items:
        geometry: Any = geometries[name]
        matrix = np.asarray(transform, dtype=np.float64)
        if getattr(geometry, "vertices", None) is None:
            continue
        with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is counted and refused later
            points = np.asarray(geometry.vertices, dtype=np.float64).reshape(-1, 3)
            if not np.array_equal(matrix, np.eye(4)):
                points = points @ matrix[:3, :3].T + matrix[:3, 3]
        triangles = getattr(geometry, "faces", None)
        if triangles is not None and len(triangles) > 0:
            triangles = np.asarray(triangles, dtype=np.int64)
            _check_faces(file, triangles, len(points))
            if np.linalg.det(matrix[:3, :3]) < 0.0:  # a mirror turns every triangle inside out
                triangles = triangles[:, ::-1]
            vertices.append(points)
            faces.append(triangles + offset)
            offset += len(points)
        elif len(points) > 0:
            clouds.append(points)
            loose += len(points)
    if faces:
        notes = (f"{loose} loose points beside the faces are left out",) if loose else ()
        return RawGeometry(np.concatenate(vertices), np.concatenate(faces), None, notes)
    if clouds:
        return RawGeometry(np.concatenate(clouds), None, None)
    raise ObjectFileError(f"object file {file.name}", "faces or points", "neither", EXPORT_HINT)


def _read_obj(file: Path) -> RawGeometry:
    """Vertices and faces are checked line by line; then trimesh reads the file."""
    corners = 0
    whole = file.read_bytes().replace(b"\\\r\n", b"  ").replace(b"\\\n", b" ").decode("latin-1")
    for number, line in enumerate(whole.split("\n"), start=1):
        words = line.split("#", 1)[0].split()
        if not words or words[0] not in ("v", "f"):
            continue
        if words[0] == "v":
            corners += 1
            try:
                good = len([float(word) for word in words[1:4]]) == 3
            except ValueError:
                good = False
            if not good:
                raise unreadable(file, f"line {number}", "v x y z", repr(line.strip()[:60]))
        else:
            _check_obj_face(file, number, line, words[1:], corners)
    return _read_mesh(file)


def _check_obj_face(file: Path, number: int, line: str, words: list[str], corners: int) -> None:
    try:
        named = [int(word.split("/", 1)[0]) for word in words]
    except ValueError:
        named = []
    if len(named) < 3 or 0 in named or min(named) < -corners:
        expected = f"f with three or more vertex numbers, from 1 on, or from -1 down to -{corners}"
        raise unreadable(file, f"line {number}", expected, repr(line.strip()[:60]))


TRIANGLE_FAN = 6
"""A way to draw faces in glTF that trimesh leaves out."""


def _read_gltf(file: Path) -> RawGeometry:
    content = file.read_bytes()
    if file.suffix.lower() == ".glb":
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    described = json.loads(content)
    pieces = [piece for mesh in described.get("meshes", ()) for piece in mesh.get("primitives", ())]
    fans = sum(piece.get("mode") == TRIANGLE_FAN for piece in pieces)
    if fans and fans == len(pieces):
        raise unreadable(file, "faces", "triangles or triangle strips", f"{fans} pieces, all of them triangle fans")
    raw = _read_mesh(file)
    if not fans:
        return raw
    notes = (*raw.warnings, f"{fans} pieces made of triangle fans left out")
    return RawGeometry(raw.vertices, raw.faces, raw.normals, notes)


def _read_npy(file: Path) -> RawGeometry:
    try:
        _check_npy_size(file)
        table = np.load(file, allow_pickle=False)
        if table.dtype.kind not in "fiub":
            raise ValueError(f"an array of type {table.dtype}")
        table = np.asarray(table, dtype=np.float64)
    except Exception as error:  # ValueError, EOFError, SyntaxError of a broken header ...
        got = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise ObjectFileError(
            f"object file {file.name}", "one array of numbers in NumPy's format", got, "save it with numpy.save"
        ) from error
    return _from_table(file, table)


def _check_npy_size(file: Path) -> None:
    """Refuses a header that speaks of more than the file holds: NumPy would make room for it first."""
    with file.open("rb") as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = read(stream)
        needed, there = math.prod(shape) * kind.itemsize, file.stat().st_size - stream.tell()
    if needed > there:
        raise ValueError(f"{there} bytes of an array of shape {shape}, which has {needed}")


def _read_xyz(file: Path) -> RawGeometry:
    try:
        text = file.read_text(encoding="utf-8", errors="strict")
    except (OSError, UnicodeDecodeError) as error:
        raise ObjectFileError(f"object file {file.name}", "a text file", f"{type(error).__name__}: {error}", EXPORT_HINT) from error
    rows: list[list[float]] = []
    for number, line in enumerate(text.replace(",", " ").replace(";", " ").splitlines(), start=1):
        fields = line.split("#", 1)[0].split("//", 1)[0].split()
        if not fields:
            continue
        try:
            row = [float(field) for field in fields]
        except ValueError as error:
            if not rows:  # a line of column names
                continue
            got = f"{line.strip()[:60]!r} in line {number}"
            raise ObjectFileError(f"object file {file.name}", "numbers", got, "mark comments with #") from error
        if not rows and len(row) == 1:  # some programs write the number of points first
            continue
        if rows and len(row) != len(rows[0]):
            expected = f"{len(rows[0])} columns, as in the lines before"
            raise InvalidShapeError(f"object file {file.name}", expected, f"{len(row)} in line {number}", "repair that line")
        rows.append(row)
    if not rows:
        raise ObjectFileError(f"object file {file.name}", "lines of x y z [nx ny nz]", "no line of numbers", EXPORT_HINT)
    return _from_table(file, np.asarray(rows, dtype=np.float64))


def _from_table(file: Path, table: FloatArray) -> RawGeometry:
    if table.ndim != 2 or table.shape[1] not in (3, 6):
        hint = "columns are x y z, or x y z nx ny nz"
        raise InvalidShapeError(f"points of {file.name}", "a table of shape (n, 3) or (n, 6)", f"shape {table.shape}", hint)
    if len(table) == 0:
        raise ObjectFileError(f"object file {file.name}", "faces or points", f"neither: an empty table of shape {table.shape}", EXPORT_HINT)
    points = np.ascontiguousarray(table[:, :3])
    # Whether columns 4 to 6 are normals, or colours say, is seen from the points: the engine looks.
    return RawGeometry(points, None, np.ascontiguousarray(table[:, 3:]) if table.shape[1] == 6 else None)
