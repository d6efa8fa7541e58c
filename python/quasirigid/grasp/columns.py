"""What a grasp records in every step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import Body, Hand
from quasirigid.arrays.types import FloatArray
from quasirigid.grasp.summary import PHASES
from quasirigid.recording.file import damaged
from quasirigid.recording.reader import Column, Recording
from quasirigid.recording.scene_columns import check_scene
from quasirigid.recording.scene_model import described_scene, read_model
from quasirigid.recording.schema import ANY, check_columns
from quasirigid.scene.model import ContactsState

IntArray = npt.NDArray[np.integer]


def columns(fingers: tuple[str, ...], joints: int) -> list[Column]:
    """The columns of a grasp's recording beyond those of any scene (``scene_recording.scene_columns``)."""
    F = len(fingers)
    return [
        Column("object/pose", (7,), unit="m, 1", frame="world", what="x y z of the body frame, quaternion w x y z"),
        Column("object/velocity", (6,), unit="m/s, rad/s", frame="world", what="of the centre of mass; angular"),
        Column("hand/pose", (7,), unit="m, 1", frame="world", what="x y z of the palm, quaternion w x y z"),
        Column("hand/joint_targets", (F, joints), unit="rad", frame="joint", labels=fingers),
        Column("hand/joint_torques", (F, joints), unit="N m", frame="joint", what="of the motors", labels=fingers),
        Column("hand/force_on_object", (F, 3), unit="N", frame="world", what="sum over the contacts of a finger", labels=fingers),
        Column("hand/normal_force", (F,), unit="N", frame="contact", what="sum of the normal reactions of a finger", labels=fingers),
        Column("hand/tangential_force", (F,), unit="N", what="length of the summed friction of a finger", labels=fingers),
        Column("hand/contacts", (F,), "i4", what="loaded contacts of a finger with the object", labels=fingers),
        Column("hand/overlap", unit="m", what="deepest overlap left at a finger's contact with the object"),
        Column("phase", (), "u1", labels=PHASES, values=(0, len(PHASES) - 1)),
    ]


SCENE_POINTS = 20_000
"""Most points of the object that the picture of the scene is given."""


def still_columns(fingers: tuple[str, ...], joints: int, object_points: int, tip_points: int) -> list[Column]:
    """The stills of a grasp's recording: what stands where at the end of the first hold, enough to draw it again."""
    F, n, m = len(fingers), min(object_points, SCENE_POINTS), tip_points
    deformed = "of the surface as deformed"
    return [
        Column("scene/object/points", (n, 3), "f4", "m", "world", f"{deformed}, an even choice of them", still=True),
        Column("scene/object/normals", (n, 3), "f4", "1", "world", "outward", still=True),
        Column("scene/object/centre_of_mass", (3,), unit="m", frame="world", still=True),
        Column("scene/tips/points", (F, m, 3), "f4", "m", "world", deformed, still=True, labels=fingers),
        Column("scene/tips/normals", (F, m, 3), "f4", "1", "world", "outward", still=True, labels=fingers),
        Column("scene/tips/pose", (F, 7), unit="m, 1", frame="world", what="middle of the pad, +z outwards", still=True, labels=fingers),
        Column("scene/tips/semi_axes", (3,), unit="m", frame="pad", what="of the pad's ellipsoid", still=True),
        Column("scene/hand/pose", (7,), unit="m, 1", frame="world", what="x y z of the palm, quaternion w x y z", still=True),
        Column("scene/hand/link_poses", (F, joints, 7), unit="m, 1", frame="world", what="link frames", still=True, labels=fingers),
        Column("scene/step", (), "i8", what="step of the recording that was drawn, from 0", still=True, values=(0, 2**62)),
    ]


def still_rows(body: Body, hand: Hand, semi_axes: FloatArray, step: int) -> dict[str, Any]:
    """The stills of ``still_columns`` as the world is now, after the recorded ``step``."""
    points, normals = body.deformed_points(), body.deformed_normals()
    chosen = np.linspace(0, len(points) - 1, min(len(points), SCENE_POINTS)).round().astype(int)
    fingers = range(hand.finger_count)
    return {
        "scene/object/points": points[chosen],
        "scene/object/normals": normals[chosen],
        "scene/object/centre_of_mass": body.centre_of_mass,
        "scene/tips/points": np.stack([hand.deformed_points(f) for f in fingers]),
        "scene/tips/normals": np.stack([hand.deformed_normals(f) for f in fingers]),
        "scene/tips/pose": np.concatenate(hand.tip_poses(), axis=1),
        "scene/tips/semi_axes": semi_axes,
        "scene/hand/pose": np.concatenate([hand.position, hand.quaternion]),
        "scene/hand/link_poses": hand.link_poses,
        "scene/step": step,
    }


