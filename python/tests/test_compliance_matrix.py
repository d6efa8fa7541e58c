"""A compliance of the user's own: what is accepted, what is refused."""

import numpy as np
import pytest

import quasirigid as qr


def test_a_matrix_goes_in_as_it_is_and_comes_out_symmetric() -> None:
    surface = qr.Surface.half_space(0.02, points=200, control_points=20)
    b = np.random.default_rng(0).normal(size=(60, 60))
    matrix = qr.ComplianceMatrix(b @ b.T)
    assert len(matrix) == 20
    assert matrix.asymmetry < 1e-12
    np.testing.assert_allclose(matrix.matrix, b @ b.T, rtol=1e-12, atol=1e-12)
    material = qr.Material.preset("rubber").replace(compliance=matrix)
    assert material.compliance == "matrix"
    assert material.replace(friction=0.3).compliance_matrix is not None
    qr.World().add_body(surface, material, motion="fixed")
    assert surface.control_normals.shape == (20, 3)


@pytest.mark.parametrize(
    ("matrix", "error", "found"),
    [
        (np.eye(4), qr.InvalidShapeError, "(4, 4)"),
        (np.zeros((3, 3, 3)), qr.InvalidShapeError, "(3, 3, 3)"),
        (np.full((3, 3), np.nan), qr.InvalidValueError, "nan"),
        (np.eye(3) + 0.1 * np.eye(3, k=1), qr.InvalidValueError, "1.0e-1"),
        (np.diag([1.0, 1.0, -0.25]), qr.InvalidValueError, "-2.500e-1"),
    ],
)
def test_what_is_no_compliance_is_refused_with_what_was_found(matrix: np.ndarray, error: type[Exception], found: str) -> None:
    with pytest.raises(error) as caught:
        qr.Material.preset("rubber").replace(compliance=matrix)
    assert found in str(caught.value).lower()


def test_a_matrix_for_another_surface_or_for_a_hand_is_refused() -> None:
    material = qr.Material.preset("rubber").replace(compliance=np.eye(30))
    with pytest.raises(qr.InvalidShapeError, match="20 control points"):
        qr.World().add_body(qr.Surface.half_space(0.02, points=200, control_points=20), material, motion="fixed")
    with pytest.raises(qr.InvalidValueError, match="hand"):
        qr.World().add_hand(material=material)
