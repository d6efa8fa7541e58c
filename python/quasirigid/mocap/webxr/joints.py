"""From the 25 joints of a WebXR hand to a ``HandFrame``.

WebXR (WebXR Hand Input Module, https://www.w3.org/TR/webxr-hand-input-1/): metres, y up. Every joint has -z along its bone towards the tip,
+y out of the back of the hand, +x to the right of both; same for both hands. A tip joint lies inside the fingertip, its radius below the
skin.

Ours (``HandFrame``): +x along the outstretched finger, +z out of the nail. So x = -z, y = -x, z = +y of the joint, which is also how the
room (y up, user looking along -z) maps to the world (z up, user looking along +x).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.mocap import HandFrame
from quasirigid.rotation import quaternion_of, quaternion_product

Side = Literal["left", "right"]

JOINTS = (
    "wrist",
    *(f"thumb-{part}" for part in ("metacarpal", "phalanx-proximal", "phalanx-distal", "tip")),
    *(
        f"{finger}-finger-{part}"
        for finger in ("index", "middle", "ring", "pinky")
        for part in ("metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip")
    ),
)
"""Names of the rows, in the order of the specification."""
WRIST = JOINTS.index("wrist")
TIPS = [i for i, name in enumerate(JOINTS) if name.endswith("tip")]
INDEX_KNUCKLE, MIDDLE_KNUCKLE, LITTLE_KNUCKLE = (
    JOINTS.index(f"{finger}-finger-phalanx-proximal") for finger in ("index", "middle", "pinky")
)
PAD_RADIUS = 0.008
"""For a device that gives no radius, m."""
FLAT = 0.01
"""Sine below which wrist and knuckles lie on one line, so that they do not say how the palm is turned."""
TURN = np.array([0.5, -0.5, 0.5, 0.5])
"""Rotation of our axes seen from those of WebXR, (w, x, y, z): columns (0, 0, -1), (-1, 0, 0), (0, 1, 0)."""


def hand_frame(side: Side, joints: FloatArray, *, time: float, arrival: float) -> HandFrame:
    """``joints`` (25, 8): position m, quaternion (x, y, z, w) as WebXR has it, radius m; rows of NaN are not tracked.

    The frame's poses are in the room of the headset (y up). Raises ``InvalidValueError`` for what is no pose.
    """
    seen = np.asarray(np.isfinite(joints[:, :7]).all(axis=1))
    positions, quaternions = np.full((6, 3), np.nan), np.full((6, 4), np.nan)
    radii = np.zeros(6)
    tracked = np.zeros(6, dtype=bool)
    tips = joints[TIPS]
    tracked[:5] = seen[TIPS]
    positions[:5] = tips[:, :3]
    quaternions[:5] = quaternion_product(tips[:, [6, 3, 4, 5]], TURN)
    radii[:5] = np.where(tips[:, 7] > 0.0, tips[:, 7], PAD_RADIUS)
    if seen[[WRIST, INDEX_KNUCKLE, MIDDLE_KNUCKLE, LITTLE_KNUCKLE]].all():
        turn = _palm_turn(side, joints[:, :3])
        if turn is not None:
            positions[5], quaternions[5], tracked[5] = joints[INDEX_KNUCKLE, :3], turn, True
    return HandFrame(side, positions, quaternions, radii, tracked.tolist(), time=time, arrival=arrival, source="webxr")


def _palm_turn(side: Side, places: FloatArray) -> FloatArray | None:
    """Quaternion of the palm frame: z normal to wrist, index and little knuckle, out of the back; x along the hand, wrist to middle
    knuckle.

    Knuckles and wrist move little against each other, whatever the fingers do; the orientation of a phalanx would bend with its finger.
    """
    wrist = places[WRIST]
    index, middle, little = (places[i] - wrist for i in (INDEX_KNUCKLE, MIDDLE_KNUCKLE, LITTLE_KNUCKLE))
    across = np.cross(little, index) if side == "right" else np.cross(index, little)
    size = float(np.linalg.norm(across))
    if size < FLAT * float(np.linalg.norm(index) * np.linalg.norm(little)) or size == 0.0:
        return None
    z = across / size
    along = middle - (middle @ z) * z
    length = float(np.linalg.norm(along))
    if length < FLAT * float(np.linalg.norm(middle)) or length == 0.0:
        return None
    x = along / length
    return quaternion_of(np.stack([x, np.cross(z, x), z], axis=1))