def check_grasp(recording: Recording) -> None:
    """See to it that a recording holds the columns of a grasp, as they are described here, and the attributes that its pictures need.

    Raises ``RecordingError``, which names the column, what was expected and what came.
    """
    model = read_model(recording, shapes=False)
    check_scene(recording, model)
    fingers = model.fingers
    labels = tuple(recording.labels("hand/force_on_object")) if "hand/force_on_object" in recording.names else fingers
    if len(labels) != len(fingers):
        raise damaged(recording.path, "labels of column hand/force_on_object", f"{len(fingers)} fingers", ", ".join(labels) or "none")
    check_columns(recording, columns(labels, ANY) + still_columns(labels, ANY, ANY, ANY))
    for pair in (("scene/object/points", "scene/object/normals"), ("scene/tips/points", "scene/tips/normals")):
        first, second = (recording.column(name).shape for name in pair)
        if first != second:
            raise damaged(recording.path, f"column {pair[1]}", f"the shape of {pair[0]}, {first}", second)
    for name in ("dt", "object_mass_kg", "gravity_m_per_s2", "friction", "squeeze_n"):
        value = recording.attributes.get(name)
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise damaged(recording.path, f"attribute {name}", "a finite number", "nothing" if value is None else value)
    if not isinstance(recording.attributes.get("object"), str):
        raise damaged(recording.path, "attribute object", "the name of the object", recording.attributes.get("object"))


def contacts_on_object(recording: Recording, step: int) -> dict[str, Any]:
    """The contacts of a step as the object feels them: ``force`` on it, ``normal`` into it, and ``finger``: the one that
    touches it, or -1.
    """
    bodies = described_scene(recording)["bodies"]
    object_index = next((i for i, body in enumerate(bodies) if body["kind"] == "object"), -1)
    if object_index < 0:
        raise damaged(recording.path, "attribute scene", "a body that is an object", "none")
    tips = {i: body["finger"] for i, body in enumerate(bodies) if body["kind"] == "fingertip"}
    rows = recording.rows("contacts", step)
    finger, sign = _seen_from(rows["body_a"], rows["body_b"], object_index, tips)
    return {**rows, "finger": finger, "force": sign[:, None] * rows["force"], "normal": sign[:, None] * rows["normal"]}


def _seen_from(a: IntArray, b: IntArray, object_index: int, finger_of: Mapping[int, int]) -> tuple[IntArray, FloatArray]:
    """Which finger touches the object in each contact of bodies ``a`` and ``b`` (-1: none), and the sign that turns
    what acts on body a into what acts on the object.
    """
    finger = np.full(len(a), -1, dtype=np.int8)
    for body, f in finger_of.items():
        finger[((a == body) & (b == object_index)) | ((a == object_index) & (b == body))] = f
    return finger, np.where(a == object_index, 1.0, -1.0)


def contact_sums(contacts: ContactsState, object_index: int, finger_of: Mapping[int, int], fingers: int) -> dict[str, Any]:
    """What the fingers do to the object in one step: the sums over their contacts with it.

    ``object_index`` is the index of the object in the scene, ``finger_of`` the finger of each fingertip's index,
    ``fingers`` their number.
    """
    finger, sign = _seen_from(contacts.body_a, contacts.body_b, object_index, finger_of)
    touching = finger >= 0
    sign = sign[touching, None]
    force, normal = sign * contacts.forces[touching], sign * contacts.normals[touching]
    mine, press = finger[touching], contacts.reactions[touching, 0]
    totals, pressing = np.zeros((fingers, 3)), np.zeros((fingers, 3))
    np.add.at(totals, mine, force)
    np.add.at(pressing, mine, press[:, None] * normal)
    return {
        "hand/force_on_object": totals,
        "hand/normal_force": np.bincount(mine, press, fingers),
        "hand/tangential_force": np.linalg.norm(totals - pressing, axis=1),
        "hand/contacts": np.bincount(mine[press > 0.0], minlength=fingers),
        "hand/overlap": max(0.0, -float(contacts.gaps[touching].min(initial=0.0))),
    }
