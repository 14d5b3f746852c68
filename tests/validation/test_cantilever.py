"""A cantilever bends until its end points down: against the elastica, and finite elements on finer
and finer grids."""

import functools

import numpy as np
import pytest
from methods import LINEAR, STRESS_LOST, TILING, over
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

import mpm_fenicsx as mpm

pytestmark = pytest.mark.validation

LENGTH, SOIL = 10.0, mpm.Hencky(young=12e6, poisson=0.2, density=1000.0)
STIFFNESS = SOIL.young / (1 - SOIL.poisson**2)  # in plane strain
SHEAR = 5 / 6 * SOIL.lame[1]
H = (0.5, 0.25, 0.125)
ELASTICA = "2 cantilever, h = {:g} m: tip against the elastica, 1.2 % off itself for its depth"
LIMIT = "2 cantilever, h = {:g} m: tip against the limit of finite elements"


def elastica(depth, load, stretches=True, shears=True):
    """Displacement of the tip (m): Reissner's beam, which stretches by N/EA and shears by Q/κGA, or
    does not."""
    EA = STIFFNESS * depth if stretches else np.inf
    GA = SHEAR * depth if shears else np.inf
    s, y = np.linspace(0, LENGTH, 101), np.zeros((4, 101))
    y[0] = s
    for P in np.linspace(0.1, 1.0, 10) * load:

        def along(s, y, P=P):
            _, _, θ, M = y
            ε, γ = -P * np.sin(θ) / EA, -P * np.cos(θ) / GA
            dx = (1 + ε) * np.cos(θ) - γ * np.sin(θ)
            return np.array(
                [dx, (1 + ε) * np.sin(θ) + γ * np.cos(θ), M / (STIFFNESS * depth**3 / 12), P * dx]
            )

        found = solve_bvp(
            along, lambda a, b: np.array([a[0], a[1], a[2], b[3]]), s, y, tol=1e-9, max_nodes=20000
        )
        assert found.success
        s, y = found.x, found.y
    return y[:2, -1] - (LENGTH, 0.0)


def test_the_elastica_is_right():
    """Without stretch and shear it is the one of elliptic integrals (Bisshopp and Drucker 1945)."""
    load, EI = 100e3, STIFFNESS / 12
    α = load * LENGTH**2 / EI

    def modulus(φ):
        k = np.sqrt((1 + np.sin(φ)) / 2)
        return k**2, np.arcsin(1 / (k * np.sqrt(2)))

    def length(φ):
        m, start = modulus(φ)
        return ellipk(m) - ellipkinc(start, m) - np.sqrt(α)

    φ = brentq(length, 0.1, 1.5707)
    m, start = modulus(φ)
    x = LENGTH * np.sqrt(2 * np.sin(φ) / α) - LENGTH
    y = 2 * LENGTH / np.sqrt(α) * (ellipe(m) - ellipeinc(start, m)) - LENGTH
    np.testing.assert_allclose(elastica(1.0, load, False, False), [x, y], rtol=1e-7)


def tip(kind, h, depth=1.0, load=100e3, steps=50):
    """Mean displacement of the end under a dead load (N/m) in as many steps."""
    n = round(1 / h)
    if kind is None:
        grid = mpm.Grid.box((0, 0), (LENGTH, depth), (10 * n, round(depth * n)))
        end = grid.facets("right")
        run = mpm.FiniteElements(
            grid,
            SOIL,
            mpm.QuasiStatic(steps),
            [mpm.Fixed(grid.facets("left")), mpm.Traction(end, lambda t: (0.0, -load * t / depth))],
        )
        probe = run.record(mpm.Probe("displacement", at=(LENGTH, depth / 2)))
        run.until(1.0)
        return probe.values[-1]
    grid = mpm.Grid.box((0, -9), (11, 2), (11 * n, 11 * n))
    body = mpm.MaterialPoints.fill(
        grid, SOIL, 4, inside=lambda x: (x[0] < LENGTH) & (x[1] > 0) & (x[1] < depth)
    )
    end = body.surface("right")
    run = mpm.Simulation(
        grid,
        body,
        mpm.QuasiStatic(steps),
        [
            mpm.Fixed(grid.facets("left")),
            mpm.Traction(end, lambda t: (0.0, -load * t / end.area.sum())),
        ],
        kind,
    )
    run.until(1.0)
    return end.x.mean(axis=0) - (LENGTH, depth / 2)


def relative(found, exact):
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


@functools.cache
def limit():
    """Of finite elements: Richardson's extrapolation at second order, from h = 1/8 m and 1/16 m."""
    coarse, fine = (tip(None, h, steps=20) for h in (0.125, 0.0625))
    return fine + (fine - coarse) / 3


def test_the_elastica_is_the_limit_of_slender_finite_elements():
    """Half the depth at the same P L²/EI: what the beam leaves out is of second order in the
    depth."""
    gaps = [relative(limit(), elastica(1.0, 100e3)), None]
    coarse, fine = (tip(None, h, 0.5, 12.5e3, steps=20) for h in (0.125, 0.0625))
    gaps[1] = relative(fine + (fine - coarse) / 3, elastica(0.5, 12.5e3))
    assert gaps[0] < 0.012
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.15)


@over(None, *TILING)
def test_the_tip_converges(mapping, record):
    found = [tip(mapping, h) for h in H]
    for h, u in zip(H, found, strict=True):
        record(ELASTICA.format(h), mapping, relative(u, elastica(1.0, 100e3)))
    error = [relative(u, limit()) for u in found]
    for h, e in zip(H, error, strict=True):
        record(LIMIT.format(h), mapping, e)
    assert error[0] > error[1] > error[2]
    assert error[2] < 0.0025


@pytest.mark.parametrize("h", H)
@over(*LINEAR)
def test_linear_shape_functions_do_not_converge(mapping, h, record):
    """The tip is off by 3.7 to 7.1 %, whatever h is.  Newton stopped as long as a node that a
    single point reaches was on its own: the light nodes around the end, on which the load acts, are
    tied."""
    u = tip(mapping, h)
    for case, exact in ((ELASTICA, elastica(1.0, 100e3)), (LIMIT, limit())):
        record(case.format(h), mapping, relative(u, exact), STRESS_LOST)
    assert 0.035 < relative(u, limit()) < (0.05 if mapping.composite else 0.078)
