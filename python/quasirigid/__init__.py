"""Real-time grasping with soft fingertips: contact patches and exact Coulomb friction.

>>> import quasirigid as qr
>>> world = qr.World()
>>> ball = world.add_body(qr.Surface.sphere(0.03, points=2000), qr.Material.preset("rubber"), mass=0.1, position=(0, 0, 1))
>>> report = world.step(100)
>>> bool(ball.position[2] < 0.96)
True
"""

from typing import TYPE_CHECKING

from quasirigid._quasirigid import (
    STAGES,
    Body,
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
    StepReport,
    Surface,
    World,
    __version__,
)
from quasirigid.errors import (
    CaptureFileError,
    DegenerateSurfaceError,
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
    SurfaceWarning,
    UnknownNameError,
)
from quasirigid.grasp_plan import GraspPlan, HandGeometry, plan_grasp
from quasirigid.objects import ObjectGeometry, load_object
from quasirigid.recorder import Recorder
from quasirigid.recording import Column, Recording
from quasirigid.scene_recording import SceneRecording
from quasirigid.solver import ContactProblem, solve_contacts
from quasirigid.world_recorder import record

if TYPE_CHECKING:
    from quasirigid.view import open_view as view
else:
    from quasirigid import view  # the package, which can be called

__all__ = [
    "STAGES",
    "Body",
    "CaptureFileError",
    "Column",
    "ComplianceMatrix",
    "ContactProblem",
    "ContactSolution",
    "ContactStatus",
    "Contacts",
    "DegenerateSurfaceError",
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
