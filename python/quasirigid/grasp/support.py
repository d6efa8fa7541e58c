"""What an object stands on: the pedestal of the experiment, and the table or the post of a scene that a person acts in."""

from __future__ import annotations

from dataclasses import dataclass

from quasirigid._quasirigid import Body, Material, Surface, World

PEDESTAL = (0.03, 0.03, 0.01)
"""Size of the experiment's pedestal, m."""
POST = (0.016, 0.016, 0.012)
"""Size of the post, m: narrow, so that few contacts carry the box."""
UNDER_OBJECTS = 0.4
"""Side of the plate on which the experiment puts an object from a file, m."""
TABLE = 0.3
"""Side of the table, m."""
TABLE_POINTS, TABLE_CONTROL_POINTS = 10_000, 1_600
"""Of the table's surface: control points 6 mm apart, closer than those of the box (``BOX_CONTROL_POINTS``), so that contacts lie at the
table's own control points, each with a compliance of its own. The other way round many contacts share a few, and the solver needs ten times
as long.
"""
BOX_CONTROL_POINTS = 400
"""Of the box on a table: 106 contacts carry it. With the 4,800 of the experiment it is 668, and no step ends in time."""
FOAM_MODULUS, FOAM_POISSON, FOAM_THICKNESS = 8e4, 0.3, 0.01
"""Young's modulus (Pa), Poisson's ratio and thickness (m) of the table's top: choice, a soft foam mat. The box sinks in by 50 µm. On
silicone a step of the standing box does not converge within 0.7 ms, on this it does within 0.15 ms."""
MAT = 0.6
"""Side of the soft mat on which things fall, m."""


def foam() -> Material:
    """What the top of the table is made of."""
    soft = Material.preset("silicone")
    return soft.replace(name="foam", young_modulus=FOAM_MODULUS, poisson_ratio=FOAM_POISSON, layer_thickness=FOAM_THICKNESS)


@dataclass(frozen=True)
class Support:
    """A surface with its material, and how far its frame and the floor lie below the object, m."""

    surface: Surface
    material: Material
    depth: float
    """From the object's lowest point down to the frame of ``surface``."""
    floor: float
    """From there down to what the support stands on."""

    def add_to(self, world: World) -> Body:
        """The fixed body of the support; the object's lowest point is at z = 0."""
        return world.add_body(self.surface, self.material, motion="fixed", position=(0.0, 0.0, -self.depth), name="support")

    def add_mat(self, world: World) -> Body:
        """The soft mat around the support, on which falls what misses it."""
        mat = Surface.half_space(MAT, points=2_500)
        return world.add_body(mat, Material.preset("silicone"), motion="fixed", position=(0.0, 0.0, -self.floor), name="mat")


def support_of(name: str | None, *, flat: bool) -> Support:
    """The support called ``name``, ``"table"`` or ``"post"``; ``None`` is that of the experiment, a pedestal.

    ``flat``: whether the object stands by itself on a pedestal or post. Any other object gets the table, or the experiment's wide plate.
    """
    if name == "table" or (name == "post" and not flat):
        surface = Surface.half_space(TABLE, points=TABLE_POINTS, control_points=TABLE_CONTROL_POINTS)
        return Support(surface, foam(), 0.0, 1e-3)
    rubber = Material.preset("rubber")
    if not flat:
        return Support(Surface.half_space(UNDER_OBJECTS, points=4_000), rubber, 0.0, 1e-3)
    size, material = (PEDESTAL, rubber) if name is None else (POST, Material.preset("silicone"))
    return Support(Surface.box(size, points=2_000), material, size[2] / 2, size[2])
