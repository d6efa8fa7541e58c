"""What is observed of a session, and who gets it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.scene.model import ContactsState, SceneModel, SceneState
from quasirigid.scene.pressure import SLIP


@dataclass(frozen=True, eq=False)
class Observation:
    """What is seen of a session now and then. Rows are the simulated fingers."""

    time: float
    """Simulated, s."""
    fingers: tuple[str, ...]
    rows: tuple[int, ...]
    """Their rows in hand arrays."""
    force: FloatArray
    """(fingers, 3) N, world: of the object on each finger."""
    pressing: FloatArray
    """(fingers,) N: sum of the normal reactions on the object."""
    slipping: FloatArray
    """(fingers,) 0 to 1: share of the pressing force whose contacts slip."""
    phase: str
    torque: FloatArray
    """(fingers, 3) N m, world: of the object on each finger, about the contact point."""
    contact_point: FloatArray
    """(fingers, 3) m, world: mean of the contacts with the object, weighted with their normal reactions; NaN where there is none."""
    object_pose: FloatArray
    """(7,) m and quaternion (w, x, y, z), body frame to world."""
    wall_time: float
    """Unix time, s, at which it was seen."""
    tracker_frame: int | None = None
    """Frame counter of the newest packet; ``None`` if the source has none."""
    tracker_time: float | None = None
    """Time of the newest packet on the tracker's clock, s; ``None`` if it sends none."""
    hand: int = 0
    """Number of the tracked hand in its source; 0 where it has none."""


def press_and_slip(contacts: ContactsState, body: int) -> tuple[float, float]:
    """Sum of the normal reactions at the contacts of a body of the scene, N, and the share of it whose contacts slip."""
    mine = (contacts.body_a == body) | (contacts.body_b == body)
    press = contacts.reactions[mine, 0]
    total = float(press.sum())
    return total, float(press[contacts.status[mine] == SLIP].sum()) / total if total > 0.0 else 0.0


def contact_wrenches(contacts: ContactsState, object_index: int, places: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Contact points (n, 3) m and torques (n, 3) N m about them, world, of what body ``object_index`` of the scene does to the
    bodies ``places``.

    NaN and 0 for those that it does not touch.
    """
    points, torques = np.full((len(places), 3), np.nan), np.zeros((len(places), 3))
    for row, place in enumerate(places):
        on_a = (contacts.body_a == place) & (contacts.body_b == object_index)
        mine = on_a | ((contacts.body_b == place) & (contacts.body_a == object_index))
        press = contacts.reactions[mine, 0]
        total = float(press.sum())
        if total > 0.0:
            points[row] = press @ contacts.points[mine] / total
            forces = np.where(on_a[mine], 1.0, -1.0)[:, None] * contacts.forces[mine]
            torques[row] = np.cross(contacts.points[mine] - points[row], forces).sum(axis=0)
    return points, torques


Observer = Callable[[Observation], None]


class Viewer(Protocol):
    """Somebody who shows the session while it runs."""

    def begin(self, model: SceneModel) -> None:
        """Show this scene from now on."""

    def wants_state(self) -> bool:
        """Whether it is time for a state."""

    def draw(self, state: SceneState) -> None:
        """Show this state."""

    def reset_asked(self) -> bool:
        """Whether somebody has asked in the page, since the last call, for the object to be put back."""
