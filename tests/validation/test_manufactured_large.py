"""A bar stretched by 31 % under a manufactured body force: orders of displacement and stress at
finite strain."""

import math

import numpy as np
import pytest
from methods import LINEAR, STRESS_LOST, TILING, name, over

import mpm_fenicsx as mpm

pytestmark = pytest.mark.validation

SOIL = mpm.Hencky(young=1e6, poisson=0.0, density=1000.0)
SPEED, LENGTH, A, END = SOIL.p_speed, 1.0, 0.05, 1.0
K, OMEGA = 2 * math.pi / LENGTH, math.pi * SPEED / LENGTH
CELLS = (20, 40, 80)
CASE = "5 manufactured, 31 % strain, 80 cells"
NOISE = (
    "order 0.8 in stress where 1.4 is wanted: it is constant over domains that grid lines cut; 1.8 "
    "with DM-GCL"
)


def displacement(X, t, a=A):
    """u = A sin(2πX/L) sin(cπt/L), m; t in units of L/c."""
    return a * np.sin(K * X) * math.sin(OMEGA * t * LENGTH / SPEED)


def stretch(X, t, a=A):
    return 1 + a * K * np.cos(K * X) * math.sin(OMEGA * t * LENGTH / SPEED)


def stress(F):
    """P = E ln F/F, which is Cauchy's stress too: the bar keeps its cross-section."""
    return SOIL.young * np.log(F) / F


def force(X, t, a=A):
    """b = u_tt - P'(F) F_X/ρ₀ (m/s²), P' = E (1 - ln F)/F²."""
    F, u = stretch(X, t, a), displacement(X, t, a)
    return -(OMEGA**2) * u + SPEED**2 * (1 - np.log(F)) / F**2 * K**2 * u


def at_rest(x, t, a=A):
    """The place X that has come to x at t, by Newton's iteration."""
    X = x.copy()
    for _ in range(30):
        X -= (X + displacement(X, t, a) - x) / stretch(X, t, a)
    return X


def test_the_body_force_balances():
    X, t, d = np.linspace(0.01, 0.99, 7), 0.37, 1e-4
    slope = (stress(stretch(X + d, t)) - stress(stretch(X - d, t))) / (2 * d)
    u = [displacement(X, t + s * d) for s in (-1, 0, 1)]
    acceleration = (u[0] - 2 * u[1] + u[2]) / (d * LENGTH / SPEED) ** 2
    np.testing.assert_allclose(
        acceleration - slope / SOIL.density, force(X, t), rtol=1e-5, atol=1e-9
    )
    np.testing.assert_allclose(at_rest(X + displacement(X, t), t), X, atol=1e-14)


def errors(kind, cells, per_cell=4, size=1.0):
    """Of displacement and stress over the bar and half a period, relative, at Courant's number ½.

    ``size`` of the amplitude.
    """
    a, h, n = A * size, LENGTH / cells, 2 * cells
    dt = END / n
    grid = mpm.Grid.box((0, 0), (LENGTH, h), (cells, 1))
    clock = SPEED / LENGTH

    def g(t, x):
        X = x[:, 0] if kind is None else at_rest(x[:, 0], t * clock - dt, a)
        return np.stack((force(X, t * clock, a), 0 * X), axis=1)

    terms = [
        mpm.Fixed(grid.facets("left", "right")),
        mpm.Fixed(grid.facets("bottom", "top"), "y"),
        mpm.Gravity(g),
    ]
    if kind is None:
        run = mpm.FiniteElements(grid, SOIL, mpm.Newmark(dt / clock), terms)
        x = grid.space.tabulate_dof_coordinates()[:, 0]
        run.nodal("velocity")[:, 0] = a * OMEGA * np.sin(K * x)
        X, centre = x, run.sampler("stress")[0][:, 0]
    else:
        body = mpm.MaterialPoints.fill(grid, SOIL, per_cell)
        X = centre = body.x[:, 0].copy()
        body.velocity = np.stack((a * OMEGA * np.sin(K * X), 0 * X), axis=1)
        run = mpm.Simulation(grid, body, mpm.Newmark(dt / clock), terms, kind)
    sums = np.zeros(4)
    for step in range(1, n + 1):
        run.step()
        t = step * dt
        u, σ = displacement(X, t, a), stress(stretch(centre, t, a))
        found = (
            (run.nodal("displacement")[:, 0], run.stress(np.arange(cells))[:, 0])
            if kind is None
            else (body.x[:, 0] - X, body.stress[:, 0])
        )
        sums += [
            ((found[0] - u) ** 2).mean(),
            (u**2).mean(),
            ((found[1] - σ) ** 2).mean(),
            (σ**2).mean(),
        ]
    return math.sqrt(sums[0] / sums[1]), math.sqrt(sums[2] / sums[3])


@pytest.mark.parametrize(
    "kind, per_cell", [*((kind, 4) for kind in (None, *TILING)), (mpm.DM_GCL, 16)], ids=name
)
def test_orders(kind, per_cell, record):
    """1.9 in displacement and 1.4 in stress are wanted; for the latter stress has to be linear over
    support domains."""
    found = np.array([errors(kind, n, per_cell) for n in CELLS])
    u, σ = np.log2(found[0] / found[-1]) / 2
    misses = kind is mpm.DM_GC
    many = ", 16 points a cell" if per_cell == 16 else ""
    record(f"{CASE}{many}: displacement", kind, found[-1, 0])
    record(f"{CASE}{many}: stress", kind, found[-1, 1], NOISE if misses else "")
    assert u > (1.85 if (kind, per_cell) == (mpm.DM_GCL, 4) else 1.9)
    assert 0.6 < σ < 1.4 if misses else σ > 1.4


def test_without_crossings_dm_gc_is_of_second_order():
    """A tenth of the amplitude, so that points hardly leave their cells: the order that noise hides
    is there."""
    found = np.array([errors(mpm.DM_GC, n, size=0.1) for n in CELLS])
    assert (np.log2(found[0] / found[-1]) / 2 > 1.9).all()


@over(*LINEAR)
def test_linear_shape_functions_do_not_converge(mapping, record):
    found = np.array([errors(mapping, n) for n in CELLS])
    record(f"{CASE}: displacement", mapping, found[-1, 0], STRESS_LOST)
    record(f"{CASE}: stress", mapping, found[-1, 1], STRESS_LOST)
    assert (found[-1] > np.maximum(found[0], 0.2)).all()
