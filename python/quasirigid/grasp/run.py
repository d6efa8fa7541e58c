"""Runs a grasp and leaves its files: the recording, ``summary.json``, plots."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from quasirigid._quasirigid import STAGES, __version__
from quasirigid.grasp.columns import check_grasp
from quasirigid.grasp.experiment import Grasp, Progress
from quasirigid.grasp.figures.plots import save_all
from quasirigid.grasp.figures.scene import save_scene
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.setup import GRAVITY
from quasirigid.grasp.summary import summarise
from quasirigid.recording.reader import Recording
from quasirigid.scene.indentation import indentation_note
from quasirigid.units import in_small_units, mass_words, plain, short_name


@dataclass(frozen=True)
class GraspResult:
    """What a grasp left behind."""

    summary: dict[str, Any]
    summary_file: Path
    recording: Path
    plots: tuple[Path, ...]


def run_grasp(
    options: GraspOptions,
    out: Path,
    *,
    record: Path | None = None,
    progress: Progress | None = None,
    show: Callable[[Grasp], AbstractContextManager[object]] | None = None,
) -> GraspResult:
    """Run the whole job and leave ``summary.json``, ``recording.h5`` and the plots in the directory ``out``; the recording in ``record`` if
    given. ``show`` shows it meanwhile: it is called before the first step, and what it returns is closed after the last.

    Raises the errors of ``quasirigid.errors`` for bad input. An interrupted run (``KeyboardInterrupt``) leaves a readable
    recording and a summary that says so, then passes the interrupt on.
    """
    grasp = Grasp(options)
    path = out / "recording.h5" if record is None else record
    chosen = {key: "" if value is None else str(value) for key, value in asdict(options).items()}
    attributes = {
        "options": json.dumps(chosen),
        "object": grasp.target.name,
        "object_mass_kg": grasp.target.mass.mass,
        "gravity_m_per_s2": GRAVITY,
    }
    attributes |= {"friction": grasp.friction, "squeeze_n": grasp.target.squeeze}
    began = time.perf_counter()
    with nullcontext() if show is None else show(grasp):  # an address that cannot be had is found out before a file is touched
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
    options, target = grasp.options, grasp.target
    mass = target.mass.mass
    with Recording(path) as recording:
        check_grasp(recording)
        figures = summarise(recording, dt=options.dt, mass=mass, gravity=GRAVITY, friction=grasp.friction, stages=STAGES)
        summary = {
            "object": target.name,
            **figures,
            "interrupted": interrupted,
            "fingers": list(grasp.fingers),
            "squeeze_n": target.squeeze,
            "material": options.material,
            "compliance": options.compliance,
            "object_motion": options.object_motion,
            "threads": options.threads,
            "approach": target.approach,
            "grasp_width_m": target.width,
            "warnings": [*grasp.notes, *indentation_note(figures["indentation_max"])],
            "elapsed_s": elapsed,
            "state_hash": f"{grasp.world.state_hash():016x}",
            "version": __version__,
        }
        file = out / "summary.json"
        file.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n")
        squeeze = in_small_units(target.squeeze, "N")
        subtitle = f"{short_name(target.name)}, {mass_words(mass)}, friction {plain(grasp.friction, 2)}, squeeze {squeeze}"
        subtitle += f", {options.compliance} compliance"
        weight = mass * GRAVITY
        plots = save_scene(recording, out)
        plots += save_all(recording, out, grasp.fingers, dt=options.dt, weight=weight, friction=grasp.friction, subtitle=subtitle)
    return GraspResult(summary, file, path, tuple(plots))
