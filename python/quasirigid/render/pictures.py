"""Pictures and films of a recording, without a browser: drawn by our own scan lines, written by Pillow and ffmpeg.

The camera is orthographic and stands still, so that lengths can be read off and films compared. The object is drawn as if of glass: the
soft pads and the pressure on them show through it.
"""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import matplotlib.colors
import numpy as np

from quasirigid.arrays.types import AnyArray
from quasirigid.errors import InvalidShapeError, InvalidValueError, UnknownNameError
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.recording.window import check_times, span
from quasirigid.render.camera import Camera
from quasirigid.render.fonts import quiet_fonts
from quasirigid.render.ground import CELL, compose, floor_lines, soft_shadow, tinted, view_of
from quasirigid.render.layer import Layer, halved
from quasirigid.render.media import Film, Frame, frame_steps, open_writer
from quasirigid.render.overlay import Layout, Overlay
from quasirigid.render.posed import Part, PosedScene, joined
from quasirigid.rotation import rotate
from quasirigid.scene.model import SceneState
from quasirigid.scene.palette import FINGER_COLOURS, SLIP_COLOUR
from quasirigid.scene.scaling import drawing_scale, scaled_model, scaled_state
from quasirigid.system.child_process import leave_signals_to_parent

FINE = 2
"""Drawn this many times larger, then reduced: smooth edges."""
SMALLEST, LARGEST = (320, 180), (3840, 2160)
"""Sizes of a picture, px."""
CAMERAS = {"front": (0.0, 0.0), "right": (90.0, 0.0), "back": (180.0, 0.0), "left": (270.0, 0.0), "top": (0.0, 90.0)}
"""Names of cameras: azimuth from -y towards +x and height above the horizon, degrees."""
REACH = 0.125
"""The floor's grid fades out at this distance from the middle, m."""
FLAT = 2e-3
"""What rises no higher than this above the floor counts as the floor, m."""
WITH = 0.6
"""A fingertip farther than this from the object, m, waits for its finger to be seen, and is left out of the picture."""
NEAR = 0.12
"""An object farther than this from the fingertips has fallen, and the camera does not follow it, m."""
SHADES = 48
"""Of pressure, in a GIF."""
LOOKED_AT = 3
"""Frames from which the colours of a GIF are chosen."""
WORTH_JOBS = 12
"""Fewer frames are drawn before other processes have started."""
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class RenderOptions:
    """What to draw. Times in s of simulated time; ``None`` is the start or the end of the recording."""

    fps: float = 30.0
    size: tuple[int, int] = (1280, 720)
    """Width and height, px."""
    camera: str = "auto"
    """``"auto"``, a name of ``CAMERAS``, or ``"azimuth,height"`` in degrees."""
    start: float | None = None
    end: float | None = None
    speed: float = 1.0
    """Simulated seconds per second of film."""
    labels: bool = True
    """Forces, time, scale and legend beside and over the scene."""
    single: bool = False
    """One picture, of the end, whatever the file."""

    def check(self) -> None:
        """Raises ``InvalidValueError`` or ``InvalidShapeError`` for what cannot be drawn."""
        width, height = self.size
        if not (SMALLEST[0] <= width <= LARGEST[0] and SMALLEST[1] <= height <= LARGEST[1]):
            expected = f"width and height from {SMALLEST[0]}x{SMALLEST[1]} to {LARGEST[0]}x{LARGEST[1]} px"
            raise InvalidShapeError("size", expected, f"{width}x{height}", "give --size 1280x720")
        if not (np.isfinite(self.speed) and self.speed > 0.0):
            raise InvalidValueError("speed", "above 0; 1 is real time", self.speed, "give --speed 0.25 for slow motion")
        check_times(self.start, self.end, single=self.single)


