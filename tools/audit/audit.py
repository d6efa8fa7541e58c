"""`make audit`: licenses and sources of all crates, and what is known to be wrong with crates and Python packages.

Exit code 0: nothing is known. 1: something is. 3: nothing was found, but a database could not be reached, so this says little. 4: a tool is missing.
Only the licenses and sources can be looked at without a network.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from enum import Enum
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PATIENCE = 300.0
"""Seconds that a tool may take."""


class Outcome(Enum):
    """Of one check; the value is the exit code."""

    CLEAN = 0
    FOUND = 1
    UNREACHABLE = 3
    MISSING = 4


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """The tool in the folder of the repository; one that hangs has reached nothing."""
    try:
        return subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 124, "", f"no answer within {PATIENCE:.0f} s")


def crates() -> list[tuple[str, Outcome, str]]:
    """Licenses and sources of the crates, and the advisories of RustSec."""
    tool = shutil.which("cargo-deny")
    if tool is None:
        return [("crates", Outcome.MISSING, "cargo install --locked cargo-deny")]
    rules = run([tool, "--locked", "--offline", "check", "licenses", "bans", "sources"])
    outcomes = [
        ("licenses and sources of crates", Outcome.FOUND if rules.returncode else Outcome.CLEAN, rules.stderr if rules.returncode else "")
    ]
    fetched = run([tool, "--locked", "fetch", "db"])
    if fetched.returncode:
        return [*outcomes, ("advisories on crates", Outcome.UNREACHABLE, fetched.stderr)]
    known = run([tool, "--locked", "check", "--disable-fetch", "advisories"])
    return [
        *outcomes,
        ("advisories on crates", Outcome.FOUND if known.returncode else Outcome.CLEAN, known.stderr if known.returncode else ""),
    ]


def packages(lock: Path) -> tuple[str, Outcome, str]:
    """What the Python Package Index knows of the versions in a lock file."""
    name = f"advisories on packages of {lock.relative_to(REPOSITORY)}"
    beside = Path(sys.executable).with_name("pip-audit")
    tool = str(beside) if beside.exists() else shutil.which("pip-audit")
    if tool is None:
        return name, Outcome.MISSING, "make audit installs pip-audit"
    asked = run([tool, "--requirement", str(lock), "--require-hashes", "--disable-pip", "--format", "json", "--progress-spinner", "off"])
    try:
        answers = json.loads(asked.stdout)["dependencies"]
    except (ValueError, KeyError, TypeError):
        return name, Outcome.UNREACHABLE, asked.stderr
    bad = [
        f"{answer['name']} {answer['version']}: {', '.join(v['id'] for v in answer['vulns'])}" for answer in answers if answer.get("vulns")
    ]
    # A package that an index without advisories (a mirror) says nothing of is skipped, and the tool then ends as if all were well.
    skipped = [answer["name"] for answer in answers if "skip_reason" in answer]
    if bad:
        return name, Outcome.FOUND, "\n".join(bad)
    if skipped or not answers:
        return name, Outcome.UNREACHABLE, f"nothing could be learnt of {len(skipped)} of {len(answers)}: {', '.join(skipped)}"
    return name, Outcome.CLEAN, ""


def main() -> int:
    """Run all, say what came of each on standard output, details on standard error."""
    results = crates()
    results += [packages(REPOSITORY / "requirements.lock"), packages(REPOSITORY / "tools" / "audit" / "requirements.lock")]
    words = {
        Outcome.CLEAN: "nothing found",
        Outcome.FOUND: "FOUND something",
        Outcome.UNREACHABLE: "NOT CHECKED: the database could not be reached",
        Outcome.MISSING: "NOT CHECKED: the tool is missing",
    }
    for name, outcome, details in results:
        print(f"{name}: {words[outcome]}", flush=True)
        if details:
            print(details.strip(), file=sys.stderr, flush=True)
    outcomes = {outcome for _, outcome, _ in results}
    for worst in (Outcome.FOUND, Outcome.UNREACHABLE, Outcome.MISSING):
        if worst in outcomes:
            return worst.value
    return 0


if __name__ == "__main__":
    sys.exit(main())
