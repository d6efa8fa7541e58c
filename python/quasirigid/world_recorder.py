"""``quasirigid.record``: records a world that you step yourself; and what records the live view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from quasirigid._quasirigid import Body, StepReport, World
from quasirigid.errors import InvalidValueError
from quasirigid.scene_recording import DEFORMATION_RATE, SceneRecorder
from quasirigid.view.world_scene import WorldScene

if TYPE_CHECKING:
    from quasirigid.view.play import Play


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

        ``report`` is what the step returned: its figures are recorded too. ``phase`` says in a word or two, of 64 bytes at most, what is going on.
        Raises ``InvalidValueError`` if the phase is longer, or if bodies came or went since the recording began: a recording has the same ones from
        start to end.
        """
        if not self._scene.unchanged():
            hint = "close this recording and begin another after adding or removing bodies"
            raise InvalidValueError("world", "the bodies that it had when the recording began", "others", hint)
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
    ``deformation_rate`` times per second of simulated time (infinity: at every ``append``). ``attributes`` are kept with the file. Pictures show what
    hands feel, and the bodies that you name as ``fingertips``.
    A thread writes blocks of 100 steps while you go on. A process that is killed leaves a file that can be read up to the last block on disk.
    Raises ``RecordingError`` where no file can be written; a disk that fills up later is told at the next ``append``, or by ``close``.
    """
    return WorldRecorder(world, path, fingertips=fingertips, deformation_rate=deformation_rate, attributes=attributes)


class LiveRecorder:
    """Records the live view: called after every step, in the simulation thread. Another object or Reset begins another file."""

    def __init__(self, path: str | Path) -> None:
        """The first file is ``path``, then ``name-2.h5`` and so on."""
        self._path = Path(path)
        self._recorder: SceneRecorder | None = None
        self.paths: list[Path] = []
        """The files written so far."""
        self._waited = 0.0

    @property
    def waited(self) -> float:
        """How long the simulation had to wait because the disk could not follow, s."""
        return self._waited + (0.0 if self._recorder is None else self._recorder.waited)

    def begin(self, play: Play) -> None:
        """Begin a file for this grasp. Raises ``RecordingError`` where none can be written."""
        self.close()
        scene, count = play.scene, len(self.paths) + 1
        path = self._path if count == 1 else self._path.with_stem(f"{self._path.stem}-{count}")
        taken = play.grasp.taken
        attributes = {"object": taken.name, "object_mass_kg": play.figures.mass, "friction": play.figures.friction}
        joints = scene.state().joint_positions.shape
        self._recorder = SceneRecorder(path, scene.model, (joints[0], joints[1]), attributes=attributes)
        self.paths.append(path)

    def __call__(self, play: Play) -> None:
        """Record the grasp as it is now."""
        scene = play.scene
        if self._recorder is None or self._recorder.model is not scene.model:
            self.begin(play)
            assert self._recorder is not None
        state = scene.state(play.report, play.phase, moved=self._recorder.wants_deformation(scene.world.time))
        self._recorder.append(state, None, play.report)

    def close(self) -> None:
        """Finish the file that is being written; one without a step is taken away, and an older one in its place stays."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            if recorder.steps == 0:
                recorder.discard()
                self.paths.remove(recorder.path)
            else:
                recorder.close()
            self._waited += recorder.waited


__all__ = ["LiveRecorder", "WorldRecorder", "record"]
