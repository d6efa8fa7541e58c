"""Data that the repository does not carry: scans of real objects, and contact problems that others have published."""

import os
from pathlib import Path

DATA = Path(os.environ.get("QUASIRIGID_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data")
"""A folder with ``objects/*.obj`` and ``fc3d/*.npz``. Tests that want them are skipped where they are not: CONTRIBUTING.md says what is in
it.
"""


def missing(what: str) -> str:
    """Why a test is skipped."""
    return f"no {what}: set QUASIRIGID_DATA to a folder that has it"
