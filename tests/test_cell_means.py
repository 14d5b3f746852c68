"""Volume changes by the means over the material in each cell: B-bar, and F-bar at finite strain."""

import warnings
from dataclasses import replace

import dense
import inside
import numpy as np
import pytest

import mpm_fenicsx as mpm

SMALL = mpm.LinearElastic(young=20e6, poisson=0.4, density=1800.0)
LARGE = mpm.Hencky(young=20e6, poisson=0.4, density=1800.0)
LAWS = {
    "von Mises": mpm.VonMises(SMALL, 20e3, 5e3, 50e3),
    "Mohr-Coulomb": mpm.MohrCoulomb(SMALL, 5e3, 25.0, 5.0),
    "Hencky": LARGE,
    "von Mises, Hencky": mpm.VonMises(LARGE, 20e3, 5e3, 50e3),
    "Mohr-Coulomb, Hencky": mpm.MohrCoulomb(LARGE, 5e3, 25.0, 5.0),
}
B_BAR = replace(mpm.DM_GC, b_bar=True, hold_cut_cells=False)


def small_grid(dim):
    lines = [np.array([0.0, 0.4, 1.0]), [0.0, 0.7, 1.1], [0.0, 0.5]][:dim]
    return mpm.Grid.rectilinear([np.asarray(line) for line in lines])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("points", [False, True])
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_matrix_is_the_derivative_of_the_residual(law, points, dim):
    rng, grid = np.random.default_rng(3), small_grid(dim)
    if points:
        body = mpm.MaterialPoints.fill(grid, law, 2**dim, jitter=0.4, seed=7)
        body.stress[:, :3] = -20e3 * rng.uniform(0.5, 1.0, (len(body), 3))
        run = mpm.Simulation(grid, body, mpm.Newmark(0.1), [], B_BAR)
    else:
        run = mpm.FiniteElements(grid, law, mpm.Newmark(0.1), [], b_bar=True)
    inside.prepared(run)
    u = run.nodal("increment").ravel()
    u[:] = 2e-3 * rng.normal(size=len(u))
    K = inside.tangent(run)
    assert np.abs(K - inside.differences(run, 1e-9)).max() < 1e-5 * np.abs(K).max()
    askew = np.abs(K - K.T).max() / np.abs(K).max()
    assert (askew < 1e-12) == law.symmetric


@pytest.mark.parametrize("points", [False, True])
def test_so_it_is_where_soil_of_small_strain_shares_the_run(points):
    """Cells of it turn, too, and its work does not know."""
    rng, grid = np.random.default_rng(3), dense.uneven(2)
    halves = [(LARGE, lambda x: x[0] < 0.5), (SMALL, lambda x: x[0] > 0.5)]
    if points:
        bodies = [mpm.MaterialPoints.fill(grid, law, 4, where) for law, where in halves]
        for body in bodies:
            body.stress[:, :3] = -2e6 * rng.uniform(0.5, 1.0, (len(body), 3))
        run = mpm.Simulation(grid, bodies, mpm.Newmark(0.1), [], B_BAR)
    else:
        run = mpm.FiniteElements(grid, halves, mpm.Newmark(0.1), [], b_bar=True)
    inside.prepared(run)
    u = run.nodal("increment").ravel()
    u[:] = 2e-2 * rng.normal(size=len(u))
    K = inside.tangent(run)
    assert np.abs(K - inside.differences(run, 1e-7)).max() < 1e-7 * np.abs(K).max()


@pytest.mark.parametrize("dim", [2, 3])
def test_the_mean_is_that_over_the_material_in_the_cell(dim):
    """By hand: the overlap of each support domain with each cell, and ∇u at the middle of it."""
    rng, grid = np.random.default_rng(1), dense.uneven(dim)
    body = mpm.MaterialPoints.fill(grid, SMALL, 2**dim, lambda x: x[0] + 0.5 * x[1] < 0.9)
    body.x += rng.uniform(-0.02, 0.02, body.x.shape)
    run = mpm.Simulation(grid, body, mpm.Newmark(0.1), [], B_BAR)
    u = rng.normal(size=(grid.nodes, dim))
    found = inside.mean_divergence(run, u)
    lattice, by_hand, volume = grid.lattice, np.zeros(grid.cells), np.zeros(grid.cells)
    for x, half, V in zip(body.x, body.half, body.volume, strict=True):
        low, high = np.maximum(x - half, lattice.lower), np.minimum(x + half, lattice.upper)
        part = np.clip(high - low, 0.0, None).prod(axis=1)
        part *= V / part.sum()  # what reaches beyond the grid is cut off
        for c in np.flatnonzero(part > 0.0):
            place = 0.5 * (low[c] + high[c]) - lattice.lower[c]
            volume[c] += part[c]
            by_hand[c] += part[c] * _divergence(u[lattice.nodes[c]], place, lattice, c)
    full = volume > 0.0
    np.testing.assert_allclose(found[full], by_hand[full] / volume[full], rtol=1e-10, atol=1e-10)
    assert not found[~full].any()
    assert (volume[full] < 0.9 * lattice.volume[full]).any()


