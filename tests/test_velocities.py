"""Velocities between points and grid: what the deposit keeps, what it smooths, and both
transfers."""

from dataclasses import replace

import dense
import inside
import numpy as np
import plastic
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions
from mpm_fenicsx.mapping.projection import AT_POINTS, DOUBLE_MAPPED

DIMS = pytest.mark.parametrize("dim", [2, 3])
SWEEPS = pytest.mark.parametrize("sweeps", [0, 1, 3])
METHODS = pytest.mark.parametrize("mapping", mpm.MAPPINGS, ids=str)
PAPER = [
    replace(mapping, name=f"{mapping}, double-mapped mass", mass=DOUBLE_MAPPED)
    for mapping in (mpm.DM_G, mpm.DM_GC)
]


def deposited(run):
    """Nodal velocity and acceleration before the step, of nodes with mass."""
    inside.prepared(run)
    return run.nodal("velocity"), run.nodal("acceleration"), summed(run, lambda body: body.mass)


def summed(run, values):
    """Σ_p S_ip q_p of ``values(body)`` over all bodies."""
    return sum(inside.shape_functions(run, n)[0].T @ values(b) for n, b in enumerate(run.bodies))


def scene(dim, mapping, sweeps, rng):
    """Two bodies with random points, velocities and accelerations, and a part of the grid without
    either."""
    grid = dense.uneven(dim)
    bodies = [
        dense.random_body(grid, rng, material=material, inside=inside)
        for material, inside in (
            (dense.SOIL, lambda x: (x[0] < 0.5) & (x[1] < 0.15)),
            (dense.SOFT, lambda x: (x[0] > 0.5) & (x[1] < 0.15)),
        )
    ]
    return mpm.Simulation(grid, bodies, mpm.Newmark(1e-3), [], replace(mapping, sweeps=sweeps))


@SWEEPS
@METHODS
@DIMS
def test_a_rigid_translation_stays_one(dim, mapping, sweeps):
    run = scene(dim, mapping, sweeps, np.random.default_rng(0))
    for body in run.bodies:
        body.velocity[:], body.acceleration[:] = [2.0, -1.0, 3.0][:dim], [-5.0, 4.0, 1.0][:dim]
    v, a, mass = deposited(run)
    there = mass > 1e-12 * mass.max()
    assert 0 < there.sum() < len(there)
    np.testing.assert_allclose(
        v[there], np.tile([2.0, -1.0, 3.0][:dim], (there.sum(), 1)), rtol=1e-9
    )
    np.testing.assert_allclose(
        a[there], np.tile([-5.0, 4.0, 1.0][:dim], (there.sum(), 1)), rtol=1e-9
    )
    np.testing.assert_array_equal(v[mass == 0.0], 0.0)


@pytest.mark.parametrize("mapping", [*mpm.MAPPINGS, *PAPER], ids=str)
@DIMS
def test_sweeps_leave_the_momentum_and_summed_mass_gives_that_of_the_points(dim, mapping):
    """1ᵀM(2 − M̄⁻¹M) = 1ᵀM.  Double-mapped mass weighs nodes otherwise than the deposit where cells
    are partly full."""
    found = []
    for sweeps in (0, 1, 3):
        run = scene(dim, mapping, sweeps, np.random.default_rng(1))
        deposited(run)
        found.append(inside.times_mass(run, run.nodal("velocity")).sum(axis=0))
    at_points = sum(body.mass @ body.velocity for body in run.bodies)
    scale = sum(body.mass @ np.abs(body.velocity) for body in run.bodies).max()
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=1e-10 * scale)
    same = bool(np.abs(found[0] - at_points).max() < 1e-10 * scale)
    assert same is (mapping.mass is AT_POINTS)


@pytest.mark.parametrize("mapping", PAPER, ids=str)
@DIMS
def test_double_mapped_mass_gives_the_momentum_of_the_points_where_the_grid_is_full(dim, mapping):
    grid, rng = dense.uneven(dim), np.random.default_rng(1)
    body = dense.tiles(grid, rng)
    body.velocity = rng.normal(size=body.x.shape)
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], mapping)
    deposited(run)
    on_grid = inside.times_mass(run, run.nodal("velocity")).sum(axis=0)
    np.testing.assert_allclose(on_grid, body.mass @ body.velocity, atol=1e-10 * body.mass.sum())


@METHODS
def test_without_sweeps_it_is_momentum_by_mass(mapping):
    run = scene(2, mapping, 0, np.random.default_rng(2))
    v, a, mass = deposited(run)
    sums = summed(run, lambda b: b.mass[:, None] * np.hstack((b.velocity, b.acceleration)))
    there = mass > 0.0
    np.testing.assert_allclose(
        np.hstack((v, a))[there], sums[there] / mass[there, None], rtol=1e-12
    )


@SWEEPS
def test_a_linear_field_comes_back_where_the_points_around_a_node_are_even_and_not_at_the_edge(
    sweeps,
):
    """Each sweep reaches one node further: what the edge of the body spoils is one row, and one
    more a sweep."""
    grid = mpm.Grid.box((0, 0), (10, 10), (10, 10))
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 9)
    A = np.array([[1.0, -2.0], [0.5, 3.0]])
    body.velocity = body.x @ A.T
    v, _, _ = deposited(
        mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], replace(mpm.GIMP, sweeps=sweeps))
    )
    x = grid.space.tabulate_dof_coordinates()[:, :2]
    depth = np.minimum(x, 10 - x).min(axis=1)
    error = np.abs(v - x @ A.T).max(axis=1)
    assert error[depth > sweeps + 0.5].max() < 1e-11
    assert error[np.abs(depth - sweeps) < 0.5].max() > 1e-4


