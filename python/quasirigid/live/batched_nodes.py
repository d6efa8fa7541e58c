"""Nodes of the page that change often, made so that a change is cheap to send and cheap to draw.

A page that draws in software pays for every node, every triangle and, dearly, for every new material. So bodies that look the same are
one mesh, line segments keep little spare room, and points keep their colours and only change their places.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import viser

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.scene.meshes import in_drawing_order
from quasirigid.scene.model import Colour, Moved

POSE_TOLERANCE = 1e-6
"""Poses that changed by less (m, and without unit for quaternions) are not sent again."""
SHAPE_TOLERANCE = 2e-6
"""Nor are vertices that moved by less, m: a fifth of what the view promises."""
SPARE = 32
"""Room for line segments grows and shrinks in such steps."""
LEAST_PLACES = 12
"""Places that a colour of a ``PatchPool`` has at least."""
OUT_OF_SIGHT = (0.0, 0.0, -1e4)
"""Where points wait that are not needed: far beyond what the camera sees, m."""
_SHARE = np.arange(256) / 255.0
LINEAR = (255.0 * np.where(_SHARE <= 0.04045, _SHARE / 12.92, ((_SHARE + 0.055) / 1.055) ** 2.4)).round().astype(np.uint8)
"""The page takes the colours of lines, unlike those of points and meshes, for linear light: from sRGB (IEC 61966-2-1) to that, (256,)."""


class Joined:
    """Bodies of one colour as one mesh with its vertices in world axes: one node and one drawing call, however many bodies move.

    Vertices without a triangle are not sent.
    """

    def __init__(self, server: viser.ViserServer, name: str, parts: Sequence[tuple[int, FloatArray, IntArray]], colour: Colour) -> None:
        """``parts`` are bodies: index, points at rest (n, 3) m in its frame, faces (m, 3)."""
        self.bodies = [index for index, _, _ in parts]
        """Index of the body of every part."""
        self.rows: list[IntArray] = []
        """Which vertex of the mesh every point of a part is: vertices are numbered as they are drawn."""
        self._slices: list[slice] = []
        rest, end = [], 0
        self._faces: list[IntArray] = []
        for _, points, triangles in parts:
            ordered = in_drawing_order(triangles, len(points))
            used, first = np.unique(ordered, return_index=True)
            order = np.concatenate([used[np.argsort(first)], np.setdiff1d(np.arange(len(points)), used)])
            rows = np.empty(len(points), np.int64)
            rows[order] = end + np.arange(len(points))
            rest.append(points[order])
            self._faces.append(rows[ordered])
            self.rows.append(rows)
            self._slices.append(slice(end, end + len(points)))
            end += len(points)
        self._rest = np.concatenate(rest).astype(np.float32)
        self._local = self._rest.copy()
        self._stale = True
        self.world = self._rest.copy()
        """Where the vertices are, (n, 3) m."""
        self.sent: IntArray = np.zeros(0, np.int64)
        """Which of them the page has, in its order: those that triangles are drawn with."""
        faces = self._renumbered()
        self.handle = server.scene.add_mesh_simple(
            name, self._rest[self.sent], faces, color=colour, cast_shadow=False, receive_shadow=False
        )

    def _renumbered(self) -> npt.NDArray[np.uint32]:
        """The triangles by the vertices that the page is to have from now on."""
        self.sent, faces = np.unique(np.concatenate(self._faces), return_inverse=True)
        return faces.reshape(-1, 3).astype(np.uint32)

    def deform(self, part: int, moved: Moved | None) -> None:
        """Vertices of a part are where its points are now; ``None``: at rest. Seen after the next ``place``."""
        where = self._slices[part]
        shape = self._rest[where].copy()
        if moved is not None:
            shape[self.rows[part][moved.indices] - where.start] = moved.points
        if np.abs(shape - self._local[where]).max() > SHAPE_TOLERANCE:
            self._local[where] = shape
            self._stale = True

    def retriangulate(self, parts: Mapping[int, IntArray]) -> None:
        """Other triangles (m, 3) of their points for some parts, in the order in which they shall be drawn."""
        for part, faces in parts.items():
            self._faces[part] = self.rows[part][faces]
        self.handle.faces = self._renumbered()
        self.handle.vertices = self.world[self.sent]
        self._stale = True

    def place(self, positions: FloatArray, rotations: FloatArray, changed: npt.NDArray[np.bool_]) -> bool:
        """Sends the vertices if a body has moved or deformed, and says whether.

        ``positions`` (bodies, 3) m and rotation matrices ``rotations`` (bodies, 3, 3) of all bodies, ``changed`` (bodies,): have moved.
        """
        if not self._stale and not changed[self.bodies].any():
            return False
        self._stale = False
        for where, turn, position in zip(self._slices, rotations[self.bodies].astype(np.float32), positions[self.bodies], strict=True):
            np.matmul(self._local[where], turn.T, out=self.world[where])
            self.world[where] += position.astype(np.float32)
        self.handle.vertices = self.world[self.sent]
        return True


class LinePool:
    """Line segments whose number changes: room is kept for some, the rest have no length."""

    def __init__(self, server: viser.ViserServer, name: str, width: float) -> None:
        self._server, self._name, self._width = server, name, width
        self._room = 0
        self._colours = np.zeros((0, 3), np.uint8)
        self._handle: viser.LineSegmentsHandle | None = None

    def show(self, segments: FloatArray, colours: npt.NDArray[np.uint8]) -> None:
        """``segments`` (n, 2, 3) m, world; ``colours`` (n, 3)."""
        n = len(segments)
        if n == 0:
            if self._handle is not None and self._handle.visible:
                self._handle.visible = False
            return
        if not n <= self._room <= 2 * n + SPARE:
            self._room = -(-n // SPARE) * SPARE if n > 16 else 16
            self._handle = None
        points = np.empty((self._room, 2, 3), np.float32)
        points[:n] = segments
        points[n:] = segments[0, 0]
        if self._handle is not None and np.array_equal(colours, self._colours):
            self._handle.points = points
        else:
            shades = np.zeros((self._room, 2, 3), np.uint8)
            shades[:n] = LINEAR[colours][:, None]
            self._colours = colours.copy()
            if self._handle is None:
                self._handle = self._server.scene.add_line_segments(
                    self._name, points, shades, thickness=self._width, thickness_units="screen"
                )
                return
            self._handle.points = points
            self._handle.colors = shades
        if not self._handle.visible:
            self._handle.visible = True


class PatchPool:
    """Coloured points whose number changes.

    New colours are a new material in the page, which a page without a graphics card takes a tenth of a second to compile. So every
    colour of the table has its own places in the cloud, and only where the points are is sent.
    """

    def __init__(self, server: viser.ViserServer, name: str, size: float) -> None:
        self._server, self._name, self._size = server, name, size
        self._table = np.zeros((0, 3), np.uint8)
        self._room = np.zeros(0, np.int64)
        self._at = np.zeros(0, np.int64)
        """Which point of the cloud each point is."""
        self._cloud = np.zeros((0, 3), np.float32)
        self._handle: viser.PointCloudHandle | None = None

    def arrange(self, levels: IntArray, table: npt.NDArray[np.uint8]) -> None:
        """How many points there are from now on, and their colours: ``levels`` (n,) are rows of ``table`` (k, 3). ``move`` must follow."""
        count = np.bincount(levels, minlength=len(table))
        known = len(self._table) == len(table) and np.array_equal(self._table, table)
        if not known or bool((count > self._room).any()):
            old = self._room if known else np.full(len(table), LEAST_PLACES)
            self._room = np.where(count > old, count + count // 2, old)
            self._table = table.copy()
            self._handle = None
            self._cloud = np.empty((int(self._room.sum()), 3), np.float32)
        order = np.argsort(levels, kind="stable")
        row = levels[order]
        starts, before = np.cumsum(self._room) - self._room, np.cumsum(count) - count
        self._at = np.empty(len(levels), np.int64)
        self._at[order] = (starts - before)[row] + np.arange(len(row))
        self._cloud[:] = OUT_OF_SIGHT

    def move(self, points: npt.NDArray[np.float32]) -> None:
        """Where they are: ``points`` (n, 3) m, world."""
        if len(points) == 0 and self._handle is None:
            return
        self._cloud[self._at] = points
        if self._handle is not None:
            self._handle.points = self._cloud
            return
        self._handle = self._server.scene.add_point_cloud(
            self._name,
            self._cloud,
            np.repeat(self._table, self._room, axis=0),
            point_size=self._size,
            point_shape="circle",
            precision="float32",
            point_shading="flat",
        )
