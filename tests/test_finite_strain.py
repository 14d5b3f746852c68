"""The step at finite strain: its derivative by differences, closed forms in patch tests, finite
elements."""

import json
import math

import dense
import inside
import numpy as np
import plastic
import pytest
import stretched
from plastic import EXACT
from stretched import LAW, SOIL
from test_ranks import difference, on_ranks

import mpm_fenicsx as mpm

SMALL = mpm.LinearElastic(SOIL.young, SOIL.poisson, SOIL.density)


def name(kind):
    return "FE" if kind is None else str(kind)


def cases(*plane, solid=(mpm.DM_GC,), marks=()):
    """Mappings, None for finite elements: all in plane strain, few in 3D, with ``marks``, whose
    forms take long to compile."""
    every = [(kind, dim) for dim, kinds in ((2, plane), (3, solid)) for kind in kinds]
    return pytest.mark.parametrize(
        ("kind", "dim"),
        [
            pytest.param(kind, dim, marks=marks if dim == 3 else (), id=f"{name(kind)}-{dim}D")
            for kind, dim in every
        ],
    )


# -- the derivative --------------------------------------------------------------------------------


def at_unrest(kind, grid, law, half=1.0):
    """A run with random states and a random displacement of some per cent of a cell; all arrays
    ready."""
    rng = np.random.default_rng(7)
    if kind is None:
        run = mpm.FiniteElements(grid, law, mpm.Newmark(0.1), [])
        run.nodal("increment").ravel()[:] = 0.02 * rng.normal(
            size=len(run.nodal("increment").ravel())
        )
        run.carry()
    else:
        body = mpm.MaterialPoints.fill(grid, law, 2**grid.dim, jitter=0.4, seed=7)
        body.stress[:] = 2e5 * rng.normal(size=body.stress.shape)
        body.volume *= rng.uniform(0.8, 1.2, len(body))
        body.half *= half
        run = mpm.Simulation(grid, body, mpm.Newmark(0.1), [], kind)
    inside.prepared(run)
    run.nodal("increment").ravel()[:] = 0.02 * rng.normal(size=len(run.nodal("increment").ravel()))
    return run


def mismatch(run):
    """Of the matrix with differences of the residual, relative."""
    K = inside.tangent(run)
    np.testing.assert_allclose(K, K.T, atol=1e-13 * np.abs(K).max())
    return np.abs(K - inside.differences(run, 1e-6)).max() / np.abs(K).max()


@pytest.mark.parametrize("law", [SOIL, LAW], ids=["Hencky", "von Mises"])
@pytest.mark.parametrize("kind", [None, mpm.MPM, mpm.DM, mpm.DM_G, mpm.DM_GC], ids=name)
def test_the_matrix_is_the_derivative_of_the_residual(kind, law):
    assert mismatch(at_unrest(kind, dense.uneven(2), law)) < 1e-7


@pytest.mark.parametrize("kind", [None, mpm.MPM, mpm.DM_GC], ids=name)
def test_the_matrix_is_the_derivative_of_the_residual_in_3d(kind):
    grid = mpm.Grid.rectilinear([np.array([0.0, 0.4, 1.0]), [0.0, 0.7], [0.0, 0.5]])
    assert mismatch(at_unrest(kind, grid, LAW)) < 1e-7


def test_support_domains_make_the_matrix_of_gimp_nearly_the_derivative():
    """∇S∇S at the points, the mean of ∇N∇N in the matrix: the difference goes with the square of
    support domains."""
    gaps = [
        mismatch(at_unrest(mpm.GIMP, dense.uneven(2), SOIL, half)) for half in (1.0, 0.04, 0.02)
    ]
    assert 1e-4 < gaps[0] < 0.2
    assert np.log2(gaps[1] / gaps[2]) > 1.9


# -- small strain is its limit ---------------------------------------------------------------------


@cases(None, mpm.MPM, mpm.GIMP, mpm.DM_G, mpm.DM_GC, marks=pytest.mark.validation)
def test_small_loads_give_the_small_strain_answer(kind, dim):
    """They differ by the order of the strain, 1e-8, and no round-off of logarithms shows."""
    found = []
    for law in (SMALL, SOIL):
        grid = dense.uneven(dim)
        loads = [term for term in plastic.loads(grid, 1e-5) if not isinstance(term, mpm.Gravity)]
        run = plastic.run_of(kind, grid, mpm.QuasiStatic(2), loads, law=law, solver=EXACT)
        run.until(1.0)
        found.append(run.bodies[0].stress if run.bodies else run.stress(np.arange(3**dim)))
    assert run.solves <= 4
    assert found[0].max() < 1e-7 * SOIL.young
    np.testing.assert_allclose(found[1], found[0], atol=1e-7 * np.abs(found[0]).max())


