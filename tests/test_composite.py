"""Strain from composite patches: exact for cubics inside, and blind to nodes without material."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpm_fenicsx import Grid
from mpm_fenicsx.mapping.composite_patches import Composite

few = settings(max_examples=30, deadline=None)


def composite(grid, filled=None):
    made = Composite(grid)
    made.place(np.ones(grid.cells, np.int8) if filled is None else filled.astype(np.int8))
    return made


def inside(grid, cell, rng):
    """One random point in each of the cells given."""
    lattice = grid.lattice
    return rng.uniform(lattice.lower[cell], lattice.upper[cell])


class Polynomial:
    """Random polynomial vector, of its own degree in each direction (dim,), centred on a place."""

    def __init__(self, degree, centre, rng):
        self.centre = centre
        self.coefficient = rng.normal(size=(len(degree), *(k + 1 for k in degree)))

    def __call__(self, x, along=None):
        out = self.coefficient[None] * np.ones((len(x),) + (1,) * self.coefficient.ndim)
        for d in reversed(range(x.shape[1])):
            power = np.arange(self.coefficient.shape[d + 1])
            t = (x[:, d] - self.centre[d])[:, None]
            row = power * t ** np.maximum(power - 1, 0) if d == along else t**power
            out = np.einsum("n...k,nk->n...", out, row)
        return out

    def gradient(self, x):
        return np.stack([self(x, along=d) for d in range(x.shape[1])], axis=-1)


@pytest.mark.parametrize("seed", range(3))
def test_gradients_are_exact_for_cubics_inside_and_quadratics_at_edges(grid, hats, seed):
    """Degree 3 where both neighbours are there, 2 at one-sided edges, and linear across: in every
    cell of an uneven grid."""
    rng = np.random.default_rng(seed)
    patch = composite(grid)
    degrees = 1 + (grid.lattice.neighbour >= 0).sum(axis=2)
    assert {2, 3} == set(degrees.ravel())
    cells = np.arange(grid.cells, dtype=np.int32)
    x = inside(grid, cells, rng)
    for c in cells:
        for d in range(grid.dim):
            degree = np.where(np.arange(grid.dim) == d, degrees[c], 1)
            f = Polynomial(degree, x[c], rng)
            computed = patch.gradient_at_points(x[c : c + 1], cells[c : c + 1], f(hats.node))[
                0, :, d
            ]
            scale = np.abs(
                f(hats.node[np.unique(grid.lattice.patch[c][grid.lattice.patch[c] >= 0])])
            ).max()
            np.testing.assert_allclose(
                computed, f(x[c : c + 1], along=d)[0], rtol=0, atol=1e-11 * max(scale, 1)
            )


def test_a_lone_cell_is_bilinear(grid, hats):
    filled = np.arange(grid.cells) == 5
    cell = np.array([5], np.int32)
    rng = np.random.default_rng(0)
    x = inside(grid, cell, rng)
    f = Polynomial((1,) * grid.dim, x[0], rng)
    np.testing.assert_allclose(
        composite(grid, filled).gradient_at_points(x, cell, f(hats.node)),
        f.gradient(x),
        rtol=0,
        atol=1e-11,
    )


@few
@given(seed=st.integers(0, 10**6), share=st.floats(0.3, 0.95))
def test_patches_use_cells_with_points_only(grid, hats, seed, share):
    """Whatever is written on nodes of empty cells changes no digit; degrees follow the neighbours
    with material."""
    rng = np.random.default_rng(seed)
    filled = rng.random(grid.cells) < share
    filled[0] = True
    patch, lattice = composite(grid, filled), grid.lattice
    cells = np.flatnonzero(filled).astype(np.int32)
    x = inside(grid, cells, rng)
    field = rng.normal(size=(grid.nodes, grid.dim))
    spoilt = field + 1e9
    held = np.unique(lattice.nodes[filled])
    spoilt[held] = field[held]
    computed = patch.gradient_at_points(x, cells, field)
    assert np.array_equal(computed, patch.gradient_at_points(x, cells, spoilt))
    # along each direction a polynomial of the patch's degree, across it linear
    has = (lattice.neighbour >= 0) & filled[lattice.neighbour]
    for c, place in zip(cells, x, strict=True):
        for d in range(grid.dim):
            degree = np.ones(grid.dim, int)
            degree[d] = 1 + has[c, d].sum()
            f = Polynomial(degree, place, rng)
            found = patch.gradient_at_points(place[None], np.array([c], np.int32), f(hats.node))[
                0, :, d
            ]
            scale = np.abs(f(hats.node[lattice.patch[c][lattice.patch[c] >= 0]])).max()
            np.testing.assert_allclose(
                found, f.gradient(place[None])[0, :, d], rtol=0, atol=1e-11 * max(scale, 1)
            )


PUBLISHED = {
    "middle": lambda s: [
        -(s + 1) * (s - 1) * (s - 3) / 48,
        (s + 3) * (s - 1) * (s - 3) / 16,
        -(s + 3) * (s + 1) * (s - 3) / 16,
        (s + 3) * (s + 1) * (s - 1) / 48,
    ],
    "left": lambda s: [(s - 1) * (s - 3) / 8, -(s + 1) * (s - 3) / 4, (s + 1) * (s - 1) / 8],
    "right": lambda s: [(s + 1) * (s - 1) / 8, -(s - 1) * (s + 3) / 4, (s + 1) * (s + 3) / 8],
}


@pytest.mark.parametrize("place, cell, first", [("middle", 1, 0), ("left", 0, 0), ("right", 2, 1)])
def test_the_published_shape_functions_come_out(place, cell, first):
    """On three equal cells with nodes at ξ = −3, −1, 1, 3 about the middle one: slopes dN/dξ ·
    2/h."""
    h, ξ = 0.7, np.linspace(-0.95, 0.95, 7)
    grid = Grid.box((4.0, -1.0), (4.0 + 3 * h, 2.0), (3, 3))
    node = grid.space.tabulate_dof_coordinates()[:, :2]
    x = np.stack([4.0 + h * (cell + (ξ + 1) / 2), np.full(7, 0.62)], axis=1)
    found = grid.find(x)
    s = np.poly1d([1, 0])
    for k, shape in enumerate(PUBLISHED[place](s)):
        delta = np.isclose(node[:, :1], 4.0 + h * (first + k)) * np.ones(2)
        gradient = composite(grid).gradient_at_points(x, found, delta)
        np.testing.assert_allclose(gradient[:, 0, 0], shape.deriv()(ξ) * 2 / h, rtol=0, atol=1e-12)
        np.testing.assert_allclose(gradient[:, 0, 1], 0, rtol=0, atol=1e-12)


def test_a_rotation_strains_nothing(grid, hats, points):
    turn = np.random.default_rng(3).normal(size=(grid.dim, grid.dim))
    turn -= turn.T
    gradient = composite(grid).gradient_at_points(points.x, grid.find(points.x), hats.node @ turn.T)
    np.testing.assert_allclose(gradient, np.broadcast_to(turn, gradient.shape), rtol=0, atol=1e-11)
