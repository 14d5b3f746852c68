"""Ghost penalty: what it does not touch, what it is by hand, and that light nodes stay where the
others are."""

from dataclasses import replace

import dense
import inside
import numpy as np
import pytest

import mpm_fenicsx as mpm

SOIL = dense.SOIL
M = SOIL.density * SOIL.p_speed**2
H, STRESS = 0.25, 100e3
DIM = pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.validation)])
DT = 1e-3


CURE = (mpm.GhostPenalty(),)


def block(dim, cut, mapping, stepping, terms=CURE, n=3):
    """A block of n cells each way whose upper corner lies ``cut`` of a cell beyond the grid lines,
    with room around."""
    grid = mpm.Grid.box([-2 * H] * dim, [(n + 3) * H] * dim, [n + 5] * dim)
    body = mpm.MaterialPoints.fill(
        grid, SOIL, 2**dim, inside=lambda x: ((x > 0) & (x < n * H)).all(axis=0)
    )
    body.x += cut * H
    return mpm.Simulation(grid, body, stepping, terms, mapping)


def ready(run):
    """The run, at the start of its first step."""
    run.prepare(0.0, run.stepping.dt)
    return run


def matrix(run):
    """K at the start of its first step."""
    return inside.equations(ready(run), assemble=True).matrix


def force(run, *motion):
    """Nodal forces (nodes, dim) of the penalty; ``motion``: u and in dynamics v and a."""
    for name, values in zip(("increment", "velocity", "acceleration"), motion, strict=False):
        run.nodal(name)[:] = values
    return inside.force_of(run, -1)


# -- what it does not touch ------------------------------------------------------------------------


@DIM
@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.DM_GC], ids=str)
def test_linear_motions_do_not_feel_it_and_momentum_is_kept(dim, mapping):
    rng = np.random.default_rng(0)
    grid = dense.uneven(dim)
    body = dense.random_body(grid, rng, inside=lambda x: x.sum(axis=0) < 0.55 * dim)
    run = ready(mpm.Simulation(grid, body, mpm.Newmark(DT), CURE, mapping))
    x = grid.space.tabulate_dof_coordinates()[:, :dim]
    motions = rng.normal(size=(3, *x.shape))
    found = force(run, *motions)
    size = np.abs(found).max()
    assert size > 0.0
    affine = [x @ rng.normal(size=(dim, dim)) + rng.normal(size=dim) for _ in range(3)]
    assert np.abs(force(run, *affine)).max() < 1e-13 * size
    assert np.abs(found.sum(axis=0)).max() < 1e-13 * size
    moment = np.einsum("ni,nj->ij", x, found)
    assert np.abs(moment - moment.T).max() < 1e-13 * size


@DIM
@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_GC], ids=str)
def test_a_body_in_free_flight_stays_as_it_is(dim, mapping):
    """It goes from cell to cell; its surface points, under no load, lie a hair outside, in cells
    without material."""
    run = block(dim, 0.0, mapping, mpm.Newmark(DT), n=2)
    body = run.bodies[0]
    surface = body.surface("right")
    surface.x[:, 0] += 1e-6 * H
    factor = mpm.Solver(petsc={"ksp_type": "preonly", "pc_type": "lu"})
    load = mpm.Traction(surface, (0.0,) * dim)
    run = mpm.Simulation(run.grid, body, run.stepping, [load, *CURE], mapping, factor)
    v = np.array([1.0, 0.17, -0.05])[:dim] * H / DT
    body.velocity[:] = v
    start = body.x.copy()
    for _ in range(2):
        run.step()
    assert np.abs(body.x - start - 2 * DT * v).max() < 1e-12
    assert np.abs(body.velocity - v).max() < 1e-11 * v.max()
    assert np.abs(body.stress).max() < 1e-9 * M


