"""Yielding: its weights, its response and its derivative by hand and by differences, and against
finite elements."""

import json
from dataclasses import replace

import dense
import inside
import numpy as np
import plastic
import pytest
from plastic import ELASTIC, EXACT, LAW, STIFFLY
from test_ranks import difference, on_ranks

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.grid.gauss_points import GaussPoints

DIMS = pytest.mark.parametrize("dim", [2, 3])


def name(kind):
    return "FE" if kind is None else str(kind)


# -- weights ---------------------------------------------------------------------------------------


def weights_by_hand(grid, body, support):
    """Σ_i N_i(x_g) S*_ip W_p / m_i (points, Gauss points): S*_ip the part of S_ip that lies in the
    cell of g, m_i the integral of N_i over that cell."""
    lat, dim = grid.lattice, grid.dim
    digit = np.stack(np.meshgrid(*[np.arange(2)] * dim, indexing="ij"), -1).reshape(-1, dim)
    gauss = 0.5 + (digit - 0.5) / np.sqrt(3)
    cell = grid.find(body.x)
    h_of = (lat.upper - lat.lower)[cell]
    half = np.minimum(body.half, h_of / 2)
    low = np.maximum(body.x - half, grid.lower_corner)
    high = np.minimum(body.x + half, grid.upper_corner)
    out = {}
    for c in range(grid.cells):
        h = lat.upper[c] - lat.lower[c]
        for p in range(len(body)):
            if support:
                a, b = np.maximum(low[p], lat.lower[c]), np.minimum(high[p], lat.upper[c])
                share = np.maximum(b - a, 0.0) / (high[p] - low[p])
                ξ = (0.5 * (a + b) - lat.lower[c]) / h
            else:
                share = np.full(dim, float(cell[p] == c))
                ξ = (body.x[p] - lat.lower[c]) / h
            if not share.prod() > 0.0:
                continue
            for q, place in enumerate(gauss):
                w = 0.0
                for node in digit:
                    N = np.prod(np.where(node, place, 1 - place))
                    S = np.prod(share * np.where(node, ξ, 1 - ξ))
                    w += N * S * body.volume[p] / (h.prod() / 2**dim)
                out[p, c, tuple(digit[q])] = w
    return out


def pairs(run):
    """Weights of a run's first body by point, cell and digit."""
    point, gauss, weight = inside.gauss_weights(run)
    n, digit = 2**run.grid.dim, GaussPoints(run.grid).digit
    return {
        (p, g // n, tuple(digit[g // n, g % n])): w
        for p, g, w in zip(point, gauss, weight, strict=True)
    }


@pytest.mark.parametrize("mapping", [mpm.DM, mpm.DM_GC], ids=str)
@DIMS
def test_weights_are_the_double_mapping(dim, mapping):
    grid = dense.uneven(dim)
    body = dense.random_body(
        grid, np.random.default_rng(0), material=LAW, inside=lambda x: x[0] + x[1] < 1.2
    )
    run = inside.prepared(mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], mapping))
    found, exact = pairs(run), weights_by_hand(grid, body, mapping.support)
    assert set(found) <= set(exact)
    for key, w in exact.items():
        assert found.get(key, 0.0) == pytest.approx(w, rel=1e-12, abs=1e-14)
    volume = GaussPoints(grid).volume
    point, gauss, weight = inside.gauss_weights(run)
    each = np.bincount(point, weight * volume[gauss], minlength=len(body))
    np.testing.assert_allclose(
        each, body.volume, rtol=1e-12
    )  # nothing of a point is lost, wherever it lies


# -- the response ----------------------------------------------------------------------------------


