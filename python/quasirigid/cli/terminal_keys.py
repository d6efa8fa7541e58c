"""Keys that are pressed in the terminal while a session runs."""

from __future__ import annotations

import os
import select
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

RESET_KEY = "r"
LISTENS = 0.2
"""How long a wait for a key lasts before the thread checks whether it shall end, s."""


class KeyPresses:
    """Whether a key was pressed."""

    def __init__(self) -> None:
        self._pressed = threading.Event()

    def press(self) -> None:
        """The key was pressed."""
        self._pressed.set()

    def pressed(self) -> bool:
        """Whether it was pressed since the last call."""
        was = self._pressed.is_set()
        self._pressed.clear()
        return was


@contextmanager
def reset_key() -> Iterator[KeyPresses | None]:
    """Listen for ``RESET_KEY`` on standard input. ``None`` where that is no terminal, or this program does not run in its foreground."""
    presses = KeyPresses()
    try:
        import termios
        import tty
    except ImportError:  # not a POSIX system
        yield None
        return
    try:
        terminal = sys.stdin.fileno()
        before = termios.tcgetattr(terminal) if _in_foreground(terminal) else None
    except (OSError, ValueError, AttributeError, termios.error):
        before = None
    if before is None:
        yield None
        return
    ending = threading.Event()

    def listen() -> None:
        while not ending.is_set():
            try:
                # In the background a read would stop the whole program.
                if not _in_foreground(terminal):
                    ending.wait(LISTENS)
                    continue
                if not select.select([terminal], [], [], LISTENS)[0]:
                    continue
                read = os.read(terminal, 32)
                if not read:
                    return
                if RESET_KEY in read.decode(errors="replace").lower():
                    presses.press()
            except OSError:
                return

    tty.setcbreak(terminal)
    thread = threading.Thread(target=listen, name="quasirigid-keys", daemon=True)
    thread.start()
    try:
        yield presses
    finally:
        ending.set()
        thread.join(timeout=1.0)
        if _in_foreground(terminal):
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _in_foreground(terminal: int) -> bool:
    try:
        return os.isatty(terminal) and os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False
