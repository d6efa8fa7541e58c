"""Files in, raw geometry out: which formats are known, and how each is read. Nothing is repaired here."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from quasirigid.errors import InvalidShapeError, InvalidValueError, ObjectFileError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

MESH_FORMATS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
POINT_FORMATS = (".xyz", ".npy")
FORMATS = MESH_FORMATS + POINT_FORMATS

EXPORT_HINT = "export the object again, or convert it with another program"


@dataclass(frozen=True, eq=False)
class RawGeometry:
    """What a file holds, in the file's own units and frame.

    Attributes:
        vertices: (n, 3).
        faces: (m, 3) vertex numbers, or None for a bare point cloud.
        normals: (n, 3), for a point cloud that stores them; not normalised yet.
        warnings: what was met and left out.
    """

    vertices: Array
    faces: IntArray | None
    normals: Array | None
    warnings: tuple[str, ...] = ()


def read_file(path: str | os.PathLike[str]) -> RawGeometry:
    """Reads a mesh or a point cloud, chosen by the file's extension.

    Scenes of several meshes are concatenated, with their transforms applied. A scene that holds faces and loose points keeps the faces. What is wrong
    with the content is said with the file's name alone: of an upload the rest of the path means nothing to whoever made it.

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

    if extension == ".npy":
        raw = _read_npy(file)
    elif extension == ".xyz":
        raw = _read_xyz(file)
    else:
        raw = _read_mesh(file)
    if len(raw.vertices) == 0:
        raise ObjectFileError(f"object file {file.name}", "faces or points", "neither", EXPORT_HINT)
    _check_finite_vertices(file, raw.vertices)
    return raw


def _check_finite_vertices(file: Path, vertices: Array) -> None:
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise InvalidValueError(
            f"vertices of {file.name}",
            "finite coordinates only",
            f"{int(bad.sum())} of {len(vertices)} vertices with NaN or infinity, the first at position {int(np.argmax(bad))}",
            "remove or repair these vertices",
        )


def _read_mesh(file: Path) -> RawGeometry:
    try:
        scene = trimesh.load_scene(file, process=False)
        items = [(scene.graph[node], scene.geometry) for node in scene.graph.nodes_geometry]
    except Exception as error:  # the format readers raise whatever they stumble on: IndexError, struct.error, KeyError ...
        got = f"{type(error).__name__}: {error}"
        raise ObjectFileError(f"object file {file.name}", f"a readable {file.suffix} file", got, EXPORT_HINT) from error

    vertices: list[Array] = []
    faces: list[IntArray] = []
    clouds: list[tuple[Array, Array | None]] = []
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
            if triangles.min() < 0 or triangles.max() >= len(points):
                got = f"vertex number {int(triangles.max() if triangles.max() >= len(points) else triangles.min())}"
                raise ObjectFileError(f"faces of {file.name}", f"vertex numbers below {len(points)}", got, EXPORT_HINT)
            if np.linalg.det(matrix[:3, :3]) < 0.0:  # a mirror turns every triangle inside out
                triangles = triangles[:, ::-1]
            vertices.append(points)
            faces.append(triangles + offset)
            offset += len(points)
        elif len(points) > 0:
            clouds.append((points, _stored_normals(geometry, len(points))))
            loose += len(points)
    if faces:
        notes = (f"{loose} loose points beside the faces are left out",) if loose else ()
        return RawGeometry(np.concatenate(vertices), np.concatenate(faces), None, notes)
    if clouds:
        all_normals = [normals for _, normals in clouds if normals is not None]
        normals = np.concatenate(all_normals) if len(all_normals) == len(clouds) == 1 else None
        return RawGeometry(np.concatenate([points for points, _ in clouds]), None, normals)
    raise ObjectFileError(f"object file {file.name}", "faces or points", "neither", EXPORT_HINT)


def _stored_normals(cloud: Any, count: int) -> Array | None:
    """Normals of a PLY point cloud: trimesh keeps them only in the raw elements."""
    try:
        data = cloud.metadata["_ply_raw"]["vertex"]["data"]
        columns = [np.asarray(data[name], dtype=np.float64).reshape(-1) for name in ("nx", "ny", "nz")]
    except (AttributeError, KeyError, TypeError, ValueError, IndexError):
        return None
    normals = np.stack(columns, axis=1)
    return normals if len(normals) == count else None


def _read_npy(file: Path) -> RawGeometry:
    try:
        table = np.load(file, allow_pickle=False)
        table = np.asarray(table, dtype=np.float64)
    except Exception as error:  # ValueError, EOFError, SyntaxError of a broken header ...
        got = f"{type(error).__name__}: {error}"
        raise ObjectFileError(
            f"object file {file.name}", "one array of numbers in NumPy's format", got, "save it with numpy.save"
        ) from error
    return _from_table(file, table)


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


def _from_table(file: Path, table: Array) -> RawGeometry:
    if table.ndim != 2 or table.shape[1] not in (3, 6):
        hint = "columns are x y z, or x y z nx ny nz"
        raise InvalidShapeError(f"points of {file.name}", "a table of shape (n, 3) or (n, 6)", f"shape {table.shape}", hint)
    points = np.ascontiguousarray(table[:, :3])
    if table.shape[1] == 3:
        return RawGeometry(points, None, None)
    extra = np.ascontiguousarray(table[:, 3:])
    with np.errstate(invalid="ignore"):
        # Lengths cannot tell colours 0 to 1 from normals; whole numbers up to 255 can only be colours.
        colours = bool(
            np.isfinite(extra).all() and (extra >= 0).all() and (extra <= 255).all() and extra.max() > 2 and (extra % 1 == 0).all()
        )
    if colours:
        return RawGeometry(points, None, None, ("columns 4 to 6 look like colours (whole numbers up to 255), not normals: left out",))
    return RawGeometry(points, None, extra)
