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

from quasirigid.grasp.options import GraspOptions
from quasirigid.live.play import Play
from quasirigid.live.server import LiveView

COUNT_DRAWING = """
window.work_ = {frames: 0, drawn: 0, calls: 0, triangles: 0};
let calls = 0;
for (const [name, at, many] of [['drawElements', 1], ['drawArrays', 2], ['drawElementsInstanced', 1, 4], ['drawArraysInstanced', 2, 3]]) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function(...a) {
    calls += 1;
    if (a[0] === this.TRIANGLES) window.work_.triangles += a[at] / 3 * (many ? a[many] : 1);
    return draw.apply(this, a);
  };
}
(function next() {
  window.work_.frames += 1;
  if (calls) { window.work_.drawn += 1; window.work_.calls += calls; calls = 0; }
  requestAnimationFrame(next);
})()
"""
"""Counts, in the page: frames of the browser, those of them in which the scene was drawn, draw calls and triangles in these."""
TICKS = os.sysconf("SC_CLK_TCK")


def browser_seconds() -> dict[str, float]:
    """CPU time so far, s, of the processes of our browser by their kind (``"gpu-process"``, ``"renderer"``, ``"browser"`` ...). Linux only."""
    parents: dict[int, int] = {}
    spent: dict[int, tuple[str, float]] = {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            fields = (path / "stat").read_text().rsplit(")", 1)[1].split()
            arguments = (path / "cmdline").read_bytes().decode(errors="replace").replace("\0", " ")
        except (OSError, IndexError):
            continue  # it ended meanwhile
        parents[int(path.name)] = int(fields[1])
        if "chrom" in arguments:
            kind = arguments.split("--type=")[1].split()[0] if "--type=" in arguments else "browser"
            spent[int(path.name)] = (kind, (int(fields[11]) + int(fields[12])) / TICKS)
    total: dict[str, float] = {}
    for process, (kind, seconds) in spent.items():
        above = process
        while above in parents and above != os.getpid():
            above = parents[above]
        if above == os.getpid():
            total[kind] = total.get(kind, 0.0) + seconds
    return total


def measure(live: LiveView, page: Any | None, seconds: float) -> dict[str, float]:
    """Rates over the next ``seconds``."""
    began, updates, cpu = time.perf_counter(), live.updates, live.update_time
    work = page.evaluate("window.work_") if page else {}
    spent = browser_seconds() if page else {}
    simulated = live.session.newest()[1].state.time
    if page:
        page.wait_for_timeout(1e3 * seconds)
    else:
        time.sleep(seconds)
    span = time.perf_counter() - began
    count = live.updates - updates
    result = {
        "updates_per_s": count / span,
        "cpu_ms_per_update": 1e3 * (live.update_time - cpu) / max(1, count),
        "real_time_factor": (live.session.newest()[1].state.time - simulated) / span,
    }
    if page:
        done = {name: value - work[name] for name, value in page.evaluate("window.work_").items()}
        drawn = max(1, done["drawn"])
        after = browser_seconds()
        result |= {
            "page_frames_per_s": done["frames"] / span,
            "drawn_frames_per_s": done["drawn"] / span,
            "draw_calls_per_frame": done["calls"] / drawn,
            "triangles_per_frame": done["triangles"] / drawn,
            "gpu_process_ms_per_frame": 1e3 * (after.get("gpu-process", 0.0) - spent.get("gpu-process", 0.0)) / drawn,
            "renderer_ms_per_frame": 1e3 * (after.get("renderer", 0.0) - spent.get("renderer", 0.0)) / drawn,
        }
    return result


def main() -> None:
    """Prints a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    parser.add_argument("--width", type=int, default=1200)
    parser.add_argument("--height", type=int, default=720)
    parser.add_argument("--port", type=int, default=8400)
    parser.add_argument("--no-page", action="store_true", help="server and simulation alone, no browser")
    given = parser.parse_args()
    options = GraspOptions()
    began = time.perf_counter()
    live = LiveView(Play(options), options, port=given.port)
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
        # The page lowers its resolution, to 3/4, when it has been slow for some seconds.
        results["carrying on"] = measure(live, page, 6.0)

    if given.no_page:
        spans(None)
    else:
        with running_browser() as browser:
            began = time.perf_counter()
            with open_page(browser, live.server.get_port(), lambda page: page.add_init_script(COUNT_DRAWING)) as page:
                page.set_viewport_size({"width": given.width, "height": given.height})
                page.get_by_role("button", name="Run", exact=True).wait_for()
                results["page_ready_s"] = time.perf_counter() - began
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
