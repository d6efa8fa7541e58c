"""The benchmark measures what it says, and its file has the keys that scripts rely on."""

import json
from pathlib import Path

import pytest

from quasirigid.benchmark import timings as bench
from quasirigid.cli.app import main

PHASE_KEYS = {
    "contacts", "traverse_ms", "interpenetration_ms", "hierarchy_update_ms", "w_rigid_ms", "w_deform_ms", "gauss_seidel_ms", "sweeps",
    "total_ms", "total_p99_ms", "residual",
}  # fmt: skip


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "QUICK_STEPS", 40)
    monkeypatch.setattr(bench, "QUICK_CONTACTS", (50, 200))
    monkeypatch.setattr(bench, "QUICK_POINTS", (10_000,))


@pytest.mark.usefixtures("small")
def test_the_file_has_the_phases_and_the_scaling(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bench.json"
    assert main(["bench", "--quick", "--json", str(file)]) == 0
    out, _ = capfd.readouterr()
    assert "paper" in out
    assert "conforming" in out
    results = json.loads(file.read_text())
    assert len(results["phases"]) == 3
    for phase, paper in zip(results["phases"], bench.PAPER, strict=True):
        assert set(phase) >= PHASE_KEYS
        assert set(phase["at_rest"]) >= PHASE_KEYS
        assert abs(phase["contacts"] / paper.contacts - 1.0) < 0.1
        assert phase["residual"] <= 1e-6
        assert phase["unconverged_steps"] == phase["at_rest"]["unconverged_steps"] == 0
        stages = phase["stages_ms"]
        assert phase["traverse_ms"] + phase["interpenetration_ms"] == pytest.approx(stages["collision"], rel=0.2, abs=0.01)
        assert phase["w_rigid_ms"] + phase["w_deform_ms"] == pytest.approx(stages["contact_problem"], rel=0.2, abs=0.01)
    assert results["phases"][2]["paper"]["total_ms"] == pytest.approx(53.26)
    rows = results["scaling"]["contacts"]
    assert [(row["contacts"], row["threads"]) for row in rows] == [(50, 1), (50, 2), (200, 1), (200, 2)]
    growth = results["scaling"]["growth"]
    assert growth["in_motion"] == pytest.approx(rows[2]["us_per_contact"] / rows[0]["us_per_contact"])
    points = results["scaling"]["points"]
    assert [(row["points"], row["threads"]) for row in points] == [(10_000, 1), (10_000, 2)]
    assert all(row["file_of_bare_points_s"] > 0.0 for row in points)
    assert max(map(len, out.splitlines())) <= 100
    assert "…" not in out, "no figure is cut off"


def test_a_file_that_cannot_be_written_is_found_out_before(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--json", "/nowhere/bench.json"]) == 2
    _, err = capfd.readouterr()
    assert "/nowhere/bench.json" in err
