"""Material point runs: rigid motions, momentum, free fall, patch tests, and what a step may
cost."""

from dataclasses import replace

import dense
import inside
import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions

ZERO = mpm.InitialAcceleration.ZERO
DIRECT = mpm.Solver(petsc={"ksp_type": "preonly", "pc_type": "lu"})
CONTIGUOUS = (mpm.GIMP, mpm.DM_G, mpm.DM_GC)


def block(grid, upper=1.5, **keywords):
    """Randomly placed points that touch no side of the grid."""
    return mpm.MaterialPoints.fill(
        grid,
        dense.SOIL,
        2**grid.dim,
        inside=lambda x: ((x > 0.5) & (x < upper)).all(axis=0),
        **keywords,
    )


def jitter(mapping, dim):
    """Even points where random ones leave the matrix singular: CMPM's everywhere, plain MPM's in
    3D."""
    return 0.0 if mapping is mpm.CMPM or (mapping is mpm.MPM and dim == 3) else 0.4


def wide(dim):
    return mpm.Grid.box((0,) * dim, (4,) * dim, (8,) * dim)


# -- motions without strain ------------------------------------------------------------------------


@pytest.mark.parametrize("mapping", mpm.MAPPINGS, ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_translation_across_cells_leaves_no_stress_and_all_momentum(dim, mapping):
    grid = wide(dim)
    body = block(grid, jitter=jitter(mapping, dim))
    v = np.array([7.0, 4.0, -1.5])[:dim]
    body.velocity = np.tile(v, (len(body), 1))
    start = body.x.copy()
    run = mpm.Simulation(grid, body, mpm.Newmark(0.02), [], mapping, DIRECT)
    run.until(0.26)
    moved = v * 0.26
    assert moved[0] > 3 * 0.5
    momentum = body.mass @ body.velocity
    np.testing.assert_allclose(momentum, body.mass.sum() * v, rtol=1e-10)
    np.testing.assert_allclose(body.x - start, np.tile(moved, (len(body), 1)), atol=1e-9)
    assert np.abs(body.stress).max() < 1e-9 * dense.SOIL.young


@pytest.mark.parametrize("mapping", mpm.MAPPINGS, ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_free_fall_is_exact(dim, mapping):
    grid, g, dt, steps = wide(dim), np.array([9.0, 5.0, 2.0])[:dim], 0.05, 8
    bodies = [
        block(grid, jitter=jitter(mapping, dim)),
        mpm.MaterialPoints.fill(
            grid,
            dense.SOFT,
            2**dim,
            seed=3,
            jitter=jitter(mapping, dim),
            inside=lambda x: (x[0] > 1.5) & (x[0] < 2) & (x[1] < 1) & (x[-1] < 1),
        ),
    ]
    start = [body.x.copy() for body in bodies]
    for body in bodies:
        body.acceleration = np.tile(g, (len(body), 1))  # it falls already
    run = mpm.Simulation(grid, bodies, mpm.Newmark(dt), [mpm.Gravity(tuple(g))], mapping, DIRECT)
    run.until(steps * dt)
    for body, x in zip(bodies, start, strict=True):
        np.testing.assert_allclose(body.velocity, np.tile(g * run.time, (len(body), 1)), rtol=1e-10)
        np.testing.assert_allclose(
            body.x - x, np.tile(g * run.time**2 / 2, (len(body), 1)), rtol=1e-10
        )


@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.DM_GC], ids=str)
def test_both_transfers_agree_while_the_motion_is_rigid(mapping):
    found = []
    for transfer in (mpm.trapezoidal, mpm.flip):
        grid = wide(2)
        body = block(grid, jitter=0.4)
        body.velocity = np.tile([1.0, 2.0], (len(body), 1))
        run = mpm.Simulation(
            grid,
            body,
            mpm.Newmark(0.02),
            [mpm.Gravity(lambda t: (30 * np.sin(9 * t), 20 * t))],
            replace(mapping, transfer=transfer),
            DIRECT,
        )
        run.until(0.4)
        found.append((body.x, body.velocity, body.acceleration))
    for a, b in zip(*found, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-7)


# -- momentum --------------------------------------------------------------------------------------


def stressed(grid, rng):
    body = block(grid, jitter=0.4)
    body.stress = 2e4 * rng.normal(size=body.stress.shape)
    body.velocity = rng.normal(size=body.x.shape)
    return body


@pytest.mark.parametrize("transfer", [mpm.trapezoidal, mpm.flip])
@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.CMPM], ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_internal_stress_does_not_change_the_momentum_of_a_free_body(dim, mapping, transfer):
    """With mass summed at points, what the points take up is what the grid's equation of motion
    gave."""
    grid = wide(dim)
    body = stressed(grid, np.random.default_rng(2))
    mapping = replace(mapping, sweeps=0 if transfer is mpm.flip else 1, transfer=transfer)
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], mapping, DIRECT)
    before = body.mass @ body.velocity
    scale = body.mass @ np.abs(body.velocity)
    for _ in range(3):
        run.step()
    change = body.mass @ body.velocity - before
    assert np.abs(body.stress).max() > 1.0
    assert np.abs(change).max() < 1e-9 * scale.max()


