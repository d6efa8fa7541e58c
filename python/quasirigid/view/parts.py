"""Nodes of the page that change often, made so that a change is cheap to send and cheap to draw.

A page that draws in software pays for every node, every triangle and, dearly, for every new material. So bodies that look the same are
one mesh, line segments keep little spare room, and points keep their colours and only change their places.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import viser

from quasirigid.view.meshes import in_drawing_order
from quasirigid.view.pressure import matrix_of
from quasirigid.view.scene import Colour, FloatArray, IntArray, Moved, SceneState

POSE_TOLERANCE = 1e-6
"""Poses that changed by less (m, and without unit for quaternions) are not sent again."""
SHAPE_TOLERANCE = 2e-6
"""Nor are vertices that moved by less, m: a fifth of what the view promises."""
SPARE = 64
"""Room for line segments grows and shrinks in such steps."""
LEAST_PLACES = 24
"""Places that a colour of a ``PatchPool`` has at least."""
OUT_OF_SIGHT = (0.0, 0.0, -1e4)
"""Where points wait that are not needed: far beyond what the camera sees, m."""
_SHARE = np.arange(256) / 255.0
LINEAR = (255.0 * np.where(_SHARE <= 0.04045, _SHARE / 12.92, ((_SHARE + 0.055) / 1.055) ** 2.4)).round().astype(np.uint8)
"""The page takes the colours of lines, unlike those of points and meshes, for linear light: from sRGB (IEC 61966-2-1) to that, (256,)."""


class Joined:
    """Bodies of one colour as one mesh with its vertices in world axes: one node and one drawing call, however many bodies move."""

    def __init__(self, server: viser.ViserServer, name: str, parts: Sequence[tuple[int, FloatArray, IntArray]], colour: Colour) -> None:
        """``parts`` are bodies: index, points at rest (n, 3) m in its frame, faces (m, 3)."""
        self.bodies = [index for index, _, _ in parts]
        """Index of the body of every part."""
        ends = np.cumsum([len(points) for _, points, _ in parts]).tolist()
        self.slices = [slice(end - len(points), end) for end, (_, points, _) in zip(ends, parts, strict=True)]
        """Where the vertices of every part are in the mesh."""
        self._rest = np.concatenate([points for _, points, _ in parts]).astype(np.float32)
        self._local = self._rest.copy()
        self._poses = np.full((len(parts), 7), np.nan)
        faces = np.concatenate(
            [in_drawing_order(faces, len(points)) + part.start for (_, points, faces), part in zip(parts, self.slices, strict=True)]
        )
        self.handle = server.scene.add_mesh_simple(
            name, self._rest, faces.astype(np.uint32), color=colour, cast_shadow=False, receive_shadow=False
        )

    def deform(self, part: int, moved: Moved | None) -> None:
        """Vertices of a part are where its points are now; ``None``: at rest. Seen after the next ``place``."""
        where = self.slices[part]
        shape = self._rest[where].copy()
        if moved is not None:
            shape[moved.indices] = moved.points
        if np.abs(shape - self._local[where]).max() > SHAPE_TOLERANCE:
            self._local[where] = shape
            self._poses[part] = np.nan

    def place(self, state: SceneState) -> None:
        """Sends the vertices if a body has moved or yielded."""
        poses = np.concatenate([state.positions[self.bodies], state.quaternions[self.bodies]], axis=1)
        if np.abs(poses - self._poses).max() <= POSE_TOLERANCE:  # false for NaN: not sent yet, or of another shape
            return
        self._poses = poses
        world = np.empty_like(self._local)
        for where, pose in zip(self.slices, poses, strict=True):
            np.matmul(self._local[where], matrix_of(pose[3:]).T.astype(np.float32), out=world[where])
            world[where] += pose[:3].astype(np.float32)
        self.handle.vertices = world


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
    colour of the table has its own places in the cloud, and only places are sent.
    """

    def __init__(self, server: viser.ViserServer, name: str, size: float) -> None:
        self._server, self._name, self._size = server, name, size
        self._table = np.zeros((0, 3), np.uint8)
        self._room = np.zeros(0, np.int64)
        self._starts = np.zeros(0, np.int64)
        self._empty = True
        self._handle: viser.PointCloudHandle | None = None

    def show(self, points: npt.NDArray[np.float32], levels: IntArray, table: npt.NDArray[np.uint8]) -> None:
        """``points`` (n, 3) m, world; ``levels`` (n,) the row of each in ``table`` (k, 3) of colours."""
        if len(points) == 0 and self._empty:
            return
        count = np.bincount(levels, minlength=len(table))
        fits = len(self._table) == len(table) and np.array_equal(self._table, table) and bool((count <= self._room).all())
        if not fits:
            old = self._room if len(self._room) == len(table) else np.zeros(len(table), np.int64)
            self._room = np.maximum(np.maximum(old, LEAST_PLACES), 2 * count * (count > old))
            self._starts = np.cumsum(self._room) - self._room
            self._table = table.copy()
        order = np.argsort(levels, kind="stable")
        row = levels[order]
        rank = np.arange(len(row)) - (np.cumsum(count) - count)[row]
        places = np.full((int(self._room.sum()), 3), OUT_OF_SIGHT, np.float32)
        places[self._starts[row] + rank] = points[order]
        self._empty = len(points) == 0
        if self._handle is not None and fits:
            self._handle.points = places
        else:
            self._handle = self._server.scene.add_point_cloud(
                self._name,
                places,
                np.repeat(table, self._room, axis=0),
                point_size=self._size,
                point_shape="circle",
                precision="float32",
                point_shading="flat",
            )
