"""``quasirigid.solve_contacts`` and Siconos on the same files in one run.

    apt-get install python3-siconos python3-scipy
    python benchmarks/solver/compare.py FOLDER...                 every .npz with W, q and mu
    python benchmarks/solver/compare.py FOLDER --write docs/solver.md

Siconos runs in the system's Python (``--siconos``); without it only our side is run. Both must bring the natural map with rho = 1, over max(|q|, |r|, |u|), below 1e-8, judged
here from the reactions alone. Time is CPU time, one thread: ours of the whole call with checks and conversion, theirs of the driver alone.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import quasirigid as qr

BEGIN, END = "<!-- solver comparison: begin -->", "<!-- solver comparison: end -->"


def residual(problem: qr.ContactProblem, r: np.ndarray) -> float:
    """The natural map with De Saxce's shift, written out once more: nothing of the solver's own."""
    u = (problem.W @ r + problem.q).reshape(-1, 3)
    r, mu = r.reshape(-1, 3), problem.mu
    if not np.isfinite(r).all():
        return float("inf")
    z = r - u
    z[:, 0] -= mu * np.hypot(u[:, 1], u[:, 2])
    tangent = np.hypot(z[:, 1], z[:, 2])
    along = np.maximum((z[:, 0] + mu * tangent) / (1 + mu**2), 0)
    inside = tangent <= mu * z[:, 0]
    scale = np.divide(mu * along, tangent, out=np.zeros_like(tangent), where=tangent > 0)
    on_edge = np.column_stack([along, scale * z[:, 1], scale * z[:, 2]])
    projected = np.where(inside[:, None], z, on_edge)
    return float(np.linalg.norm(r - projected) / max(np.linalg.norm(problem.q), np.linalg.norm(r), np.linalg.norm(u), 1e-300))


def solve_ours(path: Path, tolerance: float) -> dict[str, Any]:
    """Our side: least CPU time of several calls."""
    problem = qr.ContactProblem.load(path)
    spent, best = 0.0, float("inf")
    while spent < 0.3:
        start = time.process_time()
        solution = problem.solve(tolerance=tolerance)
        took = time.process_time() - start
        spent, best = spent + took + 1e-3, min(best, took)
    found = residual(problem, solution.reactions)
    return {"contacts": len(problem), "sweeps": solution.sweeps, "residual": found, "cpu_s": best, "converged": solution.converged}


def solve_siconos(python: str, paths: list[Path], tolerance: float) -> dict[str, dict[str, Any]]:
    """Their side: per file the fastest solver that converged, by its own account or by ours; empty if Siconos is missing."""
    worker = Path(__file__).with_name("siconos_worker.py")
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    lines = "\n".join(str(path.resolve()) for path in paths)
    done = subprocess.run(
        [python, str(worker), str(tolerance), "1"], input=lines, capture_output=True, text=True, env=environment, check=False
    )
    if done.returncode != 0:
        print(f"Siconos failed: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
    best: dict[str, dict[str, Any]] = {}
    for line in done.stdout.splitlines():
        if not line.startswith("{"):
            continue
        result = json.loads(line)
        path = result["path"]
        found = residual(qr.ContactProblem.load(path), np.array(result.pop("reactions")))
        if (result["info"] == 0 or found <= tolerance) and found <= 10 * tolerance:
            result["residual"] = found
            if path not in best or result["cpu_s"] < best[path]["cpu_s"]:
                best[path] = result
    return best


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown, with the medians below."""
    lines = [
        "| problem | contacts | sweeps | residual | CPU ms | Siconos' best | CPU ms | ratio |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        theirs = row.get("siconos")
        tail = f"{theirs['solver']} | {1e3 * theirs['cpu_s']:.3f} | {row['cpu_s'] / theirs['cpu_s']:.2f}" if theirs else "none | - | -"
        residual_ = f"{row['residual']:.1e}" if row["converged"] else f"**{row['residual']:.1e}**"
        lines.append(f"| {row['problem']} | {row['contacts']} | {row['sweeps']} | {residual_} | {1e3 * row['cpu_s']:.3f} | {tail} |")
    ratios = [row["cpu_s"] / row["siconos"]["cpu_s"] for row in rows if row.get("siconos")]
    lines.append("")
    reached = sum(row["converged"] and row["residual"] <= 1e-8 for row in rows)
    lines.append(f"Reached: {reached} of {len(rows)}.")
    if ratios:
        lines[-1] += f" Siconos: {len(ratios)}. Median ratio of CPU times {statistics.median(ratios):.2f}, largest {max(ratios):.2f}."
    return "\n".join(lines)


def main() -> None:
    """Run both, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="folders with .npz files")
    parser.add_argument("--siconos", default="/usr/bin/python3", help="a Python that has siconos")
    parser.add_argument("--tolerance", type=float, default=1e-8)
    parser.add_argument("--every", type=int, default=1, help="take one file in so many")
    parser.add_argument("--write", type=Path, help="put the table between the markers of this page")
    arguments = parser.parse_args()
    paths = sorted(path for folder in arguments.folders for path in folder.glob("*.npz"))[:: arguments.every]
    rows = [{"problem": path.stem, "path": str(path.resolve()), **solve_ours(path, arguments.tolerance)} for path in paths]
    theirs = solve_siconos(arguments.siconos, paths, arguments.tolerance)
    for row in rows:
        row["siconos"] = theirs.get(row["path"])
    rows.sort(key=lambda row: (row["contacts"], row["problem"]))
    text = table(rows)
    print(text)
    if arguments.write:
        page = arguments.write.read_text()
        before, _, rest = page.partition(BEGIN)
        _, _, after = rest.partition(END)
        arguments.write.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}")


if __name__ == "__main__":
    main()
