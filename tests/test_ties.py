"""Light nodes of cut cells: what ties keep, and that bodies of any shape come to rest and stay
there."""

from dataclasses import replace

import inside
import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.slope import BODIES, SOIL, WEAK, WEAK_BLOCK, AtRest

MAPPINGS = [mpm.GIMP, mpm.DM_G, mpm.DM_GC, mpm.DM_GCL]


def cut_block(dim, cut, stepping, terms=(), mapping=mpm.DM_GC, soil=SOIL):
    """Three cells each way and ``cut`` of a cell more, with room around, on lines that are not
    even."""
    lines = np.array([-0.5, -0.25, 0.0, 0.25, 0.55, 0.75, 1.0, 1.25])
    grid = mpm.Grid.rectilinear([lines] * dim)
    body = mpm.MaterialPoints.fill(
        grid, soil, 2**dim, inside=lambda x: ((x > 0) & (x < 0.75)).all(axis=0)
    )
    body.x += cut * 0.25
    body.stress[:, 2] = 1e-9  # a body that bears stress is one at rest, to be tied like one
    run = mpm.Simulation(
        grid, body, stepping, [mpm.Gravity((0.0, -9.81, 0.0)[:dim]), *terms], mapping
    )
    run.prepare(0.0, 1e-3)
    return run


# -- what ties keep --------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("cut", [1e-6, 1e-3, 0.3])
def test_linear_motions_are_kept_and_so_are_forces_and_moments(dim, cut):
    run = cut_block(dim, cut, mpm.Newmark(1e-3))
    x = run.grid.space.tabulate_dof_coordinates()[:, :dim]
    tied, rng = inside.tied(run), np.random.default_rng(0)
    assert tied.sum() >= 4**dim - 3**dim
    linear = x @ rng.normal(size=(dim, dim)) + rng.normal(size=dim)
    spoilt = np.where(tied[:, None], rng.normal(size=x.shape), linear)
    force = rng.normal(size=x.shape)
    motion, passed = inside.through_ties(run, spoilt, force)
    np.testing.assert_allclose(motion, linear, atol=1e-13)
    assert (passed[tied] == 0.0).all()
    np.testing.assert_allclose(passed.sum(axis=0), force.sum(axis=0), atol=1e-12)
    np.testing.assert_allclose(x.T @ passed, x.T @ force, atol=1e-12)


HELD = ("left", "x"), ("bottom", None)
SIDES = {
    "free": (mpm.Newmark(1e-3), [], []),
    "rollers": (mpm.Newmark(1e-3), HELD, []),
    "rows": (mpm.QuasiStatic(1.0), HELD, []),
    "tied sides": (mpm.Newmark(1e-3), [("bottom", "y")], [mpm.Tied("left", "right")]),
}


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("sides", SIDES)
def test_the_matrix_is_that_of_the_motions_left(dim, sides):
    """PᵀKP by hand, of nodes with a component that is free; others have a diagonal of their own."""
    lines = np.array([0.0, 0.25, 0.55, 0.75, 1.0, 1.25])
    grid = mpm.Grid.rectilinear([lines] * dim)
    inner = 1.25 if sides == "tied sides" else 0.9
    body = mpm.MaterialPoints.fill(
        grid, SOIL, 2**dim, inside=lambda x: (x[0] < inner) & (x[1:] < 0.75).all(axis=0)
    )
    body.x[:, 1:] += 0.05
    body.stress[:, 2] = 1e-9
    stepping, held, terms = SIDES[sides]
    terms = [*terms, *(mpm.Fixed(grid.facets(side), components) for side, components in held)]
    run = mpm.Simulation(grid, body, stepping, [mpm.Gravity((0.0, -9.81, 0.0)[:dim]), *terms])
    run.prepare(0.0, 1e-3)
    found = inside.equations(run, assemble=True)
    assert inside.in_blocks(run) == (sides != "rows") and found.ties is not None
    free = ~(found.idle | found.fixed | inside.tied_components(run))
    assert inside.tied(run).any() and (found.fixed.any() or sides == "free")
    kept = np.repeat(free.reshape(-1, dim).any(axis=1), dim)
    P = found.ties * ~found.fixed
    by_hand = (P.T @ found.matrix @ P)[np.ix_(kept, kept)]
    held = np.flatnonzero(~free[kept])
    by_hand[held, held] = found.solved[held, held]
    assert (found.solved[held, held] == found.solved.diagonal().max()).all()
    np.testing.assert_allclose(found.solved, by_hand, atol=1e-12 * np.abs(by_hand).max())


def test_where_no_cell_is_cut_there_is_nothing():
    """No ties, and the matrix of blocks stays; with a term that holds cut cells, or told not to,
    not even the look."""
    run = cut_block(2, 0.0, mpm.Newmark(1e-3))
    assert not inside.tied(run).any()
    assert inside.equations(run, assemble=True).ties is None and inside.in_blocks(run)
    for other in (
        cut_block(2, 0.3, mpm.Newmark(1e-3), [mpm.GhostPenalty()]),
        cut_block(2, 0.3, mpm.Newmark(1e-3), mapping=replace(mpm.DM_GC, hold_cut_cells=False)),
    ):
        assert inside.tied(other) is None