def test_where_cells_are_full_and_in_finite_elements_there_is_nothing():
    whole, bare = (block(2, 0.0, mpm.DM_GC, mpm.Newmark(DT), terms) for terms in (CURE, []))
    # DOLFINx assembles the one, our own loop the other
    K = matrix(bare)
    np.testing.assert_allclose(matrix(whole), K, rtol=0, atol=1e-14 * np.abs(K).max())
    assert not inside.bill(bare).facets_between_cells
    grid, found = dense.uneven(2), []
    for terms in ([], CURE):
        run = mpm.FiniteElements(
            grid,
            SOIL,
            mpm.Newmark(DT),
            [mpm.Fixed(grid.facets("bottom")), mpm.Gravity((0.0, -9.81)), *terms],
        )
        run.step()
        assert not inside.bill(run).facets_between_cells
        found.append(run.displacement.x.array.copy())
    assert np.array_equal(*found) and np.abs(found[0]).max() > 0.0


# -- what it is ------------------------------------------------------------------------------------


def jumps(grid, x, d):
    """[∂N_i/∂n] (points, nodes) at x on facets across direction d, from differences of hats, which
    are linear."""
    e = 1e-3 * np.eye(grid.dim)[d]
    there, after, before = (dense.hats(grid, x + k * e) for k in (0, 1, -1))
    return (after - 2 * there + before) / 1e-3


@DIM
@pytest.mark.parametrize(("mapping", "dynamic"), [(mpm.GIMP, False), (mpm.DM_GC, True)])
def test_it_is_the_sum_over_facets_by_hand(dim, mapping, dynamic):
    """A body fills the first two cells each way of an uneven grid, and 1e-5 of the next.

    Cells with 1e-10 and less, over edges and corners, have stiffness only.
    """
    lines = [np.array([0.0, 0.3, 0.8, 1.0])] * dim
    grid, cut = mpm.Grid.rectilinear(lines), 1e-5
    body = mpm.MaterialPoints.fill(grid, SOIL, 2**dim, inside=lambda x: (x < 0.8).all(axis=0))
    body.x += cut * (body.x > 0.5)
    stepping, K, G = mpm.Newmark(DT) if dynamic else mpm.QuasiStatic(1), 0.07, 0.2
    matrices = [
        matrix(mpm.Simulation(grid, body, stepping, terms, mapping))
        for terms in ([mpm.GhostPenalty(K, G)], [])
    ]
    factor = stepping.acceleration[0] if dynamic else 0.0
    low = np.stack(np.meshgrid(*[range(3)] * dim, indexing="ij"), -1).reshape(-1, dim)
    gauss = np.array([-1.0, 1.0]) / np.sqrt(3)
    by_hand = 0.0
    for d in range(dim):
        for cell in low:
            beyond = cell + np.eye(dim, dtype=int)[d]
            if beyond[d] > 2 or beyond.max() < 2:  # no facet, or both cells are full
                continue
            a, b = lines[0][cell], lines[0][cell + 1]
            h = (lines[0][beyond[d] + 1] - a[d]) / 2
            across = [k for k in range(dim) if k != d]
            x = np.full((2 ** len(across), dim), b[d])
            for k, g in zip(across, np.meshgrid(*[gauss] * len(across)), strict=True):
                x[:, k] = (a[k] + b[k]) / 2 + g.ravel() * (b[k] - a[k]) / 2
            weight = (b - a)[across].prod() / len(x)
            mass = factor * G * SOIL.density * h**3 if (beyond == 2).sum() < 2 else 0.0
            J = jumps(grid, x, d)
            by_hand = by_hand + weight * (K * M * h + mass) * J.T @ J
    node = (grid.space.tabulate_dof_coordinates()[:, :dim] < 0.99).all(
        axis=1
    )  # idle rows of the one are left out
    keep = np.repeat(node, dim)
    found = (matrices[0] - matrices[1])[np.ix_(keep, keep)]
    expected = np.kron(by_hand, np.eye(dim))[np.ix_(keep, keep)]
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()


@DIM
def test_the_matrix_of_a_moving_body_is_that_of_a_new_run(dim):
    """Facets come and go, and with them the matrix's pattern."""
    run = block(dim, 0.1, mpm.DM_GC, mpm.Newmark(DT), n=2)
    body = run.bodies[0]
    body.velocity[:] = 0.4 * H / DT
    for _ in range(4):
        run.step()
    fresh = mpm.Simulation(run.grid, body, run.stepping, CURE, mpm.DM_GC)
    moved, exact = (inside.equations(ready(r), assemble=True) for r in (run, fresh))
    used = np.ix_(~exact.idle, ~exact.idle)
    A, B = moved.matrix[used], exact.matrix[used]
    assert np.abs(A - B).max() < 1e-14 * np.abs(B).max()


