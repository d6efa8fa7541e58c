"""STL files, text and binary, also with bytes behind the last triangle or a count of triangles that is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.objects.raw import RawGeometry, fans, unreadable

HEADER, TRIANGLE = 84, 50
"""Bytes of a binary file: 80 of text and the count of triangles; a triangle is twelve numbers and two bytes for whatever one likes."""
RECORD = np.dtype([("numbers", "<f4", (4, 3)), ("attribute", "<u2")])
SENSIBLE = 1e7
"""Coordinates beyond this are no coordinates: where the count is wrong, that tells triangles from other bytes."""


def read_stl(file: Path) -> RawGeometry:
    """Reads an STL file. What does not fit its layout is left out with a warning, as long as triangles are there.

    Raises:
        ObjectFileError: no triangle, or a line that is none of the format.
    """
    content = file.read_bytes()
    declared = int.from_bytes(content[80:84], "little") if len(content) >= HEADER else 0
    exact = len(content) == HEADER + TRIANGLE * declared and declared > 0
    if not exact and content.lstrip()[:5].lower() == b"solid" and b"facet" in content[:4096].lower() and b"\0" not in content[:4096]:
        return _read_text(file, content)
    if len(content) < HEADER + TRIANGLE:
        raise unreadable(file, "content", "an STL file with triangles", f"{len(content)} bytes that are none")
    return _read_binary(file, content, declared)


def _read_binary(file: Path, content: bytes, declared: int) -> RawGeometry:
    there = (len(content) - HEADER) // TRIANGLE
    triangles = np.frombuffer(content, dtype=RECORD, count=there, offset=HEADER)["numbers"][:, 1:].astype(np.float64)
    beyond = len(content) - HEADER - TRIANGLE * declared
    notes: list[str] = []
    if beyond:
        count = there
        whole = (len(content) - HEADER) % TRIANGLE == 0
        with np.errstate(invalid="ignore"):
            sensible = np.asarray(np.max(np.abs(triangles.reshape(there, 9)), axis=1) < SENSIBLE)
        # Bytes behind the last triangle, unless they are triangles themselves: then it is the count that is wrong.
        if 0 < declared < there and not (whole and sensible[declared:].all()):
            count = declared
        if not sensible[:count].all() or count == 0:
            raise unreadable(
                file, "content", f"the {declared} triangles that the header counts", f"{len(content) - HEADER} bytes that are none"
            )
        triangles = triangles[:count]
        if count == declared:
            notes.append(f"{beyond} bytes behind the last triangle left out")
        else:
            notes.append(f"the header counts {declared} triangles, the file has {count}: those are read")
    return _of_corners(triangles.reshape(-1, 3), notes)


def _read_text(file: Path, content: bytes) -> RawGeometry:
    corners: list[list[float]] = []
    loops: list[int] = []
    open_at = 0
    ended = False
    for number, line in enumerate(content.decode("latin-1").splitlines(), start=1):
        words = line.split()
        kind = words[0].lower() if words else ""
        if kind == "vertex":
            try:
                corner = [float(word) for word in words[1:4]]
            except ValueError:
                corner = []
            if len(corner) != 3:
                raise unreadable(file, f"line {number}", "vertex x y z", repr(line.strip()[:60]))
            corners.append(corner)
        elif kind == "endloop":
            loops.append(len(corners) - open_at)
            open_at = len(corners)
        elif kind == "endsolid":
            ended = True
    notes: list[str] = []
    if not ended or open_at < len(corners):
        notes.append("the file is cut off: it ends inside a solid")
    if any(loop != 3 for loop in loops):
        ends = np.cumsum(loops)
        polygons = [np.arange(end - loop, end)[None, :] for end, loop in zip(ends, loops, strict=True) if loop >= 3]
        faces = fans(polygons)
        notes.append(f"{sum(loop != 3 for loop in loops)} facets with another number of corners than three")
        if len(faces) == 0:
            raise unreadable(file, "content", "facets with three corners", f"{len(loops)} facets with fewer")
        return RawGeometry(np.array(corners), faces, None, tuple(notes))
    if not loops:
        raise unreadable(file, "content", "facets with three corners", f"{len(corners)} corners in none")
    return _of_corners(np.array(corners[:open_at]), notes)


def _of_corners(corners: FloatArray, notes: list[str]) -> RawGeometry:
    return RawGeometry(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3), None, tuple(notes))