@pytest.mark.parametrize("mapping", mpm.MAPPINGS, ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_the_grid_gives_a_free_body_no_net_force(dim, mapping):
    grid = wide(dim)
    body = stressed(grid, np.random.default_rng(2))
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], mapping, DIRECT)
    run.step()
    f = inside.times_mass(run, run.end_of_step()[1])
    assert np.abs(f).max() > 1.0
    assert np.abs(f.sum(axis=0)).max() < 1e-9 * np.abs(f).sum()


# -- patch tests -----------------------------------------------------------------------------------


def pulled(grid, points, mapping):
    """Error of displacement and stress under a uniform pull of 20 kPa, both relative."""
    dim, t, (E, ν) = grid.dim, 2e4, (dense.SOIL.young, dense.SOIL.poisson)
    rollers = {"left": "x", "bottom": "y", "back": "z"}
    terms = [mpm.Fixed(grid.facets(side), rollers[side]) for side in list(rollers)[:dim]]
    terms.append(mpm.Traction(grid.facets("right"), (t, *(0.0,) * (dim - 1))))
    if mapping is None:
        run = mpm.FiniteElements(grid, dense.SOIL, mpm.QuasiStatic(1), terms)
        run.step()
        x, u = grid.space.tabulate_dof_coordinates()[:, :dim], run.nodal("displacement")
        stress = run.stress(np.arange(grid.owned_cells))
    else:
        x = points.x.copy()
        run = mpm.Simulation(grid, points, mpm.QuasiStatic(1), terms, mapping)
        run.step()
        u, stress = points.x - x, points.stress
    strain = (np.array([1 - ν**2, -ν * (1 + ν)]) if dim == 2 else np.array([1, -ν, -ν])) * t / E
    exact = np.zeros_like(stress)
    exact[:, 0] = t
    if dim == 2:
        exact[:, 2] = ν * t
    u_exact = strain * x
    return np.abs(u - u_exact).max() / np.abs(u_exact).max(), np.abs(stress - exact).max() / t


@pytest.mark.parametrize("dim", [2, 3])
def test_finite_elements_pass_the_patch_test(dim):
    assert max(pulled(dense.uneven(dim), None, None)) < 1e-10


@pytest.mark.parametrize("mapping", mpm.MAPPINGS, ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_evenly_placed_points_pass_the_patch_test(dim, mapping):
    grid = dense.uneven(dim)
    assert max(pulled(grid, mpm.MaterialPoints.fill(grid, dense.SOIL, 2**dim), mapping)) < 1e-10


@pytest.mark.parametrize("mapping", mpm.MAPPINGS, ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_random_support_domains_without_gaps_pass_it_if_they_are_averaged_over(dim, mapping):
    """GIMP, DM-G and DM-GC see the domains and are exact; the others see their centres only and are
    not."""
    grid = dense.uneven(dim)
    error = max(pulled(grid, dense.tiles(grid, np.random.default_rng(4)), mapping))
    if mapping.support:
        assert error < 1e-10
    else:
        assert error > 1e-2


@pytest.mark.parametrize("mapping", CONTIGUOUS, ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_full_grid_starts_like_finite_elements(dim, mapping):
    """Support domains that tile the grid give the element matrices to round-off."""
    grid = dense.uneven(dim)
    body = dense.tiles(grid, np.random.default_rng(6))
    terms = [
        mpm.Fixed(grid.facets("left"), "x"),
        mpm.ViscoelasticBoundary(grid.facets("bottom"), dense.SOFT, 2.0),
        mpm.Traction(grid.facets("top"), lambda t, x: 1e3 * x),
        mpm.Gravity((1.0,) * dim),
    ]
    points = mpm.Simulation(
        grid, body, mpm.Newmark(1e-3), terms, mapping, DIRECT, initial_acceleration=ZERO
    )
    twin = mpm.FiniteElements(grid, dense.SOIL, mpm.Newmark(1e-3), terms, initial_acceleration=ZERO)
    points.step()
    twin.step()
    u = twin.nodal("increment").ravel()
    np.testing.assert_allclose(points.nodal("increment").ravel(), u, atol=1e-11 * np.abs(u).max())


# -- what a step may cost --------------------------------------------------------------------------


def full_scene(stepping, mapping=mpm.DM_GC):
    grid = dense.uneven(2)
    inside = {"inside": lambda x: x[0] > 0.3}
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4, jitter=0.2, **inside)
    on = mpm.MaterialPoints.fill(grid, dense.SOIL, 4, **inside).surface("left")
    terms = [
        mpm.Fixed(grid.facets("bottom")),
        mpm.Gravity((0.0, -9.81)),
        mpm.Traction(on, lambda t, x: 1e2 * x),
        mpm.Traction(grid.facets("top"), lambda t: (0.0, -1e3 * t)),
    ]
    if stepping.dynamic:
        terms.append(mpm.ViscoelasticBoundary(grid.facets("right"), dense.SOFT, 2.0))
    return mpm.Simulation(grid, body, stepping, terms, mapping)


@pytest.mark.parametrize(
    ("stepping", "mapping", "solves"),
    [
        (mpm.QuasiStatic(4), mpm.DM_GC, 1),
        (mpm.Newmark(1e-4), replace(mpm.DM_GC, correction=mpm.AccelerationCorrection.OFF), 1),
        (mpm.Newmark(1e-4), replace(mpm.DM_GC, correction=mpm.AccelerationCorrection.IMPLICIT), 2),
    ],
    ids=["static", "dynamic", "corrected"],
)
def test_a_linear_scene_solves_once_a_step_and_once_to_correct_it(stepping, mapping, solves):
    run = full_scene(stepping, mapping)
    counting = inside.counting(run)
    for step in range(1, 4):
        run.step()
        assert counting.solves == step * solves


@pytest.mark.parametrize(
    "stepping", [mpm.Newmark(1e-4), mpm.QuasiStatic(4)], ids=["dynamic", "static"]
)
@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.DM_GC], ids=str)
def test_a_step_compiles_and_allocates_nothing(mapping, stepping, monkeypatch):
    run = full_scene(stepping, mapping)
    run.step()  # the first in which a loaded cell is cut makes a matrix of rows, once

    def never(*_, **__):
        raise AssertionError("compiled in a step")

    for name in ("compile_form", "space", "create_matrix"):
        monkeypatch.setattr(dolfinx_versions, name, never)
    before = inside.allocated(run)
    for _ in range(3):
        run.step()
    assert inside.allocated(run) == before


