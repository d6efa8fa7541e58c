"""What the picture of a grasp shows, read from its recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.types import AnyArray
from quasirigid.grasp.columns import check_grasp, contacts_on_object
from quasirigid.grasp.summary import creep, phases, settled
from quasirigid.recording.file import damaged
from quasirigid.recording.reader import Recording
from quasirigid.rotation import pose_in
from quasirigid.scene.pressure import spread


@dataclass(frozen=True, eq=False)
class Shot:
    """What is drawn, from a recording."""

    scene: dict[str, AnyArray]
    contacts: dict[str, AnyArray]
    fingers: list[str]
    forces: AnyArray
    """(fingers, 3) N on the object, world: arrows."""
    normal: AnyArray
    """(fingers,) N, the summed normal force of each finger."""
    friction: AnyArray
    """(fingers,) N, the length of the summed friction of each finger."""
    time: float
    """The end of the first hold, s."""
    drift: float | None
    """m/s in the hand, or ``None`` of a hold of one step."""
    attributes: dict[str, Any]

    @property
    def peak(self) -> float:
        """Largest pressure of a finger on the object, Pa."""
        mine = self.contacts["finger"] >= 0
        return max(float(self.contacts["pressure"][mine].max(initial=0.0)), 1.0)

    def patch(self, finger: int) -> npt.NDArray[np.bool_]:
        """The loaded contacts of a finger with the object."""
        mine: npt.NDArray[np.bool_] = (self.contacts["finger"] == finger) & (self.contacts["pressure"] > 0.0)
        return mine

    def centre(self, finger: int) -> AnyArray | None:
        """Centre of pressure of a finger, (3,) m, world."""
        mine = self.patch(finger)
        if not mine.any():
            return None
        centre: AnyArray = np.average(self.contacts["point"][mine].astype(float), axis=0, weights=self.contacts["reaction"][mine, 0])
        return centre


def read_shot(recording: Recording) -> Shot | None:
    """What the picture needs, or ``None`` if the run did not come to the end of its first hold.

    Raises ``RecordingError`` if the recording is not that of a grasp.
    """
    check_grasp(recording)
    scene = {name: np.asarray(values) for name, values in recording.stills("scene").items()}
    if not scene or int(scene["step"]) >= recording.steps:
        return None
    for name, values in scene.items():
        if not np.isfinite(values).all():
            raise damaged(recording.path, f"column scene/{name}", "finite numbers", "some that are not")
    step, dt = int(scene["step"]), float(recording.attributes["dt"])
    hold = next(span for span in phases(recording["phase"], recording["time"], dt) if span.first <= step < span.last)
    steady = settled(hold, dt)
    return Shot(
        scene=scene,
        contacts=contacts_on_object(recording, step),
        fingers=recording.labels("hand/force_on_object"),
        forces=recording["hand/force_on_object"][step],
        normal=recording["hand/normal_force"][step],
        friction=recording["hand/tangential_force"][step],
        time=float(recording["time"][step]),
        drift=creep(pose_in(recording["hand/pose"][steady], recording["object/pose"][steady]), dt)[0],
        attributes=recording.attributes,
    )


def pressure_on(points: AnyArray, shot: Shot, finger: int) -> AnyArray:
    """Pressure (n,) Pa at ``points`` (n, 3) of a pad: that of the contacts around."""
    mine = shot.patch(finger)
    return spread(points, *(shot.contacts[name][mine].astype(float) for name in ("point", "pressure", "area")))


__all__ = ["Shot", "pressure_on", "read_shot"]
