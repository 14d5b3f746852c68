"""Linear elasticity against its definitions."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpm_fenicsx import LinearElastic
from mpm_fenicsx.common import tensors

soils = st.builds(LinearElastic, st.floats(1e3, 1e9), st.floats(-0.9, 0.49), st.floats(100, 3000))
few = settings(max_examples=30, deadline=None)
rng = np.random.default_rng(2)


@few
@given(soils)
def test_wave_speeds_are_those_of_the_paper(soil):
    E, ν, ρ = soil.young, soil.poisson, soil.density
    assert soil.p_speed == pytest.approx(
        np.sqrt(E * (1 - ν) / (ρ * (1 + ν) * (1 - 2 * ν))), rel=1e-12
    )
    assert soil.s_speed == pytest.approx(np.sqrt(E / (2 * ρ * (1 + ν))), rel=1e-12)


@few
@given(soils)
def test_wave_speeds_are_those_of_the_stress(soil):
    """Moduli of confined compression and of shear are ρ c²."""
    stress = soil.update(np.array([[0.0, 1e-3, 0, 0], [0, 0, 0, 1e-3]]), np.zeros((2, 4)))
    assert stress[0, 1] == pytest.approx(1e-3 * soil.density * soil.p_speed**2, rel=1e-12)
    assert stress[1, 3] == pytest.approx(1e-3 * soil.density * soil.s_speed**2, rel=1e-12)


@few
@given(soils)
def test_a_bar_has_young_and_poisson(soil):
    E, ν = soil.young, soil.poisson
    stress = soil.update(np.array([[1e-3, -ν * 1e-3, -ν * 1e-3, 0, 0, 0]]), np.zeros((1, 6)))
    np.testing.assert_allclose(stress, [[1e-3 * E, 0, 0, 0, 0, 0]], rtol=0, atol=1e-12 * E)


@few
@given(soils)
def test_plane_strain_keeps_the_stress_out_of_plane(soil):
    strain = tensors.strain(rng.normal(size=(10, 2, 2)))
    stress = soil.update(strain, np.zeros((10, 4)))
    np.testing.assert_allclose(
        stress[:, 2],
        soil.poisson * (stress[:, 0] + stress[:, 1]),
        rtol=0,
        atol=1e-12 * np.abs(stress).max(),
    )


@few
@given(soils, st.sampled_from([2, 3]))
def test_energy_is_half_of_stress_times_strain(soil, dim):
    strain = tensors.strain(rng.normal(size=(10, dim, dim)))
    stress = soil.update(strain, np.zeros_like(strain))
    half = 0.5 * (stress * strain).sum(axis=1)
    np.testing.assert_allclose(soil.energy(stress), half, rtol=1e-9)
    assert np.all(soil.energy(stress) > 0)


@few
@given(soils)
def test_increments_add_up_and_leave_the_old_stress_alone(soil):
    old = soil.young * rng.normal(size=(10, 6))
    first, second = rng.normal(size=(2, 10, 6))
    kept = old.copy()
    twice = soil.update(second, soil.update(first, old))
    assert np.array_equal(old, kept)
    np.testing.assert_allclose(
        twice, soil.update(first + second, old), rtol=0, atol=1e-12 * np.abs(twice).max()
    )


@pytest.mark.parametrize(
    "name, value",
    [
        ("young", 0.0),
        ("young", -1.0),
        ("young", np.nan),
        ("poisson", 0.5),
        ("poisson", -1.0),
        ("poisson", np.inf),
        ("density", 0.0),
        ("density", "wet"),
    ],
)
def test_parameters_out_of_range_are_named(name, value):
    parameters = {"young": 1e6, "poisson": 0.3, "density": 1000.0, name: value}
    with pytest.raises(ValueError, match=name):
        LinearElastic(**parameters)


def test_parameters_are_frozen_floats():
    soil = LinearElastic(1, 0, 1)
    assert all(isinstance(v, float) for v in dataclasses.astuple(soil))
    with pytest.raises(dataclasses.FrozenInstanceError):
        soil.young = 2.0