@DIMS
def test_uniform_points_that_fill_the_grid_answer_like_the_law_at_the_gauss_points(dim):
    """Any displacement, any support domains without gaps: the double mapping of one state is that
    state."""
    rng, grid = np.random.default_rng(5), dense.uneven(dim)
    body = dense.tiles(grid, rng, material=LAW)
    state, history = np.zeros((1, tensors.components(dim))), np.zeros((1, 1))
    plastic.unrest(rng, state, history)
    body.stress[:], body.history[:] = state, history
    plain = replace(mpm.DM_GC, b_bar=False)
    points = inside.prepared(mpm.Simulation(grid, body, mpm.QuasiStatic(1), [], plain))
    twin = mpm.FiniteElements(grid, LAW, mpm.QuasiStatic(1), [], b_bar=False)
    u = 1e-3 * rng.normal(size=len(points.nodal("increment").ravel()))
    points.nodal("increment").ravel()[:] = u
    found = inside.response(points)
    strain = GaussPoints(grid).strain(u.reshape(-1, dim))
    many = len(strain)
    law = LAW.tangent(strain, np.tile(state, (many, 1)), np.tile(history, (many, 1)))
    plane = tensors.in_plane(dim)
    beyond = (law[0] - ELASTIC.update(strain, np.tile(state, (many, 1))))[:, plane]
    i, j = np.triu_indices(len(plane))
    soft = (law[2] - ELASTIC.tangent(strain, 0 * strain, None)[2])[:, plane[i], plane[j]]
    assert (law[1] > history[0, 0]).mean() > 0.3
    np.testing.assert_allclose(found.stress, beyond, atol=1e-12 * np.abs(beyond).max())
    np.testing.assert_allclose(found.tangent, soft, atol=1e-12 * np.abs(soft).max())
    twin.nodal("increment").ravel()[:] = u
    for what, value in (("stress", state), ("history", history), ("elastic", state)):
        twin.state()[f"yielding/{what}"][:] = value
    answer = inside.response(twin).stress
    np.testing.assert_allclose(answer, beyond, atol=1e-12 * np.abs(beyond).max())


@pytest.mark.parametrize("mapping", [mpm.DM_G, mpm.DM_GC, mpm.DM], ids=str)
@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.validation)])
def test_the_first_plastic_step_of_a_full_grid_is_that_of_finite_elements(dim, mapping):
    rng = np.random.default_rng(6)
    found = []
    for kind in (mapping, None):
        grid = dense.uneven(dim)
        body = (
            dense.tiles(grid, rng, material=LAW)
            if mapping.support
            else mpm.MaterialPoints.fill(grid, LAW, 2**dim)
        )
        run = plastic.run_of(
            kind, grid, mpm.QuasiStatic(1), plastic.loads(grid), body, solver=EXACT
        )
        run.step()
        assert inside.response(run, anew=False).yields
        assert run.solves > 2
        found.append(run.nodal("increment").ravel().copy())
    np.testing.assert_allclose(found[0], found[1], atol=1e-9 * np.abs(found[1]).max())


# -- the derivative --------------------------------------------------------------------------------


def at_unrest(kind, grid, seed=7, half=1.0):
    """A run with random states and a random displacement under which much yields; all arrays
    ready."""
    rng = np.random.default_rng(seed)
    if kind is None:
        stiffly = mpm.Solver(newton=STIFFLY)
        run = mpm.FiniteElements(grid, LAW, mpm.Newmark(0.1), [], solver=stiffly, b_bar=False)
        stress, history, elastic = (
            run.state()[f"yielding/{name}"] for name in ("stress", "history", "elastic")
        )
        plastic.unrest(rng, stress, history)
        elastic[:] = stress + 1e3 * rng.normal(size=stress.shape)
    else:
        bodies = [
            mpm.MaterialPoints.fill(grid, law, 2**grid.dim, jitter=0.4, seed=seed, inside=inside)
            for law, inside in ((LAW, lambda x: x[0] < 0.5), (ELASTIC, lambda x: x[0] > 0.5))
        ]
        plastic.unrest(rng, bodies[0].stress, bodies[0].history)
        for body in bodies:
            body.half *= half
        run = mpm.Simulation(grid, bodies, mpm.Newmark(0.1), [], replace(kind, b_bar=False))
    inside.prepared(run)
    run.nodal("increment").ravel()[:] = 4e-4 * rng.normal(size=len(run.nodal("increment").ravel()))
    assert inside.response(run).yields
    return run


