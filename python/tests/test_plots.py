"""The pictures: drawn without a warning from good runs, bad runs and runs cut short, and not blank."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from grasp_columns import DT, FRICTION, GRAVITY, MASS, made_up_grasp, pad_patch
from matplotlib.figure import Figure

from quasirigid import plots

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
        assert (picture != 255).any(axis=2).mean() > 0.02
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


def test_patch_plane_is_upright_and_seen_from_the_finger() -> None:
    pad = pad_patch(0)
    centre, axes = plots.patch_plane(pad["point"], pad["normal"], pad["pressure"])
    np.testing.assert_allclose(centre, [-0.03, 0.0, 0.04], atol=1e-5)
    np.testing.assert_allclose(axes.T @ axes, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(axes[:, 1], [0, 0, 1], atol=1e-12)
