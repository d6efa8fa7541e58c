"""How much is fuzzed, and with which seed: a tenth in a usual run of the tests, all with ``make fuzz``.

    QUASIRIGID_FUZZ=1 QUASIRIGID_FUZZ_SEED=7 .venv/bin/pytest python/tests/fuzz

``QUASIRIGID_FUZZ`` is the share of the full number of cases, 0.1 by default.
"""

import os

SHARE = float(os.environ.get("QUASIRIGID_FUZZ", "0.1"))
SEED = int(os.environ.get("QUASIRIGID_FUZZ_SEED", "1"))


def cases(full: int) -> range:
    """The numbers of the cases to run, of ``full`` in all; at least one."""
    return range(max(1, round(SHARE * full)))
