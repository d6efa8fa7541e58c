"""The panel: buttons and sliders that turn into commands for the simulation thread, and figures that come back."""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import viser

from quasirigid.errors import QuasirigidError
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.setup import GraspTarget
from quasirigid.live import html
from quasirigid.live.draw import Layers
from quasirigid.live.object_library import LARGEST_UPLOAD, SHAPES, built_in, from_upload
from quasirigid.live.play import PULL_LIMIT, Figures, Play
from quasirigid.live.session import Frame, Session
from quasirigid.live.uploads import UploadGate
from quasirigid.objects import FORMATS

KEPT = 4
"""Objects from files that can be chosen again."""
SOFT = ("fingertip_pulp", "silicone", "ecoflex", "rubber")
"""Materials that a fingertip may be of."""


def from_page(event: Any) -> bool:
    """Whether a person did it; values set by the program itself are not commands."""
    return event.client is not None


def set_value(handle: Any, value: object) -> None:
    """Sets what an input shows; viser's own type for it is read-only to type checkers."""
    handle.value = value


def show_value(slider: viser.GuiSliderHandle[float], value: float) -> None:
    """Sets a slider to what is so, and widens it where that lies outside: the figure of a file or of the command line is not touched."""
    widened: Any = slider
    if value > widened.max:
        unit = 10.0 ** (math.floor(math.log10(value)) - 1)
        widened.max = max(value, round(math.ceil(value / unit) * unit, 9))  # two digits: it stands below the slider
    if value < widened.min:
        widened.min = value
    if 0.0 < value < widened.step:  # else it would be shown as 0
        widened.precision = 1 - math.floor(math.log10(value))
        widened.step = 10.0**-widened.precision
    set_value(slider, float(value))


class ViewPanel:
    """What is shown and how; the same for live and recorded scenes."""

    def __init__(self, server: viser.ViserServer, layers: Layers, changed: Callable[[], None]) -> None:
        """``changed`` is called after ``layers`` was changed."""
        gui = server.gui
        boxes = {
            "object": gui.add_checkbox("Object", layers.object),
            "hand": gui.add_checkbox("Hand", layers.hand),
            "patches": gui.add_checkbox("Patches", layers.patches, hint="Colour on the pads where they are pressed"),
            "contact_forces": gui.add_checkbox("Contact forces", layers.contact_forces, hint="One arrow per contact; the longest is 5 mm"),
            "finger_forces": gui.add_checkbox(
                "Finger forces", layers.finger_forces, hint="Sum over each finger; 12 mm per N, the longest at most 90 mm"
            ),
        }
        for name, box in boxes.items():

            def toggle(event: viser.GuiEvent[Any], name: str = name) -> None:
                setattr(layers, name, event.target.value)
                changed()

            box.on_update(toggle)
        opacity = gui.add_slider("Opacity of the object", 0.05, 1.0, 0.05, layers.object_opacity)
        colours = gui.add_dropdown("Colour of patches", ("pressure", "stick and slip"), initial_value=layers.patch_colours)

        @opacity.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            layers.object_opacity = float(event.target.value)
            changed()

        @colours.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            layers.patch_colours = event.target.value
            changed()


