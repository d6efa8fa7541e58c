"""``quasirigid.solve_contacts`` on problems that it was not built on: how many it solves, and in what time.

    python benchmarks/solver/holdout.py                      rigid scenes, made here
    python benchmarks/solver/holdout.py FOLDER...            and every .npz with W, q and mu, each changed at random
    python benchmarks/solver/holdout.py FOLDER --plain       every .npz as it is: those of record.py, say
    python benchmarks/solver/holdout.py FOLDER --keep out    and the failures as .npz

Seeds are fixed: two runs solve the same problems. Solved means a natural map below 1e-8 that is computed here, from the reactions alone.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np
from compare import residual
from families import SCENES, Problem, changed, rigid

import quasirigid as qr


def make(scene: str, seeds: Iterable[int]) -> Iterator[tuple[str, Problem]]:
    """Rigid scenes of one kind."""
    for seed in seeds:
        yield f"rigid-{scene}-{seed}", rigid(scene, seed)


def change(path: Path, seeds: Iterable[int]) -> Iterator[tuple[str, Problem]]:
    """A problem from a file, changed at random."""
    given = qr.ContactProblem.load(path)
    for seed in seeds:
        yield f"{path.stem}-{seed}", changed(Problem(given.W, given.q, given.mu), seed)


def read(paths: Iterable[Path]) -> Iterator[tuple[str, Problem]]:
    """Problems from files as they are."""
    for path in paths:
        given = qr.ContactProblem.load(path)
        yield path.stem, Problem(given.W, given.q, given.mu)


def main() -> None:
    """Solve, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, help="folders with .npz files")
    parser.add_argument("--plain", action="store_true", help="the files as they are, and nothing else")
    parser.add_argument("--count", type=int, default=40, help="problems of each kind (default 40)")
    parser.add_argument("--first", type=int, default=0, help="first seed (default 0)")
    parser.add_argument("--only", default="", help="kinds whose name has this word")
    parser.add_argument("--time-budget", type=float, default=20.0, help="seconds for one problem (default 20)")
    parser.add_argument("--keep", type=Path, help="folder for the problems that were not solved")
    arguments = parser.parse_args()
    files = sorted(path for folder in arguments.folders for path in folder.glob("*.npz"))
    seeds = range(arguments.first, arguments.first + arguments.count)
    kinds: dict[str, Callable[[], Iterator[tuple[str, Problem]]]] = {}
    if arguments.plain:
        # box-100-wood-0030 and box-100-wood-0060 are of one kind.
        for name, group in groupby(files, lambda path: re.sub(r"-\d+$", "", path.stem)):
            kinds[name] = partial(read, list(group))
    else:
        kinds |= {f"rigid {scene}": partial(make, scene, seeds) for scene in SCENES}
        kinds |= {path.stem: partial(change, path, seeds) for path in files}
    print("| problem | contacts | solved | CPU ms, median | CPU ms, longest |\n| --- | --- | --- | --- | --- |")
    total = solved = 0
    for kind, problems in kinds.items():
        if arguments.only not in kind:
            continue
        times, sizes, failed = [], [], []
        for name, problem in problems():
            start = time.process_time()
            solution = qr.solve_contacts(*problem, time_budget=arguments.time_budget)
            times.append(time.process_time() - start)
            sizes.append(len(problem.mu))
            found = residual(qr.ContactProblem(*problem), solution.reactions)
            if not (solution.converged and found <= 1.001e-8):
                failed.append(f"{name}: {found:.1e}, {solution.stop_reason}, {times[-1]:.1f} s")
                if arguments.keep:
                    arguments.keep.mkdir(parents=True, exist_ok=True)
                    qr.ContactProblem(*problem).save(arguments.keep / f"{name}.npz")
        total, solved = total + len(times), solved + len(times) - len(failed)
        row = f"{len(times) - len(failed)} of {len(times)} | {1e3 * np.median(times):.2f} | {1e3 * max(times):.1f}"
        print(f"| {kind} | {min(sizes)} to {max(sizes)} | {row} |", flush=True)
        for line in failed:
            print(f"not solved: {line}", file=sys.stderr)
    print(f"\nSolved: {solved} of {total}.")


if __name__ == "__main__":
    main()
