"""Weights of points: partition of unity, linear completeness, gradients, and means over support
domains."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_kernels import dense

from mpm_fenicsx import Grid, MaterialPoints
from mpm_fenicsx.mapping.shape_functions import Stencil


def placed(grid, x, half=None):
    stencil = Stencil(grid, len(x), support=half is not None)
    stencil.place(x, half, grid.find(x))
    return stencil


@st.composite
def strewn(draw, hats):
    """Points anywhere, on lines, corners and the grid's edge too, with support domains of any
    size."""
    coordinates = [
        st.one_of(st.sampled_from(list(line)), st.floats(line[0], line[-1])) for line in hats.lines
    ]
    x = np.array(draw(st.lists(st.tuples(*coordinates), min_size=1, max_size=6)))
    sizes = st.tuples(*[st.floats(1e-3, 2.0)] * len(hats.lines))
    half = np.array(draw(st.lists(sizes, min_size=len(x), max_size=len(x))))
    return x, half


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_weights_sum_to_one_and_reproduce_linear_fields(grid, hats, data):
    """Σ S_ip = 1, Σ S_ip x_i = the centre of the support domain, Σ x_i ∇S_ip = 1."""
    x, half = data.draw(strewn(hats))
    a, b = hats.box(x, half)
    for stencil, centre in ((placed(grid, x), x), (placed(grid, x, half), (a + b) / 2)):
        assert (stencil.values > -1e-13).all()
        np.testing.assert_allclose(stencil.values.sum(axis=1), 1, rtol=0, atol=1e-13)
        np.testing.assert_allclose(stencil.at_points(hats.node), centre, rtol=0, atol=1e-12)
        np.testing.assert_allclose(stencil.gradients.sum(axis=1), 0, rtol=0, atol=1e-10)
        unity = np.broadcast_to(np.eye(grid.dim), (len(x), grid.dim, grid.dim))
        np.testing.assert_allclose(stencil.gradient_at_points(hats.node), unity, rtol=0, atol=1e-11)


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_weights_are_means_of_the_hats_over_the_support_domain(grid, hats, data):
    x, half = data.draw(strewn(hats))
    for h in (None, half):
        weights, gradients = dense(placed(grid, x, h))
        np.testing.assert_allclose(weights, hats.mean(x, h), rtol=0, atol=1e-12)
        for d in range(grid.dim):
            np.testing.assert_allclose(
                gradients[:, :, d], hats.mean(x, h, along=d), rtol=0, atol=1e-10
            )


def test_random_points_reproduce_their_place(grid, points, hats):
    inside = (
        (points.x - points.half >= grid.lower_corner)
        & (points.x + points.half <= grid.upper_corner)
    ).all(axis=1)
    assert 10 < inside.sum() < len(points)  # both kinds are there
    place = placed(grid, points.x, points.half).at_points(hats.node)
    np.testing.assert_allclose(place[inside], points.x[inside], rtol=0, atol=1e-13)


@pytest.mark.parametrize("support", [False, True])
def test_gradients_are_the_slopes_of_the_values(grid, points, support):
    """Central differences; where the grid's end cuts the domain its mean moves otherwise, so not
    there."""
    inside = (
        (points.x - points.half > grid.lower_corner) & (points.x + points.half < grid.upper_corner)
    ).all(axis=1)
    x, half = points.x[inside], points.half[inside] if support else None
    gradients = dense(placed(grid, x, half))[1]
    step = 1e-6
    for d in range(grid.dim):
        move = step * np.eye(grid.dim)[d]
        slope = (
            dense(placed(grid, x + move, half))[0] - dense(placed(grid, x - move, half))[0]
        ) / (2 * step)
        np.testing.assert_allclose(gradients[:, :, d], slope, rtol=0, atol=1e-4)


def test_no_support_is_linear_and_a_small_one_nearly(grid, points, hats):
    linear = dense(placed(grid, points.x))[0]
    none = dense(placed(grid, points.x, np.zeros_like(points.x)))[0]
    small = dense(placed(grid, points.x, np.full_like(points.x, 1e-9)))[0]
    np.testing.assert_allclose(none, linear, rtol=0, atol=1e-14)
    np.testing.assert_allclose(small, linear, rtol=0, atol=1e-7)


def test_a_point_on_a_node_has_its_weight_alone(grid, hats):
    weights = dense(placed(grid, hats.node))[0]
    np.testing.assert_allclose(weights, np.eye(grid.nodes), rtol=0, atol=1e-13)


def test_a_support_domain_wider_than_its_cell_is_capped(grid, points):
    lattice = grid.lattice
    cell = grid.find(points.x)
    widest = (lattice.upper - lattice.lower)[cell] / 2
    capped, huge = placed(grid, points.x, widest), placed(grid, points.x, 10 * widest)
    assert np.array_equal(capped.nodes, huge.nodes)
    np.testing.assert_allclose(capped.values, huge.values, rtol=0, atol=1e-15)


def test_a_stencil_placed_again_forgets_the_first_place(grid, points):
    stencil = placed(grid, points.x, points.half)
    back = points.x[::-1].copy()
    stencil.place(back, points.half[::-1].copy(), grid.find(back))
    fresh = placed(grid, back, points.half[::-1].copy())
    assert np.array_equal(stencil.values, fresh.values) and np.array_equal(
        stencil.nodes, fresh.nodes
    )


def test_an_inward_corner_gets_no_weight_from_nowhere(l_shape):
    """A support domain that reaches over the corner, where there is no cell, stays linearly
    complete."""
    node = l_shape.space.tabulate_dof_coordinates()[:, :2]
    corner = np.array([1.0, 0.5])
    x = corner + np.random.default_rng(2).uniform(-0.2, 0.2, (200, 2))
    x = x[(x < corner).any(axis=1)]
    stencil = placed(l_shape, x, np.full_like(x, 0.25))
    reached = np.abs(node[stencil.nodes] - x[:, None]) * (stencil.values > 0)[..., None]
    assert (reached.reshape(-1, 2).max(axis=0) < [1.3, 1.3]).all()
    np.testing.assert_allclose(stencil.values.sum(axis=1), 1, rtol=0, atol=1e-14)
    unity = np.broadcast_to(np.eye(2), (len(x), 2, 2))
    np.testing.assert_allclose(stencil.gradient_at_points(node), unity, rtol=0, atol=1e-12)
    assert (np.abs(stencil.at_points(node) - x) < 0.25).all()


@pytest.mark.parametrize(
    ("stretch", "tile"), [(1.5, True), (2.0, True), (2.5, False), (3.0, False)]
)
def test_support_domains_tile_a_stretched_body_until_they_are_a_cell_wide(soil, stretch, tile):
    """Σ_p V_p σ ∇S_ip = 0 inside, for uniform σ.  Wider domains end at a cell's width and leave
    gaps: a limit of points, four to a cell, where a body stretches to more than twice its
    length."""
    grid = Grid.box((-1, -1), (9, 3), (40, 16))
    body = MaterialPoints.fill(grid, soil, 4, inside=lambda x: ((x > 0) & (x < 2)).all(axis=0))
    body.x *= [stretch, 1 / stretch]
    body.half *= [stretch, 1 / stretch]
    stencil, force = placed(grid, body.x, body.half), np.zeros((grid.nodes, 2))
    stencil.deposit_divergence(
        np.tile(np.eye(2), (len(body), 1, 1)) * body.volume[:, None, None], force
    )
    node = grid.space.tabulate_dof_coordinates()
    inside = (node[:, 0] > 0.5) & (node[:, 0] < 2 * stretch - 0.5)
    assert (np.abs(force[inside, 0]).max() < 1e-13) == tile
