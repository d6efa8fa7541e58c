"""The fields of a contact: one table, of which scenes, recordings and tables are made.

A new field is a row here, an attribute of ``ContactsState`` and a property of ``quasirigid.Contacts``; a test holds the three against each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from quasirigid.arrays.types import AnyArray


@dataclass(frozen=True)
class ContactField:
    """One field of a contact."""

    name: str
    """The attribute of ``ContactsState``, and of ``Contacts`` of the compiled module."""
    column: str
    """In the group ``contacts`` of a recording."""
    shape: tuple[int, ...]
    """Of one contact."""
    dtype: str
    """In memory."""
    stored: str
    """In a recording."""
    unit: str
    frame: str
    what: str
    exported: tuple[str, ...]
    """Columns of an exported table, one for each component, with units."""
    resolution: float = 0.0
    """To what a recording rounds it, see ``Column.resolution``."""
    labels: tuple[str, ...] = ()
    """Words for its numbers."""
    counts_bodies: bool = False
    """It counts bodies: those of the world in ``Contacts``, those of the model in scenes and recordings, with -1 for one that is not drawn."""
    since: int = 2
    """The version of the format of recordings in which it came."""
    missing: float | None = None
    """What stands for it in recordings that are older."""


STATUS = ("open", "stick", "slip")
"""What becomes of a contact, by its number."""
# Where contacts are is recorded to 30 nm, their gap to 0.06 nm: half of the resolution. The digits below are noise, which cannot be compressed.
CONTACT_FIELDS = (
    ContactField("points", "point", (3,), "f8", "f4", "m", "world", "", ("x_m", "y_m", "z_m"), resolution=2.0**-24),
    ContactField("normals", "normal", (3,), "f8", "f4", "1", "world", "from body b to body a", ("normal_x", "normal_y", "normal_z")),
    ContactField(
        "forces", "force", (3,), "f8", "f4", "N", "world", "on body a; body b gets the opposite",
        ("force_on_a_x_n", "force_on_a_y_n", "force_on_a_z_n"),
    ),
    ContactField(
        "reactions", "reaction", (3,), "f8", "f4", "N", "contact", "normal, tangent1, tangent2",
        ("normal_force_n", "tangent1_force_n", "tangent2_force_n"),
    ),
    ContactField("gaps", "gap", (), "f8", "f4", "m", "contact", "> 0 is apart", ("gap_m",), resolution=2.0**-33),
    ContactField("pressures", "pressure", (), "f8", "f4", "Pa", "-", "", ("pressure_pa",)),
    ContactField("areas", "area", (), "f8", "f4", "m^2", "-", "", ("area_m2",)),
    ContactField("status", "status", (), "u1", "u1", "1", "-", "0 open, 1 stick, 2 slip", ("status",), labels=STATUS),
    ContactField("body_a", "body_a", (), "i8", "i2", "1", "-", "whose control point it is", ("body_a",), counts_bodies=True),
    ContactField(
        "control_point", "control_point", (), "i8", "u4", "1", "-",
        "which control point of body a: row of model/<body a>/control_points", ("control_point",), since=3, missing=-1,
    ),
    ContactField("body_b", "body_b", (), "i8", "i2", "1", "-", "the other body", ("body_b",), counts_bodies=True),
)  # fmt: skip
EXPORTED_FIRST = ("body_a", "body_b", "control_point", "status")
"""Fields with which the lines of an exported table begin; the others follow in the order of the table above."""


def contact_arrays(rows: dict[str, AnyArray], count: int) -> dict[str, AnyArray]:
    """The arrays of ``ContactsState`` from the ``rows`` of ``count`` contacts in a recording, by their columns."""
    return {
        field.name: rows[field.column].astype(field.dtype)
        if field.column in rows or field.missing is None
        else np.full(count, field.missing, dtype=field.dtype)
        for field in CONTACT_FIELDS
    }


def no_contacts() -> dict[str, Any]:
    """The arrays of ``ContactsState`` where nothing touches."""
    return {field.name: np.zeros((0, *field.shape), dtype=field.dtype) for field in CONTACT_FIELDS}
