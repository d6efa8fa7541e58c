"""What can be wrong with input: one exception tree, and one warning.

Every exception says what was checked, what was expected, what came, and what to do.
The compiled module raises the same classes.
"""

from __future__ import annotations

__all__ = [
    "CaptureFileError",
    "DegenerateSurfaceError",
    "ForkError",
    "GraspPlanError",
    "InvalidHandleError",
    "InvalidShapeError",
    "InvalidValueError",
    "MissingPackageError",
    "NetworkError",
    "ObjectFileError",
    "PacketError",
    "QuasirigidError",
    "RecordingError",
    "SnapshotError",
    "SurfaceWarning",
    "UnknownNameError",
]


class QuasirigidError(Exception):
    """Root of every exception of the package.

    Args:
        what: the argument, field or file that is wrong.
        expected: what would have been accepted, with unit.
        got: what came.
        hint: what to do about it.
    """

    what: str
    expected: str
    got: str
    hint: str

    def __init__(self, what: str, expected: str, got: object, hint: str) -> None:
        self.what = what
        self.expected = expected
        self.got = str(got)
        self.hint = hint
        super().__init__(f"{what}: expected {expected}, got {self.got}; {hint}")

    def __str__(self) -> str:
        return f"{self.what}: expected {self.expected}, got {self.got}; {self.hint}"

    def __reduce__(self) -> tuple[type[QuasirigidError], tuple[str, str, str, str]]:
        # The default rebuilds from `args`, which holds the message alone: worker processes could not send these home.
        return (type(self), (self.what, self.expected, self.got, self.hint))


class InvalidValueError(QuasirigidError, ValueError):
    """A number is NaN, infinite, of the wrong sign or out of range."""


class InvalidShapeError(QuasirigidError, ValueError):
    """An array has the wrong shape, or two arrays disagree."""


class DegenerateSurfaceError(QuasirigidError, ValueError):
    """Points or faces that do not make a usable surface."""


class UnknownNameError(QuasirigidError, LookupError):
    """A name that is not in the table it was looked up in."""


class InvalidHandleError(QuasirigidError, LookupError):
    """A handle whose body was removed, or that belongs to another world, or is of another kind."""


class ObjectFileError(QuasirigidError, OSError):
    """A file that is missing, unreadable or of an unknown format."""


class CaptureFileError(QuasirigidError, OSError):
    """A motion capture file (take, calibration, body map) that is missing, unreadable or has nothing in it."""


class RecordingError(QuasirigidError, OSError):
    """A recording that cannot be written, as the disk is full, the place is read-only or the file is in use; or one that cannot be read, as
    it is missing, damaged, or something else than a recording.
    """


class NetworkError(QuasirigidError, OSError):
    """A socket that cannot be opened or used: port in use, no such group, no route."""


class PacketError(QuasirigidError, ValueError):
    """A datagram that is no packet of the tracker's format."""


class SnapshotError(QuasirigidError, ValueError):
    """Bytes that are no snapshot of a world that this version can read: damaged, of another version, or something else."""


class ForkError(QuasirigidError, RuntimeError):
    """Something that works through a thread of the process that made it, or was in use there, and was used in a child forked from it."""


class GraspPlanError(QuasirigidError, ValueError):
    """An object that the hand cannot take: too large, too small, or without opposing sides."""


class MissingPackageError(QuasirigidError, ImportError):
    """An optional package that is not installed. The message says how to install it."""

    @staticmethod
    def of(package: str, purpose: str, extra: str) -> MissingPackageError:
        """``package`` is missing; ``purpose`` is what it is needed for; ``extra`` is the extra of this package that brings it."""
        hint = f"pip install {package}, or pip install 'quasirigid[{extra}]'"
        return MissingPackageError(f"package {package}", f"it installed {purpose}", "none", hint)


class SurfaceWarning(UserWarning):
    """A surface that is usable but not perfect, such as one with holes."""
