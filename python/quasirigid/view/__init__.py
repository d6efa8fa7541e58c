"""The live view in the browser: what is drawn, how, and what a person can do with it.

``quasirigid.view(world)`` calls this package: it is ``open_view``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from quasirigid._quasirigid import Body, World
    from quasirigid.view.watch import WorldView


def open_view(
    world: World, *, fingertips: Sequence[Body] = (), host: str = "127.0.0.1", port: int = 8080, browser: bool = True
) -> WorldView:
    """Show a world in the browser while you go on stepping it; returns at once.

    The page follows ``world`` at up to 30 looks a second and never changes it. Hands show what their pads feel: pressure, forces, plots. So do the
    bodies that you name as ``fingertips``. ``host`` is who may look: this machine alone
    unless you say otherwise. If ``port`` is in use, the next free one is taken and said. ``browser`` opens the page.
    ``close`` it, or use it in a ``with`` block.

    Raises ``InvalidValueError`` for a host that is not this machine's, a port out of range, ``InvalidHandleError`` for a
    fingertip that was removed.
    """
    from quasirigid.view.watch import watch  # the server takes half a second to import: only who looks pays for it

    return watch(world, host, port, browser, fingertips=fingertips)


class _CallableModule(ModuleType):
    """``quasirigid.view`` is the package, so that ``import quasirigid.view.replay as r`` finds it, and can be called."""

    def __call__(
        self, world: World, *, fingertips: Sequence[Body] = (), host: str = "127.0.0.1", port: int = 8080, browser: bool = True
    ) -> WorldView:
        """``open_view``."""
        return open_view(world, fingertips=fingertips, host=host, port=port, browser=browser)


sys.modules[__name__].__class__ = _CallableModule
