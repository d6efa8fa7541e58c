"""quasirigid on the scenes."""

from __future__ import annotations

import math

import numpy as np
import scene

from quasirigid import MassProperties, Material, Surface, World, __version__

VERSION = f"quasirigid {__version__}"
POINTS_PER_CONTROL_POINT = 7.5


class Ours:
    """Pads are fixed bodies, moved inwards until each presses with its share, and then held still."""

    def __init__(self, configuration: scene.Configuration, pad_count: int = 3, offset: float = 0.0) -> None:
        options = configuration.options
        self.world = World(dt=configuration.dt, gravity=(0.0, 0.0, 0.0))
        wood = Material.preset("wood").replace(friction=scene.FRICTION)
        pulp = Material.preset("fingertip_pulp").replace(friction=scene.FRICTION, compliance=options.get("compliance", "local"))
        edge, mass = scene.BOX, scene.BOX_MASS
        inertia = np.eye(3) * mass * edge * edge / 6.0
        surface = Surface.box((edge, edge, edge), points=36_000, control_points=2_400)
        self.box = self.world.add_body(surface, wood, mass=MassProperties(mass, (0.0, offset, 0.0), inertia), name="box")
        count = options["control_points"]
        pad = Surface.fingertip(np.full(3, scene.PAD_RADIUS), points=round(POINTS_PER_CONTROL_POINT * count), control_points=count)
        self.pads = []
        for name, side, y, share in scene.pads(pad_count):
            half = side * -math.pi / 4.0
            position = np.array([side * (edge / 2 + scene.PAD_RADIUS + 1e-4), y, 0.0])
            body = self.world.add_body(
                pad, pulp, motion="fixed", position=position, quaternion=(math.cos(half), 0.0, math.sin(half), 0.0), name=name
            )
            self.pads.append((body, side, share * scene.SQUEEZE))
        self._press()
        self.world = self._with_gravity(self.world)
        for _ in range(round(1.0 / self.world.dt)):
            self.step()

    def _with_gravity(self, world: World) -> World:
        # Gravity comes as a wrench: the pads press without it first, so that the box does not fall while they find it.
        self._load = 0.0
        self.pull(0.0)
        return world

    def _forces(self) -> list[float]:
        contacts = self.world.contacts()
        forces, first, second = contacts.forces[:, 0], contacts.body_a, contacts.body_b
        out = []
        for body, side, _ in self.pads:
            on_pad = forces[first == body.index].sum() - forces[second == body.index].sum()
            out.append(float(side * on_pad))
        return out

    def _press(self) -> None:
        for _ in range(round(20.0 / self.world.dt)):
            missing = [wanted - has for (_, _, wanted), has in zip(self.pads, self._forces(), strict=True)]
            if max(abs(m) for m in missing) < 1e-4 * scene.SQUEEZE and self.world.steps > 10:
                break
            for (body, side, _), lack in zip(self.pads, missing, strict=True):
                speed = min(max(0.01 * lack, -0.02), 0.02)
                body.move_to(body.position - np.array([side * speed * self.world.dt, 0.0, 0.0]))
            self.world.step()

    def step(self) -> None:
        self.report = self.world.step()

    def pull(self, newton: float) -> None:
        self.box.apply_wrench((0.0, 0.0, -scene.WEIGHT - newton))

    def height(self) -> float:
        return float(self.box.position[2])

    def angle(self) -> float:
        w, x, _, _ = self.box.quaternion
        return 2.0 * math.atan2(float(x), float(w))

    def squeeze(self) -> float:
        return self._forces()[0]

    def contacts(self) -> int:
        return int(self.report.contacts)


class OurCapsule:
    """Pads are free bodies on springs of the actuators' stiffness; a stiff spring keeps them upright and level."""

    def __init__(self, dt: float, _options: dict[str, object] | None = None) -> None:
        self.world = World(dt=dt)
        rubber = Material.preset("rubber").replace(friction=scene.CAPSULE_FRICTION)
        metal = Material.preset("aluminium").replace(friction=scene.CAPSULE_FRICTION)
        radius, length = scene.CAPSULE_RADIUS, 2.0 * scene.CAPSULE_HALF_LENGTH
        capsule = Surface.capsule(radius, length, points=12_000, control_points=1_600)
        mass = MassProperties.capsule(radius, length, mass=scene.CAPSULE_MASS)
        along_y = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
        self.capsule = self.world.add_body(capsule, metal, mass=mass, quaternion=along_y, name="capsule")
        # Held by a spring until the pads have closed.
        self.capsule.set_drive((0.0, 0.0, 0.0), along_y, stiffness=(1e4, 10.0), damping=(100.0, 0.1))
        half = np.array(scene.CAPSULE_PAD)
        plate = Surface.box(2.0 * half, points=16_000, control_points=2_100)
        self.plates = []
        for side in (-1.0, 1.0):
            start = np.array([side * (radius + half[0] + 1e-4), 0.0, 0.0])
            mass = MassProperties.box(2.0 * half, mass=scene.PAD_MASS)
            body = self.world.add_body(plate, rubber, mass=mass, position=start, name=f"pad {side:+.0f} x")
            self.plates.append((body, side, half[0] + radius))
        closing = round(0.5 / dt)
        for k in range(closing):
            self._aim(scene.CAPSULE_PAST_CONTACT * (k + 1) / closing)
            self.world.step()
        self.world.step(round(0.5 / dt))
        self.capsule.clear_drive()

    def _aim(self, past: float) -> None:
        for body, side, contact in self.plates:
            target = (side * (contact - past), 0.0, 0.0)
            stiffness, damping = (scene.CAPSULE_STIFFNESS, 1e3), (scene.CAPSULE_DAMPING, 10.0)
            # A spring is alike in all directions: the pads' weight is taken off, so that they stay level.
            body.apply_wrench((0.0, 0.0, scene.PAD_MASS * scene.GRAVITY))
            body.set_drive(target, stiffness=stiffness, damping=damping)

    def run(self, seconds: float) -> None:
        self.report = self.world.step(round(seconds / self.world.dt))

    def height(self) -> float:
        return float(self.capsule.position[2])

    def squeeze(self) -> float:
        contacts = self.world.contacts()
        index = self.plates[0][0].index
        on_pad = contacts.forces[contacts.body_a == index, 0].sum() - contacts.forces[contacts.body_b == index, 0].sum()
        return abs(float(on_pad))
