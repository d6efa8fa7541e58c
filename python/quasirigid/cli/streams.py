"""The standard streams of the program: what the caller closed, and readers who have left.

A stream that was closed (``>&-``) is one that nobody reads, like ``/dev/null``: the program works on, and its files are written. Unless its
number is taken, the next file that is opened would get it, and what is printed would end up in there.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

GONE = (errno.EPIPE, errno.EIO, errno.ECONNRESET, errno.ESHUTDOWN)
"""What writing says if nobody reads any more: a pipe (``| head``), a terminal that was closed, a socket."""


class OutputLostError(Exception):
    """Standard output cannot be written. No ``OSError``, so that it is not taken for one of a file."""

    def __init__(self, error: OSError) -> None:
        super().__init__(str(error))
        self.left = error.errno in GONE
        """Whether its reader has left, who then has seen enough."""
        self.reason = error.strerror or str(error)


class _Stream:
    """A stream with another way to fail; all else is as it was."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._lost: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """As of the stream."""
        self._do(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """As of the stream."""
        self._do(self._stream.flush)

    def _do(self, operation: Callable[[], object]) -> None:
        if self._lost is None:
            try:
                operation()
                return
            except OSError as error:
                self._lost = error
                self._send_nowhere()
        self._fail(self._lost)

    def _send_nowhere(self) -> None:
        """What is still in the buffer has nowhere to go, and would be tried again at exit."""
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)

    def _fail(self, error: OSError) -> None:
        """What comes of a stream that cannot be written: again at every write, for whoever tries a stream may drop what it says."""


class _Output(_Stream):
    """Standard output: the result. To lose it is an error."""

    def _fail(self, error: OSError) -> None:
        raise OutputLostError(error) from None


class _Talk(_Stream):
    """Standard error: nothing that is said there is worth a run or a recording."""


@contextmanager
def standard_streams() -> Iterator[None]:
    """While the program runs: all three are open, results that cannot be written are an ``OutputLostError``, talk that cannot be is
    dropped.
    """
    _open_closed()
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _Output(sys.stdout), _Talk(sys.stderr)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def _open_closed() -> None:
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            # The lowest number that is free, and so this one: those below are open.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
        if getattr(sys, name) is None:
            # It is open as long as the program.
            setattr(sys, name, open(os.devnull, "r" if number == 0 else "w", encoding="utf-8"))  # noqa: SIM115


__all__ = ["OutputLostError", "standard_streams"]
