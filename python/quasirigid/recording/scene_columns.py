"""The columns that every recorded scene has: one table, that writers write and readers demand."""

from __future__ import annotations

from dataclasses import replace

from quasirigid._quasirigid import STAGES
from quasirigid.recording.file import damaged
from quasirigid.recording.reader import Column, Recording
from quasirigid.recording.schema import ANY, check_columns
from quasirigid.scene.contact_fields import RECORDED_FIELDS, ContactField
from quasirigid.scene.model import SceneModel

MOVED_RESOLUTION = 2.0**-30
"""Deformation is recorded to 0.5 nm: half of this, m. The digits below are noise, which cannot be compressed and would be a third of a
recording.
"""
PHASE_BYTES = 64
"""Longest name of a phase, in UTF-8."""
PHASE_CODES = Column("phase", (), "u1")
"""What the column ``phase`` may be too: a number, with a label for each."""
SINCE: dict[str, int] = {
    **{f"contacts/{field.column}": field.since for field in RECORDED_FIELDS if field.since > 2},
    "report/indentation": 4,
}
"""The version of the format in which a column came, where that is not the first with a scene."""


COUNTED = "counted as in bodies/quarantined"
"""How bodies and colliders are counted."""


def contact_column(field: ContactField, bodies: int) -> Column:
    """The column of a field of a contact, in a scene of so many ``bodies``."""
    what, values = field.what, (0, len(field.labels) - 1) if field.labels else None
    if field.counts:
        what, values = f"{what}; {COUNTED}, -1 for a {field.counts} that is not drawn", (-1, bodies - 1)
    name, resolution = f"contacts/{field.column}", field.resolution
    return Column(name, field.shape, field.stored, field.unit, field.frame, what, True, field.labels, resolution=resolution, values=values)


def scene_columns(model: SceneModel, joints: tuple[int, int]) -> list[Column]:
    """The columns that every recorded scene has; ``joints`` is the shape of ``SceneState.joint_positions``."""
    B, F = len(model.bodies), len(model.fingers)
    bodies, frames = tuple(body.name for body in model.bodies), tuple(dict.fromkeys(frames_of(model)))
    as_in = COUNTED
    what = "x y z and quaternion w x y z of the frames; the bodies that a frame carries are in the attribute scene of the file"
    return [
        Column("frames/pose", (len(frames), 7), unit="m, 1", frame="world", what=what, labels=frames),
        Column("bodies/quarantined", (B,), "u1", what="1 from when it became non-finite and was set aside", labels=bodies),
        *(contact_column(field, B) for field in RECORDED_FIELDS),
        Column("moved/body", (), "u2", what=f"whose surface point is displaced; {as_in}", ragged=True, values=(0, B - 1)),
        Column("moved/index", (), "u4", what="row of model/<body>/points", ragged=True),
        Column("moved/displacement", (3,), "f4", "m", "body", "from the point at rest", ragged=True, resolution=MOVED_RESOLUTION),
        Column("moved/step", (), "i8", what="the step whose rows of moved/ hold here: the last one written, -1 before the first"),
        Column("fingers/force", (F, 3), "f4", "N", "world", "of a fingertip on whatever it touches", labels=model.fingers),
        Column("fingers/normal_force", (F,), "f4", "N", "contact", "sum of the normal reactions of a fingertip", labels=model.fingers),
        Column(
            "hand/joint_positions", joints, unit="rad", frame="joint", what="NaN beyond the last joint of a finger", labels=model.fingers
        ),
        Column("report/contacts", (), "i4", what="contacts in the problem, open ones included"),
        Column("report/sweeps", (), "i4", what="Gauss-Seidel sweeps"),
        Column("report/residual", what="natural-map residual of the reactions"),
        Column("report/converged", (), "u1"),
        Column("report/coarse", (), "u1", what="1 if the traversal budget ran out"),
        Column("report/indentation", what="largest indentation of a patch over the thickness of its layer"),
        Column("report/quarantined", (), "i4", what="bodies set aside in this step"),
        Column("report/step_time", unit="s", what="computing time of the step"),
        Column("report/stage_times", (len(STAGES),), unit="s", what="computing time of the stages", labels=STAGES),
        Column("phase", (), f"S{PHASE_BYTES}", what="what is going on, UTF-8"),
        Column("time", unit="s", what="simulated time at the end of the step"),
    ]


def frames_of(model: SceneModel) -> list[str]:
    """The frame of every body: bodies that move as one share it, and their pose is written once."""
    return [body.frame or body.name for body in model.bodies]


def check_scene(recording: Recording, model: SceneModel) -> None:
    """See to it that a recording has the columns of its ``model``, as ``scene_columns`` has them.

    Raises ``RecordingError``, which names the column, what was expected and what came.
    """
    columns = {column.name: column for column in scene_columns(model, (ANY, ANY))}
    labels = tuple(recording.labels("phase")) if "phase" in recording.names else ()
    if labels:
        columns["phase"] = replace(PHASE_CODES, labels=labels, values=(0, len(labels) - 1))
    check_columns(recording, columns.values(), SINCE)
    joints = recording.column("hand/joint_positions").shape[0]
    if joints > len(model.fingers):
        raise damaged(recording.path, "column hand/joint_positions", f"those of {len(model.fingers)} fingers at most", f"those of {joints}")
