"""What ``quasirigid.view(world)`` costs a loop of your own at 1 kHz: the time of ``World.step`` and how late steps begin, with and without the page.

Run on a quiet machine:  python benchmarks/view/watcher.py  (half a minute; no browser is opened; the figures are in docs/view.md)

The scene is the one of the README: two fingertips hold a box. Spans of a second with and without the page take turns.
"""

from __future__ import annotations

import time

import numpy as np

import quasirigid as qr

SPANS, DT = 6, 1e-3


def held_box() -> qr.World:
    """Two fingertips and the box that they hold."""
    world = qr.World(dt=DT)
    wood, pulp = qr.Material.preset("wood"), qr.Material.preset("fingertip_pulp")
    world.add_body(qr.Surface.box((0.05, 0.05, 0.05), points=12_000), wood, mass=0.2, position=(0, 0, 0.025))
    tip, turn = qr.Surface.fingertip((0.009, 0.009, 0.008)), 0.5**0.5
    for s in (-1, 1):
        world.add_body(tip, pulp, motion="fixed", position=(s * 0.0315, 0, 0.025), quaternion=(turn, 0, -s * turn, 0))
    world.step(500)
    return world


def span(world: qr.World, seconds: float) -> tuple[list[float], list[float], float]:
    """Time of each step, how late it began (s), and CPU time of this thread (s)."""
    taken, late, cpu, due = [], [], time.thread_time(), time.perf_counter()
    for _ in range(round(seconds / DT)):
        time.sleep(max(0.0, due - time.perf_counter()))
        began = time.perf_counter()
        late.append(began - due)
        world.step()
        taken.append(time.perf_counter() - began)
        due = max(due + DT, began - 0.05)
    return taken, late, time.thread_time() - cpu


def main() -> None:
    """Prints a line with the page and one without."""
    world = held_box()
    print(f"{len(world.contacts())} contacts")
    results: dict[str, list[tuple[list[float], list[float], float]]] = {"without": [], "with": []}
    span(world, 0.5)
    for _ in range(SPANS):
        results["without"].append(span(world, 1.0))
        with qr.view(world, browser=False):
            span(world, 0.5)
            results["with"].append(span(world, 1.0))
    for name, spans in results.items():
        taken, late = (1e3 * np.concatenate([np.array(s[i]) for s in spans]) for i in (0, 1))
        steps = [
            f"{what} {np.median(ms):.3f} median, {np.percentile(ms, 99):.3f} p99, {ms.max():.2f} max"
            for what, ms in (("step", taken), ("late", late))
        ]
        print(f"{name:<8}ms: {'; '.join(steps)}; CPU of the thread {1e3 * np.mean([s[2] / len(s[0]) for s in spans]):.3f} per step")


if __name__ == "__main__":
    main()