def towards(camera: str, recording: SceneRecording, state: SceneState) -> AnyArray:
    """Unit vector (3,) towards the viewer, world. Raises ``UnknownNameError`` for an unknown camera."""
    if camera == "auto":
        names = [body.name for body in recording.model.bodies]
        centre = _middle(recording, state)
        if "palm" in names:
            palm = names.index("palm")
            return view_of(np.concatenate([state.positions[palm], state.quaternions[palm]]), centre)
        angles = (35.0, 20.0)
    elif camera in CAMERAS:
        angles = CAMERAS[camera]
    else:
        try:
            azimuth, height = (float(part) for part in camera.split(","))
        except ValueError:
            expected = f"auto, {', '.join(CAMERAS)}, or azimuth,height in degrees"
            raise UnknownNameError("camera", expected, camera, "give --camera 30,20") from None
        if not (abs(azimuth) <= 360.0 and abs(height) <= 90.0):
            raise InvalidValueError("camera", "azimuth within 360 and height within 90 degrees", camera, "give --camera 30,20")
        angles = (azimuth, height)
    turn, lift = np.radians(angles)
    view: AnyArray = np.array([np.sin(turn) * np.cos(lift), -np.cos(turn) * np.cos(lift), np.sin(lift)])
    return view


def _middle(recording: SceneRecording, state: SceneState) -> AnyArray:
    """Middle of the fingertips, or of the objects where there are none, (3,) m."""
    objects = [i for i, body in enumerate(recording.model.bodies) if body.kind == "object" and body.part_of is None]
    tips = [i for i in recording.model.fingertips() if not waits(recording, state, i)]
    for mine in (tips, objects):
        if mine:
            middle: AnyArray = state.positions[mine].mean(axis=0)
            return middle
    return state.positions.mean(axis=0) if len(state.positions) else np.zeros(3)


def waits(recording: SceneRecording, state: SceneState, index: int) -> bool:
    """Whether a body is a fingertip that is nowhere near the object."""
    kinds = [body.kind for body in recording.model.bodies]
    if kinds[index] != "fingertip" or "object" not in kinds:
        return False
    return bool(np.linalg.norm(state.positions[index] - state.positions[kinds.index("object")]) > WITH)


