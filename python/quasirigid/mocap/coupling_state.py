"""Going back in time with a coupling: what it remembers beside the world."""

from __future__ import annotations

import copy
from typing import Any

from quasirigid._quasirigid import Body, Hand
from quasirigid.errors import InvalidValueError


class CouplingState:
    """A snapshot of a coupling, see ``Restorable``. Never changes."""

    def __init__(self, coupling: Restorable, content: dict[str, Any]) -> None:
        self.coupling, self.content = coupling, content


class Restorable:
    """A coupling whose state can be kept and taken back, together with that of its world.

        world_before, coupling_before = world.snapshot(), coupling.snapshot()
        ...
        world.restore(world_before)
        coupling.restore(coupling_before)

    A copy that goes on by itself is ``copy.deepcopy((world, coupling))``, both in one call: the copied coupling moves what is in the copied
    world. The same holds for pickle. The tracker is no part of it: ``copy.copy(tracker)`` is one that goes on by itself.
    """

    @property
    def pads(self) -> list[Body]:
        """Pads that are bodies of their own: none, unless the coupling has some."""
        return []

    @property
    def hands(self) -> list[Hand]:
        """Hands that were added: none, unless the coupling has some."""
        return []

    def _content(self, content: dict[str, Any]) -> dict[str, Any]:
        # Handles stay those of this world.
        return copy.deepcopy(content, {id(part): part for part in (*self.pads, *self.hands)})

    def snapshot(self) -> CouplingState:
        """The state as it is now, without the world's."""
        return CouplingState(self, self._content(vars(self)))

    def restore(self, state: CouplingState) -> None:
        """Go on from a state that this coupling was in. Raises ``InvalidValueError`` for one of another coupling."""
        if state.coupling is not self:
            hint = "to branch a session, copy.deepcopy((world, coupling))"
            raise InvalidValueError("state of a coupling", "one that this coupling was in", "one of another", hint)
        content = self._content(state.content)
        vars(self).clear()
        vars(self).update(content)
