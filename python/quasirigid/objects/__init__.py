"""Objects from files: meshes and point clouds in, an even point surface with mass properties out."""

from __future__ import annotations

import math
import os
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from quasirigid._quasirigid import _screen_cloud
from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.errors import DegenerateSurfaceError, InvalidValueError, SurfaceWarning
from quasirigid.objects.files import FORMATS, RawGeometry, read_file
from quasirigid.objects.mass import Solid, is_physical, solid_of_hull, solid_of_mesh
from quasirigid.objects.mesh import CleanMesh, cap_holes, clean_mesh, corner_normals
from quasirigid.objects.orientation import Up, rotation_of
from quasirigid.objects.sampling import has_duplicates, sample_mesh, thin_out

__all__ = ["DEFAULT_DENSITY", "DEFAULT_POINTS", "FORMATS", "ObjectGeometry", "load_object"]


DEFAULT_DENSITY = 1000.0
"""kg/m^3, that of water: right within a factor of two for food, plastic bottles and wood."""

DEFAULT_POINTS = 20_000
"""Points on a sampled mesh: 1.1 mm apart on an object of 8 cm."""

MIN_POINTS, MAX_POINTS = 50, 5_000_000
"""Fewer do not make a surface; more fill the memory of a machine, and are 0.1 mm apart on the largest object a hand grasps."""

SMALLEST, LARGEST = 1e-3, 2.0
"""m. Objects whose largest extent is outside count as a mistake in the units."""

MAX_CAP_SHARE = 0.25
"""Holes that take more of the closed surface than this are not filled in for the mass properties: the convex hull is used instead."""

UNITS = (("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254))


@dataclass(frozen=True, eq=False)
class ObjectGeometry:
    """A rigid object as a point surface, with its mass properties.

    All in SI units, in the object's own frame: the axes of the file, turned as asked for; the origin at the centre of mass unless
    `centre=False` was given. The arrays are read-only.

    Attributes:
        name: the file's name without extension.
        points: (n, 3) surface points, m.
        normals: (n, 3) outward unit normals, or None for a point cloud that has none (the engine then estimates them).
        areas: (n,) area that each point stands for, m^2, or None for a point cloud.
        mass: kg.
        centre_of_mass: (3,), m.
        inertia: (3, 3) about the centre of mass, kg m^2.
        extents: (3,) size of the bounding box along x, y, z, m.
        volume: m^3; see `mass_source`.
        watertight: whether the mesh is closed and consistently wound; False for a point cloud.
        kind: "mesh" or "points".
        mass_source: where volume, centre of mass and inertia come from: "volume" of a closed mesh, "capped" (holes closed by flat caps), or
            "hull" (convex hull).
        warnings: what was found in the file and what was done about it.
        vertices: (v, 3) of the mesh, m, for viewers; None for a point cloud.
        faces: (f, 3) of the mesh; None for a point cloud.
    """

    name: str
    points: FloatArray
    normals: FloatArray | None
    areas: FloatArray | None
    mass: float
    centre_of_mass: FloatArray
    inertia: FloatArray
    extents: FloatArray
    volume: float
    watertight: bool
    kind: Literal["mesh", "points"]
    mass_source: Literal["volume", "capped", "hull"]
    warnings: tuple[str, ...] = ()
    vertices: FloatArray | None = None
    faces: IntArray | None = None

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)


def load_object(
    path: str | os.PathLike[str],
    *,
    scale: float | None = None,
    size: float | None = None,
    points: int = DEFAULT_POINTS,
    density: float | None = None,
    mass: float | None = None,
    centre: bool = True,
    seed: int = 0,
    up: Up = "z",
    rotate: str | None = None,
) -> ObjectGeometry:
    """Reads an object from a file and makes it a point surface with mass properties.

    Meshes (OBJ, PLY, STL, OFF, GLB, GLTF) are sampled evenly with exactly `points` points. Bare point clouds (PLY without faces, XYZ, NPY;
    columns x y z or x y z nx ny nz) keep their own points, evenly thinned out if there are more than `points`, and without those that stray
    from the surface. Normals that come with a cloud are checked against its points: colours are left out, inward ones turned, and ones
    without a common side oriented. The axes are those of the file, where z is taken to point up, unless `up` or `rotate` turn it.

    Args:
        path: the file.
        scale: factor on the coordinates, such as 0.001 for a file in millimetres. Default 1.
        size: instead of `scale`: the largest extent that the object shall have, m.
        points: number of surface points, from 50 to 5,000,000.
        density: kg/m^3. Default 1000.
        mass: kg; overrides the density.
        centre: move the centre of mass to the origin.
        seed: of the sampling; the same seed gives the same points.
        up: the axis of the file that points up: "y" for most modelling programs. It becomes z.
        rotate: rotations about the world's axes after that, in degrees, such as "90 about x" or "90 about x, 45 about z".

    Raises:
        ObjectFileError: missing file, directory, unknown extension, unreadable or empty file.
        UnknownNameError: an `up` that is no axis.
        InvalidValueError: a bad argument, vertices that are not finite, or an object smaller than 1 mm or larger than 2 m.
        InvalidShapeError: a table of points with another number of columns than 3 or 6.
        DegenerateSurfaceError: fewer than 50 points, no area, or no volume (a flat sheet).

    Warns:
        SurfaceWarning: for each entry of `warnings` in the result, such as holes.
    """
    count = _check_count(points)
    _check_number("seed", seed, ">= 0", lambda v: v >= 0 and float(v).is_integer(), "give a whole number")
    for what, value, unit in (("scale", scale, "-"), ("size", size, "m"), ("density", density, "kg/m^3"), ("mass", mass, "kg")):
        if value is not None:
            _check_number(what, value, f"> 0 ({unit})", lambda v: v > 0, "give a positive value in SI units")
    if scale is not None and size is not None:
        raise InvalidValueError("scale and size", "one of the two", f"scale={scale} and size={size}", "leave one out")

    rotation = rotation_of(up, rotate)
    file = Path(path)
    raw = read_file(file)
    raw = _turned(_scaled(raw, scale, size, file.name), rotation)
    rng = np.random.default_rng(int(seed))
    density_used = DEFAULT_DENSITY if density is None else float(density)
    geometry = (_from_cloud if raw.faces is None else _from_mesh)(raw, file, count, density_used, rng)
    if mass is not None:
        geometry = replace(geometry, mass=float(mass), inertia=geometry.inertia * (float(mass) / geometry.mass))
    if centre:
        geometry = _centred(geometry)
    for note in geometry.warnings:
        warnings.warn(f"{file.name}: {note}", SurfaceWarning, stacklevel=2)
    return geometry


def _check_number(what: str, value: object, expected: str, fits: object, hint: str) -> None:
    good = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool) and math.isfinite(value)
    if not good or not fits(value):  # type: ignore[operator]
        raise InvalidValueError(what, f"a finite number {expected}", repr(value), hint)


