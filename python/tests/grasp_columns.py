"""A made-up grasp with known figures: what the summary and the plots are tried on."""

from typing import Any

import numpy as np

from quasirigid.grasp.summary import PHASES

DT, MASS, GRAVITY, FRICTION, SQUEEZE = 1e-3, 0.2, 9.81, 0.8, 4.0
STEPS = {"close": 400, "squeeze": 300, "support away": 300, "hold": 2000, "lift": 800, "shake": 1000, "hold again": 1000}
STEPS |= {"put down": 800, "release": 400}


def smooth(x: Any) -> Any:
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


def made_up_grasp(*, drift: float = 0.0, spin: float = 0.0, fall: bool = False) -> dict[str, Any]:
    """Columns of a run in which the object moves at ``drift`` (m/s) along the hand's y and turns at ``spin`` (rad/s)."""
    steps = dict(list(STEPS.items())[:4]) | {"fall": 100} if fall else STEPS
    codes = np.concatenate([np.full(n, PHASES.index(name), "u1") for name, n in steps.items()])
    T = len(codes)
    time = DT * np.arange(1, T + 1)
    hand, thing, support = np.zeros((T, 7)), np.zeros((T, 7)), np.zeros((T, 7))
    start = {name: sum(list(steps.values())[:i]) * DT for i, name in enumerate(steps)}
    t = time
    up = 0.05 * smooth((t - start["lift"]) / 0.8) if not fall else np.zeros(T)
    if not fall:
        up = up - 0.05 * smooth((t - start["put down"]) / 0.8)
    s = np.clip(t - start.get("shake", 1e9), 0.0, 1.0)
    hand[:, 0] = 0.01 * np.sin(2 * np.pi * 3 * s) * np.sin(np.pi * s)
    hand[:, 2], hand[:, 3] = 0.125 + up, 1.0
    hand[:, 4] = 0.0
    thing[:, 0], thing[:, 2] = hand[:, 0], 0.04 + up - 1.2e-4 * smooth((t - start["support away"]) / 0.1)
    since = np.clip(t - start["hold"], 0.0, None)
    thing[:, 1] = drift * since
    angle = spin * since
    thing[:, 3], thing[:, 6] = np.cos(angle / 2), np.sin(angle / 2)
    if fall:
        thing[:, 2] -= 0.5 * GRAVITY * np.clip(t - start["fall"] + 0.5, 0.0, None) ** 2
    support[:, 2], support[:, 3] = -0.06 * smooth((t - start["support away"]) / 0.3), 1.0

    load = smooth((t - 0.3) / 0.3) * (1 - smooth((t - start.get("release", 1e9)) / 0.2))
    normal = SQUEEZE * load[:, None] * np.array([1.0, 0.5, 0.5])
    carried = smooth((t - start["support away"]) / 0.1) * (1 - smooth((t - start.get("put down", 1e9) - 0.7) / 0.1))
    lifted = MASS * (GRAVITY + np.gradient(np.gradient(up, DT), DT)) * carried
    share = np.array([0.5, 0.25, 0.25])
    force = np.zeros((T, 3, 3))
    force[:, :, 2] = lifted[:, None] * share
    force[:, :, 0] = normal * np.array([1.0, -1.0, -1.0])
    count = np.where(load[:, None] > 0.01, np.array([60, 48, 52]), 0)
    rng = np.random.default_rng(1)
    return {
        "time": time,
        "phase": codes,
        "object/pose": thing,
        "hand/pose": hand,
        "hand/force_on_object": force,
        "hand/normal_force": normal,
        "hand/tangential_force": np.abs(force[:, :, 2]),
        "hand/contacts": count,
        "hand/overlap": np.full(T, 2e-6),
        "report/contacts": count.sum(axis=1),
        "report/residual": np.full(T, 4e-9),
        "report/converged": np.ones(T, "u1"),
        "report/indentation": np.zeros(T),
        "report/sweeps": np.full(T, 3),
        "report/quarantined": np.zeros(T, int),
        "report/step_time": 3e-4 + 5e-5 * rng.random(T),
        "report/stage_times": np.full((T, 5), 6e-5),
    }


def pad_patch(finger: int, *, slipping: bool = False) -> dict[str, np.ndarray]:
    """The contact rows of one pressed pad, with a Hertz-like pressure: the thumb at x = -30 mm, two fingers at x = +30 mm."""
    axis = np.arange(-5.5, 5.6, 0.85)
    y, z = (1e-3 * a.ravel() for a in np.meshgrid(axis, axis))
    inside = np.hypot(y, z) < 5e-3
    y, z = y[inside], z[inside]
    side, centre = (1.0, 0.0) if finger == 0 else (-1.0, (0.0125, -0.0125)[finger - 1])
    n = len(y)
    total = SQUEEZE * (1.0 if finger == 0 else 0.5)
    bump = np.sqrt(np.clip(1 - (y**2 + z**2) / 5e-3**2, 0, None))
    fn = total * bump / bump.sum()
    area = np.full(n, (0.85e-3) ** 2)
    force = np.zeros((n, 3))
    force[:, 0] = side * fn
    force[:, 2] = MASS * GRAVITY * (0.5 if finger == 0 else 0.25) * bump / bump.sum()
    status = np.full(n, 1, "u1")
    edge = np.hypot(y, z) > (0.0 if slipping else 4.2e-3)
    force[edge, 2] = FRICTION * fn[edge]
    status[edge] = 2
    return {
        "point": np.column_stack([np.full(n, -side * 0.03), y + centre, z + 0.04]),
        "normal": np.tile([side, 0.0, 0.0], (n, 1)),
        "force": force,
        "gap": np.zeros(n),
        "pressure": fn / area,
        "area": area,
        "status": status,
        "finger": np.full(n, finger, "i1"),
    }
