"""``quasirigid.solve_contacts`` on problems that it was not built on: how many it solves, and in what time.

    python benchmarks/solver/holdout.py                      rigid scenes, made here
    python benchmarks/solver/holdout.py FOLDER...            and every .npz with W, q and mu, each changed at random
    python benchmarks/solver/holdout.py FOLDER --keep out    the failures as .npz

Seeds are fixed: two runs solve the same problems. Solved means a natural map below 1e-8 that is computed here, from the reactions alone.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from compare import residual
from families import SCENES, Problem, changed, rigid

import quasirigid as qr


def main() -> None:
    """Solve, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, help="folders with .npz files")
    parser.add_argument("--count", type=int, default=40, help="problems of each kind (default 40)")
    parser.add_argument("--first", type=int, default=0, help="first seed (default 0)")
    parser.add_argument("--only", default="", help="kinds whose name has this word")
    parser.add_argument("--time-budget", type=float, default=20.0, help="seconds for one problem (default 20)")
    parser.add_argument("--keep", type=Path, help="folder for the problems that were not solved")
    arguments = parser.parse_args()
    files = sorted(path for folder in arguments.folders for path in folder.glob("*.npz"))
    seeds = range(arguments.first, arguments.first + arguments.count)
    print("| problem | contacts | solved | CPU ms, median | CPU ms, longest |\n| --- | --- | --- | --- | --- |")
    total = solved = 0
    for kind in [*SCENES, *files]:
        name = kind.stem if isinstance(kind, Path) else f"rigid {kind}"
        if arguments.only not in name:
            continue
        times, sizes, failed = [], [], []
        for seed in seeds:
            if isinstance(kind, Path):
                given = qr.ContactProblem.load(kind)
                problem = changed(Problem(given.W, given.q, given.mu), seed)
            else:
                problem = rigid(kind, seed)
            start = time.process_time()
            solution = qr.solve_contacts(*problem, time_budget=arguments.time_budget)
            times.append(time.process_time() - start)
            sizes.append(len(problem.mu))
            found = residual(qr.ContactProblem(*problem), solution.reactions)
            if not (solution.converged and found <= 1.001e-8):
                failed.append(f"seed {seed}: {found:.1e}, {solution.stop_reason}, {times[-1]:.1f} s")
                if arguments.keep:
                    arguments.keep.mkdir(parents=True, exist_ok=True)
                    qr.ContactProblem(*problem).save(arguments.keep / f"{name}-{seed}.npz".replace(" ", "-"))
        total, solved = total + len(times), solved + len(times) - len(failed)
        row = f"{len(times) - len(failed)} of {len(times)} | {1e3 * np.median(times):.2f} | {1e3 * max(times):.1f}"
        print(f"| {name} | {min(sizes)} to {max(sizes)} | {row} |" + "".join(f"\n  {line}" for line in failed), flush=True)
    print(f"\nSolved: {solved} of {total}.")


if __name__ == "__main__":
    main()
