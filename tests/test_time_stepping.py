"""Newmark's factors against his definitions, an oscillator, and the refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpm_fenicsx import Newmark, QuasiStatic

number = st.floats(-1e3, 1e3)


@st.composite
def stable(draw):
    gamma = draw(st.floats(0.5, 1.0))
    return Newmark(draw(st.floats(1e-3, 10)), draw(st.floats(gamma / 2, 1.0)), gamma)


@settings(max_examples=30, deadline=None)
@given(stable(), number, number, number)
def test_factors_invert_newmarks_definitions(step, v, a, a_end):
    """u = Δt v + Δt² ((½ − β) a + β a₁), v₁ = v + Δt ((1 − γ) a + γ a₁)."""
    β, γ, dt = step.beta, step.gamma, step.dt
    u = dt * v + dt**2 * ((0.5 - β) * a + β * a_end)
    v_end = v + dt * ((1 - γ) * a + γ * a_end)
    state = np.array([u, v, a])
    size = 1 + np.abs(state).max() / min(dt, 1) ** 2
    assert np.dot(step.velocity, state) == pytest.approx(v_end, abs=1e-12 * size)
    assert np.dot(step.acceleration, state) == pytest.approx(a_end, abs=1e-12 * size)


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-4, 1))
def test_the_trapezoidal_rule_is_the_papers(dt):
    np.testing.assert_allclose(Newmark(dt).velocity, (2 / dt, -1, 0), rtol=1e-12)
    np.testing.assert_allclose(Newmark(dt).acceleration, (4 / dt**2, -4 / dt, -1), rtol=1e-12)


def oscillate(step, steps, ω=2 * np.pi):
    """Position and velocity of ü = −ω² x from x = 1 at rest."""
    x, v, a = 1.0, 0.0, -(ω**2)
    (c0, c1, c2), (d0, d1, d2) = step.velocity, step.acceleration
    for _ in range(steps):
        u = -(d1 * v + d2 * a + ω**2 * x) / (d0 + ω**2)
        x, v, a = x + u, c0 * u + c1 * v + c2 * a, d0 * u + d1 * v + d2 * a
    return x, v


@pytest.mark.parametrize("dt", [0.01, 0.3, 5.0])
def test_the_trapezoidal_rule_keeps_an_oscillators_energy(dt):
    x, v = oscillate(Newmark(dt), 1000)
    assert x**2 + (v / (2 * np.pi)) ** 2 == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("gamma, order", [(0.5, 2), (0.6, 1)])
def test_order_of_accuracy(gamma, order):
    exact = np.array([np.cos(2.4 * np.pi), -2 * np.pi * np.sin(2.4 * np.pi)])
    errors = [
        np.linalg.norm(oscillate(Newmark(1.2 / n, beta=0.31, gamma=gamma), n) - exact)
        for n in (400, 800)
    ]
    assert np.log2(errors[0] / errors[1]) > order - 0.1


def test_more_gamma_damps():
    x, v = oscillate(Newmark(0.05, beta=0.4, gamma=0.7), 200)
    assert x**2 + (v / (2 * np.pi)) ** 2 < 0.1


@pytest.mark.parametrize(
    "parameters, name",
    [
        ({"dt": 0}, "dt"),
        ({"dt": -1}, "dt"),
        ({"dt": np.nan}, "dt"),
        ({"dt": 1, "beta": 0}, "beta"),
        ({"dt": 1, "gamma": 0.4}, "gamma=0.4"),
        ({"dt": 1, "beta": 0.25, "gamma": 0.6}, "beta=0.25"),
        ({"dt": 1, "gamma": np.inf}, "gamma"),
    ],
)
def test_unstable_or_senseless_steps_are_refused(parameters, name):
    with pytest.raises(ValueError, match=name):
        Newmark(**parameters)


def test_quasi_static_steps_reach_one():
    assert QuasiStatic(7).dt * 7 == pytest.approx(1.0, rel=1e-15)
    assert Newmark(1).dynamic and not QuasiStatic(1).dynamic
    for steps in (0, 1.5, -2):
        with pytest.raises(ValueError, match="steps"):
            QuasiStatic(steps)
