"""``python -m quasirigid.cli`` is the program ``quasirigid``."""

import sys

from quasirigid.cli.app import main

if __name__ == "__main__":
    sys.exit(main())