def roundtrip(mapping, sweeps, jitter):
    """Error of a wave of 8 cells that went from the grid to the points and is deposited again."""
    grid = mpm.Grid.box((0, 0), (16, 1), (16, 1))
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 16, jitter=jitter)
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], replace(mapping, sweeps=sweeps))
    run.locate()
    wave = np.cos(2 * np.pi / 8 * grid.space.tabulate_dof_coordinates()[:, :1]) * np.array(
        [[1.0, 0.0]]
    )
    body.velocity[:] = inside.shape_functions(run)[0] @ wave
    return np.abs(deposited(run)[0] - wave).max()


@pytest.mark.parametrize("jitter", [0.0, 0.3])
@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.DM_GC], ids=str)
def test_one_sweep_takes_most_of_the_smoothing_out(mapping, jitter):
    assert roundtrip(mapping, 1, jitter) < roundtrip(mapping, 0, jitter) / 3


def test_each_sweep_takes_the_same_share_out():
    """Even points, linear shape functions: the wave is an eigenvector of M̄⁻¹M with 1 - e, and
    e^(k+1) is left."""
    e = roundtrip(mpm.MPM, 0, 0.0)
    assert e == pytest.approx((1 - np.cos(np.pi / 4)) / 3, rel=0.05)
    for sweeps in (1, 2, 4):
        assert roundtrip(mpm.MPM, sweeps, 0.0) == pytest.approx(e ** (sweeps + 1), rel=1e-6)


# -- transfers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("transfer", [mpm.trapezoidal, mpm.flip])
def test_a_transfer_is_exact_for_a_constant_acceleration(transfer):
    rng = np.random.default_rng(3)
    weights = rng.dirichlet(np.ones(6), size=9)
    v0, g, dt = rng.normal(size=(6, 2)), np.array([3.0, -7.0]), 0.1
    v, a = weights @ v0, np.tile(g, (9, 1))
    start = v.copy()
    before, after = (v0, np.tile(g, (6, 1))), (v0 + g * dt, np.tile(g, (6, 1)))
    transfer(v, a, lambda nodal: weights @ nodal, before, after, mpm.Newmark(dt))
    np.testing.assert_allclose(v, start + g * dt, rtol=1e-13)
    np.testing.assert_allclose(a, np.tile(g, (9, 1)), rtol=1e-13)


def test_transfers_by_their_formulae():
    """Random fields: FLIP adds the change of the grid's velocity, the other one Newmark's mean of
    two accelerations."""
    rng = np.random.default_rng(4)
    weights = rng.dirichlet(np.ones(6), size=9)
    before, after = tuple(rng.normal(size=(2, 6, 3))), tuple(rng.normal(size=(2, 6, 3)))
    v, a = rng.normal(size=(2, 9, 3))
    for transfer in (mpm.flip, mpm.trapezoidal):
        new = v.copy(), a.copy()
        transfer(
            *new,
            lambda nodal: weights @ nodal,
            before,
            after,
            mpm.Newmark(0.2, beta=0.35, gamma=0.7),
        )
        change = after[0] - before[0] if transfer is mpm.flip else None
        exact = v + (
            weights @ change if transfer is mpm.flip else 0.06 * a + 0.14 * (weights @ after[1])
        )
        np.testing.assert_allclose(new[0], exact, rtol=1e-13)
        np.testing.assert_allclose(new[1], weights @ after[1], rtol=1e-13)


@SWEEPS
@pytest.mark.parametrize("transfer", [mpm.trapezoidal, mpm.flip])
@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.DM_GC], ids=str)
def test_a_body_that_falls_with_constant_acceleration_is_where_it_should_be(
    mapping, transfer, sweeps
):
    grid = mpm.Grid.rectilinear([np.array([0, 0.4, 0.9, 1.5, 2.0])] * 2)
    g = np.array([4.0, 2.0])
    dt = 0.05
    body = mpm.MaterialPoints.fill(
        grid, dense.SOIL, 4, jitter=0.4, inside=lambda x: ((x > 0.4) & (x < 1.0)).all(axis=0)
    )
    body.acceleration = np.tile(g, (len(body), 1))
    start = body.x.copy()
    run = mpm.Simulation(
        grid,
        body,
        mpm.Newmark(dt),
        [mpm.Gravity(tuple(g))],
        replace(mapping, sweeps=sweeps, transfer=transfer),
        plastic.DIRECT,
    )
    run.until(8 * dt)
    np.testing.assert_allclose(body.velocity, np.tile(8 * dt * g, (len(body), 1)), rtol=1e-8)
    np.testing.assert_allclose(
        body.x - start, np.tile((8 * dt) ** 2 / 2 * g, (len(body), 1)), rtol=1e-8
    )


def test_sweeps_are_paid_for_only_where_they_are_asked_for(monkeypatch):
    compiled = []
    compile_form = dolfinx_versions.compile_form
    monkeypatch.setattr(
        dolfinx_versions, "compile_form", lambda form: (compiled.append(1), compile_form(form))[1]
    )
    counts = []
    for sweeps in (0, 2):
        compiled.clear()
        grid = dense.uneven(2)
        run = mpm.Simulation(
            grid,
            mpm.MaterialPoints.fill(grid, dense.SOIL, 4),
            mpm.Newmark(1e-3),
            [mpm.Fixed(grid.facets("bottom"))],
            replace(mpm.DM_GC, sweeps=sweeps),
        )
        counts.append(len(compiled))
        assert hasattr(run.deposit, "_smooth") is bool(sweeps)
    assert counts[1] == counts[0]  # the mass of inertia serves


@pytest.mark.parametrize("sweeps", [-1, 0.5, "many"])
def test_refusals(sweeps):
    with pytest.raises(ValueError, match=f"sweeps must be a .*got {sweeps!r}"):
        replace(mpm.DM_GC, sweeps=sweeps)
