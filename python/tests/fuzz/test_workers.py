"""The harness itself: a case that raises, hangs, dies or eats all memory is found, with its number, and those beside it are not lost."""

import os
import time
from typing import Any

import pytest
from workers import MEMORY, run_cases

RAISES, HANGS, DIES, EATS = 3, 5, 7, 9


def task(context: dict[str, Any], number: int) -> str:
    """What a worker runs."""
    if number == RAISES:
        raise ZeroDivisionError("three")
    if number == HANGS:
        time.sleep(60.0)
    if number == DIES:
        os.abort()
    if number == EATS:
        bytearray(2 * MEMORY)
    return context["word"]


def test_cases_that_raise_hang_die_or_eat_all_memory_are_found_and_no_other_is_lost() -> None:
    summary = run_cases("test_workers:task", {"word": "value"}, range(12), workers=2, late=2.0)
    found = {finding.number: finding.kind for finding in summary.findings}
    assert found == {RAISES: "untyped", HANGS: "hang", DIES: "crash", EATS: "untyped"}, str(summary)
    assert summary.outcomes == {"value": 8, "untyped": 2, "hang": 1, "crash": 1}
    places = "\n".join(finding.place for finding in summary.findings)
    for word in ("ZeroDivisionError: three", "in task", "MemoryError"):
        assert word in places, places


def test_a_worker_that_cannot_start_is_an_error_and_not_a_result() -> None:
    with pytest.raises(RuntimeError, match="did not start"):
        run_cases("no_such_module:task", {}, range(3))