@pytest.mark.parametrize("kind", [None, mpm.DM_GC], ids=name)
@DIMS
def test_tangent_rows_are_the_derivative_of_stress_rows(dim, kind):
    run = at_unrest(kind, dense.uneven(dim))
    u = run.nodal("increment").ravel()
    start, tangent = u.copy(), inside.response(run, anew=False).tangent
    way = np.random.default_rng(1).normal(size=len(u))
    rows = []
    for sign in (1, -1):
        u[:] = start + sign * 1e-9 * way
        rows.append(inside.response(run).stress)
    size = len(tensors.in_plane(dim))
    full = np.zeros((len(tangent), size, size))
    i, j = np.triu_indices(size)
    full[:, i, j] = full[:, j, i] = tangent
    strain = GaussPoints(run.grid).strain(way.reshape(-1, dim))
    exact = np.einsum("gij,gj->gi", full, strain[:, tensors.in_plane(dim)])
    np.testing.assert_allclose((rows[0] - rows[1]) / 2e-9, exact, atol=1e-5 * np.abs(exact).max())


def plastic_part_of_the_matrix(run):
    """What yielding adds to K: from the matrix, and from differences of the residual."""
    K, elastic = (inside.tangent(run, plastic) for plastic in (True, False))
    return K - elastic, inside.differences(run, 1e-9) - elastic


def mismatch(run):
    matrix, differences = plastic_part_of_the_matrix(run)
    assert np.abs(differences).max() > 1e6
    return np.abs(matrix - differences).max() / np.abs(differences).max()


@pytest.mark.parametrize("kind", [None, mpm.MPM, mpm.DM, mpm.DM_C, mpm.DM_G, mpm.DM_GC], ids=name)
def test_the_matrix_is_the_derivative_of_the_residual(kind):
    assert mismatch(at_unrest(kind, dense.uneven(2))) < 1e-5


@pytest.mark.parametrize("kind", [None, mpm.MPM, mpm.DM_GC], ids=name)
def test_the_matrix_is_the_derivative_of_the_residual_in_3d(kind):
    assert (
        mismatch(
            at_unrest(
                kind, mpm.Grid.rectilinear([np.array([0.0, 0.4, 1.0]), [0.0, 0.7], [0.0, 0.5]])
            )
        )
        < 1e-5
    )


def test_support_domains_make_the_matrix_of_gimp_nearly_the_derivative():
    """∇S∇S of the residual's derivative is a product of means, ∇N∇N of the matrix the mean of the
    product: the difference goes with the square of small support domains."""
    gaps = [mismatch(at_unrest(mpm.GIMP, dense.uneven(2), half=half)) for half in (1.0, 0.04, 0.02)]
    assert 1e-3 < gaps[0] < 0.5
    assert np.log2(gaps[1] / gaps[2]) > 1.9


def test_the_matrix_of_cmpm_is_not_the_derivative():
    """Its force uses the gradients of the cell, its law those of the patch."""
    assert mismatch(at_unrest(mpm.CMPM, dense.uneven(2))) > 1e-2


