"""What a grasp records in every step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from quasirigid._quasirigid import STAGES, Contacts
from quasirigid.recording import Column
from quasirigid.summary import PHASES


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
