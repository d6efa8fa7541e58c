"""What goes wrong in a thread that draws: logged once, and the thread goes on with the next state."""

from __future__ import annotations

import sys
import traceback

from quasirigid.errors import QuasirigidError


class ErrorLog:
    """Logs an error once for each line that raises it: a drawing that fails thirty times a second must not fill the console."""

    def __init__(self) -> None:
        self._logged: set[tuple[str, int]] = set()

    def log(self, error: Exception) -> None:
        """One line for errors of input and of files, which say what to do; a bug has its traceback."""
        *_, last = traceback.extract_tb(error.__traceback__)
        place = (last.filename, last.lineno or 0)
        if place in self._logged:
            return
        self._logged.add(place)
        if not isinstance(error, (QuasirigidError, OSError)):
            traceback.print_exception(error)
        print(f"quasirigid: view: {error}", file=sys.stderr)
