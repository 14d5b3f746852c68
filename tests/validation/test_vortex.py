"""Case 5, a vortex: rings turn past one another under a manufactured body force, with rotation and
large shear.

Exact: x = Q(α) X, a turn by α = A g(t) h(r) that keeps r = |X|, so that X = Q(-α) x and det F = 1.
Along the turned polar frame F is a simple shear of γ = r ∂α/∂r, and Hencky's stress μ ln FFᵀ.  The
motion is the generalised vortex of Kamojjala et al. (2015), doi.org/10.1007/s00366-013-0342-x, but
for a ring that is wider, and smoother, so that the body force has no jumps.

Hencky's shear stress, μ L/cosh(L/2) with γ = 2 sinh(L/2), is largest at γ = 3.02: past it the soil
has no one answer.
"""

import numpy as np
import pytest
from methods import TILING, over

import mpm_fenicsx as mpm

pytestmark = pytest.mark.validation

SOIL = mpm.Hencky(young=1e3, poisson=0.3, density=1000.0)
SHEAR = SOIL.density * SOIL.s_speed**2
# 0.4 rad at last, shear of 1.2; points cross up to 5 cells
HALF, WIDE, A, T = 1.875, 0.75, 0.2, 1.6
CELLS = (6, 12)  # a metre
CASE = "5 vortex, 23° and a shear of 1.2, 18 cells across the ring"
FROM_NONE = {"initial_acceleration": mpm.InitialAcceleration.ZERO}
HALVED = "first order: the first step goes without half of its load"


def profile(r):
    """h, h' and h'' (n,): 1 at r = 1, nothing, and without slope, from WIDE away."""
    s = np.clip((r - 1) / WIDE, -1.0, 1.0)
    c = 1 - s**2
    return c**3, -6 * s * c**2 / WIDE, (24 * s**2 - 6 * c) * c / WIDE**2


def turn(r, t):
    """α (n,) at radii, and its first and second time derivatives: from rest at t = 0, where its
    acceleration is not."""
    h, ω = A * profile(r)[0], np.pi / T
    return h * (1 - np.cos(ω * t)), h * ω * np.sin(ω * t), h * ω**2 * np.cos(ω * t)


def stress(r, t):
    """σ_rr, σ_rθ (σ_θθ = -σ_rr) and their derivatives by r, Pa.

    ln b = L/sinh L [[-γ²/2, γ], [γ, γ²/2]] in (r, θ), with cosh L = 1 + γ²/2, since b is cosh L I
    plus that matrix.
    """
    _, slope, bend = profile(r)
    amplitude = A * (1 - np.cos(np.pi * t / T))
    γ, dγ = amplitude * r * slope, amplitude * (slope + r * bend)
    L = 2 * np.arcsinh(γ / 2)
    sinh, cosh = γ * np.sqrt(1 + γ**2 / 4), 1 + γ**2 / 2
    still = np.abs(γ) < 1e-4
    sinh[still] = 1.0
    ratio = np.where(still, 1 - γ**2 / 6, L / sinh)  # and its derivative by γ, dL/dγ = γ/sinh L
    change = np.where(still, -γ / 3, (1 - ratio * cosh) * γ / sinh**2)
    return (
        -SHEAR * ratio * γ**2 / 2,
        SHEAR * ratio * γ,
        -SHEAR * (change * γ**2 / 2 + ratio * γ) * dγ,
        SHEAR * (change * γ + ratio) * dγ,
    )


def force(r, t):
    """b_r, b_θ = a - div σ/ρ (m/s²) with a = -r α_t², r α_tt."""
    _, rate, acceleration = turn(r, t)
    rr, rθ, drr, drθ = stress(r, t)
    return (
        -r * rate**2 - (drr + 2 * rr / r) / SOIL.density,
        r * acceleration - (drθ + 2 * rθ / r) / SOIL.density,
    )


def turned(x, α):
    """Q(α) x (n, 2)."""
    c, s = np.cos(α), np.sin(α)
    return np.stack((c * x[:, 0] - s * x[:, 1], s * x[:, 0] + c * x[:, 1]), axis=1)


