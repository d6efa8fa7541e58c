"""The comparison with other engines: what it measures is right, and a pinched capsule does not creep in ours."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PEERS = Path(__file__).parents[2] / "benchmarks" / "peers"


@pytest.fixture
def peers(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Imports a module of the comparison by name."""
    monkeypatch.syspath_prepend(PEERS)
    return importlib.import_module


class CoulombBox:
    """A box between two pads, in closed form: it slides when weight and pull exceed 2 mu N, and creeps and turns at given speeds."""

    def __init__(self, scene: Any, dt: float, friction: float, creep: float = 0.0, spin: float = 0.0) -> None:
        self.scene, self.dt, self.friction, self.creep, self.spin = scene, dt, friction, creep, spin
        self.z = self.speed = self.load = self.time = 0.0

    def step(self) -> None:
        spare = self.scene.WEIGHT + self.load - 2.0 * self.friction * self.scene.SQUEEZE
        self.speed = max(self.speed + spare / self.scene.BOX_MASS * self.dt, 0.0)
        self.time += self.dt
        self.z -= (self.speed + self.creep) * self.dt

    def pull(self, newton: float) -> None:
        self.load = newton

    def height(self) -> float:
        return self.z

    def angle(self) -> float:
        return float(np.angle(np.exp(1j * self.spin * self.time)))

    def squeeze(self) -> float:
        # A sliding point contact flickers: nothing, then twice the force.
        return float(self.scene.SQUEEZE * (2.0 * (round(self.time / self.dt) % 2) if self.speed else 1.0))

    def contacts(self) -> int:
        return 2


@pytest.mark.parametrize("dt", [1e-3, 1e-2])
@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_slip_threshold_of_an_exact_coulomb_box_is_its_friction(peers: Any, dt: float, friction: float) -> None:
    figures = peers("measures").slip(CoulombBox(peers("scene"), dt, friction), dt)
    assert figures["slip_ratio"] == pytest.approx(friction, rel=1e-2), figures
    assert not figures["slips_under_its_weight"]


def test_box_too_slippery_for_its_weight_is_said_to_be(peers: Any) -> None:
    assert peers("measures").slip(CoulombBox(peers("scene"), 1e-3, 0.2), 1e-3)["slips_under_its_weight"]


def test_creep_and_turn_are_measured_as_they_are(peers: Any) -> None:
    measures, scene = peers("measures"), peers("scene")
    figures = measures.hold(CoulombBox(scene, 1e-3, 0.8, creep=3e-6), 1e-3, 1.0)
    assert figures["creep_m_per_s"] == pytest.approx(3e-6, rel=1e-6)
    assert figures["fell_at_s"] is None
    assert measures.hold(CoulombBox(scene, 1e-3, 0.8, creep=0.1), 1e-3, 1.0)["fell_at_s"] == pytest.approx(0.3, abs=2e-3)
    turned = measures.twist(CoulombBox(scene, 1e-3, 0.8, spin=2.0), 1e-3, 5.0)
    assert turned["angle_deg"] == pytest.approx(np.degrees(10.0), rel=1e-9)
    assert turned["rate_deg_per_s"] == pytest.approx(np.degrees(2.0), rel=1e-9)


@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_pinched_capsule_does_not_creep(peers: Any, dt: float) -> None:
    """google-deepmind/mujoco issue 3328: 45 g, radius 4 mm, mu 0.7, pads on position actuators that squeeze 2 mm past first contact."""
    scene = peers("scene")
    simulation = peers("ours").OurCapsule(dt)
    simulation.run(2.0)
    body = simulation.capsule
    position, turn = np.array(body.position), np.array(body.quaternion)
    simulation.run(1.0)
    drift = float(np.linalg.norm(body.position - position))
    spin = 2.0 * float(np.linalg.norm(body.quaternion - turn))
    squeeze = simulation.squeeze()
    assert drift < 1e-9, f"{drift:.2e} m/s"
    assert spin < 1e-8, f"{spin:.2e} rad/s"
    # It is held by what the actuators give, 12 N less what the pads yield, and hangs where it was taken.
    full = scene.CAPSULE_STIFFNESS * scene.CAPSULE_PAST_CONTACT
    assert 0.9 * full < squeeze < full, f"{squeeze} N of {full} N"
    assert abs(body.position[2]) < 2e-4, f"at {body.position[2]} m"


def test_quick_comparison_runs_without_peers(peers: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- compare.py -->\nold\n<!-- end -->\nafter\n")
    kept = tmp_path / "figures.json"
    peers("compare").main(["--quick", "--only", "quasirigid", "--json", str(kept), "--write", str(page)])
    text = page.read_text()
    assert text.startswith("before\n<!-- compare.py -->\nquasirigid")
    assert text.endswith("|\n<!-- end -->\nafter\n")
    assert capsys.readouterr().out.strip() in text
    row = json.loads(kept.read_text())["results"][0]
    assert abs(row["creep_m_per_s"]) < 1e-9
    assert abs(row["slip_error"]) < 0.01
    assert 50 <= row["contacts"] <= 75
    assert row["cpu_ms"] > 0.0


def test_engine_that_is_missing_gets_a_row_that_says_so(peers: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    compare, tables = peers("compare"), peers("tables")
    monkeypatch.setitem(compare.ENGINES, "mujoco", ("no_such_module", "X", "Y"))
    installed = compare.load(["mujoco"])
    assert not installed
    effort = peers("measures").QUICK
    wanted = [c for c in compare.QUICK if c.engine == "mujoco"]
    rows = compare.run(wanted, installed, effort, 1)
    capsule = compare.run_capsule(installed, effort, [c for c in compare.CAPSULE if c.engine == "mujoco"][:1])
    text = tables.markdown(rows, capsule, "about")
    assert text.count("not installed") == 2


def test_page_without_markers_is_refused_untouched(peers: Any, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("nothing here\n")
    with pytest.raises(SystemExit, match="markers"):
        peers("compare").write(page, "text")
    assert page.read_text() == "nothing here\n"
