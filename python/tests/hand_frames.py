"""Hands for the tests of motion capture: the shipped motion frame by frame, spoilt as a test wants it, and a source that plays it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from quasirigid import mocap
from quasirigid.scene.model import SceneModel, SceneState

START = 36_000.0
"""Tracker's time at the start of the take, s."""
Edit = Callable[[float, npt.NDArray[np.bool_], npt.NDArray[np.float64]], None]
"""Gets time (s), what is tracked (6,) and positions (6, 3), and changes them."""


def spoilt_frames(edit: Edit, side: Literal["left", "right"] = "right") -> list[mocap.HandFrame]:
    """The frames of the shipped motion without noise, changed by ``edit``."""
    out = []
    for frame in mocap.Take.pinch(noise=0.0, tremor=0.0, side=side).frames(mocap.HandDecoder(side)):
        tracked, positions = frame.tracked.copy(), frame.positions.copy()
        edit(frame.time - START, tracked, positions)
        out.append(copied(frame, frame.arrival, tracked.tolist(), positions))
    return out


def copied(
    frame: mocap.HandFrame,
    arrival: float,
    tracked: Sequence[bool] | None = None,
    positions: npt.ArrayLike | None = None,
    quaternions: npt.ArrayLike | None = None,
) -> mocap.HandFrame:
    """The same hand that arrives at another time."""
    return mocap.HandFrame(
        frame.side,
        frame.positions if positions is None else positions,
        frame.quaternions if quaternions is None else quaternions,
        frame.pad_radii,
        frame.tracked.tolist() if tracked is None else tracked,
        time=frame.time,
        arrival=arrival,
    )


def part(directory: Path, take: mocap.Take | None = None, *, since: float = 0.0, until: float = 1e3) -> mocap.Take:
    """What arrives from ``since`` to ``until`` s of a take, the shipped one unless told otherwise. ``directory`` is written to."""
    packets = (take or mocap.shipped_take()).packets
    with mocap.TakeWriter(directory / "part.take") as writer:
        for packet in packets:
            if since <= packet.arrival < until:
                writer.packet(packet.arrival - since, packet.data)
    return mocap.Take.read(directory / "part.take")


class FrameSource:
    """Plays frames in simulated time."""

    real_time = False
    when_silent = "nothing comes"

    def __init__(self, frames: Sequence[mocap.HandFrame]) -> None:
        self._frames = sorted(frames, key=lambda frame: frame.arrival)
        self._next, self._now = 0, self._frames[0].arrival

    def now(self) -> float:
        return self._now

    def wait_until(self, moment: float) -> None:
        self._now = max(self._now, moment)

    def take(self) -> Sequence[mocap.HandFrame]:
        first = self._next
        while self._next < len(self._frames) and self._frames[self._next].arrival <= self._now:
            self._next += 1
        return self._frames[first : self._next]

    def ended(self) -> bool:
        return self._next == len(self._frames)

    def statistics(self) -> dict[str, Any]:
        return {"packets": len(self._frames), "lost": 0, "malformed": 0}

    def close(self) -> None:
        pass


class Kept:
    """A viewer that keeps all it is shown."""

    def __init__(self) -> None:
        self.models: list[SceneModel] = []
        self.states: list[SceneState] = []

    def begin(self, model: SceneModel) -> None:
        self.models.append(model)

    def wants_state(self) -> bool:
        return True

    def reset_asked(self) -> bool:
        return False

    def draw(self, state: SceneState) -> None:
        self.states.append(state)
