"""A page to watch a grasp in that somebody else runs: ``quasirigid grasp --view``."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass

from quasirigid.grasp.experiment import Grasp
from quasirigid.live.watch import watch


@dataclass(frozen=True)
class Page:
    """A page to watch a grasp in: who may look (``host``), on which port (or the next free one), whether to open it in the ``browser``, and
    pages that may use it beside its own (``quasirigid.net.access.Access``).
    """

    host: str = "127.0.0.1"
    port: int = 8080
    browser: bool = True
    allow_origins: tuple[str, ...] = ()

    def open(self, grasp: Grasp) -> AbstractContextManager[object]:
        """Show the grasp from now on, and keep its steps to the clock."""
        grasp.real_time = True
        return watch(
            grasp.world,
            self.host,
            self.port,
            self.browser,
            allow_origins=self.allow_origins,
            phase=lambda: grasp.phase,
            speed=1.0,
            ends="it ends with the run",
        )
