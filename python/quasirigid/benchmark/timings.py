"""How long a step takes: the paper's grasp in three phases, and how cost grows with contacts, points and threads.

A phase is measured twice. *In motion* the hand is shaken, so that the solver has to find new forces in every step. *At rest* nothing
moves, and nearly all is remembered from the step before. The figures that lead are those in motion.

Times are wall-clock times of the step itself (``StepReport.step_time``); Python's share is not in them. On a machine that does other work
the 99th percentile is that of being interrupted: ``cpu_p99_ms`` is the CPU time of a step and does not count that (but counts the call from
Python).
"""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from quasirigid._quasirigid import STAGES, Grip, Hand, HandModel, MassProperties, Material, StepReport, Surface, World, __version__
from quasirigid.errors import QuasirigidError, SurfaceWarning
from quasirigid.objects import load_object
from quasirigid.scene.built_in_hand import FINGER_SPACING

PARTS = ("traverse", "interpenetration", "hierarchy_update", "w_rigid", "w_deform")
BOX = (0.06, 0.06, 0.06)
BOX_POINTS, PAD_POINTS = (36_000, 4_800), (2_400, 320)
"""Points and control points, as in the paper."""
BOX_MASS = 0.02
"""kg. So light that the lightest squeeze carries it too: the number of contacts comes from the squeeze."""
FRICTION = 0.8
PAD_DEPTH, CLEARANCE = 0.085, 0.008
SHAKE, SHAKE_FREQUENCY = 1e-3, 3.0
"""Amplitude (m) and frequency (Hz) of the hand in motion, along y, across the closing direction."""
STEPS, QUICK_STEPS = 2_000, 300
CLOSING_LIMIT = 5.0
"""Seconds after which a hand that has not settled counts as a failure."""

CONTACTS = (50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000)
QUICK_CONTACTS = (50, 100, 1_000)
POINTS = (10_000, 30_000, 100_000, 300_000, 1_000_000)
QUICK_POINTS = (10_000, 100_000)
THREADS = (1, 2)
SPACING = 1e-3
"""Distance of the control points of the conforming surfaces, m."""
PRESSURE = 2e3
"""With which they press on each other by their weight, Pa."""
POINTS_PER_CONTROL_POINT = 7.5

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class PaperPhase:
    """One column of figures 6 and 7 of the paper: ms on a 2 GHz Pentium 4."""

    squeeze: float
    """Force of the thumb that gives about as many contacts here, N."""
    contacts: int
    traverse: float
    interpenetration: float
    hierarchy_update: float
    collision: float
    w_rigid: float
    w_deform: float
    gauss_seidel: float
    sweeps: int
    resolution: float

    @property
    def total(self) -> float:
        """Collision and contact resolution, ms."""
        return self.collision + self.resolution


PAPER = (
    PaperPhase(0.3, 56, 1.170, 1.394, 2.468, 5.279, 8.838, 1.159, 0.409, 4, 14.150),
    PaperPhase(1.65, 105, 1.904, 2.376, 2.717, 7.382, 16.560, 3.140, 2.061, 4, 28.374),
    PaperPhase(5.2, 164, 2.973, 4.100, 2.549, 10.200, 25.030, 7.350, 5.410, 5, 43.060),
)