class ControlPanel:
    """Run, hand, figures, object."""

    def __init__(self, server: viser.ViserServer, session: Session, options: GraspOptions, play: Play) -> None:
        """``play`` is what the session begins with, made from ``options``."""
        self._session, self._options = session, options
        self._generation = -1
        self._choice = play.choice
        """What the object is now."""
        self._files: dict[str, Callable[[], Play]] = {}
        """What makes a grasp of an object from a file, by the name in the list, the oldest first."""
        if play.choice not in SHAPES:
            self._keep(play)
        gui = server.gui
        self._status = gui.add_html("")
        self._pull = gui.add_html("")
        self._complaint = gui.add_html("")
        run = gui.add_button_group(
            "Simulation", ("Run", "Pause", "Step", "Reset"), hint="Step is one time step; Reset brings back the start and all figures"
        )
        hand = gui.add_button_group("Hand", ("Close", "Open", "Lift", "Lower"))
        speed = gui.add_slider("Speed (× real time)", 0.05, 2.0, 0.05, 1.0)
        with gui.add_folder("Physics"):
            self._sliders = {
                "squeeze": gui.add_slider("Squeeze (N)", 0.5, 15.0, 0.1, 4.0, hint="Force of the thumb; the fingers share as much"),
                "friction": gui.add_slider("Friction", 0.0, 1.5, 0.01, 0.7, hint="Coulomb coefficient between fingers and object"),
                "mass": gui.add_slider("Mass (kg)", 0.02, 2.0, 0.01, 0.2),
                "gravity": gui.add_slider("Gravity (m/s²)", 0.0, 20.0, 0.01, 9.81),
            }
            self._pad = gui.add_dropdown("Fingertips", SOFT, initial_value=SOFT[0])
        with gui.add_folder("Object"):
            self._shape = gui.add_dropdown("Shape", (*SHAPES, *self._files), initial_value=play.choice)
            upload = gui.add_upload_button(
                "Load a file", mime_type=",".join(FORMATS), hint=f"{', '.join(FORMATS)}; at most {LARGEST_UPLOAD // 1024**2} MB"
            )
            self._note = gui.add_html("")
        self._message = ""
        self._lock = threading.Lock()
        gate = UploadGate(server, LARGEST_UPLOAD, self._say)

        @run.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            actions = {"Run": lambda: session.run(True), "Pause": lambda: session.run(False), "Step": session.single, "Reset": self._reset}
            actions[event.target.value]()

        @hand.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            actions: dict[str, Callable[[Play], None]] = {
                "Close": Play.close,
                "Open": Play.open,
                "Lift": lambda play: play.lift(True),
                "Lower": lambda play: play.lift(False),
            }
            session.do(actions[event.target.value])

        @speed.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            if from_page(event):
                session.set_speed(float(event.target.value))

        setters: dict[str, Callable[[Play, float], None]] = {
            "squeeze": Play.set_squeeze,
            "friction": Play.set_friction,
            "mass": Play.set_mass,
            "gravity": Play.set_gravity,
        }
        for name, slider in self._sliders.items():

            def set_figure(event: viser.GuiEvent[Any], setter: Callable[[Play, float], None] = setters[name]) -> None:
                if from_page(event):
                    value = float(event.target.value)
                    session.do(lambda play: setter(play, value))

            slider.on_update(set_figure)

        @self._pad.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            if from_page(event):
                name = event.target.value
                session.do(lambda play: play.set_pad(name))

        @self._shape.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            if from_page(event):
                name = event.target.value
                self._load(self._files.get(name, lambda: self._another(name, lambda o, mu, _density: built_in(name, o, mu))))

        @upload.on_upload
        def _(event: viser.GuiEvent[Any]) -> None:
            file = event.target.value
            name = Path(file.name).name

            def make() -> Play:
                play = self._another(name, lambda o, mu, density: from_upload(name, file.content, o, mu, density))
                self._keep(play)
                self._shape.options = (*SHAPES, *self._files)
                return play

            self._load(make, lambda why: gate.tell_refused(event.client_id, name, why))

    def _another(self, name: str, target: Callable[[GraspOptions, float, float], GraspTarget]) -> Play:
        """A grasp of an object other than that of the options."""
        return Play(replace(self._options, object=None, scale=None, size=None), target, name)

    def _keep(self, play: Play) -> None:
        """Remember how an object from a file is made, so that it can be chosen again; the newest of a name."""
        options, target, name = play.options, play.grasp.target, play.choice
        self._files.pop(name, None)
        self._files[name] = lambda: Play(options, lambda *_: target, name)
        for oldest in list(self._files)[:-KEPT]:
            del self._files[oldest]

    def _load(self, make: Callable[[], Play], refused: Callable[[str], None] | None = None) -> None:
        """Builds a grasp of another object here, not in the simulation thread, and then swaps it in.

        ``refused`` is called with the reason if that fails.
        """
        self._say("")
        try:
            play = make()
        except QuasirigidError as error:
            self._say(str(error))
            set_value(self._shape, self._choice)
            if refused is not None:
                refused(str(error))
            return
        self._note.content = html.note("; ".join(play.grasp.target.warnings))
        self._session.load(lambda: play)

    def _reset(self) -> None:
        self._say("")
        self._session.reset()

    def _say(self, text: str) -> None:
        with self._lock:
            self._message = text
            self._complaint.content = html.complaint(text)

    def show(self, frame: Frame) -> None:
        """Figures of a frame; sliders follow a rebuilt world."""
        self._status.content = html.figures(
            frame.state.phase,
            frame.state.time,
            frame.real_time,
            frame.speed,
            frame.step_time,
            len(frame.state.contacts),
            running=frame.running,
        )
        self._pull.content = html.force(0.0 if frame.pulled is None else frame.pulled[2], PULL_LIMIT)
        try:
            while True:
                self._say(self._session.complaints.get_nowait())
        except queue.Empty:
            pass
        if frame.generation != self._generation:
            self._generation, self._choice = frame.generation, frame.choice
            self._follow(frame.figures)
            set_value(self._shape, frame.choice)

    def _follow(self, figures: Figures) -> None:
        for name, slider in self._sliders.items():
            show_value(slider, getattr(figures, name))
        set_value(self._pad, figures.pad)