@cases(mpm.DM, mpm.DM_G, mpm.DM_GC, marks=pytest.mark.validation)
def test_the_first_step_of_a_full_grid_is_that_of_finite_elements(kind, dim):
    rng, found = np.random.default_rng(6), []
    for way in (kind, None):
        grid = dense.uneven(dim)
        body = (
            dense.tiles(grid, rng, material=LAW)
            if kind.support
            else mpm.MaterialPoints.fill(grid, LAW, 2**dim)
        )
        run = plastic.run_of(
            way,
            grid,
            mpm.QuasiStatic(1),
            plastic.loads(grid, 30.0),
            body,
            law=LAW,
            solver=EXACT,
        )
        run.step()
        assert run.solves > 3
        found.append(run.nodal("increment").ravel().copy())
    assert np.abs(found[1]).max() > 0.02
    np.testing.assert_allclose(found[0], found[1], atol=1e-9 * np.abs(found[1]).max())


@pytest.mark.parametrize("kind", [None, mpm.MPM, mpm.DM_G, mpm.DM_GC], ids=name)
def test_newton_converges_quadratically(kind):
    grid = dense.uneven(2)
    run = plastic.run_of(
        kind, grid, mpm.QuasiStatic(1), plastic.loads(grid, 60.0), law=SOIL, solver=EXACT
    )
    norms = inside.residuals(run)
    run.step()
    norms = np.array(norms[1:])
    norms = norms[norms > 1e-10 * norms[0]]
    assert len(norms) >= 3
    assert np.log(norms[-1] / norms[-2]) / np.log(norms[-2] / norms[-3]) > 1.7


# -- imposed motions -------------------------------------------------------------------------------


def imposed(run, F):
    """One step of the run with nodes that move by F about the grid's centre."""
    grid = run.grid
    centre = 0.5 * (grid.lower_corner + grid.upper_corner)
    inside.prepared(run)
    run.nodal("increment").ravel()[:] = dense.at_nodes(
        grid, lambda x: (x - centre) @ (F - np.eye(grid.dim)).T
    )
    run.carry()


def disc(grid, law):
    return mpm.MaterialPoints.fill(
        grid, law, 3**grid.dim, jitter=0.4, inside=lambda x: ((x - 0.5) ** 2).sum(axis=0) < 0.3**2
    )


@cases(*mpm.MAPPINGS)
def test_a_body_turns_all_the_way_without_stress(kind, dim):
    grid = dense.uneven(dim)
    body = disc(grid, SOIL)
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(1), [], kind)
    θ = math.radians(10.0)
    start = body.x.copy()
    R = np.eye(dim)
    R[:2, :2] = [[math.cos(θ), -math.sin(θ)], [math.sin(θ), math.cos(θ)]]
    for _ in range(36):
        imposed(run, R)
    np.testing.assert_allclose(body.x, start, atol=1e-12)
    assert np.abs(body.stress).max() < 1e-11 * SOIL.young


@cases(mpm.MPM, mpm.DM_GC)
def test_simple_shear_is_the_same_in_finite_elements_and_at_points(kind, dim):
    """In five steps to γ = 0.5: sheared steps add up, F being the product.  Elastic: the closed
    form of asinh γ/2."""
    for law in (SOIL, LAW):
        grid = dense.uneven(dim)
        body = mpm.MaterialPoints.fill(
            grid, law, 3**dim, jitter=0.4, inside=lambda x: ((x > 0.1) & (x < 0.9)).all(axis=0)
        )
        points, twin = (
            plastic.run_of(way, grid, mpm.QuasiStatic(5), [], body, law=law) for way in (kind, None)
        )
        F = np.eye(dim)
        F[0, 1] = 0.1
        body.x[:, 0] -= 0.25 * (body.x[:, 1] - 0.5)  # so that the shear ends within the grid
        for _ in range(5):
            imposed(points, F)
            imposed(twin, F)
        state = twin.gauss_stress()
        np.testing.assert_allclose(
            state, np.tile(state[0], (len(state), 1)), atol=1e-12 * SOIL.young
        )
        np.testing.assert_allclose(
            body.stress, np.tile(state[0], (len(body), 1)), atol=1e-12 * SOIL.young
        )
        if law is SOIL:
            exact = 4 * SOIL.lame[1] * math.asinh(0.25) / math.sqrt(4.25)
            np.testing.assert_allclose(state[:, 3], exact, rtol=1e-12)
        else:
            assert body.history.min() > 0.1
            np.testing.assert_allclose(twin.gauss_history(), body.history[0, 0], rtol=1e-10)


# -- loads in equilibrium --------------------------------------------------------------------------


