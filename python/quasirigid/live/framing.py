"""The camera of the page: from where the pads are in sight, and as near as everything fits into the picture.

Every page has a window of its own, so every page is fitted for itself: when it connects, when its window changes before anybody turned the
camera, and when its button is pressed.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import viser

from quasirigid.arrays.types import FloatArray
from quasirigid.rotation import rotate
from quasirigid.scene.model import SceneModel, SceneState
from quasirigid.scene.scaling import cloud

VIEW: FloatArray = np.array([0.52, -0.80, 0.30]) / np.linalg.norm([0.52, -0.80, 0.30])
"""Towards the viewer where there are no pads: from in front and a little above."""
FOV = np.radians(35.0)
"""Vertical field of view, rad."""
MARGIN = 0.92
"""How much of the picture is filled."""
NEAR, FAR = 0.005, 40.0
"""Of what is drawn, m."""
PHONE = 0.65
"""A picture narrower than this, width over height, is that of a phone: there the panel is a sheet over its lower end ..."""
SHEET = 0.45
"""... of this share of the height."""
LEAST_REACH = 0.02
"""The camera comes no nearer than for a scene of this half diagonal, m."""
FALL = 4.0
"""The floor is in the picture if it is at most so many half diagonals below."""
SLACK = 0.1
"""Room around bodies that are followed, as a share of their extent and of the picture's."""
FOLLOWED = 3.0
"""A body is followed within so many diagonals of what was in the picture at first."""
TURNED = 1e-3
"""A camera farther than this share of its distance from where it was put was moved by a person."""
CELL = 6e-3
"""Cell size of the grid in which it is found out what hides the pads, m."""
HIDERS, SKIN = 4000, 150
"""Points of links and nails, and of a pad, that are considered."""
HEIGHTS, ANGLES = (16.0, 26.0, 36.0), 24
"""Heights above the horizon, degrees, and angles around, of the views that are tried."""