def _check_count(points: object) -> int:
    if not isinstance(points, (int, np.integer)) or isinstance(points, bool) or not MIN_POINTS <= points <= MAX_POINTS:
        expected = f"a whole number from {MIN_POINTS} to {MAX_POINTS}"
        raise InvalidValueError("points", expected, repr(points), f"{DEFAULT_POINTS} suits most objects")
    return int(points)


def _scaled(raw: RawGeometry, scale: float | None, size: float | None, what: str) -> RawGeometry:
    used = raw.vertices if raw.faces is None else raw.vertices[np.unique(_faces_with_corners(raw.faces))]
    extent = float(np.ptp(used, axis=0).max())
    if extent == 0.0:
        raise DegenerateSurfaceError(what, "points that span a volume", "all points in one place", "export the object again")
    if not math.isfinite(extent):
        raise InvalidValueError(what, "coordinates of a sensible size", "coordinates too large for arithmetic", "repair the file")
    factor = size / extent if size is not None else (1.0 if scale is None else scale)
    result = extent * factor
    if not SMALLEST <= result <= LARGEST:
        hint = _scale_hint(extent, scale)
        got = f"{extent:.4g} m" if factor == 1.0 else f"{extent:.4g} x {factor:g} = {result:.4g} m"
        raise InvalidValueError(f"largest extent of {what}", f"between {SMALLEST:g} and {LARGEST:g} m", got, hint)
    if factor == 1.0:
        return raw
    return RawGeometry(raw.vertices * factor, raw.faces, raw.normals, raw.warnings)


def _turned(raw: RawGeometry, rotation: FloatArray) -> RawGeometry:
    if np.array_equal(rotation, np.eye(3)):
        return raw
    normals = None if raw.normals is None else raw.normals @ rotation.T
    return RawGeometry(np.ascontiguousarray(raw.vertices @ rotation.T), raw.faces, normals, raw.warnings)


def _faces_with_corners(faces: IntArray) -> IntArray:
    """Those with three different corners: others are dropped later, and must not count for the size. All if there are none of these."""
    good: IntArray = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    return good if len(good) else faces


def _scale_hint(extent: float, scale: float | None) -> str:
    if scale is not None and SMALLEST <= extent <= LARGEST:
        return f"the file's own figures fit: leave out scale={scale:g}"
    # An object that a hand can grasp is between 1 cm and 40 cm in size.
    for name, factor in UNITS:
        if 0.01 <= extent * factor <= 0.4:
            return f"looks like {name}: pass scale={factor:g} (that makes it {extent * factor:.3g} m)"
    return "pass scale, or size=0.08 to make it 8 cm"


