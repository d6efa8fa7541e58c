"""How long packets of a tracker wait for the step that uses them, at full size, held against the bar: at most one step and 1 ms at the 99th percentile.

Run on a quiet machine:  python benchmarks/mocap/latency.py  (15 s for each run; docs/mocap.md has the figures)

`quasirigid mocap grasp dtrack` listens on a port of this machine, `quasirigid mocap replay` sends it the shipped take in another process. Everything
runs at the pace of the clock, so what else the machine does is in the figures: two free processors at least, and nothing that begins or ends
meanwhile. The exit code is 1 if a run misses the bar.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
from typing import Any

SPARE = 1.0
"""What a packet may wait beyond one step, ms, at p99."""
LONGEST = 120.0
"""A run takes no longer, s."""
PROGRAM = (sys.executable, "-m", "quasirigid.cli")
COUPLINGS = ("tips", "hand")


def run(coupling: str, options: list[str]) -> dict[str, Any]:
    """Summary of one session."""
    with tempfile.TemporaryDirectory() as out:
        listen = [*PROGRAM, "mocap", "grasp", "dtrack:0", "--bind", "127.0.0.1", "--coupling", coupling, "--json", "--out", out, *options]
        with subprocess.Popen(listen, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as session:
            watchdog = threading.Timer(LONGEST, session.kill)
            watchdog.start()
            try:
                assert session.stderr is not None
                said = session.stderr.readline()
                if "127.0.0.1:" in said:
                    session.stderr.readline()  # it waits for the hand
                    port = said.split("127.0.0.1:")[1].split(";")[0]
                    send = [*PROGRAM, "mocap", "replay", "--to", f"127.0.0.1:{port}", "--source-port", "0"]
                    subprocess.run(send, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=LONGEST)
                printed, rest = session.communicate()
            finally:
                watchdog.cancel()
                session.kill()
    if session.returncode != 0:
        raise SystemExit(f"the session failed: {said}{rest}")
    summary: dict[str, Any] = json.loads(printed)
    return summary


def figures(coupling: str, summary: dict[str, Any]) -> dict[str, Any]:
    """What is printed of a run."""
    bar = 1e3 * summary["dt_s"] + SPARE
    waits, late = summary.get("packet_to_step_ms"), summary.get("step_lateness_ms")
    if waits is None or late is None:
        raise SystemExit("no packet came to a step: the hand was not seen")
    return {
        "coupling": coupling,
        "packet_to_step_ms": waits,
        "bar_ms": bar,
        "met": waits["p99"] <= bar,
        "step_lateness_ms": late,
        "step_ms": {"median": summary["step_ms_median"], "p99": summary["step_ms_p99"]},
        "behind_s": summary["slipped_s"],
        "passed_over": summary["passed_over"],
        "packets": summary["stream"]["packets"],
        "held": summary["held"],
    }


def line(run: dict[str, Any]) -> str:
    """A row of the table."""
    waits, late = run["packet_to_step_ms"], run["step_lateness_ms"]
    return (
        f"{run['coupling']:<8}{waits['median']:>8.2f}{waits['p99']:>9.2f}{waits['max']:>9.2f}{run['bar_ms']:>8.1f}"
        f"   {'met' if run['met'] else 'MISSED':<8}{late['p99']:>9.2f}{run['step_ms']['median']:>9.3f}{run['step_ms']['p99']:>9.3f}{run['behind_s']:>9.3f}"
    )


def main() -> None:
    """Prints a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--coupling", choices=(*COUPLINGS, "both"), default="both", help="default: both")
    parser.add_argument("--runs", type=int, default=1, metavar="N", help="of each coupling, in turns; default: 1")
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    parser.add_argument("options", nargs="*", help="for `quasirigid grasp`, after `--`, such as: -- --dt 0.002")
    given = parser.parse_args()
    if given.runs < 1:
        parser.error("--runs: expected at least 1")
    couplings = COUPLINGS if given.coupling == "both" else (given.coupling,)
    if not given.json:
        print(f"{'':<8}{'packet to step, ms':>26}{'':>19}{'steps late':>10}{'step, ms':>12}{'behind':>15}")
        print(f"{'':<8}{'median':>8}{'p99':>9}{'max':>9}{'bar':>8}   {'':<8}{'p99, ms':>9}{'median':>9}{'p99':>9}{'s':>9}", flush=True)
    runs = []
    for _ in range(given.runs):
        for coupling in couplings:
            runs.append(figures(coupling, run(coupling, given.options)))
            if not given.json:
                print(line(runs[-1]), flush=True)
    met = all(run["met"] for run in runs)
    if given.json:
        print(json.dumps({"met": met, "load_average": os.getloadavg()[0], "runs": runs}, indent=2))
    sys.exit(0 if met else 1)


if __name__ == "__main__":
    main()
