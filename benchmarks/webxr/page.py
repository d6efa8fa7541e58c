"""What the page for a headset costs: bytes per state, and time of its script per frame and per state. docs/webxr.md has the figures.

Run on a quiet machine:  python benchmarks/webxr/page.py  (after `make webxr-tools`; Chromium is found by CHROMIUM or its usual names)

The page is in an emulated headset, and a synthetic hand takes and lifts the box. Time of script is what the page itself computes between the
start and the end of its handlers; what a headset's graphics processor does with it is not in there, nor is the rasteriser in software.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "python/tests"))

from browser import open_page, running_browser
from test_webxr_browser import EMULATOR, RAISE, TAKE, Running, enter, move, with_device


def spread(page: Any, what: str) -> dict[str, float]:
    """Median and 99th percentile of the newest times, ms."""
    times = np.array(page.evaluate(f"[...quasirigid.status.{what}]"))
    times = times[times > 0.0]
    return {"median_ms": float(np.median(times)), "p99_ms": float(np.percentile(times, 99)), "count": len(times)}


def main() -> None:
    """Prints JSON."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    run = Running()
    with running_browser() as browser, run.server, open_page(browser, run.server.address[1], with_device(str(EMULATOR))) as page:
        enter(page, run)
        move(page, TAKE)
        move(page, RAISE)
        found = {
            "frame": spread(page, "frameTimes"),
            "state": spread(page, "updateTimes"),
            "bytes_per_state": page.evaluate("quasirigid.status.bytes"),
            "contacts": page.evaluate("quasirigid.drawing.contacts.count"),
            "load_average": os.getloadavg()[0],
        }
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