def _from_mesh(raw: RawGeometry, file: Path, count: int, density: float, rng: np.random.Generator) -> ObjectGeometry:
    assert raw.faces is not None
    mesh = clean_mesh(raw.vertices, raw.faces, file.name)
    solid, source, notes = _solid(mesh, file.name)
    points, face, barycentric = sample_mesh(mesh.vertices, mesh.faces, count, rng)
    corners = mesh.vertices[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(cross, axis=1).sum())
    normals = np.einsum("ij,ijk->ik", barycentric, corner_normals(mesh.vertices, mesh.faces)[face])
    # Across a crease in a coarse mesh the mean of the corners can vanish or turn; the face itself is then the better witness.
    turned = np.einsum("ij,ij->i", normals, cross[face]) <= 0.0
    normals[turned] = cross[face][turned]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return ObjectGeometry(
        name=file.stem,
        points=points,
        normals=normals,
        areas=np.full(count, area / count),
        mass=density * solid.volume,
        centre_of_mass=solid.centre,
        inertia=density * solid.inertia,
        extents=np.ptp(mesh.vertices, axis=0),
        volume=solid.volume,
        watertight=mesh.watertight,
        kind="mesh",
        mass_source=source,
        warnings=raw.warnings + mesh.warnings + notes,
        vertices=mesh.vertices,
        faces=mesh.faces,
    )


def _solid(mesh: CleanMesh, what: str) -> tuple[Solid, Literal["volume", "capped", "hull"], tuple[str, ...]]:
    """Mass properties by the best means that the mesh allows."""
    hull = solid_of_hull(mesh.vertices, what)
    if mesh.watertight:
        solid = solid_of_mesh(mesh.vertices, mesh.faces)
        if is_physical(solid):
            return solid, "volume", ()
        return hull, "hull", ("the closed surface does not enclose a sensible volume: mass properties are those of the convex hull",)
    vertices, faces, share = cap_holes(mesh.vertices, mesh.faces)
    solid = solid_of_mesh(vertices, faces)
    if share <= MAX_CAP_SHARE and is_physical(solid) and 0.01 * hull.volume < solid.volume <= hull.volume * (1.0 + 1e-9):
        return solid, "capped", (f"not watertight: for the mass properties the holes were capped ({100.0 * share:.2g} % of the surface)",)
    return hull, "hull", ("not watertight: mass properties are those of the convex hull",)


def _from_cloud(raw: RawGeometry, file: Path, count: int, density: float, rng: np.random.Generator) -> ObjectGeometry:
    del rng  # thinning out leaves nothing to chance
    notes = list(raw.warnings)
    points, normals_given = raw.vertices, raw.normals
    if has_duplicates(points):
        _, first = np.unique(points, axis=0, return_index=True)
        first = np.sort(first)
        notes.append(f"{len(points) - len(first)} duplicate points dropped")
        points = points[first]
        normals_given = None if normals_given is None else normals_given[first]
    if len(points) < MIN_POINTS:
        hint = "a surface needs more points, or faces to sample"
        raise DegenerateSurfaceError(file.name, f"at least {MIN_POINTS} different points", f"{len(points)}", hint)
    normals_given = None if normals_given is None else _usable(normals_given, notes)
    kept, normals_given, met = _screen_cloud(points, normals_given)
    notes += met
    points = np.ascontiguousarray(points[kept])
    solid = solid_of_hull(points, file.name)
    normals = None if normals_given is None else _outward(points, normals_given, solid.centre, notes)
    extents = np.ptp(points, axis=0)
    if len(points) > count:
        keep = thin_out(points, normals, count)
        points = np.ascontiguousarray(points[keep])
        normals = None if normals is None else np.ascontiguousarray(normals[keep])
    notes.append("points without faces: mass properties are those of the convex hull")
    return ObjectGeometry(
        name=file.stem,
        points=points,
        normals=normals,
        areas=None,
        mass=density * solid.volume,
        centre_of_mass=solid.centre,
        inertia=density * solid.inertia,
        extents=extents,
        volume=solid.volume,
        watertight=False,
        kind="points",
        mass_source="hull",
        warnings=tuple(notes),
    )


def _usable(normals: FloatArray, notes: list[str]) -> FloatArray | None:
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(normals, axis=1)
    bad = ~(np.isfinite(lengths) & (lengths > 1e-12))
    if bad.any():
        notes.append(f"normals left out: {int(bad.sum())} of {len(normals)} are zero or not finite")
        return None
    unit: FloatArray = normals / lengths[:, None]
    return unit


def _outward(points: FloatArray, unit: FloatArray, middle: FloatArray, notes: list[str]) -> FloatArray:
    # For a closed surface sampled evenly, sum n . (p - c) is three times the volume over the area of a point: negative means inward
    # normals.
    if float(np.einsum("ij,ij->", unit, points - middle)) < 0.0:
        notes.append("normals pointed inward: turned outward")
        unit = -unit
    return unit


def _centred(geometry: ObjectGeometry) -> ObjectGeometry:
    shift = geometry.centre_of_mass
    return replace(
        geometry,
        points=geometry.points - shift,
        vertices=None if geometry.vertices is None else geometry.vertices - shift,
        centre_of_mass=np.zeros(3),
    )
