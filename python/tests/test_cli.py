"""The command line as a user meets it: results on standard output, errors in one line, exit codes."""

import json
import logging
import os
import signal
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from quasirigid.cli.app import main
from quasirigid.cli.option_groups import GraspChoice
from quasirigid.errors import QuasirigidError
from quasirigid.grasp.experiment import Grasp
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.summary import PHASES
from quasirigid.recording.reader import Recording
from quasirigid.render.fonts import quiet_fonts

QUICK = ["--points", "4000", "--hold", "1"]
SUMMARY_KEYS = {
    "held", "object_mass_kg", "drift_m_per_s", "spin_rad_per_s", "contacts", "residual_max", "unconverged_steps", "steps",
    "step_ms_median", "step_ms_p99", "normal_force_n", "support_error", "phases",
}  # fmt: skip


def test_the_command_line_has_an_option_for_every_choice_of_a_grasp_with_its_default() -> None:
    chosen, library = GraspChoice(), GraspOptions()
    assert {field.name for field in fields(chosen)} | {"hold"} == {field.name for field in fields(library)}
    assert chosen.options() == library


def test_grasp_holds_the_box_and_leaves_its_files(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["grasp", *QUICK, "--json", "--out", str(tmp_path)]) == 0
    out, err = capfd.readouterr()
    summary = json.loads(out)
    assert err == ""
    assert set(summary) >= SUMMARY_KEYS
    assert summary["held"] is True
    assert summary["drift_m_per_s"] < 1e-9
    assert summary["spin_rad_per_s"] < 1e-8
    assert summary["residual_max"] <= 1e-6
    assert summary["unconverged_steps"] == 0
    assert summary["support_error"] < 0.005
    assert len(summary["normal_force_n"]) == 3
    assert [phase["name"] for phase in summary["phases"]] == list(PHASES[:-1])
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
    for name in ("forces.png", "motion.png", "patches.png"):
        assert (tmp_path / name).stat().st_size > 20_000
    with Recording(tmp_path / "recording.h5") as recording:
        assert recording.complete
        assert recording.steps == summary["steps"]


def test_too_slippery_is_a_result_not_an_error(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["grasp", *QUICK, "--friction", "0.05", "--out", str(tmp_path)]) == 0
    out, err = capfd.readouterr()
    assert "dropped" in out
    assert "Traceback" not in out + err
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["held"] is False
    assert summary["phases"][-1]["name"] == "fall"


def test_too_heavy_for_the_squeeze_slips(tmp_path: Path) -> None:
    assert main(["grasp", *QUICK, "--mass", "5", "--json", "--out", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "summary.json").read_text())["held"] is False


def test_points_too_far_apart_for_a_fingertip_are_told_of() -> None:
    assert "mm apart" in Grasp(GraspOptions(points=200)).notes[0]
    assert not Grasp(GraspOptions(points=2000)).notes


