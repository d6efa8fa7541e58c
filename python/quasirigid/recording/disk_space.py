"""Room for a file that grows: taken from the disk before something is written into it.

libhdf5 does not survive a disk that is full: a write that fails leaves its caches in a state in which it crashes when the file is closed,
or at the end of the program. So there is always room for what it writes next.
"""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress

PIECE = 2**16
"""Zeros that are written at once where the system cannot reserve room, bytes."""


EOF_AT, EOF_SIZE = 28, 8
"""Where a file of HDF5 (superblock of version 3, as recordings have) says how long it is, bytes. While it is written, how long it was at
first.
"""


class DiskSpace:
    """The room of one file."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Raises ``OSError`` where the file cannot be opened for writing."""
        self._file = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))

    def reserve(self, end: int) -> None:
        """See to it that the file can be written up to the byte ``end``. It may get that long. Raises ``OSError`` if the disk is full."""
        size = os.fstat(self._file).st_size
        if end <= size:
            return
        if sys.platform not in ("win32", "darwin"):
            try:
                os.posix_fallocate(self._file, size, end - size)
                return
            except OSError as error:
                if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS):
                    self.give_back(size)
                    raise
        try:
            os.lseek(self._file, size, os.SEEK_SET)
            while (size := os.fstat(self._file).st_size) < end:
                os.write(self._file, bytes(min(PIECE, end - size)))
        except OSError:
            self.give_back(size)
            raise

    def give_back(self, end: int) -> None:
        """Leave nothing reserved beyond the byte ``end``."""
        with suppress(OSError):
            if os.fstat(self._file).st_size > end:
                os.ftruncate(self._file, end)

    def trim(self) -> None:
        """Leave nothing beyond the end that HDF5 gave the file when it was closed."""
        with suppress(OSError):
            os.lseek(self._file, EOF_AT, os.SEEK_SET)
            self.give_back(int.from_bytes(os.read(self._file, EOF_SIZE), "little"))

    def to_disk(self) -> None:
        """Have everything that was written on the disk itself. Raises ``OSError``."""
        os.fsync(self._file)

    def close(self) -> None:
        """Close the file."""
        if self._file >= 0:
            file, self._file = self._file, -1
            os.close(file)


__all__ = ["DiskSpace"]
