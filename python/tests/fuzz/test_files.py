"""Spoilt files of every kind that is read: each ends with a value or a typed error that says all; none hangs, none takes the process along.

``python python/tests/fuzz/run.py objects --seed 1 --case 1234 --keep /tmp/found`` has a finding again, in one process.
"""

from pathlib import Path

import numpy as np
import pytest
from amount import SEED, cases
from cases import READERS, read_case
from seed_files import make_seeds
from workers import run_cases

FULL = {"objects": 20_000, "recordings": 1_500, "takes": 2_000, "calibrations": 1_000, "contact_problems": 4_000, "snapshots": 3_000}
"""Cases of each kind in a full run."""


@pytest.mark.filterwarnings("ignore::quasirigid.errors.SurfaceWarning")
@pytest.mark.parametrize("kind", READERS)
def test_the_files_that_are_spoilt_are_valid_before(kind: str, tmp_path: Path) -> None:
    make_seeds(kind, tmp_path)
    for path in sorted(tmp_path.iterdir()):
        assert read_case(kind, path, np.random.default_rng(0)) == "value", path.name


@pytest.mark.parametrize("kind", FULL)
def test_a_spoilt_file_is_a_value_or_a_typed_error(kind: str, tmp_path: Path) -> None:
    make_seeds(kind, tmp_path)
    summary = run_cases("cases:run_case", {"kind": kind, "seed": SEED, "folder": str(tmp_path)}, cases(FULL[kind]))
    print(f"{kind}, seed {SEED}: {summary}")
    assert not summary.findings, f"{kind}, seed {SEED}: {summary}"
    # Neither so spoilt that nothing is read any more, nor so little that nothing is refused.
    assert len(summary.outcomes) > 1, summary