def test_points_keep_their_mass_and_their_arrays_fit():
    run = full_scene(mpm.Newmark(1e-4))
    body = run.bodies[0]
    mass, x = body.mass.copy(), body.x
    for _ in range(3):
        run.step()
    np.testing.assert_array_equal(body.mass, mass)
    assert body.x is x
    assert body.stress.shape == (len(body), 4)
    assert np.isfinite(body.stress).all()


# -- more than one body, and statics ---------------------------------------------------------------


def test_two_bodies_are_one_where_they_are_of_one_material():
    grid = dense.uneven(2)
    whole = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
    halves = [
        mpm.MaterialPoints.fill(grid, dense.SOIL, 4, inside=inside)
        for inside in (lambda x: x[0] < 0.5, lambda x: x[0] >= 0.5)
    ]
    for bodies in (whole, halves):
        mpm.Simulation(
            grid,
            bodies,
            mpm.Newmark(1e-3),
            [mpm.Fixed(grid.facets("bottom")), mpm.Gravity((2.0, -9.81))],
            solver=DIRECT,
        ).until(5e-3)
    order, parts = np.lexsort(whole.x.T), np.vstack([body.x for body in halves])
    np.testing.assert_allclose(parts[np.lexsort(parts.T)], whole.x[order], rtol=1e-12)


def test_self_weight_in_steps_is_the_pressure_of_depth():
    grid = mpm.Grid.rectilinear([np.array([0.0, 1.0]), np.array([0.0, 0.7, 1.5, 2.6, 3.0])])
    soil = mpm.LinearElastic(young=1e9, poisson=0.25, density=2000.0)
    body = mpm.MaterialPoints.fill(grid, soil, 4)
    place = np.searchsorted([0.7, 1.5, 2.6], body.x[:, 1])
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom"), "y"),
        mpm.Gravity(lambda load: (0.0, -10.0 * load)),
    ]
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(5), terms, mpm.GIMP)
    run.until(1.0)
    assert run.steps == 5
    mean = (
        2000.0 * 10.0 * (3.0 - np.array([0.35, 1.1, 2.05, 2.8])[place])
    )  # all that an element knows of it
    finite_strain = 2000.0 * 10.0 * 3.0 / 1e9
    np.testing.assert_allclose(-body.stress[:, 1], mean, atol=finite_strain * mean.max())
    np.testing.assert_allclose(
        body.stress[:, 0], 1 / 3 * body.stress[:, 1], atol=finite_strain * mean.max()
    )


def test_the_end_of_a_step_is_what_a_falling_body_has():
    grid, g = mpm.Grid.box((0, 0), (2, 2), (4, 4)), np.array([3.0, -9.81])
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [mpm.Gravity(tuple(g))])
    for n in (1, 2):
        run.step()
        v, a = run.end_of_step()
        np.testing.assert_allclose(v, np.tile(n * 1e-3 * g, (grid.nodes, 1)), rtol=1e-9)
        np.testing.assert_allclose(a, np.tile(g, (grid.nodes, 1)), rtol=1e-9)
        np.testing.assert_allclose(run.nodal("velocity"), v - 1e-3 * a, atol=1e-12)
    static = mpm.Simulation(grid, body, mpm.QuasiStatic(1), [mpm.Fixed(grid.facets("bottom"))])
    with pytest.raises(ValueError, match="end_of_step is of dynamic runs, got QuasiStatic"):
        static.end_of_step()
    with pytest.raises(ValueError, match="displacement"):
        run.nodal("displacement")