class Grasp:
    """The paper's scene, closed on the box and without support."""

    def __init__(self, squeeze: float, threads: int = 1) -> None:
        """Close the hand. Raises ``QuasirigidError`` if it does not come to rest."""
        pad = Material.preset("fingertip_pulp").replace(friction=FRICTION)
        self.world = World(threads=threads)
        surface = Surface.box(BOX, points=BOX_POINTS[0], control_points=BOX_POINTS[1])
        mass = MassProperties.box(BOX, mass=BOX_MASS)
        self.world.add_body(surface, Material.preset("wood").replace(friction=FRICTION), mass=mass, name="box")
        low = np.array([0.0, 0.0, -BOX[2] / 2 - 0.005])
        rubber = Material.preset("rubber")
        support = self.world.add_body(Surface.box((0.03, 0.03, 0.01), points=2_000), rubber, motion="fixed", position=low, name="support")
        self.hand: Hand = self.world.add_hand(
            HandModel.three_finger(), position=(0.0, 0.0, PAD_DEPTH), material=pad, points=PAD_POINTS[0], control_points=PAD_POINTS[1]
        )
        sides = np.array([-1.0, 1.0, 1.0])
        across = np.array([0.0, FINGER_SPACING / 2, -FINGER_SPACING / 2])
        starts = np.column_stack([sides * (BOX[0] / 2 + CLEARANCE), across, np.full(3, -PAD_DEPTH)])
        self.grip: Grip = self.hand.grip(starts, np.outer(-sides, [1.0, 0.0, 0.0]), squeeze=squeeze)
        while self.grip.state != "holding":
            if self.world.time > CLOSING_LIMIT:
                raise QuasirigidError(
                    what="benchmark", expected=f"a hand at rest within {CLOSING_LIMIT} s", got=self.grip.state, hint="report it, please"
                )
            self.step()
        self.world.remove(support)
        for _ in range(round(0.5 / self.world.dt)):
            self.step()

    def step(self) -> StepReport:
        """One step at rest."""
        self.grip.update()
        return self.world.step()

    def step_shaken(self) -> StepReport:
        """One step with the base of the hand on its sine."""
        now = self.world.time
        sine = [SHAKE * math.sin(2.0 * math.pi * SHAKE_FREQUENCY * t) for t in (now, now + self.world.dt)]
        self.hand.move_to(self.hand.position + np.array([0.0, sine[1] - sine[0], 0.0]))
        return self.step()


class Conforming:
    """A flat plate on a flat support: as many contacts as control points, whatever their number.

    Plate, weight and patch grow together, so that one contact is like another at every size. In motion the plate is pushed to and fro
    within its friction by half of what it takes to slip.
    """

    def __init__(self, contacts: int, threads: int = 1) -> None:
        """Lay the plate down."""
        side = SPACING * math.sqrt(contacts)
        self.world = World(threads=threads)
        soft = Material.preset("fingertip_pulp").replace(friction=FRICTION)
        hard = Material.preset("wood").replace(friction=FRICTION)
        # The support is sampled a little coarser and reaches farther: the plate's control points are those that touch.
        below = contacts * 1.1**2 / 1.2**2
        floor = Surface.half_space(1.1 * side, points=round(POINTS_PER_CONTROL_POINT * below), control_points=round(below))
        self.world.add_body(floor, hard, motion="fixed", name="support")
        plate = Surface.half_space(side, points=round(POINTS_PER_CONTROL_POINT * contacts), control_points=contacts)
        self.weight = PRESSURE * side * side
        mass = MassProperties.box((side, side, 0.1 * side), mass=self.weight / 9.81)
        # Its face looks down.
        self.plate = self.world.add_body(plate, soft, mass=mass, quaternion=(0.0, 1.0, 0.0, 0.0), name="plate")
        self.world.step(300)

    def step(self) -> StepReport:
        """One step at rest."""
        return self.world.step()

    def step_shaken(self) -> StepReport:
        """One step with the push on its sine."""
        push = 0.5 * FRICTION * self.weight * math.sin(2.0 * math.pi * 10.0 * SHAKE_FREQUENCY * self.world.time)
        self.plate.apply_wrench((push, 0.0, 0.0))
        return self.world.step()


def _measured(step: Callable[[], StepReport], count: int) -> tuple[list[StepReport], list[float]]:
    """Reports of ``count`` steps, and the CPU time of each in ms, Python's share included."""
    reports, cpu = [], []
    for _ in range(count):
        before = time.thread_time_ns()
        reports.append(step())
        cpu.append(1e-6 * (time.thread_time_ns() - before))
    return reports, cpu


