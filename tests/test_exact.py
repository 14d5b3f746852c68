"""The column's closed form against what must hold of it."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from mpm_fenicsx.analytical.bar import Bar
from mpm_fenicsx.analytical.column import Column
from mpm_fenicsx.analytical.waves import (
    dashpot_echo,
    rayleigh_speed,
    relative_error,
    thick_cylinder,
)

L, C, RHO = 10.0, 100.0, 2000.0
Z, TRAVEL = RHO * C, L / C


def suddenly(t):
    return np.full_like(t, 300e3)


def pulse(t):
    return 300e3 * np.sin(np.pi * t / 0.05) ** 2 * (t < 0.05)


def column(load=suddenly, end=12 * TRAVEL, **parameters):
    return Column(L, C, RHO, load, end, **parameters)


def test_a_fixed_base_doubles_the_pressure_until_the_echo_returns():
    base = column().pressure(L, np.array([0.5, 1.5, 2.9, 3.5]) * TRAVEL)
    np.testing.assert_allclose(base, [0, 600e3, 600e3, 0], rtol=0, atol=1e-6)


def test_a_fixed_base_rests():
    t = np.linspace(0, 12 * TRAVEL, 200)
    assert np.abs(column(pulse).velocity(L, t)).max() < 1e-12


def test_a_dashpot_of_the_columns_impedance_sends_nothing_back():
    c = column(pulse, fixed=False)
    t = np.linspace(0, 12 * TRAVEL, 200)
    for depth in (0.0, 3.3, L):
        arrived = np.where(t > depth / C, pulse(t - depth / C), 0)
        np.testing.assert_allclose(c.pressure(depth, t), arrived, rtol=0, atol=60)
        np.testing.assert_allclose(
            c.velocity(depth, t), c.pressure(depth, t) / Z, rtol=0, atol=1e-12
        )


@pytest.mark.parametrize("load", [pulse, suddenly])
def test_a_spring_and_dashpot_bear_the_pressure_of_the_base(load):
    k = 3e6
    c = column(load, fixed=False, spring=k)
    t = np.linspace(0, 12 * TRAVEL, 400)
    borne = Z * c.velocity(L, t) + k * c.displacement(L, t)
    assert np.abs(borne - c.pressure(L, t)).max() < 1e-3 * 300e3


def test_a_stiff_spring_is_a_fixed_base_and_a_soft_one_settles_to_its_load():
    t = np.linspace(0.0, 12 * TRAVEL, 100)
    stiff, fixed = column(pulse, fixed=False, spring=1e12), column(pulse)
    assert relative_error(stiff.velocity(0.0, t), fixed.velocity(0.0, t)) < 1e-2
    k = Z  # a soft spring and its dashpot settle with the time Z/k = 1 s
    soft = column(end=15.0, fixed=False, spring=k, resolution=400)
    assert soft.displacement(L, 15.0) == pytest.approx(300e3 / k, rel=1e-5)


@pytest.mark.parametrize("base", [{}, {"fixed": False}, {"fixed": False, "spring": 5e6}])
def test_the_surface_bears_the_load(base):
    t = np.linspace(0.001, 11.9 * TRAVEL, 300)
    c = column(pulse, **base)
    np.testing.assert_allclose(c.pressure(0.0, t), pulse(t), rtol=0, atol=60)


@pytest.mark.parametrize("base", [{}, {"fixed": False}, {"fixed": False, "spring": 5e6}])
def test_the_momentum_is_the_impulse_of_both_ends(base):
    c = column(pulse, **base)
    depth = np.linspace(0, L, 801)
    t = np.linspace(0, 3.37 * TRAVEL, 4001)
    momentum = trapezoid(RHO * np.array([c.velocity(x, t[-1]) for x in depth]), depth)
    impulse = trapezoid(c.pressure(0.0, t) - c.pressure(L, t), t)
    assert momentum == pytest.approx(impulse, abs=1e-3 * trapezoid(pulse(t), t))


def test_displacement_is_the_integral_of_velocity():
    c = column()
    dt = 1e-4
    for t in (0.31 * TRAVEL, 1.7 * TRAVEL, 5.2 * TRAVEL):
        rate = (c.displacement(4.0, t + dt) - c.displacement(4.0, t - dt)) / (2 * dt)
        assert rate == pytest.approx(c.velocity(4.0, t), abs=1e-9)


def test_relative_error():
    assert relative_error([1.0, 2.0], np.array([1.0, 2.0])) == 0.0
    assert relative_error([0.0, 0.0], np.array([3.0, 4.0])) == 1.0


# -- the bar that moves as told --------------------------------------------------------------------

BARS = [
    Bar(2.0, 1e6, 1000.0, amplitude, drift, free, hencky)
    for amplitude, drift, free, hencky in (
        (1e-6, 0.0, False, False),
        (1e-6, 3.0, True, False),
        (0.1, 0.0, False, True),
        (0.1, 3.0, True, True),
    )
]


def derivative(f, at, step):
    """Fourth-order central difference."""
    return (8 * (f(at + step) - f(at - step)) - (f(at + 2 * step) - f(at - 2 * step))) / (12 * step)


@pytest.mark.parametrize("bar", BARS)
def test_the_bars_momentum_balances(bar):
    """ρ ẍ = ∂P/∂X + ρ b, all derivatives taken numerically, P from Cauchy's stress: in one
    dimension P = σ."""
    X, t = np.linspace(0.1, 1.9, 7), 0.017
    δX, δt = 1e-3 * bar.length, 1e-3 * bar.period
    np.testing.assert_allclose(
        derivative(lambda t: bar.displacement(X, t), t, δt), bar.velocity(X, t), rtol=1e-7
    )
    np.testing.assert_allclose(
        1 + derivative(lambda X: bar.displacement(X, t), X, δX), bar.stretch(X, t), rtol=1e-7
    )
    acceleration = derivative(lambda t: bar.velocity(X, t), t, δt)
    force = acceleration - derivative(lambda X: bar.stress(X, t), X, δX) / bar.density
    scale = np.abs(acceleration).max()
    np.testing.assert_allclose(bar.body_force(X, t) / scale, force / scale, rtol=0, atol=1e-7)
    F = bar.stretch(X, t)
    law = bar.young * (np.log(F) / F if bar.hencky else F - 1)  # J = F: τ = F σ = E ln F
    np.testing.assert_allclose(bar.stress(X, t), law, rtol=1e-9, atol=1e-15 * bar.young)


@pytest.mark.parametrize("bar", BARS)
def test_the_bar_starts_undeformed_and_its_ends_rest_or_bear_nothing(bar):
    ends, t = np.array([0.0, bar.length]), 0.4 * bar.period
    inside = bar.length * np.linspace(0.05, 0.95, 9)
    assert (
        np.abs(bar.displacement(inside, 0.0)).max() == np.abs(bar.stress(inside, 0.0)).max() == 0.0
    )
    assert np.abs(bar.velocity(inside, 0.0)).max() == pytest.approx(
        np.pi / 2 * bar.speed * bar.amplitude, rel=0.3
    )
    resting = bar.stress if bar.free else bar.displacement
    assert np.abs(resting(ends, t)).max() < 1e-14 * np.abs(resting(inside, t)).max() * 10


@pytest.mark.parametrize("bar", BARS)
def test_a_particle_is_found_where_it_went(bar):
    X = np.linspace(-0.2, 2.2, 41)
    for t in (0.0, 0.3 * bar.period, bar.period):
        np.testing.assert_allclose(
            bar.particle(X + bar.displacement(X, t) + bar.drift * t, t), X, rtol=0, atol=1e-13
        )


def test_a_thick_cylinder_is_in_equilibrium_and_elastic():
    r, E, ν = np.linspace(1.0, 2.0, 4001), 7e6, 0.3
    radial, hoop, u = thick_cylinder(r, 1.0, 2.0, 5e3, E, ν)
    np.testing.assert_allclose(radial[[0, -1]], [-5e3, 0.0], atol=1e-9)
    np.testing.assert_allclose(np.gradient(radial, r)[1:-1], ((hoop - radial) / r)[1:-1], rtol=1e-5)
    axial = ν * (radial + hoop)
    np.testing.assert_allclose(u / r, (hoop - ν * (radial + axial)) / E, rtol=1e-12)
    np.testing.assert_allclose(
        np.gradient(u, r)[1:-1], ((radial - ν * (hoop + axial)) / E)[1:-1], rtol=1e-5
    )


@pytest.mark.parametrize(
    "poisson, ratio", [(0.0, 0.8740), (0.25, 0.9194), (0.3, 0.9274), (0.41, 0.9436), (0.5, 0.9553)]
)
def test_rayleigh_waves(poisson, ratio):
    """0.8740 and 0.9553 are the textbooks' ends; √(2 - 2/√3) is the closed form at ν = 1/4."""
    assert rayleigh_speed(poisson) == pytest.approx(ratio, abs=6e-5)
    assert rayleigh_speed(0.25) == pytest.approx(np.sqrt(2 - 2 / np.sqrt(3)), rel=1e-12)


@pytest.mark.parametrize(
    "poisson, wave, echoes",
    [
        (0.25, "P", [0, 0.0002, 0.0003, 0.0016, 0.0089, 0.0359, 0.117, 0.346]),
        (0.25, "S", [0, 0.0083, 0.0359, 0.0158, 0.0475, 0.113, 0.244, 0.500]),
        (0.41, "P", [0, 0.0010, 0.0039, 0.0121, 0.033, 0.083, 0.195, 0.443]),
        (0.41, "S", [0, 0.0122, 0.0044, 0.0181, 0.050, 0.117, 0.249, 0.504]),
    ],
)
def test_what_dashpots_send_back(poisson, wave, echoes):
    """A table found by others; grazing waves come back whole."""
    found = [
        dashpot_echo(np.radians(angle), poisson, wave) for angle in (0, 20, 30, 40, 50, 60, 70, 80)
    ]
    np.testing.assert_allclose(found, echoes, atol=6e-4)
    assert dashpot_echo(np.pi / 2 - 1e-6, poisson, wave) == pytest.approx(1.0, abs=1e-4)
