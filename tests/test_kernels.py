"""The compiled loops against NumPy, and each deposit as the adjoint of its interpolation."""

import numpy as np
import pytest

from mpm_fenicsx.common.compiled import digits
from mpm_fenicsx.grid.cells import walk
from mpm_fenicsx.mapping import kernels
from mpm_fenicsx.mapping.shape_functions import Stencil

rng = np.random.default_rng(5)


@pytest.fixture(params=[False, True], ids=["linear", "support"])
def stencil(request, grid, points):
    made = Stencil(grid, len(points), support=request.param)
    made.place(points.x, points.half, grid.find(points.x))
    return made


def dense(stencil):
    """Weights (n, nodes) and gradients (n, nodes, dim) of a stencil as full arrays."""
    n = len(stencil)
    weights = np.zeros((n, stencil.grid.nodes))
    gradients = np.zeros((n, stencil.grid.nodes, stencil.grid.dim))
    rows = np.arange(n)[:, None]
    np.add.at(weights, (rows, stencil.nodes), stencil.values)
    np.add.at(gradients, (rows, stencil.nodes), stencil.gradients)
    return weights, gradients


def test_digits_count_with_the_first_direction_fastest():
    for base, dim in ((2, 2), (3, 2), (4, 3)):
        table = digits(base, dim)
        assert np.array_equal(table @ base ** np.arange(dim), np.arange(base**dim))
        assert table.min() == 0 and table.max() == base - 1


def test_deposit_and_interpolation_are_the_dense_products(stencil):
    weights, gradients = dense(stencil)
    values = rng.normal(size=(len(stencil), 5))
    field = rng.normal(size=(stencil.grid.nodes, stencil.grid.dim))
    nodal = np.ones((stencil.grid.nodes, 5))
    stencil.deposit(values, nodal)
    np.testing.assert_allclose(nodal, 1 + weights.T @ values, rtol=0, atol=1e-12)
    np.testing.assert_allclose(stencil.at_points(field), weights @ field, rtol=0, atol=1e-13)
    slope = np.einsum("nkj,ki->nij", gradients, field)
    np.testing.assert_allclose(stencil.gradient_at_points(field), slope, rtol=0, atol=1e-12)


def test_internal_force_is_the_adjoint_of_the_gradient(stencil):
    """Σ_i f_i · u_i = Σ_p σ_p : ∇u(x_p) for any u and any σ, symmetric or not."""
    dim = stencil.grid.dim
    stress = rng.normal(size=(len(stencil), dim, dim))
    u = rng.normal(size=(stencil.grid.nodes, dim))
    force = np.zeros_like(u)
    stencil.deposit_divergence(stress, force)
    assert (force * u).sum() == pytest.approx(
        (stress * stencil.gradient_at_points(u)).sum(), abs=1e-10
    )


def test_internal_force_gives_no_momentum_and_no_moment(stencil, hats):
    stress = rng.normal(size=(len(stencil), stencil.grid.dim, stencil.grid.dim))
    force = np.zeros((stencil.grid.nodes, stencil.grid.dim))
    stencil.deposit_divergence(stress + stress.transpose(0, 2, 1), force)
    np.testing.assert_allclose(force.sum(axis=0), 0, rtol=0, atol=1e-10)
    moment = force.T @ hats.node
    np.testing.assert_allclose(moment, moment.T, rtol=0, atol=1e-9)


def test_spans_of_points_worked_by_hand():
    """Cells [0, 1] and [1, 3]: a domain in one cell, across the edge, cut by the grid's end, wider
    than its cell."""
    lower, upper = np.array([[0.0], [1.0]]), np.array([[1.0], [3.0]])
    neighbour = np.array([[[-1, 1]], [[0, -1]]], np.int32)
    x = np.array([[0.5], [0.9], [1.2], [2.8], [0.9], [0.3]])
    half = np.array([[0.25], [0.2], [0.4], [0.4], [9.0], [0.0]])
    cell = np.array([0, 0, 1, 1, 0, 0], np.int32)
    side, span, share = np.zeros((6, 1), np.int8), np.zeros((6, 1, 2, 2)), np.zeros((6, 1, 2))
    first, line, slope = np.zeros(6, np.uint64), np.zeros((6, 1, 3)), np.zeros((6, 1, 3))
    cells, cut, weights = (lower, upper, neighbour), (side, span, share), (first, line, slope)
    kernels.place((0,), (x, half, cell), cells, cut, weights)
    assert side.ravel().tolist() == [0, 1, -1, 0, 1, 0]
    own = [[0.25, 0.75], [0.7, 1.0], [0.0, 0.3], [0.7, 1.0], [0.4, 1.0], [0.3, 0.3]]
    np.testing.assert_allclose(span[:, 0, 0], own, rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        span[[1, 2, 4], 0, 1], [[0, 0.05], [0.8, 1], [0, 0.2]], rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(share[:, 0, 0], [1, 0.75, 0.75, 1, 0.6, 1], rtol=0, atol=1e-15)
    np.testing.assert_allclose(share.sum(axis=2), 1, rtol=0, atol=1e-15)


def test_walk_crosses_many_cells_at_once(grid):
    x = rng.uniform(grid.lower_corner, grid.upper_corner, (50, grid.dim))
    lattice = grid.lattice
    for start in range(grid.cells):
        cell = np.full(50, start, np.int32)
        walk(x, cell, lattice.lower, lattice.upper, lattice.neighbour)
        assert ((lattice.lower[cell] <= x) & (x < lattice.upper[cell])).all()
