"""A box on a table that the tests of the module share."""

from typing import Any

import quasirigid as qr

BOX = (0.06, 0.06, 0.08)


def small_box() -> qr.Surface:
    return qr.Surface.box(BOX, points=600, control_points=80)


def resting_box(**options: Any) -> tuple[qr.World, qr.Body, qr.Body]:
    """A box of 0.2 kg on a rubber table."""
    world = qr.World(**options)
    rubber = qr.Material.preset("rubber")
    table = world.add_body(qr.Surface.half_space(0.2, points=900), rubber, motion="fixed", name="table")
    box = world.add_body(small_box(), rubber, mass=qr.MassProperties.box(BOX, mass=0.2), position=(0, 0, 0.04), name="box")
    return world, table, box


# --- shapes and figures ---------------------------------------------------------------------------------------------------
