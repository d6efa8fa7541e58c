"""A finite-element block, condensed to its surface, agrees in its middle with the half-space model and with Hertz."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from quasirigid.pads.elements import stiffness
from quasirigid.pads.mesh import pad_mesh


@pytest.fixture(scope="module")
def example() -> ModuleType:
    path = Path(__file__).parents[1] / "examples" / "condensed_block.py"
    spec = importlib.util.spec_from_file_location("condensed_block", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["condensed_block"] = module
    spec.loader.exec_module(module)
    return module


def test_a_block_agrees_with_the_half_space_in_its_middle(example: ModuleType) -> None:
    found = example.compare(8.0)
    assert found.dent < 0.01, f"dent under a Hertz pressure off by {found.dent:.2%} of its depth"
    assert found.force_ratio == pytest.approx(1.0, abs=0.02), f"force {found.force_ratio:.4f} of the half-space's"
    assert found.pressure_error < 0.03, f"pressure off by {found.pressure_error:.2%} of the peak"


def test_the_deeper_the_block_the_nearer_it_comes_to_hertz(example: ModuleType) -> None:
    found = [example.compare(depth, steps=4) for depth in (4.0, 8.0)]
    shallow, deep = (c.held_back * c.force / example.DEPTH for c in found)
    assert 0 < deep < 0.6 * shallow, f"held back {shallow:.3f} and {deep:.3f} of the depth"
    excess = [c.force / example.hertz_force() - 1 for c in found]
    assert 0 < excess[1] < 0.6 * excess[0], f"force above Hertz's by {excess[0]:.3f} and {excess[1]:.3f}"


def test_a_condensed_block_is_symmetric_and_a_uniform_stretch_is_exact(example: ModuleType) -> None:
    block = example.Quarter.graded(8 * example.CONTACT_RADIUS, 4)
    # Patch test: u = strain x is in equilibrium, so no inner node of the quarter feels a force, bubbles or not.
    x, y, z = np.meshgrid(block.x, block.y, block.z, indexing="ij")
    stretch = np.array([[1.0, 0.3, -0.2], [0.3, -0.5, 0.4], [-0.2, 0.4, 0.7]])
    u = np.stack([x, y, z], axis=-1) @ stretch
    mesh = pad_mesh(block.points(), block.bricks(), fixed=[])
    force = (stiffness(mesh, 1e6, 0.3) @ u.ravel()).reshape(u.shape)
    inner = np.abs(force[1:-1, 1:-1, 1:-1]).max() / np.abs(force).max()
    assert inner < 1e-12, f"inner nodes feel {inner:.1e} of the largest force"
    matrix = example.condensed(block, example.top_surface(4), 1e6, 0.3)
    assert np.abs(matrix - matrix.T).max() < 1e-12 * np.abs(matrix).max()
    assert np.linalg.eigvalsh(matrix).min() > 0