# -- what it is for --------------------------------------------------------------------------------


@pytest.mark.parametrize("courant", [0.05, 0.5])
@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_GC], ids=str)
def test_small_corners_stay_with_the_body(mapping, courant):
    """Under a stress set free, the largest acceleration is what the stress gives to half a cell's
    mass or so."""
    for cut in (1e-2, 1e-4, 1e-6, 1e-8):
        run = ready(block(2, cut, mapping, mpm.Newmark(courant * H / SOIL.p_speed)))
        assert inside.condition(run) < 40
        run.bodies[0].stress[:, :2] = STRESS
        run.predict()
        run.solve()
        assert np.abs(run.end_of_step()[1]).max() < 10 * STRESS / (SOIL.density * H)


def test_without_it_gimp_loses_them():
    run = ready(block(2, 1e-4, mpm.GIMP, mpm.Newmark(0.05 * H / SOIL.p_speed), []))
    run.bodies[0].stress[:, :2] = STRESS
    run.predict()
    run.solve()
    assert np.abs(run.end_of_step()[1]).max() > 1e5 * STRESS / (SOIL.density * H)


def test_nodes_that_only_a_dashpot_reaches_stay_with_the_body():
    """Surface points a hair outside the body: left alone, their far nodes turn the dashpot's
    velocity to zero."""
    moved = {}
    for name, terms, hold in (("alone", (), False), ("penalty", CURE, True), ("ties", (), True)):
        run = block(2, 0.0, mpm.DM_GC, mpm.Newmark(DT), ())
        body = run.bodies[0]
        surface = body.surface("right")
        surface.x[:, 0] += 1e-6 * H
        body.velocity[:, 0] = 1.0
        run = mpm.Simulation(
            run.grid,
            body,
            run.stepping,
            [mpm.ViscousBoundary(surface, SOIL), *terms],
            replace(mpm.DM_GC, hold_cut_cells=hold),
        )
        run.step()
        moved[name] = np.abs(run.nodal("increment").ravel()).max()
    assert moved["alone"] > 1e3 * DT
    assert moved["penalty"] < 2 * DT
    assert moved["ties"] < 1.1 * DT


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"stiffness": -1.0}, "stiffness must be >= 0, got -1.0"),
        ({"mass": -0.5}, "mass must be >= 0, got -0.5"),
        ({"mass": float("nan")}, "mass"),
        ({"below": 0.0}, "below"),
        ({"below": 1.5}, "below must be at most 1, got 1.5"),
    ],
)
def test_what_makes_no_sense_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        mpm.GhostPenalty(**given)


def test_where_a_hair_of_a_body_does_not_settle_it_says_so_early_and_what_is_left_can_be_accepted():
    """The upper layer of a slope settles until it ends 6e-5 of a cell beyond a grid line."""
    grid = mpm.Grid.box((0.0, 0.0), (3.0, 3.0), (6, 6))
    layers = [
        mpm.MaterialPoints.fill(grid, mpm.LinearElastic(young, 0.3, density), 4, inside)
        for young, density, inside in (
            (5e7, 1800.0, lambda x: x[1] < 1.0),
            (1e7, 1500.0, lambda x: (x[1] > 1.0) & (x[1] < 2.1 - 0.3 * x[0])),
        )
    ]
    terms = [
        mpm.Gravity((0.0, -9.81)),
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom")),
        mpm.GhostPenalty(),
    ]
    run = mpm.Simulation(grid, layers, mpm.QuasiStatic(steps=1), terms)
    run.step()
    message = r"after 1\d\d steps .* no progress in the last 50 steps.*settle\(tolerance=2e-07\)"
    with pytest.raises(mpm.RunError, match=message):
        run.settle()
    assert run.settle(tolerance=2e-7) <= 2e-7


def test_two_of_them_are_refused():
    with pytest.raises(ValueError, match="one term on the facets"):
        block(2, 0.0, mpm.DM_GC, mpm.Newmark(DT), [mpm.GhostPenalty(), mpm.GhostPenalty()])
