"""Gauss points against UFL, which evaluates the same things on its own."""

import dense
import numpy as np
import pytest
import ufl
from dolfinx import fem

from mpm_fenicsx import Grid
from mpm_fenicsx.common import tensors
from mpm_fenicsx.grid import dolfinx_versions
from mpm_fenicsx.grid.gauss_points import DEGREE, GaussField, GaussPoints, measure


def bent(grid):
    """The same cells, slanted and distorted: FE only."""
    x = grid.mesh.geometry.x
    shift = 0.15 * np.sin(x[:, [1, 2, 0]] * 2.0 + x) + 0.2 * x[:, [1, 0, 2]]
    x[:, : grid.dim] += shift[:, : grid.dim]
    return Grid(grid.mesh)


def at_gauss(grid, gauss, expression):
    """A vector expression of UFL at the Gauss points (points, size)."""
    Q = dolfinx_versions.quadrature_space(grid.mesh, DEGREE, expression.ufl_shape[0])
    sums = dense.vector(Q, ufl.inner(expression, ufl.TestFunction(Q)) * measure(grid.dx))
    return sums.reshape(len(gauss), -1) / gauss.volume[:, None]


GRIDS = pytest.mark.parametrize(
    "make", [dense.uneven, lambda dim: bent(dense.uneven(dim))], ids=["boxes", "bent"]
)
DIMS = pytest.mark.parametrize("dim", [2, 3])


def in_plane_strain(u):
    dim, ε = len(u), ufl.sym(ufl.grad(u))
    return ufl.as_vector(
        [ε[i, i] for i in range(dim)] + [2 * ε[i, j] for i, j in tensors.SHEAR[dim]]
    )


@GRIDS
@DIMS
def test_strain_of_random_nodal_displacements_is_that_of_ufl(make, dim):
    grid = make(dim)
    gauss, u = GaussPoints(grid), fem.Function(grid.space)
    u.x.array[:] = np.random.default_rng(1).normal(size=len(u.x.array))
    found = gauss.strain(u.x.array.reshape(-1, dim))
    exact = at_gauss(grid, gauss, in_plane_strain(u))
    np.testing.assert_allclose(
        found[:, tensors.in_plane(dim)], exact, atol=1e-12 * np.abs(exact).max()
    )
    if dim == 2:
        np.testing.assert_array_equal(found[:, 2], 0.0)


@pytest.mark.parametrize("mean_volume", [False, True])
@GRIDS
@DIMS
def test_strain_of_a_linear_displacement_is_its_gradient(make, dim, mean_volume):
    grid = make(dim)
    A = np.random.default_rng(2).normal(size=(dim, dim))
    gauss = GaussPoints(grid)
    strain = gauss.strain(
        dense.at_nodes(grid, lambda x: x @ A.T + 3.0).reshape(-1, dim),
        gauss.means() if mean_volume else None,
    )
    exact = tensors.strain(A[None])
    np.testing.assert_allclose(strain, np.tile(exact, (len(strain), 1)), atol=1e-12)


@DIMS
def test_strain_of_products_of_coordinates_on_boxes(dim):
    """u_x = xy, u_y = -2 xy (u_z = xyz): the shape functions hold these."""
    grid = dense.uneven(dim)
    gauss = GaussPoints(grid)
    x = at_gauss(grid, gauss, ufl.SpatialCoordinate(grid.mesh))

    def u(x):
        return np.stack(
            [x[:, 0] * x[:, 1], -2 * x[:, 0] * x[:, 1], *([x.prod(axis=1)] if dim == 3 else [])], 1
        )

    strain = gauss.strain(dense.at_nodes(grid, u).reshape(-1, dim))
    np.testing.assert_allclose(strain[:, 0], x[:, 1], atol=1e-13)
    np.testing.assert_allclose(strain[:, 1], -2 * x[:, 0], atol=1e-13)
    np.testing.assert_allclose(strain[:, 3], x[:, 0] - 2 * x[:, 1], atol=1e-13)
    if dim == 3:
        np.testing.assert_allclose(strain[:, 2], x[:, 0] * x[:, 1], atol=1e-13)
        np.testing.assert_allclose(strain[:, 4], x[:, 0] * x[:, 2], atol=1e-13)
        np.testing.assert_allclose(strain[:, 5], x[:, 1] * x[:, 2], atol=1e-13)