def pressed(kind, dim, law, steps=5):
    """A block of four cells a side pressed to about two thirds of its height between smooth walls;
    and the load."""
    M = law.lame[0] + 2 * law.lame[1]
    load, up = 0.5 * M, dim - 1
    grid = mpm.Grid.box((0,) * dim, (1.0,) * dim, (4,) * dim)
    held = {"left": "x", "right": "x", "bottom": "y", "top": "y", "back": "z"}
    walls = [
        mpm.Fixed(grid.facets(side), held[side]) for side in list(held)[: 3 if dim == 2 else 5]
    ]
    push = np.zeros(dim)
    push[up] = -load
    side = "top" if dim == 2 else "front"
    body = None if kind is None else mpm.MaterialPoints.fill(grid, law, 2**dim)
    top = grid.facets(side) if kind is None else body.surface(side)
    run = plastic.run_of(
        kind,
        grid,
        mpm.QuasiStatic(steps),
        [*walls, mpm.Traction(top, lambda t: t * push)],
        body,
        law=law,
        solver=EXACT,
    )
    return run, load, M


@cases(None, mpm.GIMP, mpm.DM_G, mpm.DM_GC, solid=(mpm.GIMP, mpm.DM_GC))
def test_a_block_is_pressed_as_hencky_says(kind, dim):
    """Uniaxial strain: -M ln λ/λ is the pressure.  Points that tile the block, cut cells at its
    top: exact."""
    run, load, M = pressed(kind, dim, SOIL)
    energy = run.record(mpm.Energy())
    run.until(1.0)
    low, high = 0.3, 1.0
    for _ in range(60):
        λ = 0.5 * (low + high)
        low, high = (λ, high) if -M * math.log(λ) / λ > load else (low, λ)
    assert 0.6 < λ < 0.75
    if kind is None:
        stress, height = run.gauss_stress(), 1.0 + run.nodal("displacement")[:, -1].min()
    else:
        body = run.bodies[0]
        stress, height = body.stress, body.x[:, -1].max() * 16 / 15
        np.testing.assert_allclose(body.volume * SOIL.density / body.mass, λ, rtol=1e-8)
    np.testing.assert_allclose(stress[:, dim - 1], -load, rtol=1e-8)
    assert height == pytest.approx(λ, rel=1e-8)
    assert energy["strain"][-1] == pytest.approx(0.5 * M * math.log(λ) ** 2, rel=1e-8)
    assert energy["work"][-1] == pytest.approx(
        energy["strain"][-1], rel=0.05
    )  # of the trapezoidal rule in five steps


# -- refusals --------------------------------------------------------------------------------------


def test_what_finite_strain_cannot_do_is_refused():
    grid = dense.uneven(2)
    body = mpm.MaterialPoints.fill(grid, SOIL, 4)
    law = mpm.VonMises(SMALL, 1e3, 1e3, 0.0)
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: x[0] < 0.5)
    yielding = mpm.MaterialPoints.fill(grid, law, 4, inside=lambda x: x[0] > 0.5)
    with pytest.raises(ValueError, match="yields at small strain cannot share a run"):
        mpm.Simulation(grid, [body, yielding], mpm.QuasiStatic(1), [], mpm.DM_GC)


@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_GC], ids=str)
def test_an_elastic_body_of_small_strain_may_share_a_run(mapping):
    """Two halves of a block: of little load, so that they answer alike."""

    def solved(left, right):
        grid = dense.uneven(2)
        bodies = [
            mpm.MaterialPoints.fill(grid, left, 4, inside=lambda x: x[0] < 0.5),
            mpm.MaterialPoints.fill(grid, right, 4, inside=lambda x: x[0] > 0.5),
        ]
        run = mpm.Simulation(
            grid, bodies, mpm.QuasiStatic(1), plastic.loads(grid, 1e-2), mapping, EXACT
        )
        run.step()
        return np.vstack([b.stress for b in bodies])

    np.testing.assert_allclose(solved(SOIL, SMALL), solved(SMALL, SMALL), atol=50.0)
    assert np.abs(solved(SOIL, SMALL)).max() > 1e4


def test_a_point_that_turns_inside_out_stops_the_run_by_name():
    grid = dense.uneven(2)
    run = mpm.Simulation(
        grid,
        mpm.MaterialPoints.fill(grid, SOIL, 4),
        mpm.QuasiStatic(1),
        [mpm.Fixed(grid.facets("bottom")), mpm.Traction(grid.facets("top"), (0.0, -1e9))],
        mpm.DM_GC,
    )
    with pytest.raises(mpm.RunError, match="step 1, t = 1"):
        run.step()


def test_small_strain_has_nothing_of_it():
    grid = dense.uneven(2)
    run = mpm.Simulation(
        grid, mpm.MaterialPoints.fill(grid, SMALL, 4), mpm.QuasiStatic(1), [], mpm.CMPM
    )
    assert run.yielding is None
    assert run.bodies[0].history is None
    assert not SOIL.history and mpm.MaterialPoints.fill(grid, SOIL, 4).history is None


# -- several ranks ---------------------------------------------------------------------------------


@pytest.mark.ranks
def test_two_ranks_strain_like_one(tmp_path):
    out = tmp_path / "out.json"
    on_ranks(2, stretched.__file__, out)
    several, serial = json.loads(out.read_text()), stretched.everything()
    for case, quantities in serial.items():
        for quantity, expected in quantities.items():
            assert difference(several[case][quantity], expected) < 1e-7, (case, quantity)