def _figures(measured: tuple[list[StepReport], list[float]]) -> dict[str, Any]:
    """Medians in ms over consecutive steps, with the keys of the output."""
    reports, cpu = measured

    def median(values: Iterable[float]) -> float:
        return 1e3 * float(np.median(list(values)))

    totals = [1e3 * report.step_time for report in reports]
    parts = [report.part_times for report in reports]
    stages = [report.stage_times for report in reports]
    return {
        "contacts": int(np.median([report.contacts for report in reports])),
        **{f"{part}_ms": median(p[part] for p in parts) for part in PARTS},
        "gauss_seidel_ms": median(s["gauss_seidel"] for s in stages),
        "sweeps": int(np.median([report.sweeps for report in reports])),
        "sweeps_max": max(report.sweeps for report in reports),
        "total_ms": float(np.median(totals)),
        "total_p99_ms": float(np.quantile(totals, 0.99)),
        "total_max_ms": max(totals),
        "cpu_p99_ms": float(np.quantile(cpu, 0.99)),
        "residual": max(report.residual for report in reports),
        "unconverged_steps": sum(not report.converged for report in reports),
        "steps": len(reports),
        "stages_ms": {stage: median(s[stage] for s in stages) for stage in STAGES},
    }


def measure_phase(paper: PaperPhase, steps: int) -> dict[str, Any]:
    """One phase of the grasp: figures in motion, those at rest under ``at_rest``, the paper's under ``paper``."""
    grasp = Grasp(paper.squeeze)
    at_rest = _figures(_measured(grasp.step, steps))
    for _ in range(50):
        grasp.step_shaken()
    in_motion = _figures(_measured(grasp.step_shaken, steps))
    published = {
        "contacts": paper.contacts,
        **{f"{part}_ms": getattr(paper, part) for part in (*PARTS, "collision", "resolution", "gauss_seidel", "total")},
        "sweeps": paper.sweeps,
    }
    ratio = paper.total / in_motion["total_ms"]
    return {"squeeze_n": paper.squeeze, **in_motion, "ratio_to_paper": ratio, "at_rest": at_rest, "paper": published}


def measure_contacts(contacts: int, threads: int, steps: int) -> dict[str, Any]:
    """Cost of a step with about so many contacts between two conforming surfaces."""
    scene = Conforming(contacts, threads)
    at_rest = _figures(_measured(scene.step, steps))
    for _ in range(20):
        scene.step_shaken()
    in_motion = _figures(_measured(scene.step_shaken, steps))

    def row(figures: dict[str, Any]) -> dict[str, Any]:
        wanted = ("contacts", "sweeps", "total_ms", "total_p99_ms", "residual", "unconverged_steps", "stages_ms")
        return {key: figures[key] for key in wanted} | {"us_per_contact": 1e3 * figures["total_ms"] / max(figures["contacts"], 1)}

    return {"threads": threads, **row(in_motion), "at_rest": row(at_rest)}


def measure_points(points: int, threads: int) -> dict[str, Any]:
    """Seconds from points to a surface ready for contact, in a process of its own with so many threads.

    Three ways in: arrays of points with normals and areas, with normals, and bare; and two files (PLY, binary, single precision): points
    with normals, and bare points. Wall-clock time under ``..._s``, CPU time of all threads under ``..._cpu_s``; a file's is from opening it
    to the surface, mass properties included.
    """
    code = f"import json; from quasirigid.benchmark.timings import _build_surfaces; print(json.dumps(_build_surfaces({points})))"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"RAYON_NUM_THREADS": str(threads)}, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        got = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise QuasirigidError(what=f"benchmark of {points} points", expected="surfaces", got=got, hint="report it, please")
    return {"points": points, "threads": threads, **json.loads(done.stdout)}


