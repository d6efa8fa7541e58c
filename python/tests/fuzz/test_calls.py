"""Random calls of everything public: each ends with a value, a typed error, or a ``TypeError`` for a wrong Python type; none hangs, none
takes the process along.
"""

from amount import SEED, cases
from calls import CALLS
from workers import run_cases

FULL = 30_000
"""Calls in a full run."""


def test_an_odd_call_is_a_value_or_a_typed_error() -> None:
    summary = run_cases("calls:run_calls", {"seed": SEED}, cases(FULL // CALLS))
    print(f"{CALLS * sum(summary.outcomes.values())} calls, seed {SEED}: {summary}")
    assert not summary.findings, f"seed {SEED}: {summary}\n{summary.findings[0].text}"
    # Neither so odd that all is refused, nor so usual that nothing is.
    assert len(summary.outcomes) > 2, summary
