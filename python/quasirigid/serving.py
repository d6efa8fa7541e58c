"""Servers that run in a thread of their own beside a session."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from concurrent.futures import Future
from typing import Any


def run_server(loop: asyncio.AbstractEventLoop, served: Coroutine[Any, Any, None], ready: Future[tuple[str, int]]) -> None:
    """What the thread does: ``served`` until it ends, then ``loop`` is closed. ``ready`` gets the address from ``served``, or its ``OSError``."""
    asyncio.set_event_loop(loop)
    try:
        loop.run_until_complete(served)
    except OSError as error:
        ready.set_exception(error)
    finally:
        loop.close()
