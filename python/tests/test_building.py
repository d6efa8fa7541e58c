"""Building a surface: what does not fit in memory is refused before it is made, and Ctrl-C ends it."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from quasirigid import Surface
from quasirigid.errors import InvalidValueError

SOON = 0.2
"""s, within which building ends."""

TOO_MANY = 4_000_000_000
MAKERS: list[tuple[str, Callable[[int], Surface]]] = [
    ("box", lambda n: Surface.box((0.06, 0.05, 0.08), points=n)),
    ("sphere", lambda n: Surface.sphere(0.03, points=n)),
    ("capsule", lambda n: Surface.capsule(0.01, 0.1, points=n)),
    ("cylinder", lambda n: Surface.cylinder(0.01, 0.1, points=n)),
    ("half-space", lambda n: Surface.half_space(0.1, points=n)),
    ("fingertip", lambda n: Surface.fingertip((0.008, 0.009, 0.007), points=n)),
    ("points", lambda n: Surface.from_points(np.broadcast_to(np.zeros(3), (n, 3)))),
]


@pytest.mark.parametrize(("name", "make"), MAKERS, ids=[name for name, _ in MAKERS])
def test_a_surface_that_no_memory_holds_is_refused_before_it_is_made(name: str, make: Callable[[int], Surface]) -> None:
    began = time.monotonic()
    with pytest.raises(InvalidValueError, match=r"bytes\) are free"):
        make(TOO_MANY)
    assert time.monotonic() - began < 1.0, name


BUILD = """
import os, signal, sys, threading, time
import numpy as np
import quasirigid as qr

cloud = np.random.default_rng(0).normal(size=(1_500_000, 3))
cloud *= 0.03 / np.linalg.norm(cloud, axis=1)[:, None]
sent = []

def press():
    sent.append(time.monotonic())
    os.kill(os.getpid(), signal.SIGINT)

waited = []
for _ in range(3):  # the least counts: a busy machine lets a process wait
    timer = threading.Timer(float(sys.argv[2]), press)
    timer.start()
    try:
        qr.Surface.sphere(0.03, points=3_000_000) if sys.argv[1] == "shape" else qr.Surface.from_points(cloud)
        print("finished")
    except KeyboardInterrupt:
        waited.append(time.monotonic() - sent[-1])
    timer.join()
print(min(waited), len(qr.Surface.sphere(0.03, points=500)))
"""


@pytest.mark.parametrize("what", ["shape", "cloud"])
@pytest.mark.parametrize("after", [0.2, 0.6])
def test_ctrl_c_ends_building_soon_and_the_next_surface_is_made(what: str, after: float) -> None:
    done = subprocess.run([sys.executable, "-c", BUILD, what, str(after)], capture_output=True, text=True, timeout=120, check=True)
    assert "finished" not in done.stdout, "built before it was interrupted: the test needs more points"
    waited, points = done.stdout.split()
    assert float(waited) < SOON, f"{waited} s after the interrupt"
    assert points == "500"


def test_a_signal_is_raised_where_python_asks_for_it() -> None:
    """What a handler raises comes out of the call, and from another thread building goes on."""
    done: list[int] = []
    thread = threading.Thread(target=lambda: done.append(len(Surface.sphere(0.03, points=60_000))))

    class AskedError(Exception):
        pass

    def ask(*_: object) -> None:
        raise AskedError

    before = signal.signal(signal.SIGALRM, ask)
    try:
        thread.start()
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with pytest.raises(AskedError):
            for _ in range(1000):
                Surface.sphere(0.03, points=300_000)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        thread.join()
    assert done == [60_000]
