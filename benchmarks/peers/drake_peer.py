"""Drake on the scenes."""

from __future__ import annotations

import math
from importlib.metadata import version

import numpy as np
import scene
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    CoulombFriction,
    DiscreteContactApproximation,
    ExternallyAppliedSpatialForce,
)
from pydrake.multibody.tree import FixedOffsetFrame, PdControllerGains, PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

VERSION = f"Drake {version('drake')}"


class Drake:
    """Pads are spheres on slides along x; the fingers push with a constant force, the thumb stands on a stiff position servo."""

    def __init__(self, configuration: scene.Configuration, pad_count: int = 3, offset: float = 0.0) -> None:
        options = configuration.options
        hydroelastic = options["model"] == "hydroelastic"
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, configuration.dt)
        plant.set_contact_model(ContactModel.kHydroelasticWithFallback if hydroelastic else ContactModel.kPoint)
        plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -scene.GRAVITY])
        friction = CoulombFriction(scene.FRICTION, scene.FRICTION)

        def material(rigid: bool) -> ProximityProperties:
            properties = ProximityProperties()
            if hydroelastic and rigid:
                AddRigidHydroelasticProperties(0.01, properties)
            elif hydroelastic:
                AddCompliantHydroelasticProperties(options["resolution_hint"], options["modulus"], properties)
            AddContactMaterial(dissipation=1.0, point_stiffness=options.get("stiffness"), friction=friction, properties=properties)
            return properties

        edge, mass = scene.BOX, scene.BOX_MASS
        # About the body's origin: that of a cube about its centre, moved by the offset.
        com = np.array([0.0, offset, 0.0])
        unit = UnitInertia.SolidCube(edge).ShiftFromCenterOfMass(-com)
        instance = plant.AddModelInstance("box")
        self.box = plant.AddRigidBody("box", instance, SpatialInertia(mass, com, unit))
        plant.RegisterCollisionGeometry(self.box, RigidTransform(), Box(edge, edge, edge), "box", material(rigid=True))
        self.com = com
        self.pads, instances = [], []
        for name, side, y, share in scene.pads(pad_count):
            instance = plant.AddModelInstance(name)
            pad = plant.AddRigidBody(name, instance, SpatialInertia.SolidSphereWithMass(scene.PAD_MASS, scene.PAD_RADIUS))
            plant.RegisterCollisionGeometry(pad, RigidTransform(), Sphere(scene.PAD_RADIUS), name, material(rigid=False))
            rail = plant.AddFrame(FixedOffsetFrame(f"rail {name}", plant.world_frame(), RigidTransform([0.0, y, 0.0])))
            joint = plant.AddJoint(PrismaticJoint(f"slide {name}", rail, pad.body_frame(), [1.0, 0.0, 0.0], damping=20.0))
            joint.set_default_translation(side * (edge / 2 + scene.PAD_RADIUS))
            actuator = plant.AddJointActuator(f"motor {name}", joint)
            if side < 0.0:
                actuator.set_controller_gains(PdControllerGains(p=20_000.0, d=200.0))
            plant.set_gravity_enabled(instance, False)
            self.pads.append((pad, side))
            instances.append((instance, side, share))
        plant.Finalize()
        self.plant, self.diagram = plant, builder.Build()
        self.simulator = Simulator(self.diagram)
        self.root = self.simulator.get_mutable_context()
        self.context = plant.GetMyMutableContextFromRoot(self.root)
        for instance, side, share in instances:
            if side < 0.0:
                plant.get_desired_state_input_port(instance).FixValue(self.context, [-edge / 2 - scene.PAD_RADIUS, 0.0])
                plant.get_actuation_input_port(instance).FixValue(self.context, [0.0])
            else:
                plant.get_actuation_input_port(instance).FixValue(self.context, [-share * scene.SQUEEZE])
        self.dt, self.steps = configuration.dt, 0
        # Gravity is taken off the box while the pads press.
        self.pull(-scene.WEIGHT)
        self.simulator.Initialize()
        self._run(0.5)
        self.pull(0.0)
        self._run(0.2)

    def _run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.dt)):
            self.step()

    def step(self) -> None:
        self.steps += 1
        self.simulator.AdvanceTo(self.steps * self.dt)

    def pull(self, newton: float) -> None:
        force = ExternallyAppliedSpatialForce()
        force.body_index = self.box.index()
        force.p_BoBq_B = self.com
        force.F_Bq_W = SpatialForce(tau=np.zeros(3), f=np.array([0.0, 0.0, -newton]))
        self.plant.get_applied_spatial_force_input_port().FixValue(self.context, [force])

    def _pose(self) -> RigidTransform:
        return self.plant.EvalBodyPoseInWorld(self.context, self.box)

    def height(self) -> float:
        return float(self._pose().translation()[2])

    def angle(self) -> float:
        matrix = self._pose().rotation().matrix()
        return math.atan2(float(matrix[2, 1]), float(matrix[1, 1]))

    def _results(self):
        return self.plant.get_contact_results_output_port().Eval(self.context)

    def squeeze(self) -> float:
        results, total = self._results(), 0.0
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            if self.pads[0][0].index() in (info.bodyA_index(), info.bodyB_index()):
                total += abs(float(info.contact_force()[0]))
        for i in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(i)
            if info.contact_surface().centroid()[0] < 0.0:
                total += abs(float(info.F_Ac_W().translational()[0]))
        return total

    def contacts(self) -> int:
        results = self._results()
        polygons = sum(
            results.hydroelastic_contact_info(i).contact_surface().num_faces() for i in range(results.num_hydroelastic_contacts())
        )
        return results.num_point_pair_contacts() + polygons
