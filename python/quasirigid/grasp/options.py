"""What can be chosen about a grasp."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from quasirigid._quasirigid import Material
from quasirigid.errors import InvalidValueError, UnknownNameError
from quasirigid.objects import MAX_POINTS, MIN_POINTS
from quasirigid.objects.orientation import rotation_of


@dataclass(frozen=True)
class GraspOptions:
    """What can be chosen about a grasp; the command line has one option for each."""

    object: Path | None = None
    """A file with a mesh or a point cloud; ``None`` is the built-in box of 60 x 60 x 80 mm."""
    scale: float | None = None
    """Factor on the coordinates of the file."""
    size: float | None = None
    """Largest extent that the object shall have, m, in place of ``scale``."""
    up: str = "z"
    """Axis of the file that points up: x, y, z, -x, -y or -z."""
    rotate: str | None = None
    """Rotations after that, in words, such as ``"90 about x, 45 about z"``, degrees."""
    mass: float | None = None
    """Mass of the object, kg. Default 0.2 for the box, otherwise from the density of the material."""
    points: int | None = None
    """Points on the object. Default 36,000 on the box and 20,000 on others."""
    friction: float | None = None
    """Coulomb coefficient between fingers and object. Default that of the two materials."""
    material: str = "wood"
    """Preset of the object's material."""
    dt: float = 1e-3
    """Time step, s."""
    hold: float = 2.0
    """Length of the first hold, s."""
    squeeze: float | None = None
    """Force of the thumb, N; each of the two fingers presses with half of it. Default 4 N, and for an object from a file
    three times what friction needs if that is more."""
    compliance: Literal["local", "layer", "half-space", "gaussian"] = "gaussian"
    """Of fingers and object: ``"local"`` (a bonded layer, normal and tangential displacements apart), ``"layer"`` (the same with what couples
    them), ``"half-space"`` or ``"gaussian"`` (the paper's).
    """
    object_motion: Literal["inertial", "quasi-static"] = "inertial"
    """``"inertial"``, or ``"quasi-static"`` for the paper's bodies without inertia (object and fingers)."""
    support: Literal["table", "post"] | None = None
    """What the box stands on: ``"table"``, ``"post"`` (16 mm wide), or the experiment's pedestal of 30 mm. An object from a file has a
    table anyway.
    """
    threads: int = 1
    """Threads of the engine; the result is the same for any number."""
    seed: int = 0
    """Seed of the sampling of the object's surface."""

    def check(self) -> None:
        """Refuse figures that make no grasp. Raises ``InvalidValueError`` or ``UnknownNameError``."""
        positive = {"scale": "-", "size": "m", "mass": "kg", "dt": "s", "hold": "s", "squeeze": "N"}
        for name, unit in positive.items():
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise InvalidValueError(name, f"a finite number > 0 ({unit})", value, "give a positive value in SI units")
        if self.friction is not None and not (math.isfinite(self.friction) and self.friction >= 0.0):
            raise InvalidValueError("friction", "a finite number >= 0", self.friction, "0 is ice, 0.8 a dry fingertip")
        if self.dt > 0.02:
            raise InvalidValueError("dt", "at most 0.02 s", self.dt, "contacts need a finer step")
        if self.hold > 3600.0:
            raise InvalidValueError("hold", "at most 3600 s", self.hold, "an hour shows all there is to see")
        if self.threads < 1:
            raise InvalidValueError("threads", "at least 1", self.threads, "0.25 ms of work rarely gains from more than 2")
        if self.points is not None and not MIN_POINTS <= self.points <= MAX_POINTS:
            raise InvalidValueError("points", f"{MIN_POINTS} to {MAX_POINTS}", self.points, "a few thousand make a surface")
        if self.seed < 0:
            raise InvalidValueError("seed", "a whole number >= 0", self.seed, "any will do")
        if self.scale is not None and self.size is not None:
            raise InvalidValueError("scale and size", "one of the two", "both", "leave one out")
        if self.object is None and (self.scale is not None or self.size is not None):
            raise InvalidValueError("scale or size", "an object from a file to scale", "the built-in box", "add --object FILE")
        rotation_of(self.up, self.rotate)
        if self.object is None and (self.up != "z" or self.rotate is not None):
            raise InvalidValueError("up or rotate", "an object from a file to turn", "the built-in box", "add --object FILE")
        if self.support not in (None, "table", "post"):
            raise UnknownNameError("support", "table or post", self.support, "leave it out for what is usual")
        for name, known in (("compliance", ("local", "layer", "half-space", "gaussian")), ("object_motion", ("inertial", "quasi-static"))):
            if getattr(self, name) not in known:
                raise UnknownNameError(name.replace("_", " "), " or ".join(known), getattr(self, name), "choose one of them")
        if self.material not in Material.preset_names():
            raise UnknownNameError("material", ", ".join(Material.preset_names()), self.material, "see `quasirigid materials`")
