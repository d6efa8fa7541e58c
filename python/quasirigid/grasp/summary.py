"""The figures that tell how a grasp went: pure functions of the recorded columns.

A *columns* mapping is anything that gives NumPy arrays by column name, such as a ``Recording``. ``T`` is the number of
steps and ``F`` the number of fingers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.types import FloatArray
from quasirigid.rotation import conjugate, pose_in, quaternion_product, rotation_angle

PHASES = ("close", "squeeze", "support away", "hold", "lift", "shake", "hold again", "put down", "release", "fall")
"""Names of the phases of a grasp, in order; ``fall`` takes the place of what is left when the object is dropped."""

CARRIED = ("hold", "lift", "shake", "hold again")
"""The phases in which nothing but the fingers carries the object."""

LOST_AT = 0.005
"""Moved this far (m) against the hand since the support went away, the object no longer counts as held."""

SETTLED = 1.0
"""The last second (s) of a hold is what drift, forces and balance are read from."""


class Columns(Protocol):
    """Anything with recorded arrays by name."""

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """The column of that name, one row per step."""


@dataclass(frozen=True)
class Phase:
    """A run of steps with one name: steps ``first:last``, seconds ``start`` to ``end``."""

    name: str
    first: int
    last: int
    start: float
    end: float


def phases(codes: npt.NDArray[Any], times: FloatArray, dt: float, names: Sequence[str] = PHASES) -> list[Phase]:
    """The phases in the order in which they came. ``codes`` (T,) index ``names``; ``times`` (T,) s at the end of each step."""
    if len(codes) == 0:
        return []
    cuts = np.flatnonzero(np.diff(codes.astype(int))) + 1
    firsts, lasts = [0, *cuts.tolist()], [*cuts.tolist(), len(codes)]
    return [Phase(names[int(codes[a])], a, b, float(times[a] - dt), float(times[b - 1])) for a, b in zip(firsts, lasts, strict=True)]


def moved(poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far each of the ``poses`` (T, 7) is from the first: distance (T,) m and angle (T,) rad."""
    distance: FloatArray = np.linalg.norm(poses[:, :3] - poses[:1, :3], axis=1)
    return distance, rotation_angle(quaternion_product(conjugate(poses[:1, 3:]), poses[:, 3:]))


def creep(poses: FloatArray, dt: float) -> tuple[float, float] | tuple[None, None]:
    """Speed (m/s, rad/s) of a pose that ought to rest: the furthest that it gets from where it was, over the time watched.

    At least the mean speed; a tremble counts too, which a mean over the window would hide. ``None`` of a single pose: nothing was watched.
    """
    duration = (len(poses) - 1) * dt
    if duration <= 0.0:
        return None, None
    distance, angle = moved(poses)
    return float(distance.max() / duration), float(angle.max() / duration)


def settled(phase: Phase, dt: float) -> slice:
    """The steps of the last second of a phase, or all of it if it is shorter."""
    return slice(max(phase.first, phase.last - round(SETTLED / dt)), phase.last)


def slip_margin(normal: FloatArray, tangent: FloatArray, friction: float) -> FloatArray:
    """What is left of the friction cone, per finger: ``1 - |f_t| / (mu f_n)``; 1 is untouched, 0 slips.

    ``normal`` and ``tangent`` (..., F) N. A finger without load has no margin to lose and counts as 1.
    """
    limit = friction * normal
    return np.where(limit > 0.0, 1.0 - tangent / np.where(limit > 0.0, limit, 1.0), 1.0)


def was_held(relative: FloatArray, hand_contacts: npt.NDArray[Any], spans: Sequence[Phase]) -> bool:
    """Whether the object was still in the hand at the end.

    True if every phase of ``CARRIED`` came, with contact in each of its steps, and the pose of the object in the hand frame
    ``relative`` (T, 7) never got further than ``LOST_AT`` from where it was when the support had gone.
    """
    carried = [span for span in spans if span.name in CARRIED]
    if tuple(span.name for span in carried) != CARRIED:
        return False
    steps = slice(carried[0].first, carried[-1].last)
    distance, _ = moved(relative[steps])
    return bool(distance.max() < LOST_AT and hand_contacts[steps].min() > 0)


def summarise(columns: Columns, *, dt: float, mass: float, gravity: float, friction: float, stages: Sequence[str] = ()) -> dict[str, Any]:
    """Every figure of ``summary.json`` that follows from the recording.

    ``dt`` s, ``mass`` kg of the object, ``gravity`` m/s^2 (positive), ``friction`` of object against finger. Where the run
    did not get far enough for a figure, that figure is ``None``.
    """
    times, codes = columns["time"], columns["phase"]
    spans = phases(codes, times, dt)
    step_ms = 1e3 * columns["report/step_time"]
    converged = columns["report/converged"].astype(bool)
    residual = columns["report/residual"][converged]
    relative = pose_in(columns["hand/pose"], columns["object/pose"])
    steps = len(times)
    stage_ms = np.median(1e3 * columns["report/stage_times"], axis=0).tolist() if steps else []
    summary: dict[str, Any] = {
        "held": was_held(relative, columns["hand/contacts"].sum(axis=1), spans),
        "object_mass_kg": mass,
        "friction": friction,
        "drift_m_per_s": None,
        "spin_rad_per_s": None,
        "contacts": int(columns["report/contacts"].max(initial=0)),
        "residual_max": float(residual.max(initial=0.0)),
        "unconverged_steps": int((~converged).sum()),
        "indentation_max": float(columns["report/indentation"].max(initial=0.0)),
        "steps": steps,
        "dt_s": dt,
        "step_ms_median": float(np.median(step_ms)) if steps else None,
        "step_ms_p99": float(np.percentile(step_ms, 99)) if steps else None,
        "real_time_factor": float(1e3 * dt * steps / step_ms.sum()) if steps else None,
        "sweeps_median": float(np.median(columns["report/sweeps"])) if steps else None,
        "normal_force_n": None,
        "tangential_force_n": None,
        "slip_margin": None,
        "support_error": None,
        "overlap_max_m": None,
        "quarantined_steps": int((columns["report/quarantined"] > 0).sum()),
        "stage_ms_median": dict(zip(stages, stage_ms, strict=False)) if steps else None,
        "phases": [{"name": span.name, "start": round(span.start, 9), "end": round(span.end, 9)} for span in spans],
    }
    hold = next((span for span in spans if span.name == "hold"), None)
    if hold is None:
        return summary
    window = settled(hold, dt)
    summary["drift_m_per_s"], summary["spin_rad_per_s"] = creep(relative[window], dt)
    force = columns["hand/force_on_object"][window]
    normal, tangent = columns["hand/normal_force"][window], columns["hand/tangential_force"][window]
    summary["normal_force_n"] = [float(x) for x in normal.mean(axis=0)]
    summary["tangential_force_n"] = [float(x) for x in tangent.mean(axis=0)]
    summary["slip_margin"] = float(slip_margin(normal, tangent, friction).min())
    weight = mass * gravity
    if weight > 0.0:
        balance = np.abs(force[:, :, 2].sum(axis=1) - weight) / weight
        summary["support_error"] = float(balance.max())
    summary["overlap_max_m"] = float(columns["hand/overlap"][hold.first : hold.last].max())
    return summary
