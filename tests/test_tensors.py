"""Rows of numbers stand for tensors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mpm_fenicsx.common import tensors

rng = np.random.default_rng(1)


def full(rows):
    """Stress rows as 3×3 tensors, written out."""
    out = np.zeros((len(rows), 3, 3))
    for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)][: rows.shape[1]]):
        out[:, i, j] = out[:, j, i] = rows[:, k]
    return out


@pytest.mark.parametrize("dim", [2, 3])
def test_row_product_is_the_work_of_the_tensors(dim):
    gradient = rng.normal(size=(20, dim, dim))
    stress = rng.normal(size=(20, tensors.components(dim)))
    work = np.einsum("nij,nij->n", full(stress)[:, :dim, :dim], gradient)
    np.testing.assert_allclose(
        (stress * tensors.strain(gradient)).sum(axis=1), work, rtol=0, atol=1e-14
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_a_small_rotation_strains_nothing(dim):
    gradient = rng.normal(size=(20, dim, dim))
    assert np.all(tensors.strain(gradient - gradient.transpose(0, 2, 1)) == 0.0)


@pytest.mark.parametrize("dim", [2, 3])
def test_matrix_holds_the_in_plane_stress(dim):
    stress = rng.normal(size=(20, tensors.components(dim)))
    assert np.array_equal(tensors.matrix(stress, dim), full(stress)[:, :dim, :dim])


@pytest.mark.parametrize("dim", [2, 3])
def test_invariants_do_not_see_a_rotation_or_its_axes(dim):
    stress = rng.normal(size=(20, tensors.components(dim)))
    turn = Rotation.from_euler("zyx", [0.7, 0.0, 0.0] if dim == 2 else [0.7, -0.4, 1.9]).as_matrix()
    turned = np.einsum("ij,njk,lk->nil", turn, full(stress), turn)
    rows = np.stack(
        [turned[:, i, j] for i, j in [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]], 1
    )
    rows = rows[:, : stress.shape[1]]
    np.testing.assert_allclose(tensors.von_mises(rows), tensors.von_mises(stress), rtol=1e-12)
    np.testing.assert_allclose(tensors.mean(rows), tensors.mean(stress), rtol=0, atol=1e-14)


def test_von_mises_of_known_states():
    uniaxial, shear, pressure = [-3.0, 0, 0, 0], [0, 0, 0, 2.0], [5.0, 5.0, 5.0, 0]
    q = tensors.von_mises(np.array([uniaxial, shear, pressure]))
    np.testing.assert_allclose(q, [3, 2 * np.sqrt(3), 0], rtol=1e-12)


def test_out_of_plane_stress_counts():
    q = tensors.von_mises(np.array([[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 1.0, 0.0]]))
    np.testing.assert_allclose(q, [1, 0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("dim", [2, 3])
def test_stretch_is_the_determinant(dim):
    gradient = np.random.default_rng(5).normal(size=(7, dim, dim))
    np.testing.assert_allclose(
        tensors.stretch(gradient), np.linalg.det(np.eye(dim) + gradient), rtol=1e-12
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_the_cofactor_is_the_derivative_of_the_determinant(dim):
    gradient = np.random.default_rng(7).normal(0.0, 0.4, (5, dim, dim))
    step = 1e-6
    for i in range(dim):
        for j in range(dim):
            there, back = gradient.copy(), gradient.copy()
            there[:, i, j] += step
            back[:, i, j] -= step
            slope = (tensors.stretch(there) - tensors.stretch(back)) / (2 * step)
            np.testing.assert_allclose(
                tensors.cofactor(gradient)[:, i, j], slope, rtol=0, atol=1e-9
            )
