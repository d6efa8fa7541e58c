"""What stands beside and over the scene in a picture or a film: time, forces, pads as a tactile sensor sees them, scale and legend."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from quasirigid.arrays.types import AnyArray
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.render.camera import Camera
from quasirigid.render.layer import halved, shade
from quasirigid.render.media import Frame
from quasirigid.render.posed import PosedScene
from quasirigid.render.triangles import rasterise
from quasirigid.rotation import rotate
from quasirigid.scene.model import SceneState
from quasirigid.scene.palette import FINGER_COLOURS, INK, MUTED, SLIP_COLOUR
from quasirigid.scene.pressure import SLIP, nice_above
from quasirigid.units import in_small_units, pressure_unit

Box = tuple[int, int, int, int]
"""Left, top, width, height, px."""
ARROW = 0.035
"""Length of the longest force arrow, m."""
DPI = 100


@dataclass(frozen=True)
class Layout:
    """What goes where in a picture, px."""

    size: tuple[int, int]
    unit: float
    """Size of letters and gaps: 1 in a picture of 1280 x 720."""
    scene: Box
    panel: Box | None
    chart: Box | None

    @staticmethod
    def of(size: tuple[int, int], *, panel: bool) -> Layout:
        """The layout for a picture of ``size`` (width, height); the ``panel`` and the chart need 768 x 432 at least."""
        width, height = size
        unit = min(width / 1280, height / 720)
        if not panel or unit < 0.6:
            return Layout(size, max(unit, 0.5), (0, 0, width, height), None, None)
        right, below = round(264 * unit), round(140 * unit)
        return Layout(
            size,
            unit,
            (0, 0, width - right, height - below),
            (width - right, 0, right, height - below),
            (0, height - below, width, below),
        )


@lru_cache(maxsize=32)
def _font(pixels: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), pixels)


class Overlay:
    """Draws over the frames of one film. What does not change from frame to frame is drawn once."""

    def __init__(
        self,
        posed_scene: PosedScene,
        recording: SceneRecording,
        layout: Layout,
        camera: Camera,
        peak: float,
        times: tuple[float, float],
        scale: float = 1.0,
    ) -> None:
        """``camera`` is that of the scene, which is drawn ``scale`` times as large as the world; ``peak`` Pa is the top of the colour
        scale, 0 where nothing is pressed; ``times`` first and last s of the film.
        """
        self._posed_scene, self._scale = posed_scene, scale
        self.recording, self.layout, self.camera, self.peak = recording, layout, camera, peak
        first, last = recording.step_at(times[0]), recording.step_at(times[1])
        self._steps = slice(first, last + 1)
        self._forces = recording.columns["fingers/force"][self._steps]
        longest = float(np.linalg.norm(self._forces, axis=2).max(initial=0.0)) if self._forces.size else 0.0
        self._metres_per_newton = ARROW / longest if longest > 0.0 else 0.0
        self._title = _title_of(recording)
        self._chart: Image.Image | None = None
        self._chart_x = (0.0, 0.0)
        if layout.chart is not None:
            self._chart, self._chart_x = self._draw_chart(times)
        self._bar = self._draw_bar() if layout.panel else None
        self._times = times

    def draw(self, frame: Frame, state: SceneState) -> Frame:
        """The frame with everything drawn over it."""
        image = Image.fromarray(frame)
        self._arrows(image, state)
        pen = ImageDraw.Draw(image)
        self._scale_bar(pen)
        if self.layout.panel is None:
            self._caption(pen, state)
        else:
            self._panel(image, pen, state)
        if self._chart is not None and self.layout.chart is not None:
            left, top, _, _ = self.layout.chart
            image.paste(self._chart, (left, top))
            self._cursor(pen, state)
        done: Frame = np.asarray(image)
        return done

    def _text(
        self, pen: ImageDraw.ImageDraw, place: tuple[float, float], text: str, size: float, colour: str = INK, *, bold: bool = False,
        anchor: Literal["la", "ra", "ma", "lm", "ls", "ms", "rs"] = "la", halo: bool = False,
    ) -> None:  # fmt: skip
        font = _font(max(7, round(size * self.layout.unit)), bold=bold)
        extra: dict[str, Any] = {"stroke_width": max(1, round(2 * self.layout.unit)), "stroke_fill": "white"} if halo else {}
        pen.text(place, text, font=font, fill=colour, anchor=anchor, **extra)

    def _at(self, point: AnyArray) -> AnyArray:
        """Where a point (3,) m is seen, px of the picture."""
        left, top, width, height = self.layout.scene
        seen = self.camera.project(point)[..., :2] * self.camera.scale
        place: AnyArray = np.array([left + width / 2, top + height / 2]) + seen * [1.0, -1.0]
        return place

    def _arrows(self, image: Image.Image, state: SceneState) -> None:
        """The force of every fingertip, at its centre of pressure."""
        tips = self.recording.model.fingertips()
        arrows: list[tuple[AnyArray, AnyArray, str]] = []
        c = state.contacts
        for finger, tip in enumerate(tips):
            mine = c.on(tip) & (c.reactions[:, 0] > 0.0)
            if mine.any():
                centre = np.average(c.points[mine], axis=0, weights=c.reactions[mine, 0])
                start, end = self._at(centre), self._at(centre + self._metres_per_newton * state.finger_forces[finger])
                arrows.append((start, end, FINGER_COLOURS[finger % 6]))
        if not arrows:
            return
        places = np.concatenate([[a, b] for a, b, _ in arrows])
        low = np.floor(places.min(axis=0)).astype(int) - 20
        high = np.ceil(places.max(axis=0)).astype(int) + 20
        fine = 4  # Pillow's polygons have jagged edges: drawn large, then reduced
        sheet = Image.new("RGBA", (int(fine * (high - low)[0]), int(fine * (high - low)[1])), (255, 255, 255, 0))
        pen = ImageDraw.Draw(sheet)
        for start, end, colour in arrows:
            for grow, fill in ((1.3 * self.layout.unit, "white"), (0.0, colour)):
                shape = _arrow_shape(start - low, end - low, 1.25 * self.layout.unit, grow)
                pen.polygon([(fine * x, fine * y) for x, y in shape], fill=fill)
        small = sheet.resize((sheet.width // fine, sheet.height // fine), Image.Resampling.BOX)
        image.paste(small, (int(low[0]), int(low[1])), small)

    def _scale_bar(self, pen: ImageDraw.ImageDraw) -> None:
        """A length that is round, in the plane of the picture."""
        left, top, _, height = self.layout.scene
        u = self.layout.unit
        metres = nice_above(60 * u / (self.camera.scale * self._scale))  # at most 150 px
        length = metres * self._scale * self.camera.scale
        x, y = left + 22 * u, top + height - 20 * u
        pen.line([(x, y), (x + length, y)], fill=INK, width=max(2, round(3 * u)))
        self._text(pen, (x + length / 2, y - 7 * u), in_small_units(metres, "m"), 13, anchor="ms", halo=True)

    def _caption(self, pen: ImageDraw.ImageDraw, state: SceneState) -> None:
        """Time and phase in a corner, where there is no panel."""
        u = self.layout.unit
        words = f"{state.time:.3f} s" + (f"   {state.phase}" if state.phase else "")
        self._text(pen, (self.layout.scene[0] + 20 * u, self.layout.scene[1] + 16 * u), words, 18, halo=True)

    def _panel(self, image: Image.Image, pen: ImageDraw.ImageDraw, state: SceneState) -> None:
        assert self.layout.panel is not None
        left, top, width, height = self.layout.panel
        u = self.layout.unit
        x = left + 8 * u
        self._text(pen, (22 * u, 18 * u), self._title, 22, bold=True, halo=True)
        words = f"{state.time:.3f} s" + (f"  ·  {state.phase}" if state.phase else "")
        self._text(pen, (22 * u, 50 * u), words, 16, MUTED, halo=True)
        fingers = self.recording.model.fingers
        bar = 62 * u
        room = (height - 16 * u - bar) / max(1, len(fingers))
        side = round(min(room - 12 * u, 0.62 * width))
        c = state.contacts
        for finger, (name, tip) in enumerate(zip(fingers, self.recording.model.fingertips(), strict=False)):
            y = top + 16 * u + finger * room
            picture = self._pad(state, tip, side)
            image.paste(picture, (round(x), round(y)))
            pen.rectangle([round(x), round(y), round(x) + side - 1, round(y) + side - 1], outline="#CCCCCC")
            mine = c.on(tip) & (c.reactions[:, 0] > 0.0)
            slips = int((c.status[mine] == SLIP).sum())
            tx = round(x) + side + 10 * u
            colour = FINGER_COLOURS[finger % 6]
            for line, (text, size, ink, bold) in enumerate(
                [
                    (_short(name), 13, colour, True),
                    (f"{state.normal_forces[finger]:.2f} N", 15, colour, True),  # as in the chart below
                    (f"{int(mine.sum())} contacts", 12, MUTED, False),
                    (f"{slips} slip" if slips else ("all stick" if mine.any() else ""), 12, INK if slips else MUTED, False),
                ]
            ):
                self._text(pen, (tx, y + (2 + 20 * line) * u), text, size, ink, bold=bold)
        if self._bar is not None:
            image.paste(self._bar, (left, top + height - self._bar.height))

    def _pad(self, state: SceneState, tip: int, side: int) -> Image.Image:
        """A pad as the object sees it, pressure in colour; what slips has a ring."""
        body = self._posed_scene.model.bodies[tip]
        rest = body.normals.mean(axis=0)
        outward = rest / max(float(np.linalg.norm(rest)), 1e-12)
        # The finger's own direction, its frame's z, upwards.
        up = np.array([0.0, 0.0, 1.0]) if abs(outward[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        posed, turn = self._posed_scene.posed(state, tip), state.quaternions[tip]
        size = (2 * side, 2 * side)
        middle = posed.points.mean(axis=0)
        frame = Camera.towards(rotate(turn, outward), rotate(turn, up), middle, 1.0, size)
        reach = np.ptp(frame.project(rotate(turn, body.points) + state.positions[tip])[:, :2], axis=0).max()
        camera = Camera(frame.axes, middle, size[0] / (1.12 * float(reach)), size)
        layer = rasterise(camera, posed.points, posed.normals, posed.colours, posed.faces)
        picture = np.where(layer.drawn[..., None], shade(layer, camera.scale, gloss=0.0, hollows=False), 1.0)
        image = Image.fromarray((255.0 * halved(picture) + 0.5).astype(np.uint8))
        c = state.contacts
        slips = c.on(tip) & (c.status == SLIP) & (c.reactions[:, 0] > 0.0)
        pen = ImageDraw.Draw(image)
        places = camera.project(c.points[slips])[:, :2] * camera.scale / 2 * [1.0, -1.0] + side / 2
        ring = max(2.0, 0.022 * side)
        for px, py in places:
            pen.ellipse([px - ring, py - ring, px + ring, py + ring], outline=SLIP_COLOUR, width=max(1, round(1.6 * self.layout.unit)))
        return image

    def _draw_bar(self) -> Image.Image:
        """The colour scale of pressure."""
        assert self.layout.panel is not None
        width, height, u = self.layout.panel[2], round(62 * self.layout.unit), self.layout.unit
        figure = _figure(width, height)
        if self.peak <= 0.0:
            figure.text(8 * u / width, 0.79, "no contact: no pressure", fontsize=9 * u, color=MUTED, va="center")
            return _picture(figure)
        unit, name = pressure_unit(self.peak)
        axes = figure.add_axes((8 * u / width, 0.70, (width - 40 * u) / width, 0.18))
        bar = figure.colorbar(ScalarMappable(Normalize(0.0, self.peak / unit), "viridis"), cax=axes, orientation="horizontal")
        bar.set_label(f"pressure ({name})", fontsize=9 * u, color=INK, labelpad=2 * u)
        bar.ax.tick_params(labelsize=8.5 * u, colors=MUTED, length=3 * u)
        bar.outline.set_visible(False)
        return _picture(figure)

    def _draw_chart(self, times: tuple[float, float]) -> tuple[Image.Image, tuple[float, float]]:
        """Normal force of the fingers over the time of the film, and the px at which that begins and ends."""
        assert self.layout.chart is not None
        _, _, width, height = self.layout.chart
        u = self.layout.unit
        figure = _figure(width, height)
        left, right = 62 * u, width - 24 * u
        axes = figure.add_axes((left / width, 0.25, (right - left) / width, 0.56))
        columns = self.recording.columns
        thin = max(1, len(self._forces) // 4000)
        time, force = self.recording.times[self._steps][::thin], columns["fingers/normal_force"][self._steps][::thin]
        end = max(times[1], times[0] + self.recording.model.dt)
        for i, (start, stop, name) in enumerate(self.recording.phases(self._steps)):
            axes.axvspan(start, stop, color="#F1F1EF" if i % 2 == 0 else "white", linewidth=0)
            if (stop - start) / (end - times[0]) * (right - left) > 6.2 * u * len(name):
                place: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "ha": "center", "va": "bottom"}
                axes.text(0.5 * (start + stop), 1.03, name, fontsize=8 * u, color=MUTED, **place)
        for finger in range(force.shape[1]):
            # Fingers that share a squeeze press alike: dashes let the line below be seen.
            style = "-" if finger < 2 else (0, (3, 2))
            axes.plot(time, force[:, finger], color=FINGER_COLOURS[finger % 6], linewidth=1.6 * u, linestyle=style)
        axes.set(xlim=(times[0], end), ylim=(0.0, 1.12 * max(float(force.max(initial=0.0)), 1e-3)))
        axes.set_ylabel("normal\nforce (N)", fontsize=8.5 * u, color=INK)
        axes.set_xlabel("time (s)", fontsize=8.5 * u, color=INK, labelpad=1)
        axes.tick_params(labelsize=8 * u, colors=MUTED, length=3 * u)
        axes.locator_params(axis="y", nbins=4)
        if force.max(initial=0.0) <= 0.0:
            axes.set_yticks([])
            axes.text(0.5, 0.5, "no contact", transform=axes.transAxes, ha="center", va="center", fontsize=8.5 * u, color=MUTED)
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["bottom", "left"]].set_color("#BBBBBB")
        return _picture(figure), (left, right)

    def _cursor(self, pen: ImageDraw.ImageDraw, state: SceneState) -> None:
        assert self.layout.chart is not None
        left, top, _, height = self.layout.chart
        start, end = self._times
        share = (state.time - start) / max(end - start, self.recording.model.dt)
        x = left + self._chart_x[0] + share * (self._chart_x[1] - self._chart_x[0])
        pen.line([(x, top + 0.17 * height), (x, top + 0.75 * height)], fill=INK, width=max(1, round(1.5 * self.layout.unit)))


def _title_of(recording: SceneRecording) -> str:
    objects = [body.name for body in recording.model.bodies if body.kind == "object" and body.part_of is None]
    name = (
        Path(str(recording.columns.attributes.get("object", objects[0] if objects else "scene"))).stem.replace("-", " ").replace("_", " ")
    )
    return name[:1].upper() + name[1:]


def _short(name: str) -> str:
    """A finger's name where room is scarce: without the word."""
    return name.removesuffix(" finger") if len(name) > 9 else name


def _arrow_shape(start: AnyArray, end: AnyArray, unit: float, grow: float) -> list[tuple[float, float]]:
    """Corners of a flat arrow, px, ``grow`` px larger on all sides; the head of a short one is smaller."""
    along = np.asarray(end, float) - start
    length = float(np.linalg.norm(along))
    if length < 2.0:
        return [tuple(start)] * 3
    along /= length
    across = np.array([-along[1], along[0]])
    head = min(16.0 * unit, 0.62 * length)
    wide, thin = 0.5 * head, 0.15 * head
    corners = [
        (-grow, thin + grow),
        (length - head - grow, thin + grow),
        (length - head - grow, wide + 1.6 * grow),
        (length + 2.2 * grow, 0.0),
    ]
    corners += [(s, -w) for s, w in reversed(corners[:-1])]
    return [(float(p[0]), float(p[1])) for p in (start + s * along + w * across for s, w in corners)]


def _figure(width: int, height: int) -> Figure:
    return Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")


def _picture(figure: Figure) -> Image.Image:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())  # type: ignore[no-untyped-call]


__all__ = ["Layout", "Overlay"]