@pytest.mark.parametrize("choice", [["--compliance", "half-space"], ["--object-motion", "quasi-static"]], ids=" ".join)
def test_every_model_holds_the_box(tmp_path: Path, choice: list[str]) -> None:
    assert main(["grasp", "--points", "2000", "--hold", "1", *choice, "--json", "--out", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["held"] is True
    assert summary["drift_m_per_s"] < 1e-9
    assert summary["unconverged_steps"] == 0


@pytest.mark.parametrize("name", ["banana.ply", "cloud.npy"])
def test_objects_from_files(tmp_path: Path, name: str) -> None:
    import trimesh

    bar = trimesh.creation.capsule(height=0.08, radius=0.018).apply_transform(trimesh.transformations.rotation_matrix(1.5708, [0, 1, 0]))
    if name.endswith(".ply"):
        bar.export(tmp_path / name)
    else:
        np.save(tmp_path / name, np.asarray(trimesh.sample.sample_surface_even(bar, 6000, seed=0)[0]))
    out = tmp_path / "out"
    assert main(["grasp", "--object", str(tmp_path / name), "--points", "4000", "--hold", "1", "--json", "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["held"] is True
    assert summary["drift_m_per_s"] < 1e-9


@pytest.mark.parametrize(("size", "says"), [("0.3", "mm"), ("0.004", "mm")])
def test_object_that_does_not_fit_the_hand(tmp_path: Path, capfd: pytest.CaptureFixture[str], size: str, says: str) -> None:
    import trimesh

    trimesh.creation.icosphere(subdivisions=4, radius=0.5).export(tmp_path / "ball.obj")
    assert main(["grasp", "--object", str(tmp_path / "ball.obj"), "--size", size, "--points", "2000", "--out", str(tmp_path / "out")]) == 2
    assert says in capfd.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--mass", "-1"], "mass: expected a finite number > 0 (kg), got -1.0"),
        (["--mass", "nan"], "got nan"),
        (["--mass", "heavy"], "--mass"),
        (["--friction", "-0.5"], "friction"),
        (["--friction", "inf"], "friction"),
        (["--material", "cheese"], "fingertip_pulp"),
        (["--object", "no-such-file.obj"], "no-such-file.obj"),
        (["--points", "0"], "points"),
        (["--points", "4000000000"], "5000000"),
        (["--threads", "0"], "threads"),
        (["--dt", "0"], "dt"),
        (["--hold", "nan"], "hold"),
        (["--squeeze", "0"], "squeeze"),
        (["--size", "0.1"], "--object"),
        (["--compliance", "jelly"], "half-space"),
        (["--seed", "-1"], "seed"),
        (["--frictoin", "1"], "--friction); see `quasirigid grasp --help`"),
        (["--port", "9000"], "add --view"),
        (["--no-browser"], "--no-browser: expected --view beside it"),
        (["--points", "2000", "--view", "--no-browser", "--port", "0"], "1 to 65535"),
    ],
    ids=" ".join,
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], says: str) -> None:
    assert main(["grasp", *arguments, "--out", str(tmp_path / "out")]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1, err
    assert says in err
    assert not (tmp_path / "out").exists(), "bad input must leave nothing behind"


def test_output_that_cannot_be_written(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("in the way")
    assert main(["grasp", *QUICK, "--out", str(tmp_path / "file")]) == 2
    assert "--out" in capfd.readouterr().err


def test_help_version_and_materials(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capfd.readouterr().out.startswith("quasirigid ")
    assert main(["grasp", "--help"]) == 0
    text = capfd.readouterr().out
    for option in ("--object", "--friction", "--squeeze", "--compliance", "--object-motion", "--json", "--out", "Examples"):
        assert option in text
    assert main(["materials"]) == 0
    assert "fingertip_pulp" in capfd.readouterr().out
    assert main(["no-such-command"]) == 2


@pytest.mark.parametrize(("command", "most"), [("grasp", 60), ("mocap grasp", 90), ("view", 60)])
def test_help_fits_a_few_screens_and_begins_with_examples(
    command: str, most: int, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main([*command.split(), "--help"]) == 0
    text = capfd.readouterr().out
    assert text.index("Examples") < text.index("--help"), "the options come first"
    assert "dim]" not in text, "markup is shown"
    lines = len(text.splitlines())
    assert lines <= most, f"{command} --help: {lines} lines of 80 columns, at most {most}"


def steps_on_disk(path: Path) -> int:
    """Steps that a running job has written so far."""
    try:
        with Recording(path) as recording:
            return recording.steps
    except QuasirigidError:
        return 0  # not there yet, or not complete


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_run_keeps_its_files(tmp_path: Path, number: int, code: int) -> None:
    command = [sys.executable, "-m", "quasirigid.cli", "grasp", *QUICK, "--hold", "1000", "--out", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and steps_on_disk(tmp_path / "recording.h5") < 100:
            time.sleep(0.1)
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert process.returncode == code
    assert "interrupted" in err
    assert "Traceback" not in err
    with Recording(tmp_path / "recording.h5") as recording:
        assert recording.steps >= 100  # a block of the file at least
        assert not recording.complete
    assert json.loads((tmp_path / "summary.json").read_text())["interrupted"] is True


def test_a_first_run_with_json_says_nothing_on_standard_error(tmp_path: Path) -> None:
    # matplotlib makes its list of fonts anew, and would talk about it.
    environment = {**os.environ, "MPLCONFIGDIR": str(tmp_path / "matplotlib")}
    command = [
        sys.executable,
        "-m",
        "quasirigid.cli",
        "grasp",
        "--points",
        "2000",
        "--hold",
        "0.2",
        "--json",
        "--out",
        str(tmp_path / "out"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["steps"] > 0


def test_only_the_talk_about_fonts_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    quiet_fonts()
    log = logging.getLogger("matplotlib.font_manager")
    log.warning("findfont: Font family ['cmr10'] not found. Falling back to DejaVu Sans.")
    log.warning("Matplotlib is building the font cache; this may take a moment.")
    log.warning("something else")
    logging.getLogger("mine").warning("findfont: mine")
    assert caplog.messages == ["something else", "findfont: mine"]
