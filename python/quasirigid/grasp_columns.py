"""What a grasp records in every step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from quasirigid._quasirigid import STAGES, Body, Contacts, Hand
from quasirigid.recording import Column
from quasirigid.summary import PHASES, FloatArray


def columns(fingers: tuple[str, ...], joints: int) -> list[Column]:
    """The columns of a grasp's recording."""
    F, bodies = len(fingers), ("object", "support", "hand")
    return [
        Column("bodies/pose", (3, 7), unit="m, 1", frame="world", what="x y z of the body frame, quaternion w x y z", labels=bodies),
        Column("object/velocity", (6,), unit="m/s, rad/s", frame="world", what="of the centre of mass; angular"),
        Column("hand/joint_positions", (F, joints), unit="rad", frame="joint", labels=fingers),
        Column("hand/joint_targets", (F, joints), unit="rad", frame="joint", labels=fingers),
        Column("hand/joint_torques", (F, joints), unit="N m", frame="joint", what="of the motors", labels=fingers),
        Column("hand/force_on_object", (F, 3), unit="N", frame="world", what="sum over the contacts of a finger", labels=fingers),
        Column("hand/normal_force", (F,), unit="N", frame="contact", what="sum of the normal reactions of a finger", labels=fingers),
        Column("hand/tangential_force", (F,), unit="N", what="length of the summed friction of a finger", labels=fingers),
        Column("hand/contacts", (F,), "i4", what="loaded contacts of a finger with the object", labels=fingers),
        Column("hand/overlap", unit="m", what="deepest overlap left at a finger's contact with the object"),
        Column("contacts/point", (3,), "f4", "m", "world", ragged=True),
        Column("contacts/normal", (3,), "f4", "1", "world", "into the object", ragged=True),
        Column("contacts/force", (3,), "f4", "N", "world", "on the object", ragged=True),
        Column("contacts/reaction", (3,), "f4", "N", "contact", "normal, tangent1, tangent2", ragged=True),
        Column("contacts/gap", (), "f4", "m", "contact", "> 0 is apart", ragged=True),
        Column("contacts/pressure", (), "f4", "Pa", ragged=True),
        Column("contacts/area", (), "f4", "m^2", ragged=True),
        Column("contacts/status", (), "u1", what="0 open, 1 stick, 2 slip", ragged=True, labels=("open", "stick", "slip")),
        Column("contacts/finger", (), "i1", what="finger that touches the object, -1 for anything else", ragged=True),
        Column("report/contacts", (), "i4", what="contacts in the problem, open ones included"),
        Column("report/sweeps", (), "i4", what="Gauss-Seidel sweeps"),
        Column("report/residual", what="natural-map residual of the reactions"),
        Column("report/converged", (), "u1"),
        Column("report/coarse", (), "u1", what="1 if the traversal budget ran out"),
        Column("report/quarantined", (), "i4", what="bodies set aside in this step"),
        Column("report/step_time", unit="s", what="computing time of the step"),
        Column("report/stage_times", (len(STAGES),), unit="s", what="computing time of the stages", labels=STAGES),
        Column("phase", (), "u1", labels=PHASES),
        Column("time", unit="s", what="simulated time at the end of the step"),
    ]


SCENE_POINTS = 20_000
"""Most points of the object that the picture of the scene is given."""


def scene_columns(fingers: tuple[str, ...], joints: int, object_points: int, tip_points: int) -> list[Column]:
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
        Column("scene/step", (), "i8", what="step of the recording that was drawn, from 0", still=True),
    ]


def scene_rows(thing: Body, hand: Hand, semi_axes: FloatArray, step: int) -> dict[str, Any]:
    """The stills of ``scene_columns`` as the world is now, after the recorded ``step``."""
    points, normals = thing.deformed_points(), thing.deformed_normals()
    chosen = np.linspace(0, len(points) - 1, min(len(points), SCENE_POINTS)).round().astype(int)
    fingers = range(hand.finger_count)
    return {
        "scene/object/points": points[chosen],
        "scene/object/normals": normals[chosen],
        "scene/object/centre_of_mass": thing.centre_of_mass,
        "scene/tips/points": np.stack([hand.deformed_points(f) for f in fingers]),
        "scene/tips/normals": np.stack([hand.deformed_normals(f) for f in fingers]),
        "scene/tips/pose": np.concatenate(hand.tip_poses(), axis=1),
        "scene/tips/semi_axes": semi_axes,
        "scene/hand/pose": np.concatenate([hand.position, hand.quaternion]),
        "scene/hand/link_poses": hand.link_poses,
        "scene/step": step,
    }


def contact_rows(contacts: Contacts, thing: int, finger_of: Mapping[int, int], fingers: int) -> dict[str, Any]:
    """The contact columns of one step, and their sums per finger.

    ``thing`` is the index of the object's body, ``finger_of`` gives the finger of a finger's body, ``fingers`` their number.
    The engine's normals and forces are those of body a; here both are seen from the object: force on it, normal into it.
    """
    a, b = contacts.body_a, contacts.body_b
    on_a = a == thing
    finger = np.full(len(a), -1, dtype=np.int8)
    for body, f in finger_of.items():
        finger[((a == body) & (b == thing)) | (on_a & (b == body))] = f
    sign = np.where(on_a, 1.0, -1.0)[:, None]
    force, normal = sign * contacts.forces, sign * contacts.normals
    reaction, gap = contacts.reactions, contacts.gaps
    touching = finger >= 0
    mine, press = finger[touching], reaction[touching, 0]
    totals, pressing = np.zeros((fingers, 3)), np.zeros((fingers, 3))
    np.add.at(totals, mine, force[touching])
    np.add.at(pressing, mine, press[:, None] * normal[touching])
    return {
        "hand/force_on_object": totals,
        "hand/normal_force": np.bincount(mine, press, fingers),
        "hand/tangential_force": np.linalg.norm(totals - pressing, axis=1),
        "hand/contacts": np.bincount(mine[press > 0.0], minlength=fingers),
        "hand/overlap": max(0.0, -float(gap[touching].min(initial=0.0))),
        "contacts/point": contacts.points,
        "contacts/normal": normal,
        "contacts/force": force,
        "contacts/reaction": reaction,
        "contacts/gap": gap,
        "contacts/pressure": contacts.pressures,
        "contacts/area": contacts.areas,
        "contacts/status": contacts.status,
        "contacts/finger": finger,
    }
