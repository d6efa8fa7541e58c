"""Import paths of 0.1.0 that lead elsewhere now. They work for one release, and say so with a ``DeprecationWarning``.

``MOVED`` is the whole truth: by an old module where its names are now. What has kept its path is not in it.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

PACKAGE = "quasirigid"
MOVED: dict[str, tuple[str, ...]] = {
    "access": ("net.access",),
    "bench": ("benchmark.timings",),
    "bench_tables": ("benchmark.tables",),
    "cli_streams": ("cli.streams",),
    "disk_space": ("recording.disk_space",),
    "forks": ("system.forks",),
    "grasp": ("grasp.experiment", "grasp.setup", "rotation"),
    "grasp_columns": ("grasp.columns",),
    "grasp_options": ("grasp.options",),
    "grasp_panel": ("cli.grasp_panel",),
    "grasp_plan": ("grasp.plan",),
    "grasp_run": ("grasp.run", "live.grasp_page"),
    "objects.turning": ("objects.orientation",),
    "palette": ("scene.palette",),
    "plots": ("grasp.figures.plots", "scene.palette", "scene.pressure"),
    "quiet": ("render.fonts", "system.child_process"),
    "real_arrays": ("arrays.real",),
    "recorder": ("recording.recorder",),
    "recording_attributes": ("recording.attributes",),
    "recording_file": ("recording.file",),
    "recording_model": ("recording.scene_model",),
    "recording_place": ("recording.lock",),
    "recording_schema": ("recording.schema",),
    "recording_values": ("recording.values",),
    "recording_writer": ("recording.writer",),
    "scene_columns": ("recording.scene_columns",),
    "scene_plot": ("grasp.figures.scene", "render.ground", "scene.pressure"),
    "scene_recording": ("recording.scene_recording", "recording.scene_recorder"),
    "scene_shot": ("grasp.figures.scene_data",),
    "serving": ("net.serving",),
    "small_figures": ("units",),
    "sparse_matrix": ("arrays.sparse",),
    "splats": ("render.camera", "render.layer"),
    "state_arrays": ("arrays.read_only",),
    "summary": ("grasp.summary", "rotation", "arrays.types"),
    "supports": ("grasp.support",),
    "triangles": ("render.triangles",),
    "world_recorder": ("recording.world_recorder", "live.recorder"),
    "mocap.commands": ("cli.mocap",),
    "mocap.grasp_command": ("cli.mocap_session",),
    "mocap.stream": ("mocap.source",),
    "mocap.tables": ("cli.mocap_tables",),
    "mocap.terminal_keys": ("cli.terminal_keys",),
    "view.checked_server": ("net.checked_server",),
    "view.draw": ("live.draw",),
    "view.export": ("recording.export", "recording.window"),
    "view.export_rerun": ("recording.export_rerun",),
    "view.framing": ("live.framing",),
    "view.media": ("render.media",),
    "view.meshes": ("scene.meshes",),
    "view.overlay": ("render.overlay",),
    "view.play": ("live.play",),
    "view.pressure": ("scene.pressure", "rotation"),
    "view.render": ("render.pictures", "render.posed"),
    "view.replay": ("live.replay",),
    "view.scale_bar": ("live.scale_bar",),
    "view.scaling": ("scene.scaling",),
    "view.scene": ("scene.model", "arrays.types"),
    "view.server": ("live.server",),
    "view.session": ("live.session",),
    "view.uploads": ("live.uploads",),
    "view.watch": ("live.watch",),
    "view.world_scene": ("scene.world",),
    "webxr": ("mocap.webxr",),
    "webxr.joints": ("mocap.webxr.joints", "rotation"),
    "webxr.messages": ("mocap.webxr.messages",),
    "webxr.pages": ("mocap.webxr.pages",),
    "webxr.placement": ("mocap.webxr.placement",),
    "webxr.server": ("mocap.webxr.server",),
    "webxr.wire": ("mocap.webxr.wire",),
}


def names_of(old: str) -> Callable[[str], Any]:
    """A module's ``__getattr__`` for the names that were in ``old``, which is now elsewhere, or a folder.

    Raises ``AttributeError`` for a name that is in none of the new modules.
    """
    places = [f"{PACKAGE}.{new}" for new in MOVED[old.removeprefix(f"{PACKAGE}.")]]

    def find(name: str) -> Any:
        if not name.startswith("__"):
            for place in places:
                module = import_module(place)
                if hasattr(module, name):
                    _warn(f"{old}.{name}", f"{place}.{name}")
                    return getattr(module, name)
        raise AttributeError(f"module {old!r} has no attribute {name!r}")

    return find


class _Finder(MetaPathFinder, Loader):
    """Finds the old modules, after all others have been asked."""

    def find_spec(self, fullname: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None, /) -> ModuleSpec | None:
        """The specification of an old module; ``None`` of all others."""
        old = fullname.removeprefix(f"{PACKAGE}.")
        if old == fullname or old not in MOVED:
            return None
        return ModuleSpec(fullname, self, is_package=any(other.startswith(f"{old}.") for other in MOVED))

    def exec_module(self, module: ModuleType) -> None:
        """An empty module whose names come from where they are now."""
        old = module.__name__
        new = f"{PACKAGE}.{MOVED[old.removeprefix(f'{PACKAGE}.')][0]}"
        _warn(old, new)
        module.__doc__ = f"Has moved to ``{new}``; this path goes with the next release."
        vars(module)["__getattr__"] = names_of(old)


def _warn(old: str, new: str) -> None:
    """Warn of the line that uses an old path: the first that is neither here, nor in the package's own file, nor in Python's import."""
    level, frame = 1, sys._getframe()
    own = (__file__, f"{__file__.removesuffix('_moved.py')}__init__.py")
    while frame.f_back is not None and (frame.f_code.co_filename in own or "importlib" in frame.f_code.co_filename):
        level += "_bootstrap" not in frame.f_code.co_filename  # warnings leaves these out by itself
        frame = frame.f_back
    warnings.warn(f"{old} has moved to {new}; the old path goes with the next release", DeprecationWarning, stacklevel=level)


def install() -> None:
    """From now on the old paths can be imported."""
    sys.meta_path.append(_Finder())
