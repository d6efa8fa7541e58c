"""Runs a grasp and leaves its files: the recording, ``summary.json``, plots."""

from __future__ import annotations

import json
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from quasirigid._quasirigid import STAGES, __version__
from quasirigid.grasp import GRAVITY, Grasp, Progress
from quasirigid.grasp_options import GraspOptions
from quasirigid.plots import save_all
from quasirigid.recording import Recording
from quasirigid.scene_plot import save_scene
from quasirigid.summary import summarise


@dataclass(frozen=True)
class GraspResult:
    """What a grasp left behind."""

    summary: dict[str, Any]
    summary_file: Path
    recording: Path
    plots: tuple[Path, ...]


@dataclass(frozen=True)
class Page:
    """A page to watch a grasp in: who may look (``host``), on which port (or the next free one), and whether to open it in the ``browser``."""

    host: str = "127.0.0.1"
    port: int = 8080
    browser: bool = True

    def open(self, grasp: Grasp) -> AbstractContextManager[object]:
        """Show the grasp from now on, and keep its steps to the clock."""
        from quasirigid.view.watch import watch  # the server takes half a second to import: only who looks pays for it

        grasp.paced = True
        return watch(grasp.world, self.host, self.port, self.browser, phase=lambda: grasp.phase, speed=1.0, ends="it ends with the run")


def run_grasp(
    options: GraspOptions, out: Path, *, record: Path | None = None, progress: Progress | None = None, view: Page | None = None
) -> GraspResult:
    """Run the whole job and leave ``summary.json``, ``recording.h5`` and the plots in the directory ``out``; the recording in ``record`` if given.
    ``view`` shows it in the browser meanwhile, no faster than the clock.

    Raises the errors of ``quasirigid.errors`` for bad input. An interrupted run (``KeyboardInterrupt``) leaves a readable
    recording and a summary that says so, then passes the interrupt on.
    """
    grasp = Grasp(options)
    path = out / "recording.h5" if record is None else record
    chosen = {key: "" if value is None else str(value) for key, value in asdict(options).items()}
    attributes = {
        "options": json.dumps(chosen),
        "object": grasp.taken.name,
        "object_mass_kg": grasp.taken.mass.mass,
        "gravity_m_per_s2": GRAVITY,
    }
    attributes |= {"friction": grasp.friction, "squeeze_n": grasp.taken.squeeze}
    began = time.perf_counter()
    with nullcontext() if view is None else view.open(grasp):  # an address that cannot be had is found out before a file is touched
        out.mkdir(parents=True, exist_ok=True)
        recorder = grasp.recorder(path, attributes)
        try:
            with recorder:
                grasp.run(recorder, progress)
        except KeyboardInterrupt:
            _leave_summary(grasp, path, out, time.perf_counter() - began, interrupted=True)
            raise
    return _leave_summary(grasp, path, out, time.perf_counter() - began, interrupted=False)


def _leave_summary(grasp: Grasp, path: Path, out: Path, elapsed: float, *, interrupted: bool) -> GraspResult:
    options, taken = grasp.options, grasp.taken
    mass = taken.mass.mass
    with Recording(path) as recording:
        figures = summarise(recording, dt=options.dt, mass=mass, gravity=GRAVITY, friction=grasp.friction, stages=STAGES)
        summary = {
            "object": taken.name,
            **figures,
            "interrupted": interrupted,
            "fingers": list(grasp.fingers),
            "squeeze_n": taken.squeeze,
            "material": options.material,
            "compliance": options.compliance,
            "object_motion": options.object_motion,
            "threads": options.threads,
            "approach": taken.approach,
            "grasp_width_m": taken.width,
            "warnings": grasp.notes,
            "elapsed_s": elapsed,
            "state_hash": f"{grasp.world.state_hash():016x}",
            "version": __version__,
        }
        file = out / "summary.json"
        file.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n")
        subtitle = (
            f"{taken.name}, {mass:.3g} kg, friction {grasp.friction:.2g}, squeeze {taken.squeeze:.3g} N, {options.compliance} compliance"
        )
        weight = mass * GRAVITY
        plots = save_scene(recording, out)
        plots += save_all(recording, out, grasp.fingers, dt=options.dt, weight=weight, friction=grasp.friction, subtitle=subtitle)
    return GraspResult(summary, file, path, tuple(plots))
