"""Where a recording is written: by one process at a time, and in the place of an older one only once there is something to read."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from quasirigid.errors import RecordingError

if sys.platform != "win32":
    import fcntl


class RecordingLock:
    """A path that nobody else records to. HDF5 does not see to that: who writes for readers in other processes holds no lock of it, and a
    second writer would empty the file before it was refused.

    The lock is on a side file and ends with the process, however that ends. On Windows there is none, and the file is written where it
    belongs.
    """

    def __init__(self, path: Path) -> None:
        """Lock ``path`` and make its directory. Raises ``RecordingError`` if it is no place for a file or is being recorded to, and
        ``OSError``.
        """
        self.target = path.resolve()
        """The file itself, wherever the process goes."""
        if self.target.exists() and not self.target.is_file():
            found = "a directory" if self.target.is_dir() else "something else than a file"
            raise RecordingError(str(path), "a file that can be written", found, "choose another place with --record or --out")
        self.target.parent.mkdir(parents=True, exist_ok=True)
        self._side = self.target.with_name(f".{self.target.name}.lock")
        self._lock = -1 if sys.platform == "win32" else _locked(self._side, path)
        self.draft = self.target if self._lock < 0 else self.target.with_name(f".{self.target.name}.new")
        """Where the file is begun."""
        self.settled = self.draft == self.target
        """Whether the file is where it belongs."""

    def settle(self) -> None:
        """Put the draft where it belongs, unless it is there. Whoever reads an older recording there keeps that one."""
        if not self.settled:
            with suppress(FileNotFoundError):  # an interrupt came between this and the next line
                os.replace(self.draft, self.target)
            self.settled = True

    def abandon(self) -> None:
        """Take away what was begun and let others record here. An older recording stays, unless its place was taken already."""
        if self.settled:
            self.target.unlink(missing_ok=True)
        self.release()

    def release(self) -> None:
        """Let others record here. What was begun and never settled goes away."""
        if not self.settled:
            self.draft.unlink(missing_ok=True)
        if self._lock >= 0:
            lock, self._lock = self._lock, -1
            with suppress(OSError):
                self._side.unlink(missing_ok=True)  # while it is locked: nobody else can have taken it for theirs
            os.close(lock)


def _locked(side: Path, path: Path) -> int:
    """The descriptor of a locked side file."""
    assert sys.platform != "win32"
    while True:
        lock = os.open(side, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                hint = "wait for that run to end, or choose another place with --record or --out"
                raise RecordingError(str(path), "a file that can be written", "one that is being recorded to", hint) from None
            except OSError:
                return lock  # a file system without locks
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(lock), os.stat(side)):
                    return lock
        except BaseException:
            os.close(lock)
            raise
        os.close(lock)  # its owner took it away between our opening and locking it


__all__ = ["RecordingLock"]
