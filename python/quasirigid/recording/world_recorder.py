"""``quasirigid.record``: records a world that you step yourself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from quasirigid._quasirigid import Body, StepReport, World
from quasirigid.errors import InvalidValueError
from quasirigid.recording.scene_recorder import DEFORMATION_RATE, SceneRecorder
from quasirigid.scene.world import WorldScene


class WorldRecorder:
    """Records a world step by step. Made by ``record``; use it in a ``with`` block."""

    def __init__(
        self, world: World, path: str | Path, *, fingertips: Sequence[Body], deformation_rate: float, attributes: Mapping[str, Any] | None
    ) -> None:
        self._scene = WorldScene(world, pads=fingertips)
        shape = self._scene.state().joint_positions.shape
        self._recorder = SceneRecorder(
            path, self._scene.model, (shape[0], shape[1]), deformation_rate=deformation_rate, attributes=attributes
        )

    @property
    def path(self) -> Path:
        """The file."""
        return self._recorder.path

    @property
    def steps(self) -> int:
        """Steps recorded so far."""
        return self._recorder.steps

    def append(self, report: StepReport | None = None, *, phase: str = "") -> None:
        """Record the world as it is now, after a step; call it once per step, or now and then.

        ``report`` is what the step returned: its figures are recorded too. ``phase`` says in a word or two, of 64 bytes at most, what is
        going on. Raises ``InvalidValueError`` if the phase is longer, or if bodies or colliders came or went since the recording began: a
        recording has the same ones from start to end.
        """
        if not self._scene.unchanged():
            hint = "close this recording and begin another after adding or removing some"
            raise InvalidValueError("world", "the bodies and colliders that it had when the recording began", "others", hint)
        state = self._scene.state(report, phase, moved=self._recorder.wants_deformation(self._scene.world.time))
        self._recorder.append(state, None, report)

    @property
    def waited(self) -> float:
        """How long ``append`` had to wait because the disk could not follow, s."""
        return self._recorder.waited

    def flush(self) -> None:
        """Put everything appended so far on disk, and wait for it. Raises ``RecordingError`` if it cannot be written."""
        self._recorder.flush()

    def close(self) -> None:
        """Write what is buffered and mark the recording as complete. Raises ``RecordingError`` if it cannot be written."""
        self._recorder.close()

    def __enter__(self) -> WorldRecorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._recorder.__exit__(kind, error, trace)


def record(
    world: World,
    path: str | Path,
    *,
    fingertips: Sequence[Body] = (),
    deformation_rate: float = DEFORMATION_RATE,
    attributes: Mapping[str, Any] | None = None,
) -> WorldRecorder:
    """Begin a recording of ``world`` in the file ``path`` (an old one is replaced), for ``quasirigid replay``, ``render`` and ``export``.

    >>> with quasirigid.record(world, "run.h5") as recording:  # doctest: +SKIP
    ...     for _ in range(1000):
    ...         recording.append(world.step())

    Call it when all bodies are in the world. Poses, contacts and forces are written at every ``append``, the deformation of the surfaces
    ``deformation_rate`` times per second of simulated time (infinity: at every ``append``). ``attributes`` are kept with the file. Pictures
    show what hands feel, and the bodies that you name as ``fingertips``.
    A thread writes blocks of 100 steps while you go on. A process that is killed leaves a file that can be read up to the last block on
    disk. Raises ``RecordingError`` where no file can be written; a disk that fills up later is reported at the next ``append``, or by
    ``close``.
    """
    return WorldRecorder(world, path, fingertips=fingertips, deformation_rate=deformation_rate, attributes=attributes)


__all__ = ["WorldRecorder", "record"]
