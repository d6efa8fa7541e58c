"""Real-time grasping with soft fingertips: contact patches and exact Coulomb friction.

>>> import quasirigid as qr
>>> world = qr.World()
>>> ball = world.add_body(qr.Surface.sphere(0.03, points=2000), qr.Material.preset("rubber"), mass=0.1, position=(0, 0, 1))
>>> report = world.step(100)
>>> bool(ball.position[2] < 0.96)
True
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from quasirigid._moved import MOVED, install
from quasirigid._quasirigid import (
    STAGES,
    Body,
    Collider,
    ComplianceMatrix,
    Contacts,
    ContactSolution,
    ContactStatus,
    Friction,
    Grip,
    Hand,
    HandModel,
    MassProperties,
    Material,
    Snapshot,
    StepReport,
    Surface,
    World,
    __version__,
)
from quasirigid.errors import (
    CaptureFileError,
    DegenerateSurfaceError,
    ForkError,
    GraspPlanError,
    InvalidHandleError,
    InvalidShapeError,
    InvalidValueError,
    MissingPackageError,
    NetworkError,
    ObjectFileError,
    PacketError,
    QuasirigidError,
    RecordingError,
    SnapshotError,
    SurfaceWarning,
    UnknownNameError,
)

if TYPE_CHECKING:
    from quasirigid.grasp.plan import GraspPlan, HandGeometry, plan_grasp
    from quasirigid.objects import ObjectGeometry, load_object
    from quasirigid.recording import Column, Recording
    from quasirigid.recording.recorder import Recorder
    from quasirigid.recording.scene_recording import SceneRecording
    from quasirigid.recording.world_recorder import record
    from quasirigid.solver import ContactProblem, solve_contacts
    from quasirigid.view import open_view as view

__all__ = [
    "STAGES",
    "Body",
    "CaptureFileError",
    "Collider",
    "Column",
    "ComplianceMatrix",
    "ContactProblem",
    "ContactSolution",
    "ContactStatus",
    "Contacts",
    "DegenerateSurfaceError",
    "ForkError",
    "Friction",
    "GraspPlan",
    "GraspPlanError",
    "Grip",
    "Hand",
    "HandGeometry",
    "HandModel",
    "InvalidHandleError",
    "InvalidShapeError",
    "InvalidValueError",
    "MassProperties",
    "Material",
    "MissingPackageError",
    "NetworkError",
    "ObjectFileError",
    "ObjectGeometry",
    "PacketError",
    "QuasirigidError",
    "Recorder",
    "Recording",
    "RecordingError",
    "SceneRecording",
    "Snapshot",
    "SnapshotError",
    "StepReport",
    "Surface",
    "SurfaceWarning",
    "UnknownNameError",
    "World",
    "__version__",
    "load_object",
    "plan_grasp",
    "record",
    "solve_contacts",
    "view",
]

# What needs SciPy, trimesh, h5py or Matplotlib is imported when it is first used: `import quasirigid` costs what NumPy costs (PEP 562).
_MODULE_OF = {
    "Column": "recording",
    "ContactProblem": "solver",
    "GraspPlan": "grasp.plan",
    "HandGeometry": "grasp.plan",
    "ObjectGeometry": "objects",
    "Recorder": "recording.recorder",
    "Recording": "recording",
    "SceneRecording": "recording.scene_recording",
    "load_object": "objects",
    "plan_grasp": "grasp.plan",
    "record": "recording.world_recorder",
    "solve_contacts": "solver",
}
_MODULES = ("grasp", "mocap", "objects", "pads", "recording", "solver", "view")
"""Modules that need not be imported by name."""


def __getattr__(name: str) -> Any:
    if name in _MODULE_OF:
        value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
        globals()[name] = value
        return value
    if name in _MODULES or name in MOVED:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


install()