class Renderer:
    """Draws the steps of a recording, all with one camera."""

    def __init__(self, recording: SceneRecording, options: RenderOptions | None = None) -> None:
        """Choose camera and scales so that everything between the times of ``options`` is seen."""
        self.options = options or RenderOptions()
        self.options.check()
        self.recording = recording
        start, end = span(recording, self.options.start, self.options.end, single=self.options.single)
        first, last = recording.step_at(start), recording.step_at(end)
        self.layout = Layout.of(self.options.size, panel=self.options.labels and bool(recording.model.fingers))
        self.scale = drawing_scale(recording.model, recording.state(first))
        """Metres in the drawing over metres in the world."""
        self.model = scaled_model(recording.model, self.scale)
        """What is drawn."""
        samples = [self._state(int(i)) for i in np.unique(np.linspace(first, last, 25).round().astype(int))]
        self.floor = self.model.floor
        back = towards(self.options.camera, recording, samples[-1])
        # Seen from the side or from below, a floor is a line or hides everything: there is none then.
        self._has_floor = bool(back[2] > 0.05)
        width, height = self.layout.scene[2:]
        self.camera = self._camera(back, samples, (width, height))
        self._middle = _middle(recording, samples[0])
        self._ground, self._lines = (np.zeros(0), np.zeros(0)), np.zeros((height, width))
        if self._has_floor:
            coarse = self.camera
            x, y, _ = coarse.plane(self.floor)
            self._ground = (x - self._middle[0], y - self._middle[1])
            fine = Camera(coarse.axes, coarse.centre, FINE * coarse.scale, (FINE * width, FINE * height))
            xs, ys, _ = fine.plane(self.floor)
            self._lines = halved(floor_lines(xs, ys, self._middle, REACH)[..., None], FINE)[..., 0]
        # Of a single moment, chart and colours are those of the whole recording.
        shown = (start, end) if last > first else (float(recording.times[0]), float(recording.times[-1]))
        peak = recording.peak_pressure(recording.step_at(shown[0]), recording.step_at(shown[1]))
        self.posed_scene = PosedScene(self.model, max(peak, 1.0))
        self.overlay = (
            Overlay(self.posed_scene, recording, self.layout, self.camera, peak, shown, self.scale) if self.options.labels else None
        )

    def _state(self, step: int) -> SceneState:
        return scaled_state(self.recording.state(step), self.scale)

    def _camera(self, back: AnyArray, samples: list[SceneState], size: tuple[int, int]) -> Camera:
        """The camera that has all that moves in the picture."""
        up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
        camera = Camera.towards(back, up, np.zeros(3), 1.0, size)
        bodies = self.model.bodies
        held = any(body.kind == "fingertip" for body in bodies)
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for everything in (False, True):
            for state in samples:
                middle = _middle(self.recording, state)
                for i, body in enumerate(bodies):
                    fallen = held and body.kind == "object" and np.linalg.norm(state.positions[i] - middle) > NEAR
                    if waits(self.recording, state, i):
                        continue
                    if len(body.points) and (everything or (body.kind != "support" and not fallen)):
                        some = rotate(state.quaternions[i], body.points[:: max(1, len(body.points) // 400)]) + state.positions[i]
                        if state is samples[0] and body.kind == "object" and back[2] > 0.0:
                            # With its shadow on the floor.
                            some = np.concatenate([some, np.column_stack([some[:, :2], np.full(len(some), self.floor)])])
                        seen = camera.project(some)[:, :2]
                        low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
            if np.isfinite(low).all():
                break
        else:
            low, high = np.full(2, -0.1), np.full(2, 0.1)
        room = np.maximum(1.12 * (high - low), 0.01)
        scale = float(min(size[0] / room[0], size[1] / room[1]))
        return Camera(camera.axes, camera.axes[:, :2] @ (0.5 * (low + high)), scale, size)

    def frame(self, step: int) -> Frame:
        """The picture of a step: (height, width, 3) ``uint8``."""
        state = self._state(step)
        solid, glass = self._parts(state)
        left, top, width, height = self.layout.scene
        scene = self._ground_with(solid + glass)
        self._draw(scene, solid, glass)
        image = np.ones((self.options.size[1], self.options.size[0], 3), np.float32)
        image[top : top + height, left : left + width] = scene
        frame: Frame = (255.0 * np.clip(image, 0.0, 1.0) + 0.5).astype(np.uint8)
        return frame if self.overlay is None else self.overlay.draw(frame, state)

    def _parts(self, state: SceneState) -> tuple[list[Part], list[Part]]:
        solid: list[Part] = []
        glass: list[Part] = []
        for i, body in enumerate(self.model.bodies):
            if not len(body.faces):
                continue
            part = self.posed_scene.posed(state, i)
            if body.kind == "support" and self._has_floor:
                # A support that is lowered sinks into the floor; a flat one that lies there is the floor.
                above = part.points[body.faces, 2] > self.floor + FLAT
                part = replace(part, faces=body.faces[above.any(axis=1)])
            (glass if body.kind == "object" and self._pads_show() else solid).append(part)
        return solid, glass

    def _pads_show(self) -> bool:
        """Glass is for seeing pads through it: without fingertips, objects are solid."""
        return bool(self.model.fingertips())

    def _ground_with(self, parts: list[Part]) -> AnyArray:
        """The floor under soft shadows, (height, width, 3)."""
        light = np.ones(self._lines.shape)
        if self._has_floor:
            cells = int(2 * REACH / CELL)
            above = Camera(np.eye(3), np.array([*self._middle[:2], 0.0]), 1.0 / CELL, (cells, cells))
            covered = np.zeros((cells, cells))
            for part in parts:
                covered = np.maximum(covered, part.drawn_by(above).drawn)
            # Rows of a picture run down, against the world's y.
            dark = 0.2 * soft_shadow(covered[::-1].T, *self._ground, REACH)
            light = (1.0 - 0.13 * self._lines) * (1.0 - dark)
        return tinted(light).astype(np.float32)

    def _draw(self, scene: AnyArray, solid: list[Part], glass: list[Part]) -> None:
        """Draw the parts over the ``scene``, where they are and nowhere else."""
        width, height = self.camera.size
        places = [self.camera.project(part.points)[:, :2] * self.camera.scale for part in solid + glass]
        if not places:
            return
        seen = np.concatenate(places) * [1.0, -1.0] + [width / 2, height / 2]
        left, top = np.clip(np.floor(seen.min(axis=0)).astype(int) - 4, 0, [width, height])
        right, bottom = np.clip(np.ceil(seen.max(axis=0)).astype(int) + 4, 0, [width, height])
        if right <= left or bottom <= top:
            return
        # A part of the camera's picture: the same camera, looking at the middle of that part.
        off = np.array([0.5 * (left + right) - width / 2, height / 2 - 0.5 * (top + bottom)]) / self.camera.scale
        size = (FINE * int(right - left), FINE * int(bottom - top))
        fine = Camera(self.camera.axes, self.camera.centre + self.camera.axes[:, :2] @ off, FINE * self.camera.scale, size)
        body = joined(solid).drawn_by(fine) if solid else Layer.nothing(size)
        whole = joined(glass) if glass else None
        walls = [] if whole is None else [whole.drawn_by(fine, back=True), whole.drawn_by(fine)]
        region = scene[top:bottom, left:right]
        background = np.repeat(np.repeat(region, FINE, axis=0), FINE, axis=1)
        region[:] = halved(compose(background, body, walls, fine.scale), FINE)

    def steps(self) -> Iterator[int]:
        """The steps of the film's frames."""
        start, end = span(self.recording, self.options.start, self.options.end, single=self.options.single)
        return frame_steps(self.recording.times, self.options.fps, start, end, self.options.speed)


def render(
    path: str | Path,
    out: str | Path,
    options: RenderOptions | None = None,
    *,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Draw the recording at ``path`` and write ``out``: ``.png`` (one moment), ``.gif``, ``.mp4``, or a directory of PNG frames.

    ``jobs`` processes draw; ``None`` is one per core. Returns what was written. Raises the errors of ``quasirigid.errors``:
    ``MissingPackageError`` says what to install for an MP4.
    """
    options, out = options or RenderOptions(), Path(out)
    options.check()
    if jobs is not None and jobs < 1:
        raise InvalidValueError("jobs", "at least 1 process", jobs, "leave --jobs out for one per core")
    with SceneRecording(path) as recording:
        _, end = span(recording, options.start, options.end, single=options.single)
        # Asked before anything is drawn: a missing package is found out at once.
        film = Film(open_writer(out, fps=options.fps, size=options.size))
        renderer = Renderer(recording, options)
        with film as writer:
            single = options.single or out.suffix.lower() == ".png"
            steps = [recording.step_at(end)] if single else list(renderer.steps())
            needed = list(dict.fromkeys(steps))  # in slow motion a step is shown many times
            if out.suffix.lower() == ".gif":
                some = np.unique(np.linspace(0, len(needed) - 1, LOOKED_AT).round().astype(int))
                writer.prepare([renderer.frame(needed[i]) for i in some], accents())
            drawn = iter(_draw_all(renderer, needed, jobs or os.cpu_count() or 1))
            last, frame = -1, np.zeros((0, 0, 3), np.uint8)
            for i, step in enumerate(steps):
                if step != last:
                    last, frame = step, next(drawn)
                writer.add(frame)
                if progress is not None:
                    progress(f"frame {i + 1} of {len(steps)}", (i + 1) / len(steps))
        return writer.paths


def accents() -> Frame:
    """Colours that mean something: of pressure, of the fingers, of what slips, of the ground; (1, n, 3)."""
    pressure = 255.0 * matplotlib.colormaps["viridis"](np.linspace(0.0, 1.0, SHADES))[:, :3]
    others = [255.0 * np.array(matplotlib.colors.to_rgb(colour)) for colour in (*FINGER_COLOURS, SLIP_COLOUR, "white")]
    colours: Frame = np.concatenate([pressure, others]).round().astype(np.uint8)[None]
    return colours


def _draw_all(renderer: Renderer, steps: list[int], jobs: int) -> Iterator[Frame]:
    """The pictures of the steps in their order, drawn by several processes if that pays."""
    if jobs == 1 or len(steps) < WORTH_JOBS:
        for step in steps:
            yield renderer.frame(step)
        return
    # Fresh processes: an open HDF5 file must not be shared with a forked one.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_prepare, initargs=(renderer.recording.columns.path, renderer.options))
    try:
        waiting: deque[Future[Frame]] = deque()
        for step in steps:
            waiting.append(pool.submit(_frame, step))
            if len(waiting) > 2 * jobs:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


_mine: Renderer | None = None
"""Of a process that draws."""


def _prepare(path: Path, options: RenderOptions) -> None:
    global _mine
    leave_signals_to_parent()  # it ends the work
    quiet_fonts()
    _mine = Renderer(SceneRecording(path), options)


def _frame(step: int) -> Frame:
    assert _mine is not None
    return _mine.frame(step)


__all__ = ["CAMERAS", "RenderOptions", "Renderer", "render"]
