"""What a process that works for another does not listen to."""

from __future__ import annotations

import signal


def leave_signals_to_parent() -> None:
    """For a process that works for another: Ctrl-C and a closed terminal reach both, and it is the other one that ends the work in good
    order.
    """
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
