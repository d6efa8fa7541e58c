"""What is measured on every simulation, and how."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scene
from scene import Configuration, Simulation

Make = Callable[..., Simulation]

FALLEN = 0.03
"""m: the box has left the pads."""
SLIDING = 0.01
"""m/s: the box slips."""
RAMPS = (2.0, 0.3)
"""N/s, of the pull that makes it slip: up to 85 % of what Coulomb allows, and from there on."""
SLOW_FROM = 0.85
SPEED_WINDOW, FORCE_WINDOW = 0.02, 0.15
"""s, over which the speed is averaged when the box slips, and the squeeze before that."""
OFFSETS = (0.003, 0.01)
"""Of the centre of mass from the axis of two pads, m."""
SHAKE_FORCE, SHAKE_FREQUENCY = 1.0, 5.0
"""N and Hz, of the pull on the box while the cost of a step is taken in motion."""
COST_BLOCK = 50
"""Steps of one engine before it is another one's turn."""


@dataclass(frozen=True)
class Effort:
    """How long the measurements last."""

    hold: float = 60.0
    """s"""
    hold_costly: float = 60.0
    """The same for costly configurations, s."""
    twist: float = 5.0
    """s"""
    capsule: float = 5.0
    """s"""
    cost_rounds: int = 20


QUICK = Effort(hold=1.0, hold_costly=1.0, twist=0.5, capsule=1.0, cost_rounds=2)


def measure(make: Make, configuration: Configuration, effort: Effort) -> dict[str, Any]:
    """All figures of one configuration but for its cost."""
    return {
        "engine": configuration.engine,
        "name": configuration.name,
        "dt_ms": 1e3 * configuration.dt,
        **hold(make(configuration), configuration.dt, effort.hold_costly if configuration.costly else effort.hold),
        **slip(make(configuration), configuration.dt),
        "twist": [
            twist(make(configuration, 2, offset), configuration.dt, effort.twist) | {"offset_mm": 1e3 * offset} for offset in OFFSETS
        ],
        "pressure_field": configuration.pressure_field,
    }


def hold(simulation: Simulation, dt: float, seconds: float) -> dict[str, Any]:
    """Sink rate over the last five sixths of the hold (+ is down)."""
    heights = [simulation.height()]
    fell = None
    for k in range(round(seconds / dt)):
        simulation.step()
        heights.append(simulation.height())
        if heights[0] - heights[-1] > FALLEN:
            fell = (k + 1) * dt
            break
    since = len(heights) // 6
    return {
        "contacts": simulation.contacts(),
        "hold_s": seconds,
        "drift_m": heights[0] - heights[-1],
        "creep_m_per_s": (heights[since] - heights[-1]) / ((len(heights) - 1 - since) * dt),
        "fell_at_s": fell,
        "squeeze_n": simulation.squeeze(),
    }


def slip(simulation: Simulation, dt: float) -> dict[str, Any]:
    """Friction over twice the squeeze when the box slides at 10 mm/s under a growing pull; exactly mu if Coulomb holds.

    The squeeze is a mean from just before: point contacts that slide flicker between nothing and twice the force. The speed is a mean too. The pull overshoots the threshold while the box gathers
    speed: with the ramp's rate ``r``, ``m v' = r t`` gives ``sqrt(2 m v r)``, 0.5 % of the load, which is taken off.
    """
    window = max(round(SPEED_WINDOW / dt), 1)
    squeezes: deque[float] = deque(maxlen=2 * round(FORCE_WINDOW / dt))
    heights: deque[float] = deque([simulation.height()], maxlen=window + 1)
    capacity = 2.0 * scene.FRICTION * scene.SQUEEZE
    pull = 0.0
    while scene.WEIGHT + pull < 2.0 * capacity:
        ramp = RAMPS[scene.WEIGHT + pull > SLOW_FROM * capacity]
        pull += ramp * dt
        simulation.pull(pull)
        simulation.step()
        heights.append(simulation.height())
        squeezes.append(simulation.squeeze())
        speed = (heights[0] - heights[-1]) / (window * dt)
        if len(heights) > window and speed > SLIDING:
            overshoot = min(math.sqrt(2.0 * scene.BOX_MASS * speed * ramp), pull)
            ratio = (scene.WEIGHT + pull - overshoot) / (2.0 * float(np.mean(list(squeezes)[: (len(squeezes) + 1) // 2])))
            return {"slip_ratio": ratio, "slip_error": ratio / scene.FRICTION - 1.0, "slips_under_its_weight": pull < 0.05 * scene.WEIGHT}
    return {"slip_ratio": None, "slip_error": None, "slips_under_its_weight": False}


def twist(simulation: Simulation, dt: float, seconds: float) -> dict[str, Any]:
    """Angle of the box with its centre of mass off the axis of the pads, and how fast it turned in the last fifth of the time."""
    angles = [simulation.angle()]
    for _ in range(round(seconds / dt)):
        simulation.step()
        angles.append(simulation.angle())
    turned = np.degrees(np.unwrap(angles))
    last = max(round(seconds / 5.0 / dt), 1)
    return {
        "angle_deg": float(turned[-1]),
        "peak_deg": float(np.abs(turned).max()),
        "rate_deg_per_s": float(turned[-1] - turned[-1 - last]) / (last * dt),
    }


def cost(makes: Sequence[tuple[Make, Configuration]], rounds: int) -> list[dict[str, float]]:
    """CPU ms of a step, held at rest and shaken. The engines take turns, so that a busy machine is alike for all."""
    simulations = [make(configuration) for make, configuration in makes]
    out: list[dict[str, float]] = [{} for _ in makes]
    for key, force in (("cpu_ms", 0.0), ("cpu_shaken_ms", SHAKE_FORCE)):
        times: list[list[int]] = [[] for _ in makes]
        for turn in range(rounds):
            for simulation, (_, configuration), taken in zip(simulations, makes, times, strict=True):
                for k in range(COST_BLOCK):
                    seconds = (turn * COST_BLOCK + k + 1) * configuration.dt
                    simulation.pull(force * math.sin(2.0 * math.pi * SHAKE_FREQUENCY * seconds))
                    before = time.thread_time_ns()
                    simulation.step()
                    taken.append(time.thread_time_ns() - before)
        for figures, taken in zip(out, times, strict=True):
            figures[key] = 1e-6 * float(np.median(taken))
    return out


def capsule(simulation: Any, seconds: float) -> dict[str, float]:
    """Mean speed of the capsule downwards after a second of rest, and what it is held with."""
    simulation.run(1.0)
    start = simulation.height()
    simulation.run(seconds)
    weight = scene.CAPSULE_MASS * scene.GRAVITY
    squeeze = simulation.squeeze()
    return {
        "squeeze_n": squeeze,
        "margin": 2.0 * scene.CAPSULE_FRICTION * squeeze / weight,
        "drift_m_per_s": (start - simulation.height()) / seconds,
    }
