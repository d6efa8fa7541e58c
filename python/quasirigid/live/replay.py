"""``quasirigid replay``: a recording in the same view as a live world, with a timeline."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import viser

from quasirigid.live import html
from quasirigid.live.curves import Curves
from quasirigid.live.draw import Layers, SceneDrawing
from quasirigid.live.error_log import ErrorLog
from quasirigid.live.framing import Framing, frame_of
from quasirigid.live.panel import ViewPanel, from_page, set_value
from quasirigid.live.scale_bar import set_scene
from quasirigid.live.server import HANDLE, LEFT_WIDTH, SLOW_RATE
from quasirigid.live.stage import PORT, close_server, open_server, page_url
from quasirigid.live.tactile import Tactile
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.scene.model import SceneState
from quasirigid.scene.pressure import SLIP, Scale
from quasirigid.scene.scaling import drawing_scale, scaled_model, scaled_state

RATE = 40.0
"""Updates of the page per second, at most."""
CURVE_POINTS = 1500
"""Most points of the curves over the whole recording."""
SPEEDS = ("0.02", "0.1", "0.25", "0.5", "1", "2", "4")


class Timeline:
    """Where in the recording the view is, and how it moves on. Any thread may call it."""

    def __init__(self, times: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
        self.start, self.end = float(times[0]), float(times[-1])
        self._lock = threading.Lock()
        self._time = self.start
        self._since = time.perf_counter()
        self._playing, self._speed, self.loop = False, 1.0, True

    @property
    def playing(self) -> bool:
        """Whether it moves on by itself."""
        return self._playing

    def now(self) -> float:
        """The time of the recording that is due, s; at the end it starts again or stops."""
        with self._lock:
            if not self._playing:
                return self._time
            clock = time.perf_counter()
            self._time += self._speed * (clock - self._since)
            self._since = clock
            if self._time > self.end:
                length = self.end - self.start
                if self.loop and length > 0.0:
                    self._time = self.start + (self._time - self.start) % length
                else:
                    self._time, self._playing = self.end, False
            return self._time

    def play(self, on: bool) -> None:
        """Play or pause; from the end it plays from the start."""
        self.now()
        with self._lock:
            if on and not self._playing and self._time >= self.end:
                self._time = self.start
            self._playing, self._since = on, time.perf_counter()

    def seek(self, to: float) -> None:
        """Go to a time, s."""
        with self._lock:
            self._time, self._since = min(max(to, self.start), self.end), time.perf_counter()

    def set_speed(self, speed: float) -> None:
        """Simulated seconds per second."""
        self.now()
        with self._lock:
            self._speed = speed


class FixedScale(Scale):
    """One full scale from start to end: colours of two moments can be compared."""

    def follow(self, peak: float) -> bool:  # noqa: ARG002
        """Stays as it is."""
        return False


class ReplayView:
    """A page that shows a recording. Use it as a context manager, or call ``close``."""

    def __init__(self, path: str | Path, *, host: str = "127.0.0.1", port: int = PORT, allow_origins: Sequence[str] = ()) -> None:
        """Open the recording at ``path`` and serve the page. Raises ``RecordingError`` for a file that cannot be replayed."""
        self.recording = SceneRecording(path)
        try:
            self.server = open_server(host, port, f"quasirigid: {Path(path).name}", allow_origins)
        except BaseException:
            self.recording.close()
            raise
        self.host = host
        self.timeline = Timeline(self.recording.times)
        self._layers = Layers()
        self._redraw = threading.Event()
        self._ended = threading.Event()
        self._wake = threading.Event()
        self._step = -1
        """The step on show."""
        model = self.recording.model
        state = self.recording.state(0)
        state = self._widest(state)
        self._scale = drawing_scale(model, state)
        drawn, shown = scaled_model(model, self._scale), scaled_state(state, self._scale)
        self._now = drawn, shown
        self._framing = Framing(self.server)
        set_scene(self.server, self._framing, frame_of(drawn, shown, HANDLE * bool(model.fingers)), drawn.floor, self._scale)
        self._drawing = SceneDrawing(self.server, drawn, layers=self._layers)
        top = float(f"{1.05 * max(self.recording.peak_pressure(), 1e3):.1e}")
        self._drawing.scale = FixedScale(top)
        self._tactile = Tactile(model)
        self._panel()
        self._thread = threading.Thread(target=self._show_on, name="quasirigid-replay", daemon=True)
        self._thread.start()

    def _widest(self, first: SceneState) -> SceneState:
        """The state for the camera: halfway through the recording, where something is held, unless it has ended early."""
        middle = self.recording.state(len(self.recording) // 2)
        return first if middle.quarantined else middle

    @property
    def url(self) -> str:
        """Address of the page."""
        return page_url(self.host, self.server.get_port())

    @property
    def step(self) -> int:
        """The step on show, counted from 0."""
        return self._step

    def close(self) -> None:
        """End the page."""
        self._ended.set()
        self._wake.set()
        self._thread.join(timeout=5.0)
        close_server(self.server)
        self.recording.close()

    def __enter__(self) -> ReplayView:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _panel(self) -> None:
        gui, line = self.server.gui, self.timeline
        gui.set_panel_label("quasirigid replay")
        self._framing.add_button(lambda: self._now)
        self._status = gui.add_html("")
        with gui.add_folder("Timeline"):
            buttons = gui.add_button_group("Replay", ("Play", "Pause", "‹", "›"), hint="‹ and › go one time step back and on")
            dt = self.recording.model.dt
            span = max(line.end - line.start, dt)
            self._slider = gui.add_slider("Time (s)", line.start, line.start + span, dt, line.start)
            speed = gui.add_dropdown("Speed (× real time)", SPEEDS, initial_value="1")
            loop = gui.add_checkbox("Loop", line.loop)
        with gui.add_folder("View"):
            ViewPanel(self.server, self._layers, self._layers_changed)
        left = gui.add_panel()
        with left.add_tab("Sensors") as sensors:
            self._legend = gui.add_html("")
            self._picture = gui.add_image(np.full((8, 8, 3), 255, np.uint8), format="png")
        timing = left.add_tab("Timing") if self.recording.model.fingers else None
        self._fill_curves(Curves(self.server, self.recording.model, sensors, timing))
        left.dock_left()
        left.set_width(LEFT_WIDTH)

        @buttons.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            name = event.target.value
            if name in ("Play", "Pause"):
                line.play(name == "Play")
            else:
                self.go_to(self._step + (1 if name == "›" else -1))
            self._wake.set()

        @self._slider.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            if from_page(event):
                line.seek(float(event.target.value))
                self._wake.set()

        @speed.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            line.set_speed(float(event.target.value))

        @loop.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            line.loop = bool(event.target.value)

    def _layers_changed(self) -> None:
        self._redraw.set()
        self._wake.set()

    def go_to(self, step: int) -> None:
        """Pause, and show a step, counted from 0."""
        self.timeline.play(False)
        self.timeline.seek(float(self.recording.times[min(max(step, 0), len(self.recording) - 1)]))
        self._wake.set()

    def _fill_curves(self, curves: Curves) -> None:
        """The curves over the whole recording."""
        columns = self.recording.columns
        thin = slice(None, None, max(1, len(self.recording) // CURVE_POINTS))
        forces, times = columns["fingers/normal_force"][thin], self.recording.times[thin]
        curves.show(times.tolist(), forces.tolist(), columns["report/step_time"][thin].tolist(), columns["report/contacts"][thin].tolist())

    def _show_on(self) -> None:
        slow, errors = 0.0, ErrorLog()
        while not self._ended.is_set():
            began = time.perf_counter()
            playing = self.timeline.playing
            step = self.recording.step_at(self.timeline.now())
            redraw = self._redraw.is_set()
            settled = not self.timeline.playing
            if step != self._step or redraw or (settled and playing):
                self._redraw.clear()
                slowly = settled or began - slow > 1.0 / SLOW_RATE
                slow = began if slowly else slow
                try:
                    self._show(step, redraw=redraw, exact=settled, figures=slowly)
                except Exception as error:  # a damaged step, or the server was stopped meanwhile: the next one may be whole
                    self._step = step
                    if not self._ended.is_set():
                        errors.log(error)
                        self._status.content = html.complaint(f"step {step} cannot be shown: {error}")
            if settled:
                self._wake.wait(0.2)
                self._wake.clear()
            else:
                time.sleep(max(0.0, 1.0 / RATE - (time.perf_counter() - began)))

    def _show(self, step: int, *, redraw: bool, exact: bool, figures: bool) -> None:
        if redraw:
            self._drawing.apply_layers()
        state = self.recording.state(step)
        self._now = self._drawing.model, scaled_state(state, self._scale)
        self._drawing.draw(self._now[1], exact=exact)
        self._step = step
        if figures:
            self._figures(state)

    def _figures(self, state: SceneState) -> None:
        """What is slow to show: words, legend, pictures, the slider."""
        contacts = state.contacts
        loaded = contacts.reactions[:, 0] > 0.0
        slips = int((contacts.status[loaded] == SLIP).sum())
        rows = [("phase", state.phase), ("time", f"{state.time:.3f} s of {self.timeline.end:.3f} s")]
        rows += [("contacts", f"{int(loaded.sum())}, {slips} slip"), ("step", f"{state.step}, computed in {1e3 * state.step_time:.2f} ms")]
        for name, force, normal in zip(self.recording.model.fingers, state.finger_forces, state.normal_forces, strict=True):
            rows.append((name, f"presses with {normal:.2f} N, whole force {np.linalg.norm(force):.2f} N"))
        if not self.recording.columns.complete:
            rows.append(("recording", "its run was ended, or still goes on"))
        self._status.content = html.table([row for row in rows if row[1]])
        scale = self._drawing.scale.top
        self._legend.content = html.legend(scale if self.recording.model.fingers else None)
        if self.recording.model.fingers:
            self._picture.image = self._tactile.picture(state, scale)
        set_value(self._slider, state.time)


__all__ = ["ReplayView", "Timeline"]
