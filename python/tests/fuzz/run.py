"""Fuzz the readers of files, and have a finding again.

python python/tests/fuzz/run.py objects --cases 20000           all of them; what was found, by place, on standard output
python python/tests/fuzz/run.py recordings --cases 200 --seed 7
python python/tests/fuzz/run.py objects --seed 1 --case 1234 --keep /tmp/found   one case in this process; its file stays
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from cases import READERS, make_case, read_case
from seed_files import make_seeds
from workers import LATE, run_cases


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=sorted(READERS))
    parser.add_argument("--cases", type=int, default=1000, help="how many")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="this one alone, in this process")
    parser.add_argument("--keep", type=Path, help="a folder for the file of --case")
    parser.add_argument("--workers", type=int, help="processes; default: one a processor")
    parser.add_argument("--late", type=float, default=LATE, help="a case that takes longer hangs, s")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        make_seeds(options.kind, Path(folder))
        context = {"kind": options.kind, "seed": options.seed, "folder": folder}
        if options.case is not None:
            keep = options.keep or Path(tempfile.mkdtemp(prefix="case-"))
            keep.mkdir(parents=True, exist_ok=True)
            path = make_case(context, options.case, keep)
            print(path, path.stat().st_size, "bytes", flush=True)
            print(read_case(options.kind, path, np.random.default_rng([options.seed, options.case, 1])))
            return 0
        summary = run_cases("cases:run_case", context, range(options.cases), workers=options.workers, late=options.late)
    print(f"{options.kind}, seed {options.seed}: {summary}")
    return 1 if summary.findings else 0


if __name__ == "__main__":
    sys.exit(main())
