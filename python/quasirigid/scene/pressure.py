"""Pressure and friction as colours: the colour map, the scale of its legend, and the pressure at the points of a pad."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.types import AnyArray, FloatArray
from quasirigid.rotation import matrix_of
from quasirigid.scene.model import ContactsState, SceneState
from quasirigid.scene.palette import PAD

STICK, SLIP = 1, 2


@cache
def viridis() -> FloatArray:
    """The colour map of pressure, (256, 3) in 0 to 1: perceptually uniform, colour-blind-safe. Matplotlib has it, and is imported with the
    first call.
    """
    from matplotlib import colormaps

    return np.asarray(colormaps["viridis"](np.arange(256))[:, :3], dtype=np.float64)


def byte_colours() -> npt.NDArray[np.uint8]:
    """``viridis``, (256, 3) in 0 to 255."""
    return (viridis() * 255.0).round().astype(np.uint8)


def rgb(text: str) -> npt.NDArray[np.uint8]:
    """(3,) of ``"#0072B2"``."""
    return np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)], dtype=np.uint8)


def colour_map(share: FloatArray) -> npt.NDArray[np.uint8]:
    """(n, 3) colours of ``share`` (n,) of the full scale."""
    return byte_colours()[(np.clip(share, 0.0, 1.0) * 255.0).astype(np.int64)]


def pad_colours(pressure: AnyArray, peak: float) -> FloatArray:
    """Colours (n, 4) of a pad under ``pressure`` (n,): viridis where it is pressed, its own where not."""
    x = np.clip(pressure / peak, 0.0, 1.0)
    loaded = np.clip((x - 0.01) / 0.05, 0.0, 1.0)[:, None]
    # As matplotlib picks the colour of a number: the last one for 1.
    colour = loaded * viridis()[np.minimum((x * 256.0).astype(np.int64), 255)] + (1.0 - loaded) * np.array(PAD)
    return np.concatenate([colour, loaded], axis=1)


@dataclass
class Scale:
    """Full scale of the pressure colours, Pa: 1, 2 or 5 times a power of ten, and calm: it grows at once and shrinks late."""

    top: float = 50e3
    least: float = 1e3

    def follow(self, peak: float) -> bool:
        """Takes in the highest pressure of now; whether the scale changed."""
        wanted = nice_above(max(peak, self.least))
        if wanted > self.top or (wanted <= 0.25 * self.top and peak > 0.0):
            self.top = wanted
            return True
        return False


def nice_above(value: float) -> float:
    """The least of 1, 2, 5 times a power of ten that is not below ``value``."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1.0 - 1e-9))


@dataclass(frozen=True, eq=False)
class Patch:
    """The contacts of one body, in its frame or in world axes."""

    points: FloatArray
    """(c, 3) m."""
    pressures: FloatArray
    """(c,) Pa."""
    shear: FloatArray
    """(c, 3) Pa: friction on the body over area."""
    areas: FloatArray
    """(c,) m^2."""
    status: npt.NDArray[np.uint8]

    def near(self, points: FloatArray | npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Which of ``points`` (n, 3) may be under pressure: those in a sphere around the loaded contacts."""
        loaded = self.points[self.pressures > 0.0]
        if len(loaded) == 0:
            return np.zeros(0, dtype=np.int64)
        middle = loaded.mean(axis=0)
        reach = math.sqrt(float(((loaded - middle) ** 2).sum(axis=1).max())) + 1.5 * math.sqrt(float(self.areas.mean()))
        return np.flatnonzero(((points - middle) ** 2).sum(axis=1) < reach * reach)


def world_patch(contacts: ContactsState, body: int) -> Patch:
    """The contacts of a body, in world axes."""
    mine = np.flatnonzero(contacts.on(body))
    sign = np.where(contacts.collider_a[mine] == body, 1.0, -1.0)[:, None]
    along = contacts.reactions[mine, :1] * contacts.normals[mine]
    areas = contacts.areas[mine]
    return Patch(
        points=contacts.points[mine],
        pressures=contacts.pressures[mine],
        shear=sign * (contacts.forces[mine] - along) / areas[:, None],
        areas=areas,
        status=contacts.status[mine],
    )


def patch_of(state: SceneState, body: int) -> Patch:
    """The contacts of a body, in its frame."""
    patch = world_patch(state.contacts, body)
    turn = matrix_of(state.quaternions[body])
    return replace(patch, points=(patch.points - state.positions[body]) @ turn, shear=patch.shear @ turn)


def pressure_at(points: FloatArray | npt.NDArray[np.float32], patch: Patch) -> FloatArray:
    """Pressure (n,) Pa at ``points`` (n, 3), frame of the ``patch``."""
    return spread(points, patch.points, patch.pressures, patch.areas)


def spread(points: FloatArray | npt.NDArray[np.float32], spots: FloatArray, pressures: FloatArray, areas: FloatArray) -> FloatArray:
    """Pressure (n,) Pa at ``points`` (n, 3) m: that of the contacts around, a Gaussian as wide as they are apart. The contacts are at
    ``spots`` (c, 3) m, have ``pressures`` (c,) Pa and ``areas`` (c,) m^2. Vectors, such as shear (c, k) Pa, give (n, k).
    """
    if len(spots) == 0 or not pressures.any():
        return np.zeros((len(points), *pressures.shape[1:]))
    spacing = float(np.sqrt(areas.mean()))
    h = 0.8 * spacing
    # Single precision about the middle of the patch: far below what a colour shows.
    middle = spots.mean(axis=0)
    there, here = ((points - middle) / h).astype(np.float32), ((spots - middle) / h).astype(np.float32)
    weight = there @ (2.0 * here.T)
    weight -= (there**2).sum(axis=1)[:, None]
    weight -= (here**2).sum(axis=1)
    np.maximum(weight, -80.0, out=weight)
    np.exp(weight, out=weight)
    # Where few contacts are around, at the rim, the rest counts as unloaded. Within the patch the sum is pi (h / spacing)^2.
    total = np.maximum(weight.sum(axis=1), 0.75 * math.pi * (h / spacing) ** 2)
    result: FloatArray = ((weight @ pressures.astype(np.float32)).T.astype(np.float64) / total).T
    return result


def alike(one: SceneState, two: SceneState) -> bool:
    """Whether forces and patches look the same in both."""
    a, b = one.contacts, two.contacts
    if len(a) != len(b) or not np.array_equal(a.status, b.status) or one.moved.keys() != two.moved.keys():
        return False
    if len(a) == 0:
        return True
    same = np.abs(a.forces - b.forces).max() < 1e-4 * np.abs(a.forces).max() and np.abs(a.points - b.points).max() < 5e-6
    return bool(same)