def _build_surfaces(points: int) -> dict[str, Any]:
    sphere = Surface.sphere(0.05, points=points, control_points=max(points // 100, 1))
    cloud, normals, areas = sphere.points, sphere.normals, sphere.areas
    rows: dict[str, Any] = {"control_points": round(points / POINTS_PER_CONTROL_POINT)}

    def timed(name: str, build: Callable[[], object]) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        build()
        rows[f"{name}_s"], rows[f"{name}_cpu_s"] = time.perf_counter() - wall, time.process_time() - cpu

    def from_file(file: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SurfaceWarning)
            loaded = load_object(file, points=points)
        Surface.from_points(loaded.points, loaded.normals, loaded.areas)

    timed("build", lambda: Surface.from_points(cloud, normals, areas))
    timed("build_with_normals", lambda: Surface.from_points(cloud, normals))
    timed("build_from_bare_points", lambda: Surface.from_points(cloud))
    with tempfile.TemporaryDirectory() as folder:
        for name, columns, table in (
            ("file_with_normals", "x y z nx ny nz", np.hstack([cloud, normals])),
            ("file_of_bare_points", "x y z", cloud),
        ):
            file = Path(folder) / f"{name}.ply"
            properties = "".join(f"property float {column}\n" for column in columns.split())
            header = f"ply\nformat binary_little_endian 1.0\nelement vertex {points}\n{properties}end_header\n"
            file.write_bytes(header.encode() + table.astype("<f4").tobytes())
            timed(name, partial(from_file, file))
    return rows


def run_bench(*, quick: bool = False, progress: Progress | None = None) -> dict[str, Any]:
    """Measure everything. ``quick``: fewer steps and sizes; ``progress`` is called with what is measured and the share that is done."""
    steps = QUICK_STEPS if quick else STEPS
    contacts = QUICK_CONTACTS if quick else CONTACTS
    points = QUICK_POINTS if quick else POINTS
    # Name, rough share of the whole time, what to do.
    jobs: list[tuple[str, float, Callable[[], Any]]] = []
    for paper in PAPER:
        jobs.append((f"grasp, {paper.contacts} contacts", 6.0, partial(measure_phase, paper, steps)))
    for count in contacts:
        for threads in THREADS:
            name = f"{count:,} contacts, {threads} thread{'s' if threads > 1 else ''}"
            jobs.append((name, 1.0 + count / 1_000, partial(measure_contacts, count, threads, _steps_for(count, steps))))
    for count in points:
        for threads in THREADS:
            name = f"{count:,} points, {threads} thread{'s' if threads > 1 else ''}"
            jobs.append((name, count / 1e5, partial(measure_points, count, threads)))
    machine = _machine()
    whole = sum(job[1] for job in jobs)
    done, results = 0.0, []
    for name, share, job in jobs:
        if progress is not None:
            progress(name, done / whole)
        results.append(job())
        done += share
    phases, rest = results[: len(PAPER)], results[len(PAPER) :]
    by_contacts = rest[: len(contacts) * len(THREADS)]
    return {
        "phases": phases,
        "scaling": {"contacts": by_contacts, "points": rest[len(contacts) * len(THREADS) :], "growth": _growth(by_contacts)},
        "machine": machine,
        "quasirigid": __version__,
        "quick": quick,
    }


def _growth(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """How much more a contact costs among the most contacts than among about 100, one thread."""
    one = [row for row in rows if row["threads"] == 1]
    few, most = min(one, key=lambda row: abs(row["contacts"] - 100)), max(one, key=lambda row: row["contacts"])
    return {
        "from_contacts": few["contacts"],
        "to_contacts": most["contacts"],
        "in_motion": most["us_per_contact"] / few["us_per_contact"],
        "at_rest": most["at_rest"]["us_per_contact"] / few["at_rest"]["us_per_contact"],
    }


def _steps_for(contacts: int, steps: int) -> int:
    """Fewer steps of the large ones: their medians are steady, and minutes are long."""
    return max(20, min(steps // 4, 300_000 // contacts))


def _machine() -> dict[str, Any]:
    processor = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as info:
            processor = next((line.split(":", 1)[1].strip() for line in info if line.startswith("model name")), processor)
    except OSError:
        pass
    return {"processor": processor, "cores": os.cpu_count(), "system": platform.system(), "load": os.getloadavg()[0]}
