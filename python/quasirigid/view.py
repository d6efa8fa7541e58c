"""``quasirigid.view(world)``: the live view of a world that you step yourself. What it is made of is in ``quasirigid.live``.

The module can be called: that is ``open_view``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from quasirigid._quasirigid import Body, World
    from quasirigid.live.watch import WorldView


def open_view(
    world: World,
    *,
    fingertips: Sequence[Body] = (),
    host: str = "127.0.0.1",
    port: int = 8080,
    browser: bool = True,
    allow_origins: Sequence[str] = (),
) -> WorldView:
    """Show a world in the browser while you go on stepping it; returns at once.

    The page shows ``world`` up to 30 times a second and never changes it. Hands show what their pads feel: pressure, forces, plots. So do
    the bodies that you name as ``fingertips``. ``host`` is who may look: this machine alone
    unless you say otherwise. Pages of other servers are refused, and names that are not this machine's; ``allow_origins`` are
    those that may show and use the page nevertheless: a notebook's server, such as ``["http://localhost:8888"]``. If ``port`` is in use,
    the next free one is taken and said. ``browser`` opens the page. ``close`` it, or use it in a ``with`` block.

    Raises ``InvalidValueError`` for a host that is not this machine's, a port out of range, an origin that is none, ``InvalidHandleError``
    for a fingertip that was removed.
    """
    from quasirigid.live.watch import watch  # the server takes half a second to import: only with a page

    return watch(world, host, port, browser, fingertips=fingertips, allow_origins=allow_origins)


class _CallableModule(ModuleType):
    """A module that can be called, as the function and as ``import quasirigid.view``."""

    def __call__(
        self,
        world: World,
        *,
        fingertips: Sequence[Body] = (),
        host: str = "127.0.0.1",
        port: int = 8080,
        browser: bool = True,
        allow_origins: Sequence[str] = (),
    ) -> WorldView:
        """``open_view``."""
        return open_view(world, fingertips=fingertips, host=host, port=port, browser=browser, allow_origins=allow_origins)


__path__: list[str] = []
"""Its parts have moved to ``quasirigid.live`` and elsewhere: ``quasirigid._moved``."""
sys.modules[__name__].__class__ = _CallableModule