@dataclass(frozen=True, eq=False)
class Frame:
    """What the camera shall have in the picture."""

    points: FloatArray
    """(n, 3) m."""
    towards: FloatArray
    """(3,) unit vector towards the viewer."""

    def camera(self, aspect: float, towards: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Where the camera is and what it looks at, (3,) m each, so that all points are in a picture of width over height ``aspect``."""
        back = self.towards if towards is None else towards
        right = np.cross([0.0, 0.0, 1.0], back)
        length = float(np.linalg.norm(right))
        right = right / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])  # seen from straight above
        axes = np.column_stack([right, np.cross(back, right), back])
        x, y, z = (self.points @ axes).T
        # With the camera at depth D and the picture's middle at c, a point is in the picture if -b (D - z) <= x - c <= a (D - z): the
        # slopes a and b of its right (upper) and left (lower) rim. All points are if U - a D <= c <= L + b D with U = max(x + a z), L =
        # min(x - b z).
        t, room = np.tan(0.5 * FOV), SHEET if aspect < PHONE else 0.0
        upper, lower = t * (room + MARGIN * (1.0 - room)), t * (MARGIN * (1.0 - room) - room)
        side = MARGIN * t * aspect
        limits = [
            (c, *slopes, (c + slopes[0] * z).max(), (c - slopes[1] * z).min()) for c, slopes in ((x, (side, side)), (y, (upper, lower)))
        ]
        depth = max(float(z.max()) + LEAST_REACH / t, *(float((high - low) / (a + b)) for _, a, b, high, low in limits))
        middle = [0.5 * (high - a * depth + low + b * depth) for _, a, b, high, low in limits]
        look_at: FloatArray = axes @ np.array([*middle, 0.5 * (z.min() + z.max())])
        position: FloatArray = axes @ np.array([*middle, depth])
        return position, look_at


def frame_of(model: SceneModel, state: SceneState, headroom: float = 0.0) -> Frame:
    """All that moves, the floor below it, and ``headroom`` m above, seen from where the pads are in sight."""
    return Frame(_points(model, state, headroom), pads_in_sight(model, state))


def _points(model: SceneModel, state: SceneState, headroom: float) -> FloatArray:
    points = cloud(model, state.positions, state.quaternions)
    reach = 0.5 * float(np.linalg.norm(np.ptp(points, axis=0)))
    top = points[points[:, 2].argmax()] + [0.0, 0.0, headroom]
    everything = [points, top[None]]
    if 0.0 <= points[:, 2].min() - model.floor <= FALL * reach:
        everything.append(np.column_stack([points[:, :2], np.full(len(points), model.floor)]))
    whole: FloatArray = np.concatenate(everything)
    return whole


def _sampled(points: FloatArray, faces: np.ndarray[tuple[int, int], np.dtype[np.int64]], count: int) -> FloatArray:
    """``count`` points evenly spread over triangles, the same ones every time."""
    corner = points[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    whole = np.cumsum(area)
    which = np.searchsorted(whole, (np.arange(count) + 0.5) / count * whole[-1])
    # Low-discrepancy numbers (Roberts' R2), folded into the triangle.
    a, b = np.modf(np.arange(1, count + 1)[:, None] * [0.7548776662466927, 0.5698402909980532])[0].T
    a, b = np.where(a + b > 1.0, 1.0 - a, a), np.where(a + b > 1.0, 1.0 - b, b)
    picked = corner[which]
    sampled: FloatArray = picked[:, 0] + a[:, None] * (picked[:, 1] - picked[:, 0]) + b[:, None] * (picked[:, 2] - picked[:, 0])
    return sampled


def pads_in_sight(model: SceneModel, state: SceneState) -> FloatArray:
    """(3,) unit vector towards the viewer, from where the least visible pad is seen best; links and other pads may hide it, objects are
    glass.
    """
    tips = model.fingertips()
    links = [i for i, body in enumerate(model.bodies) if body.kind == "link" and len(body.faces)]
    if not tips:
        return VIEW

    def posed(i: int, points: FloatArray) -> FloatArray:
        placed: FloatArray = state.positions[i] + rotate(state.quaternions[i], points)
        return placed

    opaque = [*tips, *links]
    hiders = np.concatenate([posed(i, _sampled(model.bodies[i].points, model.bodies[i].faces, HIDERS // len(opaque))) for i in opaque])
    skins = []
    for tip in tips:
        some = slice(None, None, max(1, len(model.bodies[tip].points) // SKIN))
        skins.append((posed(tip, model.bodies[tip].points[some]), rotate(state.quaternions[tip], model.bodies[tip].normals[some])))
    best, chosen = -np.inf, VIEW
    for height in np.radians(HEIGHTS):
        for angle in 2.0 * np.pi * np.arange(ANGLES) / ANGLES:
            back: FloatArray = np.array([np.cos(height) * np.sin(angle), -np.cos(height) * np.cos(angle), np.sin(height)])
            seen = _visible(skins, hiders, back)
            score = min(seen) + 0.25 * float(np.mean(seen)) + 0.05 * float(back @ VIEW)
            if score > best + 1e-9:
                best, chosen = score, back
    return chosen


def _visible(skins: list[tuple[FloatArray, FloatArray]], hiders: FloatArray, back: FloatArray) -> list[float]:
    """How much is seen from ``back`` of pads with these points and outward normals (n, 3): mean cosine of what no
    ``hiders`` (n, 3) hide.
    """
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    flat = np.column_stack([right, np.cross(back, right)])
    places = hiders @ flat
    corner = places.min(axis=0) - CELL
    cells = ((places - corner) / CELL).astype(np.int64)
    shape = cells.max(axis=0) + 2
    nearest = np.full(shape.prod(), -np.inf)
    np.maximum.at(nearest, cells[:, 0] * shape[1] + cells[:, 1], hiders @ back)
    seen = []
    for points, normals in skins:
        mine = np.clip(((points @ flat - corner) / CELL).astype(np.int64), 0, shape - 1)
        clear = points @ back > nearest[mine[:, 0] * shape[1] + mine[:, 1]] - CELL
        seen.append(float((np.clip(normals @ back, 0.0, None) * clear).mean()))
    return seen


class Framing:
    """Fits the cameras of all pages of a server to what it shows."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._home = self._frame = Frame(np.zeros((1, 3)), VIEW)
        self._lock = threading.Lock()
        self._put: dict[int, tuple[FloatArray, float, Frame]] = {}
        """By page: where its camera was put, the shape of its picture then, and what is in it."""
        server.on_client_connect(self._welcome)

    def show(self, frame: Frame) -> None:
        """Frames another scene, in all pages in which nobody has turned the camera."""
        self._home = frame
        self._reframe(frame)

    def _reframe(self, frame: Frame) -> None:
        self._frame = frame
        camera = self._server.initial_camera
        camera.fov, camera.near, camera.far = FOV, NEAR, FAR
        camera.position, camera.look_at = frame.camera(1.0)
        for client in self._server.get_clients().values():
            if self._untouched(client.camera):
                self.fit(client)

    def follow(self, model: SceneModel, state: SceneState) -> None:
        """Frames bodies that have left the picture, if they are not too far away, in all pages in which nobody has turned the camera."""
        low, high = self._frame.points.min(axis=0), self._frame.points.max(axis=0)
        movable = [i for i, body in enumerate(model.bodies) if body.kind != "support" and len(body.points)]
        places = state.positions[movable]
        first, last = self._home.points.min(axis=0), self._home.points.max(axis=0)
        near = (np.abs(places - 0.5 * (first + last)) < FOLLOWED * np.linalg.norm(last - first)).all(axis=1)
        if not (near & ((places < low) | (places > high)).any(axis=1)).any():
            return
        kept = [movable[k] for k in np.flatnonzero(near)]
        there = replace(model, bodies=tuple(model.bodies[i] for i in kept))
        points = cloud(there, state.positions[kept], state.quaternions[kept])
        ahead = SLACK * (points.max(axis=0) - points.min(axis=0)) + SLACK * (high - low)  # so that it is not framed again every time
        corners = np.array([points.min(axis=0) - ahead, points.max(axis=0) + ahead])
        self._reframe(replace(self._frame, points=np.concatenate([self._frame.points, corners])))

    def fit(self, client: viser.ClientHandle) -> None:
        """Puts the camera of a page where all of the scene is in the picture, as it was when it was shown."""
        self._put_camera(client, self._frame, None)

    def add_button(self, now: Callable[[], tuple[SceneModel, SceneState] | None]) -> None:
        """A button in the panel that fits the page to what there is ``now``, seen from where its camera is."""
        button = self._server.gui.add_button(
            "Fit the view", color="gray", hint="All that moves comes into the picture, seen from where you are"
        )

        @button.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            shown = now()
            if shown is None or event.client is None:
                return
            camera = event.client.camera
            back = camera.position - camera.look_at
            back = back / max(float(np.linalg.norm(back)), 1e-12)
            self._put_camera(event.client, Frame(_points(*shown, 0.0), back), back)

    def _put_camera(self, client: viser.ClientHandle, frame: Frame, towards: FloatArray | None) -> None:
        camera = client.camera
        aspect = camera.image_width / max(camera.image_height, 1)
        position, look_at = frame.camera(aspect, towards)
        with self._lock:
            self._put[client.client_id] = (position, aspect, frame)
        with client.atomic():
            camera.position, camera.look_at = position, look_at

    def _untouched(self, camera: viser.CameraHandle) -> bool:
        """Whether the camera is where it was put, or where viser puts it in a page that has just come or is reset."""
        put = self._put.get(camera.client.client_id)
        return put is not None and (_is_at(camera, put[0]) or _is_at(camera, self._server.initial_camera.position))

    def _welcome(self, client: viser.ClientHandle) -> None:
        self.fit(client)

        @client.camera.on_update
        def _(camera: viser.CameraHandle) -> None:
            """A window that took another shape, or a page that was reset, before anybody moved the camera."""
            put = self._put.get(client.client_id)
            if put is None or not self._untouched(camera):
                return
            other = abs(camera.image_width / max(camera.image_height, 1) - put[1]) > 1e-3
            if other or not _is_at(camera, put[0]):
                self._put_camera(client, put[2], None)


def _is_at(camera: viser.CameraHandle, place: FloatArray) -> bool:
    distance = float(np.linalg.norm(camera.position - camera.look_at))
    return float(np.linalg.norm(camera.position - place)) <= TURNED * distance


__all__ = ["FOV", "Frame", "Framing", "frame_of", "pads_in_sight"]
