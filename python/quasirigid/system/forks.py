"""What a forked child leaves to its parent: objects that work through a thread, which a child does not have, and files that are being
written.

Use them in the process that made them; they raise ``ForkError`` elsewhere.
"""

from __future__ import annotations

import os

import h5py

from quasirigid.errors import ForkError


class Owner:
    """The process that made something, kept beside it."""

    def __init__(self, what: str, hint: str) -> None:
        """``what`` is made here; ``hint`` says what to do in a child instead."""
        self._process = os.getpid()
        self._what, self._hint = what, hint

    @property
    def here(self) -> bool:
        """Whether it is this process."""
        return os.getpid() == self._process

    def check(self) -> None:
        """Raises ``ForkError`` in another process."""
        if not self.here:
            raise ForkError(self._what, "one of this process", "one of the process that this one was forked from", self._hint)


_written: dict[int, h5py.File] = {}
"""Files that are being written, by their descriptors."""


def keep_for_parent(file: h5py.File) -> None:
    """Until ``close_kept`` no forked child writes to ``file``: HDF5 closes all files when a process ends, and writes then."""
    _written[file.id.get_vfd_handle()] = file


def close_kept(file: h5py.File) -> None:
    """Close a file of ``keep_for_parent``; nothing happens if it is closed."""
    for descriptor in [d for d, kept in _written.items() if kept is file]:
        del _written[descriptor]
    file.close()


def _leave_files() -> None:
    # What HDF5 in the child takes for the file leads nowhere from here on. The parent's own descriptor is not touched. HDF5 is not asked: a
    # thread of the parent may have had its lock. The files stay in the table, so that no garbage collection closes them.
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in _written:
        os.dup2(nowhere, descriptor)
    os.close(nowhere)


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(after_in_child=_leave_files)


__all__ = ["Owner", "close_kept", "keep_for_parent"]
