"""The live view at full size in a headless browser: what docs/view.md says about speed.

Run on a quiet machine:  python benchmarks/view/page.py  (Chromium is found by CHROMIUM or its usual names)

The scene is that of the grasp: 36,000 + 3 x 2,400 points. Page and simulation share the machine. Figures are for three spans of time: the
hand closes, it holds at rest, and it carries the object about, which moves everything and keeps deforming the pads.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "python/tests"))

from browser import open_page, running_browser

from quasirigid.grasp_options import GraspOptions
from quasirigid.view.play import Play
from quasirigid.view.server import LiveView

COUNT_FRAMES = "window.frames_ = 0; (function next() { window.frames_ += 1; requestAnimationFrame(next) })()"


def measure(live: LiveView, page: Any | None, seconds: float) -> dict[str, float]:
    """Rates over the next ``seconds``."""
    began, updates, cpu = time.perf_counter(), live.updates, live.update_time
    frames = page.evaluate("window.frames_") if page else 0
    simulated = live.session.newest()[1].state.time
    if page:
        page.wait_for_timeout(1e3 * seconds)
    else:
        time.sleep(seconds)
    drawn = (page.evaluate("window.frames_") if page else 0) - frames
    span = time.perf_counter() - began
    count = live.updates - updates
    return {
        "updates_per_s": count / span,
        "cpu_ms_per_update": 1e3 * (live.update_time - cpu) / max(1, count),
        "page_frames_per_s": drawn / span,
        "real_time_factor": (live.session.newest()[1].state.time - simulated) / span,
    }


def main() -> None:
    """Prints a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    parser.add_argument("--width", type=int, default=1200)
    parser.add_argument("--height", type=int, default=720)
    parser.add_argument("--no-page", action="store_true", help="server and simulation alone, no browser")
    given = parser.parse_args()
    options = GraspOptions()
    began = time.perf_counter()
    live = LiveView(Play(options), options, port=8400)
    live.start()
    results: dict[str, Any] = {"server_ready_s": time.perf_counter() - began, "load_average": os.getloadavg()[0]}

    def spans(page: Any | None) -> None:
        live.session.run(True)
        results["closing"] = measure(live, page, 2.0)
        end = time.monotonic() + 30
        while live.session.newest()[1].state.phase != "holding" and time.monotonic() < end:
            time.sleep(0.1)
        live.session.do(lambda play: play.lift(True))
        measure(live, page, 1.0)
        results["holding"] = measure(live, page, 4.0)
        place, turn = live.session.newest()[1].base

        def sway(play: Play) -> None:
            t = play.world.time
            swing = 0.02 * np.array([np.sin(3.0 * t), np.cos(3.0 * t), 0.0])
            play.aim_base(place + swing, turn)

        live.session.observe(sway)
        measure(live, page, 1.0)
        results["carrying"] = measure(live, page, 6.0)

    if given.no_page:
        spans(None)
    else:
        with running_browser() as browser:
            began = time.perf_counter()
            with open_page(browser, live.server.get_port()) as page:
                page.set_viewport_size({"width": given.width, "height": given.height})
                page.get_by_role("button", name="Run", exact=True).wait_for()
                results["page_ready_s"] = time.perf_counter() - began
                page.evaluate(COUNT_FRAMES)
                page.wait_for_timeout(2000)
                spans(page)
    live.stop()
    if given.json:
        print(json.dumps(results))
        return
    for name, value in results.items():
        if isinstance(value, dict):
            print(f"{name:>16}: " + ", ".join(f"{key} {figure:.2f}" for key, figure in value.items()))
        else:
            print(f"{name:>16}: {value:.2f}")


if __name__ == "__main__":
    main()