def force_at(x, t):
    """b (n, 2) at places x at time t; none where nothing moves."""
    r = np.hypot(*x.T)
    moves = np.abs(r - 1) < WIDE
    found, r = np.zeros_like(x), r[moves]
    radial, along = force(r, t)
    e = x[moves] / r[:, None]
    found[moves] = radial[:, None] * e + along[:, None] * np.stack((-e[:, 1], e[:, 0]), axis=1)
    return found


def error(kind, cells, **keywords):
    """Of displacement at t = T, relative, L2 over points or nodes; ``cells`` a metre."""
    n = round(2 * HALF * cells)
    steps = round(2 * T * SOIL.p_speed * cells)  # Courant number ½
    dt = T / steps
    grid = mpm.Grid.box((-HALF, -HALF), (HALF, HALF), (n, n))

    def g(t, x):
        α, before = (turn(np.hypot(*x.T), max(time, 0.0))[0] for time in (t, t - dt))
        return force_at(
            turned(x, α if kind is None else α - before), t
        )  # points are where the step starts

    terms = [mpm.Fixed(grid.facets("left", "right", "bottom", "top")), mpm.Gravity(g)]
    if kind is None:
        run = mpm.FiniteElements(grid, SOIL, mpm.Newmark(dt), terms, **keywords)
        X = grid.space.tabulate_dof_coordinates()[:, :2]
    else:
        body = mpm.MaterialPoints.fill(grid, SOIL, 4)
        X = body.x.copy()
        run = mpm.Simulation(grid, body, mpm.Newmark(dt), terms, kind, **keywords)
    for _ in range(steps):
        run.step()
    u = turned(X, turn(np.hypot(*X.T), T)[0]) - X
    found = run.nodal("displacement") if kind is None else body.x - X
    return np.sqrt(((found - u) ** 2).sum() / (u**2).sum())


def test_the_body_force_balances():
    """Against F by differences of the motion, ln b by its eigenvalues, div σ by differences in
    Cartesian axes."""
    d, t, μ = 1e-4, 0.7 * T, SOIL.young / 2 / (1 + SOIL.poisson)

    def place(X, t):
        return turned(X, turn(np.hypot(*X.T), t)[0])

    def cauchy(x):
        X = turned(x, -turn(np.hypot(*x.T), t)[0])
        F = np.stack([(place(X + e, t) - place(X - e, t)) / (2 * d) for e in d * np.eye(2)], axis=2)
        np.testing.assert_allclose(np.linalg.det(F), 1.0, atol=1e-5)
        values, axes = np.linalg.eigh(F @ F.transpose(0, 2, 1))
        return μ * np.einsum("nik,nk,njk->nij", axes, np.log(values), axes)

    X = np.array([[0.8, 0.1], [0.0, 0.9], [-0.7, 0.75], [0.3, -1.1], [-0.6, -0.6]])
    x = place(X, t)
    divergence = sum(
        (cauchy(x + e) - cauchy(x - e))[:, :, j] / (2 * d) for j, e in enumerate(d * np.eye(2))
    )
    acceleration = (place(X, t + d) - 2 * x + place(X, t - d)) / d**2
    np.testing.assert_allclose(
        acceleration - divergence / SOIL.density, force_at(x, t), rtol=1e-4, atol=1e-4
    )


@over(None, *TILING)
def test_order(mapping, record):
    """2 in displacement, with the acceleration that the balance of forces starts with; less from
    none."""
    (coarse, fine), (coarse_from_none, fine_from_none) = (
        [error(mapping, cells, **keywords) for cells in CELLS] for keywords in ({}, FROM_NONE)
    )
    record(f"{CASE}: displacement", mapping, fine)
    record(f"{CASE}, initial acceleration zero: displacement", mapping, fine_from_none, HALVED)
    assert np.log2(coarse / fine) > 1.9
    assert np.log2(coarse_from_none / fine_from_none) < 1.5
    assert fine_from_none > 1.5 * fine
