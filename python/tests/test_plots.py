"""The pictures: drawn without a warning from good runs, bad runs and runs cut short, and not blank."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from grasp_columns import DT, FRICTION, GRAVITY, MASS, made_up_grasp, pad_patch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from quasirigid.grasp.figures import plots
from quasirigid.units import force_words, mass_words, short_name

FINGERS = ["thumb", "index", "middle"]


def drawn(figure: Figure, path: Path) -> np.ndarray:
    figure.savefig(path)
    return np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]


def texts(figure: Figure) -> str:
    return " | ".join(t.get_text() for axes in figure.axes for t in [*axes.texts, axes.xaxis.label, axes.yaxis.label, axes.title])


@pytest.mark.parametrize("steps", [0, 1, 500, None])
@pytest.mark.parametrize("fall", [False, True])
def test_time_plots_of_any_run(tmp_path: Path, fall: bool, steps: int | None) -> None:
    columns: dict[str, Any] = {name: column[:steps] for name, column in made_up_grasp(fall=fall).items()}
    for figure in (
        plots.forces(columns, FINGERS, dt=DT, weight=MASS * GRAVITY, friction=FRICTION, subtitle="a box"),
        plots.motion(columns, dt=DT, subtitle="a box"),
    ):
        picture = drawn(figure, tmp_path / "plot.png")
        assert picture.shape == (1050, 1350, 3)
        # Of no step at all there are words alone, without axes.
        assert (picture != 255).any(axis=2).mean() > (0.01 if steps == 0 else 0.02)
        assert "time (s)" in texts(figure)
        if steps is None:
            assert "squeeze" in texts(figure)


def test_patches_name_units_and_slip(tmp_path: Path) -> None:
    pads = [pad_patch(0), pad_patch(1, slipping=True)]  # the third finger does not touch
    rows = {key: np.concatenate([pad[key] for pad in pads]) for key in pads[0]}
    figure = plots.patches(rows, FINGERS)
    drawn(figure, tmp_path / "patches.png")
    said = texts(figure)
    for words in ("across (mm)", "up (mm)", "pressure (kPa)", "presses with 4.00 N", "presses with 2.00 N", "no contact"):
        assert words in said
    n = len(pads[1]["gap"])
    assert f"{n} contacts, {n} of them slip" in said
    for axes in figure.axes[:3]:
        assert axes.get_aspect() == 1.0


def ticks(axes: Axes) -> list[str]:
    return [label.get_text() for label in axes.get_yticklabels() if label.get_text()]


@pytest.mark.parametrize("steps", [0, 500])
def test_panels_without_data_have_no_axis_and_say_so(steps: int, tmp_path: Path) -> None:
    columns: dict[str, Any] = {name: column[:steps] for name, column in made_up_grasp().items()}
    columns["hand/normal_force"] = np.zeros((steps, 3))
    figures = [
        plots.forces(columns, FINGERS, dt=DT, weight=MASS * GRAVITY, friction=FRICTION),
        plots.motion(columns, dt=DT),
        plots.patches({key: rows[:0] for key, rows in pad_patch(0).items()}, FINGERS),
    ]
    for figure in figures:
        drawn(figure, tmp_path / "plot.png")
        # The object's height is known after one step, whatever became of it.
        known = 1 if steps and "rise" in texts(figure) else 0
        for axes in figure.axes[known:]:
            assert ticks(axes) == [], f"{axes.get_ylabel()!r} has figures though there are no data: {ticks(axes)}"
            assert any("no " in text.get_text() or "ended" in text.get_text() for text in axes.texts), axes.get_ylabel()


def test_force_and_friction_of_a_finger_are_the_same_in_patches_and_in_the_recorded_columns(tmp_path: Path) -> None:
    pad = pad_patch(0)
    rng = np.random.default_rng(3)
    pad["normal"] = pad["normal"] + 0.4 * rng.standard_normal(pad["normal"].shape)  # a patch around an edge
    pad["normal"] /= np.linalg.norm(pad["normal"], axis=1, keepdims=True)
    press = np.einsum("ij,ij->i", pad["force"], pad["normal"])
    press[press < 0.0] = 0.0
    pad["force"] = press[:, None] * pad["normal"] + 0.02 * np.cross(pad["normal"], rng.standard_normal(pad["normal"].shape))
    pressing = (press[:, None] * pad["normal"]).sum(axis=0)
    friction = np.linalg.norm(pad["force"].sum(axis=0) - pressing)  # the definition of the column hand/tangential_force
    figure = plots.patches(pad, FINGERS, time=1.5)
    drawn(figure, tmp_path / "patches.png")
    expected = f"presses with {press.sum():.2f} N, friction {force_words(friction)}"
    assert expected in texts(figure), texts(figure)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 30.0, 1e4])
def test_labels_of_patches_have_no_exponent_at_any_scale_and_stay_in_the_picture(tmp_path: Path, scale: float) -> None:
    pads = [pad_patch(0), pad_patch(1, slipping=True)]
    rows = {key: np.concatenate([pad[key] for pad in pads]) for key in pads[0]}
    rows |= {"force": scale * rows["force"], "pressure": scale * rows["pressure"]}
    subtitle = f"{short_name('a_scan_of_$something$_with_a_name_that_goes_on_and_on_and_on')}, {mass_words(1.31e-5)}"
    figure = plots.patches(rows, FINGERS, time=4.2, subtitle=subtitle)
    picture = drawn(figure, tmp_path / "patches.png")
    words = [*figure.texts, *figure.legends[0].get_texts(), *(t for axes in figure.axes for t in [*axes.texts, axes.yaxis.label])]
    for text in words:
        assert not re.search(r"\de[+-]\d", text.get_text()), text.get_text()
        box = text.get_window_extent()
        inside = box.x0 >= 0 and box.y0 >= 0 and box.x1 <= picture.shape[1] and box.y1 <= picture.shape[0]
        assert inside, f"{text.get_text()!r} leaves the picture: {box}"


def test_motion_is_labelled_in_metres_and_radians_with_prefixes(tmp_path: Path) -> None:
    figure = plots.motion(made_up_grasp(drift=3e-9, spin=2e-7), dt=DT)
    drawn(figure, tmp_path / "motion.png")
    for axes, unit in zip(figure.axes[1:], ("m", "rad"), strict=True):
        assert len(ticks(axes)) >= 2, ticks(axes)
        for label in ticks(axes):
            assert re.fullmatch(rf"\d+ [afpnµm]?{unit}", label), label


def test_patch_plane_is_upright_and_seen_from_the_finger() -> None:
    pad = pad_patch(0)
    centre, axes = plots.patch_plane(pad["point"], pad["normal"], pad["pressure"])
    np.testing.assert_allclose(centre, [-0.03, 0.0, 0.04], atol=1e-5)
    np.testing.assert_allclose(axes.T @ axes, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(axes[:, 1], [0, 0, 1], atol=1e-12)