# -- where nothing yields --------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [None, mpm.MPM, mpm.GIMP, mpm.DM_G, mpm.DM_GC], ids=name)
def test_far_below_yield_it_is_the_elastic_scene(kind):
    found = []
    for law in (ELASTIC, mpm.VonMises(ELASTIC, 1e9, 1e9, 0.0)):
        grid = dense.uneven(2)
        run = plastic.run_of(kind, grid, mpm.Newmark(1e-3), plastic.loads(grid, 10.0), law=law)
        run.until(5e-3)
        assert run.solves == 5
        found.append(run)
    elastic, law = found
    assert elastic.yielding is None
    assert not inside.response(law, anew=False).yields
    if kind is None:
        np.testing.assert_allclose(
            law.displacement.x.array, elastic.displacement.x.array, rtol=1e-12, atol=0
        )
        stress = elastic.stress(np.arange(9))
        np.testing.assert_allclose(
            law.stress(np.arange(9)), stress, atol=1e-12 * np.abs(stress).max()
        )
    else:
        for field in ("x", "velocity", "acceleration", "stress", "volume"):
            exact = getattr(elastic.bodies[0], field)
            np.testing.assert_allclose(
                getattr(law.bodies[0], field), exact, atol=1e-12 * np.abs(exact).max()
            )
        assert elastic.bodies[0].history is None
        np.testing.assert_array_equal(law.bodies[0].history, 0.0)


# -- Newton on real scenes -------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [None, mpm.MPM, mpm.DM_G, mpm.DM_GC], ids=name)
def test_newton_converges_quadratically(kind):
    run = plastic.static(kind, STIFFLY)
    norms = inside.residuals(run)
    run.step()
    assert inside.response(run, anew=False).yields
    norms = np.array(norms[1:])  # after the first solve
    norms = norms[norms > 1e-10 * norms[0]]
    assert len(norms) >= 4
    order = np.log(norms[-1] / norms[-2]) / np.log(norms[-2] / norms[-3])
    assert order > 1.7


# -- one element, one state ------------------------------------------------------------------------


@DIMS
def test_an_element_that_is_pressed_and_held_sideways_follows_the_law(dim):
    """Uniaxial strain into the residual range: the traction that it bears is the law's stress at
    its strain."""
    grid = mpm.Grid.box((0,) * dim, (2.0,) * dim, (1,) * dim)
    law = mpm.VonMises(ELASTIC, 10e3, 6e3, 1e6)
    held = {"left": "x", "right": "x", "bottom": "y", "top": "y"}
    base, top, up = ("bottom", "top", 1) if dim == 2 else ("back", "front", 2)
    sides = [mpm.Fixed(grid.facets(side), held[side]) for side in list(held)[: 2 * dim - 2]]
    load = np.zeros(dim)
    load[up] = -1e5
    run = mpm.FiniteElements(
        grid,
        law,
        mpm.QuasiStatic(10),
        [
            *sides,
            mpm.Fixed(grid.facets(base), "xyz"[up]),
            mpm.Traction(grid.facets(top), lambda t: load * np.sin(np.pi * t)),
        ],
        solver=mpm.Solver(newton=STIFFLY),
    )
    stress, history, before = np.zeros((1, tensors.components(dim))), np.zeros((1, 1)), 0.0
    for _ in range(10):
        run.step()
        total = run.nodal("displacement")[:, up].min() / 2.0
        strain = np.zeros_like(stress)
        strain[0, up] = total - before
        stress, history = law.respond(strain, stress, history)
        before = total
        assert stress[0, up] == pytest.approx(
            load[up] * np.sin(np.pi * run.time), rel=1e-9, abs=1e-4
        )
        np.testing.assert_allclose(run.gauss_stress(), np.tile(stress, (2**dim, 1)), atol=1e-4)
        np.testing.assert_allclose(run.gauss_history(), history[0, 0], atol=1e-13)
    assert history[0, 0] > (law.peak - law.residual) / law.softening


