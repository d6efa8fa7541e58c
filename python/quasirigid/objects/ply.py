"""PLY files: text and binary of both byte orders, faces of any number of corners, triangle strips, bare clouds with normals.

Format: G. Turk, The PLY polygon file format (1994). An element is a table; a property is a column, or a list of numbers in every row.
Vertices are the element ``vertex``. Faces are whatever else has a list ``vertex_indices`` or ``vertex_index``: polygons in ``face``, strips
with -1 between them in ``tristrips``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.errors import ObjectFileError
from quasirigid.objects.raw import RawGeometry, fans, strip_triangles, unreadable

TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"}
TYPES |= {
    f"{kind}{bits}": f"{kind[0]}{bits // 8}"
    for kind in ("int", "uint", "float")
    for bits in (8, 16, 32, 64)
    if (kind, bits) != ("float", 8)
}
"""NumPy's names of the types: the old words, and the ones with the bits in them."""
CORNERS = ("vertex_indices", "vertex_index")
LONGEST_HEADER = 1 << 20
"""Bytes. A real one has some hundred."""


@dataclass
class Property:
    """A column of an element: ``count`` is the type of a list's length, None for a single number."""

    name: str
    type: str
    count: str | None


@dataclass(eq=False)
class Element:
    """A table of the file, and what was read of it: numbers by property, lists of rows by property."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)
    columns: dict[str, FloatArray] = field(default_factory=dict)
    lists: dict[str, list[IntArray]] = field(default_factory=dict)
    missing: int = 0


def read_ply(file: Path) -> RawGeometry:
    """Reads a PLY file. Faces that are missing at its end, or that have fewer than three corners, are left out with a warning.

    Raises:
        ObjectFileError: what is wrong, with the line of the text or the element.
    """
    content = file.read_bytes()
    layout, elements, start, lines = _header(file, content)
    if layout == "ascii":
        _read_text(file, content[start:], elements, lines)
    else:
        _read_binary(file, content, start, elements, "<" if "little" in layout else ">")

    vertex = next((element for element in elements if element.name == "vertex"), None)
    if vertex is None or vertex.rows == 0:
        raise unreadable(file, "header", "an element vertex with rows", "none")
    lacking = [axis for axis in "xyz" if axis not in vertex.columns]
    if lacking:
        raise unreadable(file, "element vertex", "properties x, y and z", f"no {', '.join(lacking)}")
    if vertex.missing:
        raise unreadable(file, "element vertex", f"{vertex.rows} rows", f"{vertex.rows - vertex.missing}: the file is cut off")
    points = np.stack([vertex.columns[axis] for axis in "xyz"], axis=1)
    notes: list[str] = []
    triangles = [_triangles(element, notes) for element in elements if element is not vertex]
    faces = np.concatenate([np.zeros((0, 3), dtype=np.int64), *triangles])
    if len(faces):
        return RawGeometry(points, faces, None, tuple(notes))
    names = ("nx", "ny", "nz")
    normals = np.stack([vertex.columns[name] for name in names], axis=1) if all(name in vertex.columns for name in names) else None
    return RawGeometry(points, None, normals, tuple(notes))


def _header(file: Path, content: bytes) -> tuple[str, list[Element], int, int]:
    """Layout, elements, where the data begin (bytes), and how many lines the header has."""
    if not content[:3].lower() == b"ply":
        raise unreadable(file, "line 1", "ply", repr(content[:20]))
    layout, elements, position, number = "", [], 0, 0
    while True:
        end = content.find(b"\n", position, LONGEST_HEADER)
        if end < 0:
            raise unreadable(file, "header", "a line end_header", f"none in {number} lines")
        words = content[position:end].decode("latin-1").split()
        position, number = end + 1, number + 1
        kind = words[0].lower() if words else ""
        try:
            if kind == "end_header":
                break
            if kind == "format":
                layout = words[1].lower()
            elif kind == "element":
                elements.append(Element(words[1], int(words[2])))
                if elements[-1].rows < 0:
                    raise ValueError
            elif kind == "property":
                listed = words[1] == "list"
                types = [TYPES[word.lower()] for word in words[1 + listed : 3 + listed if listed else 2]]
                elements[-1].properties.append(Property(words[-1], types[-1], types[0] if listed else None))
                if len(words) != (5 if listed else 3):
                    raise ValueError
        except (IndexError, KeyError, ValueError):
            got = repr(" ".join(words)[:60])
            raise unreadable(file, f"line {number}", "an element or a property of the PLY format", got) from None
    if layout not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise unreadable(file, "header", "format ascii, binary_little_endian or binary_big_endian", repr(layout))
    return layout, elements, position, number


def _read_text(file: Path, body: bytes, elements: list[Element], before: int) -> None:
    lines = body.decode("latin-1").split("\n")
    full = [number for number, line in enumerate(lines) if line and not line.isspace()]
    at = 0
    for element in elements:
        mine = full[at : at + element.rows]
        at += len(mine)
        element.missing = element.rows - len(mine)
        rows = [lines[number].split() for number in mine]
        listed = any(prop.count for prop in element.properties)
        if not listed:
            width = len(element.properties)
            _check_rows(file, rows, mine, before, lambda row, width=width: len(row) >= width, f"{width} numbers")
            table = _numbers(file, [row[:width] for row in rows], mine, before)
            for column, prop in enumerate(element.properties):
                element.columns[prop.name] = table[:, column] if len(rows) else np.zeros(0)
            continue
        for row, number in zip(rows, mine, strict=True):
            try:
                _text_row(file, element, row, before + number + 1)
            except ObjectFileError:
                if not (element.missing and number == full[-1]):
                    raise
                element.missing += 1  # the file is cut off within its last line


def _check_rows(file: Path, rows: list[list[str]], numbers: list[int], before: int, fits: object, expected: str) -> None:
    for row, number in zip(rows, numbers, strict=True):
        if not fits(row):  # type: ignore[operator]
            raise unreadable(file, f"line {before + number + 1}", expected, repr(" ".join(row)[:60]))


def _numbers(file: Path, rows: list[list[str]], numbers: list[int], before: int) -> FloatArray:
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError:
        for row, number in zip(rows, numbers, strict=True):
            try:
                np.array(row, dtype=np.float64)
            except ValueError:
                raise unreadable(file, f"line {before + number + 1}", "numbers", repr(" ".join(row)[:60])) from None
        raise


def _text_row(file: Path, element: Element, row: list[str], line: int) -> None:
    """One row of an element that has lists. Of the numbers beside them nothing is needed."""
    at = 0
    for prop in element.properties:
        try:
            length = int(float(row[at])) if prop.count else 1
            begin = at + 1 if prop.count else at
            if length < 0 or begin + length > len(row):
                raise ValueError
            if prop.count and prop.name in CORNERS:
                values = np.array(row[begin : begin + length], dtype=np.float64)
                if not (np.abs(values) < 2**53).all():
                    raise ValueError
                element.lists.setdefault(prop.name, []).append(values.astype(np.int64))
            at = begin + length
        except (ValueError, IndexError, OverflowError):
            expected = f"a row of element {element.name}: as many numbers as its lists say"
            raise unreadable(file, f"line {line}", expected, repr(" ".join(row)[:60])) from None


def _read_binary(file: Path, content: bytes, position: int, elements: list[Element], order: str) -> None:
    for element in elements:
        if element.rows == 0:
            continue
        if not element.properties:
            raise unreadable(file, f"element {element.name}", "at least one property", "none")
        left = len(content) - position
        if not any(prop.count for prop in element.properties):
            kind = np.dtype([(str(k), order + prop.type) for k, prop in enumerate(element.properties)])
            there = min(element.rows, left // kind.itemsize)
            table = np.frombuffer(content, dtype=kind, count=there, offset=position)
            for k, prop in enumerate(element.properties):
                element.columns[prop.name] = table[str(k)].astype(np.float64)
            element.missing = element.rows - there
            position += there * kind.itemsize
        else:
            position = _binary_lists(content, position, element, order)
        if element.missing:  # what follows is not where it should be
            position = len(content)


def _binary_lists(content: bytes, position: int, element: Element, order: str) -> int:
    """Reads the lists of an element; returns where it ends. As many rows at once as have lists of the same lengths as the first of them."""
    row = 0
    while row < element.rows:
        kind = _row_type(content, position, element, order)
        if kind is None:
            break
        there = min(element.rows - row, (len(content) - position) // kind.itemsize)
        table = np.frombuffer(content, dtype=kind, count=there, offset=position)
        same = np.ones(there, dtype=bool)
        for k, prop in enumerate(element.properties):
            if prop.count:
                same &= table[f"n{k}"] == table[f"n{k}"][0]
        alike = there if same.all() else int(np.argmin(same))
        for k, prop in enumerate(element.properties):
            if prop.count and prop.name in CORNERS:
                with np.errstate(invalid="ignore"):
                    element.lists.setdefault(prop.name, []).extend(table[str(k)][:alike].astype(np.int64))
        row += alike
        position += alike * kind.itemsize
    element.missing = element.rows - row
    return position


def _row_type(content: bytes, position: int, element: Element, order: str) -> np.dtype[np.void] | None:
    """The layout of the row at ``position``, whose lists are as long as it says; None where it does not fit in the file."""
    parts: list[tuple[str, str] | tuple[str, str, int]] = []
    at = position
    for k, prop in enumerate(element.properties):
        length = 1
        if prop.count:
            counter = np.dtype(order + prop.count)
            if at + counter.itemsize > len(content):
                return None
            said = float(np.frombuffer(content, dtype=counter, count=1, offset=at)[0])
            if not 0.0 <= said <= len(content):
                return None
            length = int(said)
            parts.append((f"n{k}", order + prop.count))
            at += counter.itemsize
        parts.append((str(k), order + prop.type, length) if prop.count else (str(k), order + prop.type))
        at += length * np.dtype(prop.type).itemsize
    return np.dtype(parts) if at <= len(content) else None


def _triangles(element: Element, notes: list[str]) -> IntArray:
    rows = next((element.lists[name] for name in CORNERS if name in element.lists), [])
    if not rows:
        return np.zeros((0, 3), dtype=np.int64)
    if element.missing:
        notes.append(f"element {element.name} ends early: {element.missing} of {element.rows} rows are missing")
    if "strip" in element.name.lower():
        return np.concatenate([strip_triangles(row) for row in rows])
    lengths = np.array([len(row) for row in rows])
    short = int((lengths < 3).sum())
    if short == len(rows):  # a grid of a range scan, say: no faces
        return np.zeros((0, 3), dtype=np.int64)
    if short:
        notes.append(f"{short} faces with fewer than three corners left out")
    sizes = [size for size in np.unique(lengths) if size >= 3]
    triangles = fans([np.stack([rows[i] for i in np.flatnonzero(lengths == size)]) for size in sizes])
    if element.name != "face":
        notes.append(f"faces taken from element {element.name}")
    return triangles
