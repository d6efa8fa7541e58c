"""Who looks at a session, and what they are shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from quasirigid.view.scene import SceneModel, SceneState

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


Observer = Callable[[Look], None]


class Viewer(Protocol):
    """Somebody who shows the session while it runs."""

    def begin(self, model: SceneModel) -> None:
        """Show this scene from now on."""

    def wants_state(self) -> bool:
        """Whether it is time for a state."""

    def draw(self, state: SceneState) -> None:
        """Show this state."""