@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.DM_G, mpm.DM_GC], ids=str)
@DIMS
def test_simple_shear_of_a_block_is_the_same_in_finite_elements_and_at_points(dim, mapping):
    """The shear is imposed, step by step, through softening to the residual strength and back."""
    grid = dense.uneven(dim)
    body = mpm.MaterialPoints.fill(
        grid, LAW, 3**dim, jitter=0.4, inside=lambda x: ((x > 0.1) & (x < 0.9)).all(axis=0)
    )
    points = mpm.Simulation(grid, body, mpm.QuasiStatic(40), [], mapping)
    twin = mpm.FiniteElements(grid, LAW, mpm.QuasiStatic(40), [])
    stress, history = np.zeros((1, tensors.components(dim))), np.zeros((1, 1))
    for step in range(40):
        γ = 1.5e-3 if step < 30 else -1.5e-3
        for run in (points, twin):
            inside.prepared(run)
            run.nodal("increment").ravel()[:] = dense.at_nodes(
                grid, lambda x, γ=γ: γ * x[:, [1]] * np.eye(dim)[0]
            )
            run.carry()
        strain = np.zeros_like(stress)
        strain[0, 3] = γ
        stress, history = LAW.respond(strain, stress, history)
        np.testing.assert_allclose(
            body.stress, np.tile(stress, (len(body), 1)), atol=1e-8 * LAW.peak
        )
        np.testing.assert_allclose(
            twin.gauss_stress(),
            np.tile(stress, (len(twin.gauss_stress()), 1)),
            atol=1e-8 * LAW.peak,
        )
        np.testing.assert_allclose(body.history, history[0, 0], atol=1e-12)
    assert history[0, 0] > (LAW.peak - LAW.residual) / LAW.softening


# -- more than one body ----------------------------------------------------------------------------


@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_GC], ids=str)
def test_two_bodies_of_one_law_are_one_and_an_elastic_one_has_no_history(mapping):
    def solved(*halves):
        grid = dense.uneven(2)
        bodies = [mpm.MaterialPoints.fill(grid, law, 4, inside=inside) for law, inside in halves]
        run = mpm.Simulation(grid, bodies, mpm.QuasiStatic(2), plastic.loads(grid), mapping, EXACT)
        run.until(1.0)
        return bodies

    def everywhere(x):
        return x[0] > -1

    def left(x):
        return x[0] < 0.5

    def right(x):
        return x[0] > 0.5

    rows = []
    for bodies in (solved((LAW, everywhere)), solved((LAW, left), (LAW, right))):
        all_of = np.vstack([np.hstack((b.x, 1e-6 * b.stress, b.history)) for b in bodies])
        rows.append(all_of[np.lexsort(all_of[:, :2].T)])
    assert rows[0][:, -1].max() > 1e-4
    np.testing.assert_allclose(rows[1], rows[0], atol=1e-9)
    soil, rock = solved((LAW, left), (ELASTIC, right))
    assert soil.history.max() > 1e-4
    assert rock.history is None
    assert tensors.von_mises(rock.stress).max() > 1.2 * np.sqrt(3) * LAW.peak


# -- several ranks ---------------------------------------------------------------------------------


@pytest.mark.ranks
def test_two_ranks_yield_like_one(tmp_path):
    out = tmp_path / "out.json"
    on_ranks(2, plastic.__file__, out)
    several, serial = json.loads(out.read_text()), plastic.everything()
    for kind, dim in plastic.SEVERAL:
        case = f"{kind or 'FE'} {dim}D"
        assert several[case]["solves"] == serial[case]["solves"]
        assert serial[case]["solves"][""][0] > 1
        for quantity, expected in serial[case].items():
            if expected and quantity != "solves":
                assert difference(several[case][quantity], expected) < 1e-6, (case, quantity)
    for dim in (2, 3):
        case, total = f"gather {dim}D", {}
        for found in (several, serial):
            for quantity, rows in found[case].items():
                total.setdefault(quantity, []).append(sum(v[0] for v in rows.values()))
        assert several[case]["held"] != {"0": [0.0], "1": [0.0]}
        assert (
            total["held"][0] == total["cells"][0] > total["cells"][1]
        )  # every holder's 1 has reached the owner
        assert total["volume"][0] == pytest.approx(total["volume"][1], rel=1e-12)
