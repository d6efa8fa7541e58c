"""The figures of the summary, on a made-up grasp whose figures are known."""

import json

import numpy as np
import pytest
from grasp_columns import DT, FRICTION, GRAVITY, MASS, SQUEEZE, STEPS, made_up_grasp

from quasirigid.grasp import summary as s
from quasirigid.rotation import conjugate, matrix_of, quaternion_of, quaternion_product, rotate, rotation_angle
from quasirigid.scene.indentation import indentation_note
from quasirigid.units import in_small_units, mass_words, percent, pressure_unit

KEYS = "held object_mass_kg drift_m_per_s spin_rad_per_s contacts residual_max unconverged_steps steps step_ms_median step_ms_p99"
KEYS += " normal_force_n support_error phases"


def summarise(columns: dict) -> dict:
    return s.summarise(columns, dt=DT, mass=MASS, gravity=GRAVITY, friction=FRICTION, stages=["a", "b", "c", "d", "e"])


def test_a_good_grasp() -> None:
    summary = summarise(made_up_grasp())
    assert set(KEYS.split()) <= set(summary)
    assert summary["held"] is True
    assert summary["drift_m_per_s"] < 1e-12
    assert summary["spin_rad_per_s"] < 1e-12
    assert summary["contacts"] == 160
    assert summary["steps"] == sum(STEPS.values())
    assert summary["residual_max"] == 4e-9
    assert summary["unconverged_steps"] == 0
    assert summary["normal_force_n"] == pytest.approx([SQUEEZE, SQUEEZE / 2, SQUEEZE / 2])
    assert summary["support_error"] < 1e-3
    assert summary["slip_margin"] == pytest.approx(1 - MASS * GRAVITY / 2 / (FRICTION * SQUEEZE), abs=1e-3)
    assert [p["name"] for p in summary["phases"]] == list(STEPS)
    assert summary["phases"][0]["start"] == 0.0
    assert all(a["end"] == b["start"] for a, b in zip(summary["phases"], summary["phases"][1:], strict=False))
    assert 0.3 <= summary["step_ms_median"] <= summary["step_ms_p99"] <= 0.35
    json.dumps(summary, allow_nan=False)


@pytest.mark.parametrize("drift", [3e-10, 1e-6, 2e-3])
def test_drift_and_spin_are_read_back(drift: float) -> None:
    summary = summarise(made_up_grasp(drift=drift, spin=10 * drift))
    assert summary["drift_m_per_s"] == pytest.approx(drift, rel=1e-4)
    assert summary["spin_rad_per_s"] == pytest.approx(10 * drift, rel=1e-4)
    assert summary["held"] is (drift < 1e-4)


def test_a_tremble_counts_as_creep() -> None:
    poses = np.tile([0.0, 0, 0, 1, 0, 0, 0], (1001, 1))
    poses[500, 0] = 1e-6
    assert s.creep(poses, 1e-3)[0] == pytest.approx(1e-6)


def test_a_dropped_object_is_not_held() -> None:
    summary = summarise(made_up_grasp(fall=True))
    assert summary["held"] is False
    assert summary["phases"][-1]["name"] == "fall"


def test_a_run_cut_short_has_no_figures_of_the_hold() -> None:
    for steps in (0, 1, 500):
        columns = {name: column[:steps] for name, column in made_up_grasp().items()}
        summary = summarise(columns)
        assert summary["held"] is False
        assert summary["steps"] == steps
        assert summary["drift_m_per_s"] is None
        json.dumps(summary, allow_nan=False)


def test_a_hold_of_one_step_has_no_drift() -> None:
    columns = made_up_grasp()
    hold = np.flatnonzero(columns["phase"] == s.PHASES.index("hold"))
    summary = summarise({name: np.delete(column, hold[1:], axis=0) for name, column in columns.items()})
    assert (summary["drift_m_per_s"], summary["spin_rad_per_s"]) == (None, None)
    assert summary["normal_force_n"] is not None
    json.dumps(summary, allow_nan=False)


def test_unconverged_steps_do_not_count_for_the_residual() -> None:
    columns = made_up_grasp()
    columns["report/converged"][10:12] = 0
    columns["report/residual"][10:12] = 0.5
    summary = summarise(columns)
    assert summary["unconverged_steps"] == 2
    assert summary["residual_max"] == 4e-9


def test_quaternions_agree_with_matrices() -> None:
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=(50, 4)), rng.normal(size=(50, 3))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    from scipy.spatial.transform import Rotation

    r = Rotation.from_quat(q[:, [1, 2, 3, 0]])
    np.testing.assert_allclose(rotate(q, v), r.apply(v), atol=1e-14)
    np.testing.assert_allclose(rotation_angle(q), r.magnitude(), atol=1e-14)
    np.testing.assert_allclose(rotate(quaternion_product(q, conjugate(q)), v), v, atol=1e-14)
    np.testing.assert_allclose(matrix_of(q), r.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(matrix_of(q[0]), matrix_of(q)[0], atol=0.0)
    scipys = np.array([Rotation.from_matrix(matrix).as_quat()[[3, 0, 1, 2]] for matrix in r.as_matrix()])
    np.testing.assert_allclose([quaternion_of(matrix) for matrix in r.as_matrix()], scipys, atol=3e-16)
    assert rotation_angle(np.array([1.0, 1e-12, 0, 0])) == pytest.approx(2e-12)


def test_slip_margin() -> None:
    np.testing.assert_allclose(s.slip_margin(np.array([2.0, 2.0, 0.0]), np.array([0.0, 1.0, 0.0]), 0.5), [1.0, 0.0, 1.0])


def test_figures_next_to_nothing_read_well() -> None:
    told = [in_small_units(value, "m/s") for value in (2.4e-18, 1.04e-9, 3.9e-7, 1.9e-3, 2.0)]
    assert told == ["under 0.001 nm/s", "1.04 nm/s", "390 nm/s", "1.9 mm/s", "2 m/s"]
    told = [in_small_units(value, "N", 2) for value in (0.1123, 0.99999, 1234.0, 2.5e6)]
    assert told == ["110 mN", "1 N", "1.2 kN", "2500 kN"]
    assert [mass_words(kilograms) for kilograms in (0.0131, 1e-5, 0.99999, 5.0)] == ["13.1 g", "10 mg", "1 kg", "5 kg"]
    assert [pressure_unit(pascal) for pascal in (20.0, 1.1e5, 3e6)] == [(1.0, "Pa"), (1e3, "kPa"), (1e6, "MPa")]
    assert (percent(1.7e-14), percent(0.0025)) == ("0.001 %", "0.25 %")


def test_a_pad_pressed_beyond_half_of_its_thickness_is_said() -> None:
    columns = made_up_grasp()
    assert summarise(columns)["indentation_max"] == 0.0
    columns["report/indentation"] = np.linspace(0.0, 0.62, len(columns["time"]))
    assert summarise(columns)["indentation_max"] == pytest.approx(0.62)
    assert indentation_note(None) == indentation_note(0.5) == []
    assert "62 % of its thickness" in indentation_note(0.62)[0]