def test_bodies_of_unlike_density_are_full_alike():
    """A light body beside a heavy one is not taken for a cut one."""
    grid = mpm.Grid.box((0, 0), (4, 3), (4, 3))
    heavy, light = (
        mpm.MaterialPoints.fill(
            grid,
            mpm.LinearElastic(20e6, 0.25, density),
            4,
            inside=lambda x, low=low: (x[0] > low) & (x[0] < low + 2) & (x[1] < 2),
        )
        for low, density in ((0, 3000.0), (2, 30.0))
    )
    light.stress[:, 2] = 1e-9
    run = mpm.Simulation(grid, [heavy, light], mpm.Newmark(1e-3), [mpm.Gravity((0.0, -9.81))])
    run.step()
    assert not inside.tied(run).any()
    light.x[:, 1] += 0.3
    run.prepare(0.0, 1e-3)
    assert inside.tied(run).sum() == 3


def test_a_cut_block_falls_freely():
    for dim in (2, 3):
        run = cut_block(dim, 0.1, mpm.Newmark(1e-3))
        run.step()
        assert inside.equations(run).ties is not None
        for body in run.bodies:
            np.testing.assert_allclose(body.velocity[:, 1] / body.velocity[0, 1], 1.0, atol=1e-9)
            assert np.abs(body.stress).max() < 1e-7


# -- rest ------------------------------------------------------------------------------------------


CASES = [
    ("slope", 0.3, mpm.DM_GC, SOIL),
    ("step", 0.15, mpm.GIMP, WEAK),
    ("embankment", 0.15, mpm.DM_G, SOIL),
    ("block", 0.15, mpm.DM_GCL, WEAK_BLOCK),
    ("block", 0.0, mpm.DM_GC, SOIL),
]
NAMES = [
    f"{name}-{offset}-{mapping}-{type(soil).__name__}" for name, offset, mapping, soil in CASES
]


@pytest.mark.parametrize(("name", "offset", "mapping", "soil"), CASES, ids=NAMES)
def test_any_body_settles_and_nothing_moves_when_its_edges_become_dashpots(
    name, offset, mapping, soil
):
    """The weight lies on the base to 1e-10; no velocity above 1e-4 gH/c."""
    rest = AtRest(name, offset, mapping, soil)
    assert rest.left <= 1e-10
    assert np.abs(rest.borne()[1] - 1.0) < 1e-10
    if soil is not SOIL:
        assert 0.0 < (rest.body.history[:, 0] > 0.0).mean() < 0.9
    run = rest.release()
    for _ in range(60):
        run.step()
        assert rest.fastest() < 1e-4


def test_left_alone_a_slope_does_not_settle_and_says_where():
    grid = mpm.Grid.box((0, 0), (4, 2.5), (16, 10))
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: (x[0] + x[1] < 3) & (x[1] < 2))
    body.x += 0.3 * 0.25
    run = mpm.Simulation(
        grid,
        body,
        mpm.QuasiStatic(1),
        [
            mpm.Gravity((0.0, -9.81)),
            mpm.Fixed(grid.facets("left"), "x"),
            mpm.Fixed(grid.facets("bottom")),
        ],
        replace(mpm.DM_GC, hold_cut_cells=False),
    )
    run.step()
    with pytest.raises(
        mpm.RunError, match=r"out of balance by .* after 40 steps .* N at the node x="
    ):
        run.settle(steps=40)
    assert run.strict_imbalance == run.balance()[1]


def test_the_strict_figure_stays():
    """With every node on its own a settled body is out of balance where it is cut: 7e-3 of the
    forces at work."""
    rest = AtRest("block", 0.15, mpm.DM_GC)
    assert rest.static.balance()[1] < 1e-10 < 1e-4 < rest.static.strict_imbalance


def test_dashpots_that_drift_over_a_line_use_ties_and_leave_them():
    grid = mpm.Grid.box((0, -1), (1, 3), (4, 16))
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: (x[1] > 0) & (x[1] < 2))
    body.velocity = np.tile([0.0, -50.0], (len(body), 1))
    run = mpm.Simulation(
        grid,
        body,
        mpm.Newmark(1e-3),
        [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.ViscousBoundary(body.surface("bottom"), mpm.LinearElastic(1e2, 0.0, 1.0)),
        ],
    )
    tied = []
    for _ in range(8):
        run.step()
        tied.append(inside.tied(run).any())
    assert True in tied and False in tied
    np.testing.assert_allclose(body.velocity[:, 1], -50.0, rtol=1e-3)


def test_all_options_of_bodies_are_known():
    assert set(case[0] for case in CASES) == set(BODIES)