def _divergence(u, place, lattice, cell):
    """div u of a cell's corner values (2^dim, dim), x fastest, at a place from its lower corner."""
    h = lattice.upper[cell] - lattice.lower[cell]
    ξ, dim, total = place / h, len(h), 0.0
    for node in range(2**dim):
        up = np.array([(node >> d) & 1 for d in range(dim)])
        line = np.where(up, ξ, 1.0 - ξ)
        for d in range(dim):
            total += u[node, d] * (2 * up[d] - 1) / h[d] * np.delete(line, d).prod()
    return total


@pytest.mark.parametrize("dim", [2, 3])
def test_uniform_stress_pulls_as_it_does_point_by_point(dim):
    """Wherever the body ends: askew, in cut cells."""
    grid = mpm.Grid.box((0.0,) * dim, (8.0,) * dim, (8,) * dim)
    n = np.array([0.85, 0.5, 0.3])[:dim]

    def tilted(x):
        across = n[1] * x[0] - n[0] * x[1] - 4 * (n[1] - n[0])
        return (abs(n @ x - 4 * n.sum()) < 2.1) & (abs(across) < 1.7)

    body = mpm.MaterialPoints.fill(grid, SMALL, 2**dim, tilted)
    body.stress[:] = np.array([1e3, 2e3, -500.0, 300.0, 100.0, -200.0])[: body.stress.shape[1]]
    whole, plain = (
        inside.internal_force(mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], mapping))
        for mapping in (B_BAR, replace(B_BAR, b_bar=False))
    )
    assert np.abs(whole - plain).max() < 1e-13 * np.abs(plain).max()


@pytest.mark.parametrize("points", [False, True])
def test_a_turned_body_bears_nothing(points):
    """F-bar is blind to rotations: here of all nodes by 20°."""
    grid = small_grid(2)
    turn = np.radians(20)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])

    if points:
        body = mpm.MaterialPoints.fill(grid, LARGE, 4)
        run = mpm.Simulation(grid, body, mpm.QuasiStatic(1), [], B_BAR)
        run.locate()
        run.project()
    else:
        run = mpm.FiniteElements(grid, LARGE, mpm.QuasiStatic(1), [], b_bar=True)
    x = grid.space.tabulate_dof_coordinates()[:, :2]
    run.nodal("increment")[:] = x @ (R - np.eye(2)).T
    run.carry()
    stress = run.bodies[0].stress if points else run.gauss_stress()
    assert np.abs(stress).max() < 1e-8 * LARGE.young


@pytest.mark.parametrize("offset", [0.0, 0.15, 0.3])
def test_free_blocks_at_rest_do_not_grow(offset):
    grid = mpm.Grid.box((0.0, 0.0), (8.0, 7.0), (8, 7))
    body = mpm.MaterialPoints.fill(
        grid, SMALL, 4, lambda x: (abs(x[0] - 4) < 2) & (abs(x[1] - 3.5) < 1.5)
    )
    body.x += offset
    body.seat = None if body.seat is None else body.seat + offset
    body.velocity = 1e-6 * np.random.default_rng(0).normal(size=body.x.shape)
    run = mpm.Simulation(
        grid, body, mpm.Newmark(0.5 / SMALL.p_speed), [], replace(mpm.DM_GC, b_bar=True)
    )
    energy = run.record(mpm.Energy())
    for _ in range(600):
        run.step()
    left = energy.left
    assert left[-1] < left[300] < left[0]


# -- when it is chosen -----------------------------------------------------------------------------


def made(law, mapping=mpm.DM_GC):
    grid = small_grid(2)
    body = mpm.MaterialPoints.fill(grid, law, 4)
    return mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], mapping)


def test_laws_that_tie_the_volume_choose_it():
    flow, saturated = LAWS["von Mises"], mpm.Undrained(SMALL, 1e9)
    for law in (flow, LAWS["Mohr-Coulomb"], LAWS["von Mises, Hencky"], saturated):
        assert "means of cells: B-bar (chosen for the materials)" in str(made(law))
        assert mpm.FiniteElements(small_grid(2), law, mpm.Newmark(1e-3), []).b_bar
    for run in (made(SMALL), made(LARGE), made(flow, mpm.GIMP), made(flow, mpm.PAPER["mapping"])):
        assert "B-bar" not in str(run)
    assert "B-bar" not in str(made(flow, replace(mpm.DM_GC, b_bar=False)))
    assert not mpm.FiniteElements(small_grid(2), SMALL, mpm.Newmark(1e-3), []).b_bar


def test_a_clay_column_collapses_without_losing_energy():
    """2 m × 4 m, h = 0.5 m, until it is half as high: what supports have taken is counted."""
    clay = mpm.VonMises(mpm.Hencky(young=2e6, poisson=0.4, density=1800.0), 5e3, 5e3, 0.0)
    grid = mpm.Grid.box((0.0, 0.0), (8.0, 5.0), (16, 10))
    body = mpm.MaterialPoints.fill(grid, clay, 4, lambda x: (x[0] < 2) & (x[1] < 4))
    held = [mpm.Fixed(grid.facets("bottom")), mpm.Fixed(grid.facets("left"), "x")]
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-2), [*held, mpm.Gravity((0.0, -9.81))])
    energy = run.record(mpm.Energy())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run.until(0.8)
    assert 0.01 < energy["supports"][-1] / energy["work"][-1] < 0.1
    assert np.abs(energy.lost).max() < 0.02 * energy["work"][-1]
    assert body.x[:, 1].max() < 2.5
