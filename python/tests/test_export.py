"""Tables out of a recording: tidy, with units in the names, and with the recording's own figures."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from recorded import record_pinch

import quasirigid as qr
from quasirigid.cli.app import main
from quasirigid.errors import InvalidValueError, MissingPackageError
from quasirigid.recording import export, window
from quasirigid.recording.export import export_tables
from quasirigid.recording.export_rerun import export_rerun
from quasirigid.recording.scene_recording import SceneRecording

STEPS = 200
WITHOUT_UNIT = {"step", "phase", "contacts", "sweeps", "residual", "converged", "coarse", "quarantined", "frame", "finger", "status"}
WITHOUT_UNIT |= {
    "body_a",
    "body_b",
    "collider_a",
    "collider_b",
    "control_point",
    "normal_x",
    "normal_y",
    "normal_z",
    "qw",
    "qx",
    "qy",
    "qz",
}
UNITS = ("_s", "_m", "_n", "_rad", "_pa", "_m2")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.h5"
    record_pinch(path, STEPS)
    return path


def read(path: Path) -> dict[str, list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return {name: [row[i] for row in rows[1:]] for i, name in enumerate(rows[0])}


def test_csv_holds_every_step_pose_finger_and_contact(run: Path, tmp_path: Path) -> None:
    paths = export_tables(run, tmp_path, "csv")
    assert [path.name for path in paths] == ["steps.csv", "poses.csv", "fingers.csv", "contacts.csv"]
    tables = {path.stem: read(path) for path in paths}
    for name, table in tables.items():
        assert {"step", "time_s"} <= set(table), name
        for column in table:
            assert column in WITHOUT_UNIT or column.endswith(UNITS), f"{name}.{column} has no unit"
    with SceneRecording(run) as recording:
        frames, model = recording.columns.labels("frames/pose"), recording.model
        ends = recording.columns["contacts/end"]
        assert ends[-1] > 1000
        assert [len(tables[name]["step"]) for name in tables] == [STEPS, STEPS * len(frames), STEPS * 3, ends[-1]]
        k = STEPS - 3
        state = recording.state(k)
        steps, poses, fingers, contacts = tables.values()
        np.testing.assert_array_equal(np.array(steps["time_s"], float), recording.times)
        assert steps["phase"][k] == state.phase
        assert int(steps["contacts"][k]) == len(state.contacts)
        box = [i for i, (s, f) in enumerate(zip(poses["step"], poses["frame"], strict=True)) if (s, f) == (str(k), "box")]
        assert [float(poses[f"{axis}_m"][box[0]]) for axis in "xyz"] == state.positions[0].tolist()
        thumb = 3 * k
        assert fingers["finger"][thumb] == "thumb"
        assert float(fingers["normal_force_n"][thumb]) == pytest.approx(state.normal_forces[0], rel=1e-6)
        assert float(fingers["joint_2_rad"][thumb]) == state.joint_positions[0, 2]
        rows = slice(ends[k - 1], ends[k])
        np.testing.assert_array_equal(np.array(contacts["pressure_pa"][rows], "f4"), state.contacts.pressures.astype("f4"))
        np.testing.assert_array_equal(np.array(contacts["force_on_a_y_n"][rows], "f4"), state.contacts.forces[:, 1].astype("f4"))
        names = [body.name for body in model.bodies]
        assert contacts["body_a"][rows] == [names[i] for i in state.contacts.body_a]
        assert contacts["status"][rows] == [("open", "stick", "slip")[i] for i in state.contacts.status]


def test_every_and_the_time_window_choose_steps(run: Path, tmp_path: Path) -> None:
    export_tables(run, tmp_path, "csv", every=7, start=0.1, end=0.2)
    chosen = read(tmp_path / "steps.csv")["step"]
    assert [int(step) for step in chosen] == list(range(49, 100, 7))
    assert set(read(tmp_path / "contacts.csv")["step"]) <= set(chosen)
    for wrong in ({"every": 0}, {"start": 3.0, "end": 2.0}, {"start": 1e3}):
        with pytest.raises(InvalidValueError):
            export_tables(run, tmp_path, "csv", **wrong)  # type: ignore[arg-type]


def test_parquet_holds_the_same(run: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    export_tables(run, tmp_path, "csv", every=9)
    for path in export_tables(run, tmp_path, "parquet", every=9):
        table, text = parquet.read_table(path), read(path.with_suffix(".csv"))
        assert table.column_names == list(text)
        assert table.num_rows == len(text["step"]) > 0
        for name in table.column_names:
            values = table[name].to_pylist()
            if isinstance(values[0], str):
                assert values == text[name]
            else:
                np.testing.assert_allclose(np.array(values, float), np.array(text[name], float), rtol=1e-8)


def test_parquet_begins_without_contacts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    world = qr.World()
    rubber = qr.Material.preset("rubber")
    world.add_body(qr.Surface.half_space(0.1, points=1_000), rubber, motion="fixed", name="floor")
    world.add_body(qr.Surface.sphere(0.02, points=500), rubber, mass=0.05, position=(0, 0, 0.022), name="ball")
    with qr.record(world, tmp_path / "fall.h5") as recording:
        for _ in range(40):
            recording.append(world.step())
    monkeypatch.setattr(window, "BLOCK", 5)
    for end, some in ((None, True), (0.005, False)):
        path = export_tables(tmp_path / "fall.h5", tmp_path, "parquet", end=end)[-1]
        table = parquet.read_table(path)
        assert [str(table.schema.field(name).type) for name in ("body_a", "status")] == ["string", "string"]
        assert (table.num_rows > 0) is some
        assert set(table["status"].to_pylist()) <= {"open", "stick", "slip"}


def test_tables_do_not_depend_on_how_they_are_read(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = export_tables(run, tmp_path / "a", "csv", every=3)
    monkeypatch.setattr(export, "READ", 50)
    for one, other in zip(whole, export_tables(run, tmp_path / "b", "csv", every=3), strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_the_time_before_the_first_step_is_part_of_the_recording(run: Path, tmp_path: Path) -> None:
    export_tables(run, tmp_path, "csv", end=0.0)
    assert read(tmp_path / "steps.csv")["step"] == ["0"]
    with pytest.raises(InvalidValueError, match=r"expected a time within the recording, 0 to 0\.4 s"):
        export_tables(run, tmp_path, "csv", end=-0.1)


def test_rerun_gets_the_scene(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    (path,) = export_rerun(run, tmp_path / "run.rrd", start=0.2)
    data = path.read_bytes()
    assert data[:3] == b"RRF"
    assert len(data) > 100_000


@pytest.mark.parametrize(("package", "kind"), [("pyarrow.parquet", "parquet"), ("rerun", "rerun")])
def test_missing_package_is_said_with_the_command(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, kind: str
) -> None:
    monkeypatch.setitem(__import__("sys").modules, package, None)
    with pytest.raises(MissingPackageError, match=f"pip install 'quasirigid\\[{kind}\\]'"):
        if kind == "parquet":
            export_tables(run, tmp_path / "out", "parquet")
        else:
            export_rerun(run, tmp_path / "out.rrd")
    assert list(tmp_path.iterdir()) == []


def test_command_line(run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(run), "--csv", str(tmp_path / "t"), "--every", "50", "--json"]) == 0
    out = json.loads(capfd.readouterr().out)
    assert [Path(file).name for file in out["files"]] == ["steps.csv", "poses.csv", "fingers.csv", "contacts.csv"]
    assert out["bytes"] == sum(Path(file).stat().st_size for file in out["files"])
    assert main(["export", str(run)]) == 2
    assert "--csv DIR" in capfd.readouterr().err
    (tmp_path / "file").write_text("in the way")
    assert main(["export", str(run), "--parquet", str(tmp_path / "file")]) == 2
    err = capfd.readouterr().err
    assert "File exists; choose another with --parquet" in err
    assert err.count("\n") == 1
    assert main(["export", str(tmp_path / "none.h5"), "--csv", str(tmp_path)]) == 2
    assert "no such file" in capfd.readouterr().err
