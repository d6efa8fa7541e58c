"""What recording costs the thread that steps: the time of every ``append``, and how late steps are in a grasp at the pace of the clock.

Run on a quiet machine:  python benchmarks/recording/lateness.py  (half a minute; the figures are in docs/recordings.md)

The scene is that of ``quasirigid grasp`` at full size, a thousand steps a second. A step is late by what it takes longer than its millisecond, and
by what the steps before it left over.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from quasirigid.grasp.experiment import Grasp
from quasirigid.grasp.options import GraspOptions
from quasirigid.recording.scene_recorder import SceneRecorder


class Timed:
    """A recorder whose ``append`` is timed; ``silent`` records nothing."""

    def __init__(self, recorder: SceneRecorder, *, silent: bool) -> None:
        self._recorder, self._silent = recorder, silent
        self.times: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._recorder, name)

    def append(self, *values: Any) -> None:
        """As of ``SceneRecorder``."""
        began = time.perf_counter()
        if not self._silent:
            self._recorder.append(*values)
        self.times.append(time.perf_counter() - began)

    def still(self, values: Any) -> None:
        """As of ``SceneRecorder``."""
        if not self._silent:
            self._recorder.still(values)


def measure(path: Path, *, hold: float, paced: bool, silent: bool) -> dict[str, Any]:
    """One grasp."""
    grasp = Grasp(GraspOptions(hold=hold))
    grasp.real_time = paced
    late: list[float] = []
    step = grasp._step

    def timed_step(*values: Any) -> None:
        step(*values)
        if paced:
            late.append(max(0.0, time.perf_counter() - grasp._began - grasp.world.time))

    grasp._step = timed_step  # type: ignore[method-assign]
    with grasp.recorder(path, {}) as recorder:
        timed = Timed(recorder, silent=silent)
        wall, cpu, own = time.perf_counter(), time.process_time(), time.thread_time()
        grasp.run(timed)  # type: ignore[arg-type]
        wall, cpu, own = time.perf_counter() - wall, time.process_time() - cpu, time.thread_time() - own
    simulated = grasp.world.time
    return {
        "append_ms": spread(timed.times),
        "late_ms": spread(late) if paced else None,
        "wall_s": wall,
        "cpu_s": cpu,
        "stepping_thread_cpu_s": own,
        "simulated_s": simulated,
        "megabytes_per_s": path.stat().st_size / 1e6 / simulated,
        "state_hash": f"{grasp.world.state_hash():016x}",
    }


def spread(seconds: list[float]) -> dict[str, float]:
    """Of times in s, in ms."""
    ms = 1e3 * np.array(seconds)
    return {
        "median": float(np.median(ms)),
        "p99": float(np.percentile(ms, 99)),
        "p99.9": float(np.percentile(ms, 99.9)),
        "max": float(ms.max()),
    }


def main() -> None:
    """Prints a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    parser.add_argument("--hold", type=float, default=2.0, help="length of the hold, s")
    given = parser.parse_args()
    results: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as directory:
        for name, paced, silent in (
            ("at the pace of the clock", True, False),
            ("the same, not recorded", True, True),
            ("as fast as it goes", False, False),
        ):
            results[name] = measure(Path(directory) / "run.h5", hold=given.hold, paced=paced, silent=silent)
    if given.json:
        print(json.dumps(results, indent=2))
        return
    for name, figures in results.items():
        print(
            f"{name}: {figures['simulated_s']:.2f} s simulated in {figures['wall_s']:.2f} s, {figures['megabytes_per_s']:.2f} MB per simulated second"
        )
        print(
            f"  CPU {figures['cpu_s']:.2f} s, of which the stepping thread {figures['stepping_thread_cpu_s']:.2f} s; state {figures['state_hash']}"
        )
        for what in ("append_ms", "late_ms"):
            if figures[what]:
                print(f"  {what:<10}" + "  ".join(f"{key} {value:.3f}" for key, value in figures[what].items()))


if __name__ == "__main__":
    main()
