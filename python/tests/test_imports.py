"""What is imported when: `import quasirigid` costs what NumPy costs, commands load what they need, and the paths of 0.1.0 go on working."""

import ast
import importlib
import pickle
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import quasirigid as qr
from quasirigid._moved import MOVED

PACKAGE = Path(qr.__file__).parent
HEAVY = ("scipy", "trimesh", "matplotlib", "h5py", "viser", "websockets", "PIL", "typer", "rich", "networkx")
"""What takes time to import, and is imported when it is used."""
MOST = 1.5
"""CPU of `import quasirigid` over that of `import numpy`, median of 7."""


def loaded_by(program: str) -> set[str]:
    """The modules that are loaded once a program has run in a process of its own."""
    program += "\nimport sys\nprint('\\n' + ' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, timeout=120, check=True)
    return set(done.stdout.rsplit("\n", 2)[-2].split())


def cpu_of(program: str) -> float:
    program += "\nimport resource\nr = resource.getrusage(resource.RUSAGE_SELF)\nprint(r.ru_utime + r.ru_stime)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    return float(done.stdout)


def test_importing_the_package_loads_nothing_that_takes_time() -> None:
    loaded = loaded_by("import quasirigid") & set(HEAVY)
    assert not loaded, f"import quasirigid loads {', '.join(sorted(loaded))}"
    pairs = [(cpu_of("import quasirigid"), cpu_of("import numpy")) for _ in range(7)]
    ours, numpys = np.median(pairs, axis=0)
    print(f"import quasirigid: {ours:.3f} s of CPU, numpy {numpys:.3f} s, ratio {ours / numpys:.2f} (at most {MOST})")


@pytest.mark.parametrize("module", ["grasp.run", "recording.export", "recording.world_recorder", "mocap.session"])
def test_grasps_recordings_and_sessions_do_not_load_the_page(module: str) -> None:
    loaded = loaded_by(f"import quasirigid.{module}")
    assert not {name for name in loaded if name == "viser" or name.startswith("quasirigid.live")}, "loads the page"


def test_tables_of_a_recording_load_no_matplotlib(tmp_path: Path) -> None:
    world = qr.World()
    world.add_body(qr.Surface.sphere(0.01, points=200), qr.Material.preset("rubber"), mass=0.1)
    with qr.record(world, tmp_path / "run.h5") as recording:
        recording.append(world.step())
    arguments = ["export", str(tmp_path / "run.h5"), "--csv", str(tmp_path / "tables")]
    loaded = loaded_by(f"from quasirigid.cli import main\nassert main({arguments!r}) == 0") & {"matplotlib", "viser", "trimesh"}
    assert not loaded, f"export --csv loads {', '.join(sorted(loaded))}"
    assert (tmp_path / "tables" / "poses.csv").exists()


def test_every_public_name_is_there_and_listed() -> None:
    everything: dict[str, object] = {}
    exec("from quasirigid import *", everything)
    missing = {name for name in qr.__all__ if name not in everything or name not in dir(qr) or not hasattr(qr, name)}
    assert not missing, missing
    assert everything["Recording"] is importlib.import_module("quasirigid.recording").Recording
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = qr.nonsense  # type: ignore[attr-defined]


def test_the_static_imports_name_what_is_imported_when_it_is_used() -> None:
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    static: dict[str, str] = {}
    for node in tree.body:
        if isinstance(node, ast.If):
            for line in node.body:
                assert isinstance(line, ast.ImportFrom)
                assert line.module is not None
                static |= {alias.asname or alias.name: line.module.removeprefix("quasirigid.") for alias in line.names}
    assert static.pop("view") == "view"
    assert static == qr._MODULE_OF  # type: ignore[attr-defined]


def test_values_of_names_that_were_imported_late_can_be_pickled() -> None:
    column = qr.Column("force", (3,), unit="N")
    assert pickle.loads(pickle.dumps(column)) == column
    program = f"import pickle\nassert pickle.loads({pickle.dumps(column)!r}).unit == 'N'"
    assert "quasirigid.recording.reader" in loaded_by(program)


def test_view_is_a_function_and_a_module() -> None:
    import quasirigid.view

    assert quasirigid.view is qr.view
    assert callable(qr.view)
    program = "import quasirigid as qr\nassert callable(qr.view)\nimport quasirigid.view\nassert callable(quasirigid.view)"
    assert not loaded_by(program) & {"viser"}, "only who looks pays for the server"


OLD_NAMES = [
    ("grasp", "Grasp"),
    ("grasp_options", "GraspOptions"),
    ("grasp_plan", "plan_grasp"),
    ("grasp_run", "run_grasp"),
    ("grasp_run", "Page"),
    ("recorder", "Recorder"),
    ("scene_recording", "SceneRecording"),
    ("scene_recording", "SceneRecorder"),
    ("world_recorder", "record"),
    ("world_recorder", "LiveRecorder"),
    ("summary", "summarise"),
    ("summary", "rotate"),
    ("splats", "Camera"),
    ("splats", "shade"),
    ("scene_plot", "save_scene"),
    ("scene_plot", "compose"),
    ("access", "Access"),
    ("view.play", "Play"),
    ("view.server", "LiveView"),
    ("view.render", "render"),
    ("view.export", "export_tables"),
    ("view.export", "window_of"),
    ("view.scene", "SceneModel"),
    ("view.scene", "FloatArray"),
    ("view.pressure", "matrix_of"),
    ("webxr", "XrServer"),
    ("mocap.stream", "open_source"),
    ("mocap.commands", "app"),
]


@pytest.mark.parametrize("old", sorted(MOVED))
def test_import_paths_of_0_1_0_work_and_warn(old: str) -> None:
    assert not (PACKAGE / f"{old.replace('.', '/')}.py").exists(), "nothing has moved"
    names = [name for module, name in OLD_NAMES if module == old]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sys.modules.pop(f"quasirigid.{old}", None) if old != "grasp" else None
        module = importlib.import_module(f"quasirigid.{old}")
        for name in names:
            assert getattr(module, name) is not None
    for new in MOVED[old]:
        importlib.import_module(f"quasirigid.{new}")
    about = [warning for warning in told if warning.category is DeprecationWarning and f"quasirigid.{old}" in str(warning.message)]
    assert about, f"import quasirigid.{old} says nothing"
    assert all(Path(warning.filename) == Path(__file__) for warning in about if "importlib" not in warning.filename), about[0].filename
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        module.nonsense  # noqa: B018


def test_old_paths_are_attributes_of_the_package_too() -> None:
    sys.modules.pop("quasirigid.summary", None)
    vars(qr).pop("summary", None)
    with pytest.warns(DeprecationWarning, match=r"quasirigid.summary has moved to quasirigid.grasp.summary") as told:
        _ = qr.summary  # type: ignore[attr-defined]
    assert told[0].filename == __file__
