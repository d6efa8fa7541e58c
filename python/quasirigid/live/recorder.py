"""Records the live view: ``quasirigid view --record``."""

from __future__ import annotations

from pathlib import Path

from quasirigid.live.play import Play
from quasirigid.recording.scene_recorder import SceneRecorder


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
        target = play.grasp.target
        attributes = {"object": target.name, "object_mass_kg": play.figures.mass, "friction": play.figures.friction}
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
