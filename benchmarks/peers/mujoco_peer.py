"""MuJoCo on the scenes."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import scene

VERSION = f"MuJoCo {mujoco.__version__}"


def _option(dt: float, options: dict[str, object]) -> str:
    # The integrator that takes the damping of servos implicitly: at 10 ms the default one is unstable on the thumb's servo. It does not change the contacts.
    options = {"integrator": "implicitfast"} | options
    words = " ".join(f'{key}="{value}"' for key, value in options.items() if key not in ("condim", "young"))
    return f'<option timestep="{dt}" gravity="0 0 -{scene.GRAVITY}" {words}/>'


FLEX_NODES = 8
"""Vertices along each edge of a flexible pad; its shape is interpolated from the eight corners, of which the four behind are fixed to the finger."""
FLEX_CONTACT = 'solref="0.002 1" solimp="0.99 0.999 0.001"'
"""Stiff contacts: with the defaults the box sinks millimetres into a flexible pad."""


def _flexible_pad(name: str, side: float, young: float) -> str:
    """An elastic ball in the frame of a finger that looks along -side."""
    spacing = 2.0 * scene.PAD_RADIUS / (FLEX_NODES - 1)
    count, spacings = " ".join([str(FLEX_NODES)] * 3), " ".join([str(spacing)] * 3)
    pinned = "0 0 0 0 1 1" if side < 0 else "1 0 0 1 1 1"
    return (
        f'<inertial pos="0 0 0" mass="{scene.PAD_MASS}" diaginertia="1e-5 1e-5 1e-5"/>'
        f'<flexcomp name="{name}" type="ellipsoid" dim="3" dof="trilinear" count="{count}" spacing="{spacings}" mass="0.005" radius="0.0005">'
        f'<elasticity young="{young}" poisson="0.4"/><pin gridrange="{pinned}"/>'
        f'<contact selfcollide="none" condim="3" friction="{scene.FRICTION} 0.0019 0.0001" {FLEX_CONTACT}/></flexcomp>'
    )


class MuJoCo:
    """Pads are spheres on slides along x; the fingers push with a constant force, the thumb stands on a stiff position servo."""

    def __init__(self, configuration: scene.Configuration, pad_count: int = 3, offset: float = 0.0) -> None:
        young = configuration.options.get("young")
        condim = configuration.options.get("condim", 3)
        edge, mass = scene.BOX, scene.BOX_MASS
        inertia = mass * edge * edge / 6.0
        # Torsional friction (m) of a Hertz-like patch of 4.4 mm radius, 8/15 of it; used by condim 4 and up.
        geom = f'friction="{scene.FRICTION} 0.0019 0.0001" condim="{condim}" {FLEX_CONTACT if young else ""}'
        bodies, actuators = [], []
        for k, (_, side, y, _) in enumerate(scene.pads(pad_count)):
            x = side * (edge / 2 + scene.PAD_RADIUS)
            ball = f'<geom type="sphere" size="{scene.PAD_RADIUS}" mass="{scene.PAD_MASS}" {geom}/>'
            bodies.append(
                f'<body name="pad{k}" pos="{x} {y} 0" gravcomp="1"><joint name="slide{k}" type="slide" axis="{-side} 0 0" damping="20"/>'
                f"{_flexible_pad(f'flex{k}', side, young) if young else ball}</body>"
            )
            actuators.append(f'<position joint="slide{k}" kp="20000" kv="200"/>' if side < 0 else f'<motor joint="slide{k}"/>')
        xml = f"""<mujoco>{_option(configuration.dt, configuration.options)}<size memory="100M"/><worldbody>
            <body name="box"><freejoint/><inertial pos="0 {offset} 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
            <geom name="box" type="box" size="{edge / 2} {edge / 2} {edge / 2}" {geom}/></body>{"".join(bodies)}</worldbody>
            <actuator>{"".join(actuators)}</actuator></mujoco>"""
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.box = self.model.body("box").id
        self.thumb = self.model.body("pad0").id
        # The box stands still while the pads press.
        self.model.opt.gravity[2] = 0.0
        for k, (_, side, _, share) in enumerate(scene.pads(pad_count)):
            # With flexible pads only half of what the motor gives arrives at the contacts.
            self.data.ctrl[k] = 0.0 if side < 0 else share * scene.SQUEEZE * (2.0 if young else 1.0)
        for _ in range(round(0.5 / configuration.dt)):
            mujoco.mj_step(self.model, self.data)
        self.model.opt.gravity[2] = -scene.GRAVITY
        for _ in range(round(0.2 / configuration.dt)):
            mujoco.mj_step(self.model, self.data)

    def step(self) -> None:
        mujoco.mj_step(self.model, self.data)

    def pull(self, newton: float) -> None:
        self.data.xfrc_applied[self.box, 2] = -newton

    def height(self) -> float:
        return float(self.data.qpos[2])

    def angle(self) -> float:
        w, x = self.data.qpos[3:5]
        return 2.0 * math.atan2(float(x), float(w))

    def squeeze(self) -> float:
        total, force = 0.0, np.zeros(6)
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            # A flexible pad has no geom; its number is that of the pad.
            if 0 in contact.flex or self.thumb in self.model.geom_bodyid[contact.geom[contact.geom >= 0]]:
                mujoco.mj_contactForce(self.model, self.data, i, force)
                total += float(force[0])
        return total

    def contacts(self) -> int:
        return int(self.data.ncon)


class MuJoCoCapsule:
    """The issue's scene: pads on damped slides, position actuators with targets past first contact."""

    def __init__(self, dt: float, options: dict[str, object]) -> None:
        radius, half_length, half = scene.CAPSULE_RADIUS, scene.CAPSULE_HALF_LENGTH, scene.CAPSULE_PAD
        geom = f'friction="{scene.CAPSULE_FRICTION} 0.005 0.0001" condim="{options.get("condim", 3)}"'
        pads = "".join(
            f'<body name="pad{k}" pos="{side * (radius + half[0])} 0 0" gravcomp="1"><joint name="slide{k}" type="slide" axis="{-side} 0 0"/>'
            f'<geom type="box" size="{half[0]} {half[1]} {half[2]}" mass="{scene.PAD_MASS}" {geom}/></body>'
            for k, side in enumerate((-1, 1))
        )
        actuators = "".join(f'<position joint="slide{k}" kp="{scene.CAPSULE_STIFFNESS}" kv="{scene.CAPSULE_DAMPING}"/>' for k in range(2))
        self.model = mujoco.MjModel.from_xml_string(
            f"""<mujoco>{_option(dt, options)}<worldbody><body name="capsule" quat="0.7071067811865476 0.7071067811865476 0 0"><freejoint/>
            <geom type="capsule" size="{radius} {half_length}" mass="{scene.CAPSULE_MASS}" {geom}/></body>{pads}</worldbody><actuator>{actuators}</actuator></mujoco>"""
        )
        self.data = mujoco.MjData(self.model)
        self.model.opt.gravity[2] = 0.0
        self.data.ctrl[:] = scene.CAPSULE_PAST_CONTACT
        self.run(0.5)
        self.model.opt.gravity[2] = -scene.GRAVITY

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)

    def height(self) -> float:
        return float(self.data.qpos[2])

    def squeeze(self) -> float:
        total, force = 0.0, np.zeros(6)
        pad = self.model.body("pad0").id
        for i in range(self.data.ncon):
            if pad in self.model.geom_bodyid[self.data.contact[i].geom]:
                mujoco.mj_contactForce(self.model, self.data, i, force)
                total += float(force[0])
        return total
