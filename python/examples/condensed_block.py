"""A finite-element block as the soft side of a contact: condense it to its surface, press a ball on it, compare with Hertz.

    python python/examples/condensed_block.py

A surface knows nothing of what lies below it but its compliance: how far each control point gives under a force at each. For a
finite-element model that is a part of the inverse of its stiffness matrix, which `quasirigid.pads.condense` works out from a mesh. Here it is a block of
bricks, clamped at the bottom; the control points are nodes of its top.

A block is stiffer than a half-space because it ends: by 6 % at 16 contact radii deep, 27 % at 4. In its middle that is a sinking that is missing everywhere alike.
A linear load case tells how much, without any contact; pressed as much deeper, the half-space model has the same force and the same pressures.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import quasirigid as qr

RADIUS = 0.05  # of the ball, m
DEPTH = 2e-4  # of the ball below first contact, m
CONTACT_RADIUS = float(np.sqrt(RADIUS * DEPTH))  # Hertz, m
FINE = 1.6 * CONTACT_RADIUS  # half the side of the piece of the top that is touched and finely meshed, m
STRETCH = 1.05  # of all along x: a tree that halves squares may halve them along a diagonal
YOUNG_MODULUS, POISSON_RATIO = 1e6, 0.3  # of the block
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Quarter:
    """The quarter x, y >= 0 of a block of bricks below z = 0: coordinates (m) of the planes of nodes along each axis, ascending; z ends at 0.

    The block is its own mirror image in x = 0 and in y = 0, which saves most of the work.
    """

    x: Array
    y: Array
    z: Array

    @classmethod
    def graded(cls, depth: float, steps: int) -> Quarter:
        """Of a block ``depth`` m deep and twice as wide: around the patch elements of ``FINE / steps`` m, half as high, then growing outwards by half."""
        element = FINE / steps
        out = _graded(depth, element, steps)
        return cls(STRETCH * out, out, -_graded(depth, element / 2, 2 * steps)[::-1])

    def points(self) -> Array:
        """(nodes, 3) m."""
        return np.stack([axis.ravel() for axis in np.meshgrid(self.x, self.y, self.z, indexing="ij")], axis=1)

    def bricks(self) -> npt.NDArray[np.intp]:
        """(bricks, 8) numbers of the nodes of every brick: around its lower face, and around its upper one."""
        number = np.arange(len(self.x) * len(self.y) * len(self.z)).reshape(len(self.x), len(self.y), len(self.z))
        ends = [slice(None, -1), slice(1, None)]
        around = [(0, 0), (1, 0), (1, 1), (0, 1)]
        return np.stack([number[ends[i], ends[j], k].ravel() for k in ends for i, j in around], axis=1)


def _graded(length: float, element: float, steps: int) -> Array:
    """Planes from 0 to ``length``: ``steps`` steps of one ``element``, then each half as long again as the last."""
    inner = element * np.arange(steps + 1)
    left = length - inner[-1]
    outer = [1.5 * element]
    while sum(outer) < left:
        outer.append(1.5 * outer[-1])
    return np.concatenate([inner, inner[-1] + np.cumsum(outer) * left / sum(outer)])


def condensed(block: Quarter, surface: qr.Surface, young_modulus: float, poisson_ratio: float) -> Array:
    """Compliance (3m, 3m) m/N of the top of a block, clamped at its bottom, over the m control points of a surface: they are nodes of the top.

    A force on a node is the pressure of its shape function: the surface sinks in by a finite amount, the finer the mesh the deeper, as under a smaller stamp.
    """
    points = block.points()
    return qr.pads.condense(
        points,
        block.bricks(),
        young_modulus=young_modulus,
        poisson_ratio=poisson_ratio,
        fixed=points[:, 2] == block.z[0],
        surface=surface,
        mirrors="xy",
        load="point",
    ).matrix


def top_surface(steps: int) -> qr.Surface:
    """The piece of the top that the ball may touch: a grid of ``(2 steps)^2`` control points, one for each node, and four surface points around each.

    ``steps`` is a power of two, so that the tree of the surface, which halves and halves again, ends at those four.
    """
    across = FINE / steps * (np.arange(4 * steps) / 2 - steps + 0.75)
    x, y = (axis.ravel() for axis in np.meshgrid(across, across, indexing="ij"))
    points = np.stack([STRETCH * x, y, 0 * x], axis=1)
    return qr.Surface.from_points(
        points, np.tile((0.0, 0.0, 1.0), (len(x), 1)), np.full(len(x), STRETCH * (FINE / steps / 2) ** 2), control_points=len(x) // 4
    )


def press(surface: qr.Surface, material: qr.Material, depth: float = DEPTH) -> qr.Contacts:
    """Presses a rigid ball ``depth`` (m) into a surface at z = 0 and returns the contacts."""
    world = qr.World(gravity=(0, 0, 0))
    hard = qr.Material.preset("steel").replace(young_modulus=1e13, friction=0.0, compliance="half-space")
    angle = np.linspace(0, 0.12, 25)[1:]
    ring = [np.linspace(0, 2 * np.pi, 6 * k, endpoint=False) for k in range(1, len(angle) + 1)]
    normals = np.concatenate(
        [
            [(0, 0, -1)],
            *[np.stack([np.sin(a) * np.cos(r), np.sin(a) * np.sin(r), -np.cos(a) + 0 * r], 1) for a, r in zip(angle, ring, strict=True)],
        ]
    )
    cap = qr.Surface.from_points(RADIUS * normals, normals, control_points=len(surface.control_points) // 3)
    ball = world.add_body(cap, hard, motion="fixed", position=(0, 0, RADIUS))
    block = world.add_body(surface, material.replace(friction=0.0), mass=qr.MassProperties.sphere(0.01, mass=1.0))
    block.set_drive((0, 0, 0), stiffness=(1e12, 1e10), damping=(0, 0))
    for share in (0.5, 1, 1):
        ball.move_to((0, 0, RADIUS - share * depth))
        report = world.step(2)
    if not report.converged:
        raise RuntimeError(f"the solver stopped at a residual of {report.residual:.1e}")
    return world.contacts()


def block_material() -> qr.Material:
    """Rubber with the figures of the block, answering at once."""
    return qr.Material.preset("rubber").replace(young_modulus=YOUNG_MODULUS, poisson_ratio=POISSON_RATIO, relaxation_time=0.0)


def force(contacts: qr.Contacts) -> float:
    """Force between ball and block, N."""
    return float(abs(contacts.forces[:, 2].sum()))


def pressures(contacts: qr.Contacts, surface: qr.Surface) -> Array:
    """Pressure at every control point of the surface, (m,) Pa; 0 where nothing touches."""
    found = np.zeros(len(surface.control_points))
    found[contacts.control_point] = contacts.pressures
    return found


def hertz_force(depth: float = DEPTH) -> float:
    """Force (N) of a rigid ball pressed into a half-space; Johnson, Contact Mechanics, section 4.2."""
    return float(4 / 3 * YOUNG_MODULUS / (1 - POISSON_RATIO**2) * np.sqrt(RADIUS) * depth**1.5)


def sinking(r: Array, a: float = CONTACT_RADIUS) -> Array:
    """How far a half-space sinks in (m) at the distances r (m) from the middle of a Hertz pressure of radius a (m) and 1 N; Johnson, equations 3.42a and b."""
    out = np.maximum(r, a)
    inside = np.pi / 2 * (2 * a**2 - r**2)
    outside = (2 * a**2 - r**2) * np.arcsin(a / out) + a * np.sqrt(out**2 - a**2)
    return np.asarray((1 - POISSON_RATIO**2) / (2 * a * YOUNG_MODULUS) * np.where(r <= a, inside, outside) * 3 / (2 * np.pi * a**2))


def held_back(compliance: Array, surface: qr.Surface) -> tuple[float, float]:
    """A block under a Hertz pressure of 1 N beside a half-space: linear, without any contact.

    A block that ends somewhere sinks in less, and in its middle by nearly the same everywhere: what is missing is made far from the load. Returns how much (m/N, mean
    over the load), and how far the shape of the dent in the inner three quarters of the load is off beside that, as a share of its depth.
    """
    r = np.hypot(surface.control_points[:, 0], surface.control_points[:, 1])
    side = np.sqrt(surface.control_areas[0] / STRETCH)
    within = side * ((np.arange(10) + 0.5) / 10 - 0.5)  # of the cell of a node
    x, y = (surface.control_points[:, axis, None] + np.outer(np.ones(len(r)), within * (STRETCH, 1)[axis]) for axis in (0, 1))
    load = np.sqrt(np.maximum(0, 1 - (x[:, :, None] ** 2 + y[:, None, :] ** 2) / CONTACT_RADIUS**2)).mean(axis=(1, 2))
    load /= load.sum()
    missing = sinking(r) - compliance[2::3, 2::3] @ load
    offset = float(load @ missing)
    return offset, float(abs(missing - offset)[r <= 0.75 * CONTACT_RADIUS].max() / sinking(np.zeros(1))[0])


@dataclass(frozen=True)
class Comparison:
    """A ball pressed into a block and into a half-space, on the same control points."""

    force: float
    """On the block, N."""
    held_back: float
    """What the ends of the block take off its compliance, m/N; see `held_back`."""
    dent: float
    """How far the shape of the dent under a given pressure is off, share of its depth."""
    half_space_force: float
    """N, of the half-space pressed deeper by what the ends of the block hold back."""
    radius: Array
    """(m,) m, of the control points from the middle."""
    pressure: Array
    """(m,) Pa on the block."""
    half_space_pressure: Array
    """(m,) Pa on the half-space pressed as much deeper."""

    @property
    def force_ratio(self) -> float:
        """Force on the block over that on the half-space pressed as much deeper."""
        return self.force / self.half_space_force

    @property
    def pressure_error(self) -> float:
        """Largest difference of the two pressures at a control point in the inner three quarters of the contact, share of the peak."""
        inner = self.radius <= 0.75 * CONTACT_RADIUS
        return float(abs(self.pressure - self.half_space_pressure)[inner].max() / self.half_space_pressure.max())


def compare(depth: float, steps: int = 8) -> Comparison:
    """Presses the ball into a block ``depth`` contact radii deep, and into the half-space model; ``steps`` bricks from the middle of the top to the border of what is touched."""
    surface, material = top_surface(steps), block_material()
    block = Quarter.graded(depth * CONTACT_RADIUS, steps)
    matrix = condensed(block, surface, YOUNG_MODULUS, POISSON_RATIO)
    offset, dent = held_back(matrix, surface)
    pressed = press(surface, material.replace(compliance=matrix))
    deeper = press(surface, material.replace(compliance="half-space"), DEPTH + offset * force(pressed))
    radius = np.hypot(surface.control_points[:, 0], surface.control_points[:, 1])
    return Comparison(force(pressed), offset, dent, force(deeper), radius, pressures(pressed, surface), pressures(deeper, surface))


def main() -> None:
    """Prints the force of blocks of several depths beside that of a half-space."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], epilog="example: python condensed_block.py --depths 8 --steps 4")
    parser.add_argument("--steps", type=int, default=8, choices=(4, 8, 16), help="bricks in 1.6 contact radii (8); 16 takes minutes")
    parser.add_argument("--depths", type=float, nargs="+", default=[4, 8, 16], help="of the blocks, contact radii (4 8 16)")
    options = parser.parse_args()
    print(
        f"a ball of {RADIUS * 1e3:g} mm pressed {DEPTH * 1e3:g} mm into blocks; contact radius {CONTACT_RADIUS * 1e3:.2f} mm, depths in contact radii"
    )
    print("depth  force of Hertz  held back by the ends  force of the half-space, pressed deeper  pressure off  dent off")
    for depth in options.depths:
        found = compare(depth, options.steps)
        off = found.held_back * found.force / DEPTH
        print(
            f"{depth:5g}  {found.force / hertz_force():14.3f}  {off:19.1%}  {found.force_ratio:38.3f}"
            f"  {found.pressure_error:12.1%}  {found.dent:8.1%}"
        )


if __name__ == "__main__":
    main()
