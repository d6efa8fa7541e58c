"""Who looks at a session, and what they are shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from quasirigid.view.pressure import SLIP
from quasirigid.view.scene import ContactsState, SceneModel, SceneState

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Look:
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
    hand: int = 0
    """Number of the tracked hand in its source; 0 where it has none."""


def press_and_slip(contacts: ContactsState, body: int) -> tuple[float, float]:
    """Sum of the normal reactions at the contacts of a body of the scene, N, and the share of it whose contacts slip."""
    mine = (contacts.body_a == body) | (contacts.body_b == body)
    press = contacts.reactions[mine, 0]
    total = float(press.sum())
    return total, float(press[contacts.status[mine] == SLIP].sum()) / total if total > 0.0 else 0.0


Observer = Callable[[Look], None]


class Viewer(Protocol):
    """Somebody who shows the session while it runs."""

    def begin(self, model: SceneModel) -> None:
        """Show this scene from now on."""

    def wants_state(self) -> bool:
        """Whether it is time for a state."""

    def draw(self, state: SceneState) -> None:
        """Show this state."""