@GRIDS
@DIMS
def test_mean_volume_spreads_the_divergence_over_the_cell_and_leaves_the_deviator(make, dim):
    grid = make(dim)
    u = fem.Function(grid.space)
    u.x.array[:] = np.random.default_rng(3).normal(size=len(u.x.array))
    gauss = GaussPoints(grid)
    plain, mean = (gauss.strain(u.x.array.reshape(-1, dim), how) for how in (None, gauss.means()))
    V = dolfinx_versions.space(grid.mesh, "DQ", 0)
    size = dense.vector(V, ufl.TestFunction(V) * measure(grid.dx))
    divergence = dense.vector(V, ufl.div(u) * ufl.TestFunction(V) * measure(grid.dx)) / size
    divergence = divergence[dolfinx_versions.cell_dofs(V)[:, 0]]
    np.testing.assert_allclose(mean[:, :3].sum(axis=1), np.repeat(divergence, 2**dim), atol=1e-12)
    np.testing.assert_allclose(
        gauss.means().divergence(u.x.array.reshape(-1, dim)), divergence, atol=1e-12
    )
    for rows in (plain, mean):
        rows[:, :3] -= rows[:, :3].mean(axis=1, keepdims=True)
    np.testing.assert_allclose(mean, plain, atol=1e-12)


@GRIDS
@DIMS
def test_volumes_are_the_weights_of_ufl(make, dim):
    grid = make(dim)
    gauss = GaussPoints(grid)
    Q = dolfinx_versions.quadrature_space(grid.mesh, DEGREE, 1)
    weights = dense.vector(Q, ufl.TestFunction(Q)[0] * measure(grid.dx))
    np.testing.assert_allclose(gauss.volume, weights, rtol=1e-13)
    whole = dolfinx_versions.assemble_scalar(
        dolfinx_versions.compile_form(fem.Constant(grid.mesh, 1.0) * grid.dx)
    )
    assert gauss.volume.sum() == pytest.approx(whole, rel=1e-13)
    cells = gauss.volume.reshape(grid.cells, -1).sum(axis=1)
    np.testing.assert_allclose(gauss.size, np.repeat(cells ** (1 / dim), 2**dim), rtol=1e-13)


@DIMS
def test_digits_say_which_gauss_point_lies_where(dim):
    grid = dense.uneven(dim)
    gauss, lat = GaussPoints(grid), grid.lattice
    x = at_gauss(grid, gauss, ufl.SpatialCoordinate(grid.mesh)).reshape(grid.cells, -1, dim)
    place = 0.5 + (gauss.digit - 0.5) / np.sqrt(3)
    np.testing.assert_allclose(
        x, lat.lower[:, None] + place * (lat.upper - lat.lower)[:, None], atol=1e-14
    )


@GRIDS
@DIMS
def test_forms_integrate_rows_as_sums_over_the_points(make, dim):
    grid = make(dim)
    gauss, field = GaussPoints(grid), GaussField(grid, 3)
    field.rows[:] = np.random.default_rng(4).normal(size=field.rows.shape)
    x = ufl.SpatialCoordinate(grid.mesh)
    form = dolfinx_versions.compile_form(
        ufl.inner(field.function, ufl.as_vector([1.0, x[0], x[1] ** 2])) * measure(grid.dx)
    )
    place = at_gauss(grid, gauss, x)
    weight = np.stack([np.ones(len(place)), place[:, 0], place[:, 1] ** 2], axis=1)
    by_hand = gauss.volume @ (field.rows * weight).sum(axis=1)
    assert dolfinx_versions.assemble_scalar(form) == pytest.approx(by_hand, rel=1e-12)
