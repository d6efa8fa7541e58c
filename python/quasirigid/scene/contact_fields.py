"""The fields of a contact: one table, of which scenes, recordings and tables are made.

A new field is a row here, a getter of ``quasirigid.Contacts`` and, if it is recorded, an attribute of ``ContactsState``; a test holds the
binding, its stubs, scenes and recordings against the table.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from quasirigid.arrays.types import AnyArray


@dataclass(frozen=True)
class ContactField:
    """One field of a contact."""

    name: str
    """The attribute of ``Contacts`` of the compiled module, and of ``ContactsState``."""
    shape: tuple[int, ...]
    """Of one contact."""
    dtype: str
    """In memory. What counts from 0 is signed in scenes, where -1 stands for none, and ``u4`` in ``Contacts``."""
    unit: str
    frame: str
    what: str
    column: str = ""
    """In the group ``contacts`` of a recording; empty: neither scenes nor recordings have it."""
    stored: str = ""
    """Its type in a recording."""
    exported: tuple[str, ...] = ()
    """Columns of an exported table, one for each component, with units."""
    resolution: float = 0.0
    """To what a recording rounds it, see ``Column.resolution``."""
    labels: tuple[str, ...] = ()
    """Words for its numbers."""
    counts: Literal["", "body", "collider"] = ""
    """What it counts: bodies by ``Body.index`` or colliders by ``Collider.id`` in ``Contacts``; in scenes and recordings the views of the
    model, with -1 for what is not drawn."""
    since: int = 2
    """The version of the format of recordings in which it came."""
    missing: int | str | None = None
    """What stands for it in recordings that are older: a number, or the column of another field."""

    @property
    def docstring(self) -> str:
        """What the stubs of ``Contacts`` say of it."""
        shape = f"(n, {', '.join(map(str, self.shape))})" if self.shape else "(n,)"
        counted = {"": "", "body": "index of a body", "collider": "``Collider.id``"}[self.counts]
        of = ", ".join(
            word
            for word in (self.unit.replace("1", ""), {"-": "", "contact": "contact frame"}.get(self.frame, self.frame), counted)
            if word
        )
        return f"{shape} {of}: {self.what}." if of else f"{shape} {self.what}."


STATUS = ("open", "stick", "slip")
"""What becomes of a contact, by its number."""
# Where contacts are is recorded to 30 nm, their gap to 0.06 nm: half of the resolution. The digits below are noise, which cannot be
# compressed.
CONTACT_FIELDS = (
    ContactField(
        "points", (3,), "f8", "m", "world", "the control point, where the reaction acts, at the start of the step",
        "point", "f4", ("x_m", "y_m", "z_m"), resolution=2.0**-24,
    ),
    ContactField(
        "normals", (3,), "f8", "1", "world", "unit normal from body b to body a; a positive normal force pushes body a along it",
        "normal", "f4", ("normal_x", "normal_y", "normal_z"),
    ),
    ContactField("frames", (3, 3), "f8", "1", "world", "columns are (normal, tangent1, tangent2)"),
    ContactField(
        "forces", (3,), "f8", "N", "world", "on body a; body b gets the opposite",
        "force", "f4", ("force_on_a_x_n", "force_on_a_y_n", "force_on_a_z_n"),
    ),
    ContactField(
        "reactions", (3,), "f8", "N", "contact", "normal, tangent1, tangent2",
        "reaction", "f4", ("normal_force_n", "tangent1_force_n", "tangent2_force_n"),
    ),
    ContactField("gaps", (), "f8", "m", "contact", "after the step; > 0 is apart", "gap", "f4", ("gap_m",), resolution=2.0**-33),
    ContactField("pressures", (), "f8", "Pa", "-", "normal force over area", "pressure", "f4", ("pressure_pa",)),
    ContactField("areas", (), "f8", "m^2", "-", "of the control point", "area", "f4", ("area_m2",)),
    ContactField(
        "friction", (), "f8", "1", "-",
        "friction coefficient, along tangent1. Falls with slip speed if the pair's kinetic coefficient is lower",
    ),
    ContactField(
        "friction_ratio", (), "f8", "1", "-",
        "friction coefficient along tangent2 over that along tangent1: 1 unless friction has a direction",
    ),
    ContactField(
        "status", (), "u1", "1", "-", "0 open, 1 stick, 2 slip, as ``ContactStatus``", "status", "u1", ("status",), labels=STATUS
    ),
    ContactField(
        "body_a", (), "i8", "1", "-", "the body whose control point it is", "body_a", "i2", ("body_a",), counts="body"
    ),
    ContactField("link_a", (), "i8", "1", "-", "link of body a that carries the control point, from 0; 0 for a rigid body"),
    ContactField(
        "collider_a", (), "i8", "1", "-",
        "the surface whose control point it is; unlike ``body_a`` it does not change when a body is removed",
        "collider_a", "i2", ("collider_a",), counts="collider", since=4, missing="body_a",
    ),
    ContactField(
        "control_point", (), "i8", "1", "-", "which control point of the surface of collider a it is",
        "control_point", "u4", ("control_point",), since=3, missing=-1,
    ),
    ContactField("body_b", (), "i8", "1", "-", "the other body", "body_b", "i2", ("body_b",), counts="body"),
    ContactField("link_b", (), "i8", "1", "-", "link of body b"),
    ContactField(
        "collider_b", (), "i8", "1", "-", "the other surface",
        "collider_b", "i2", ("collider_b",), counts="collider", since=4, missing="body_b",
    ),
)  # fmt: skip
RECORDED_FIELDS = tuple(field for field in CONTACT_FIELDS if field.column)
"""Those of scenes and recordings."""
FIELD_OF = {field.name: field for field in CONTACT_FIELDS}
"""The fields by their names."""
EXPORTED_FIRST = ("body_a", "body_b", "collider_a", "collider_b", "control_point", "status")
"""Fields with which the lines of an exported table begin; the others follow in the order of the table above."""


def recorded_values(field: ContactField, columns: Container[str], read: Callable[[str], AnyArray], count: int) -> AnyArray:
    """The values of a field for ``count`` contacts in a recording that has these ``columns`` of the group ``contacts``; ``read`` gives the
    values of one of them.
    """
    if field.column not in columns:
        if isinstance(field.missing, int):
            return np.full(count, field.missing, dtype=field.dtype)
        if field.missing is not None:
            return read(field.missing).astype(field.dtype)
    values = read(field.column)
    return values.astype(field.dtype) if values.dtype.kind in "iu" else values


def contact_arrays(rows: Mapping[str, AnyArray], count: int) -> dict[str, AnyArray]:
    """The arrays of ``ContactsState`` from the ``rows`` of ``count`` contacts in a recording, by their columns."""
    return {field.name: recorded_values(field, rows, rows.__getitem__, count).astype(field.dtype, copy=False) for field in RECORDED_FIELDS}


def no_contacts() -> dict[str, Any]:
    """The arrays of ``ContactsState`` where nothing touches."""
    return {field.name: np.zeros((0, *field.shape), dtype=field.dtype) for field in RECORDED_FIELDS}
