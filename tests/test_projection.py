"""Fields projected from points: UFL integrals equal the point sums, double mapping is eq. (7)."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from hypothesis import given, settings
from hypothesis import strategies as st
from petsc4py import PETSc
from test_shapes import placed, strewn

from mpm_fenicsx import MaterialPoints
from mpm_fenicsx.grid import dolfinx_versions, weak_forms
from mpm_fenicsx.mapping.projection import AT_POINTS, DOUBLE_MAPPED, Projection

few = settings(max_examples=30, deadline=None)


def project(grid, integration, values, x, half=None):
    """Fields of one set of points; values (n, fields) are volume-weighted."""
    projection = Projection(grid, integration, values.shape[1])
    projection.add(placed(grid, x, half), values)
    projection.finish()
    return projection


def matrix(grid, integrand, quadrature=AT_POINTS.quadrature):
    """Dense Jacobian of ∫ integrand(u, w), nodes and directions kept apart (nodes, dim, nodes,
    dim)."""
    u, w = ufl.TrialFunction(grid.space), ufl.TestFunction(grid.space)
    form = dolfinx_versions.compile_form(
        integrand(u, w) * grid.dx(metadata={"quadrature_degree": quadrature})
    )
    A = dolfinx_versions.create_matrix(form)
    dolfinx_versions.assemble_matrix(A, form, [])
    A.assemble()
    size = range(grid.nodes * grid.dim)
    return A.getValues(np.array(size, PETSc.IntType), np.array(size, PETSc.IntType)).reshape(
        (grid.nodes, grid.dim) * 2
    )


def near(computed, wanted, relative=1e-12):
    np.testing.assert_allclose(computed, wanted, rtol=0, atol=relative * np.abs(wanted).max())


# -- sums at the points ----------------------------------------------------------------------------


@pytest.fixture(params=[False, True], ids=["MPM", "GIMP"])
def strewn_points(request, points):
    """Random points with and without support domains, each of its own density, λ and μ."""
    q = points.volume[:, None] * np.random.default_rng(4).uniform(0.5, 2.0, (len(points), 3))
    return points.x, points.half if request.param else None, q


def test_mass_matrix_is_the_point_sum(grid, hats, strewn_points):
    """MPM: Σ m_p N_i N_j at the points; GIMP: the mean of N_i N_j over each support domain."""
    x, half, q = strewn_points
    ρ = project(grid, AT_POINTS, q, x, half).fields[0]
    wanted = np.einsum("ij,ab->iajb", hats.pairs(x, half, q[:, 0]), np.eye(grid.dim))
    near(matrix(grid, lambda u, w: weak_forms.inertia(ρ, u, w)), wanted)


def test_stiffness_matrix_is_the_point_sum(grid, hats, strewn_points):
    """Σ V_p ⟨λ ∂_a N_i ∂_b N_j + μ (∂_b N_i ∂_a N_j + δ_ab ∇N_i·∇N_j)⟩."""
    x, half, q = strewn_points
    λ, μ = project(grid, AT_POINTS, q, x, half).fields[1:]
    dim = range(grid.dim)
    with_λ, with_μ = (
        np.array([[hats.pairs(x, half, q[:, k], a, b) for b in dim] for a in dim]) for k in (1, 2)
    )
    wanted = np.einsum("abij->iajb", with_λ) + np.einsum("baij->iajb", with_μ)
    wanted += np.einsum("ccij,ab->iajb", with_μ, np.eye(grid.dim))
    near(
        matrix(
            grid,
            lambda u, w: weak_forms.internal_work(weak_forms.hooke(λ, μ, weak_forms.strain(u)), w),
        ),
        wanted,
    )


def test_moments_up_to_quadratics_are_the_point_sums(grid, points):
    """∫ q_h g dx = Σ V_p q_p g(x_p) for g quadratic in every direction, cell by cell different."""
    q = project(grid, AT_POINTS, points.volume[:, None], points.x).fields[0]
    rng = np.random.default_rng(0)
    g = fem.Function(q.function_space)
    g.x.array[:] = rng.normal(size=len(g.x.array))
    lattice, cell = grid.lattice, grid.find(points.x)
    ξ = (points.x - lattice.lower[cell]) / (lattice.upper - lattice.lower)[cell]
    at = np.ones((len(points), 1))
    for d in range(grid.dim):
        t = ξ[:, d]
        line = np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], 1)
        at = (line[:, :, None] * at[:, None, :]).reshape(len(points), -1)
    at_points = (at * g.x.array[grid.tensor_order(q.function_space, 2)][cell]).sum(axis=1)
    integral = fem.assemble_scalar(fem.form(q * g * grid.dx(metadata={"quadrature_degree": 8})))
    assert integral == pytest.approx((points.volume * at_points).sum(), rel=1e-12)


# -- both ------------------------------------------------------------------------------------------


def integrals(projection):
    """∫ q_h of the projected fields, exact."""
    V = projection.fields[0].function_space
    w = ufl.TestFunction(V)
    ones = fem.assemble_vector(fem.form(w * projection.grid.dx(metadata={"quadrature_degree": 4})))
    ones = ones.array if hasattr(ones, "array") else ones
    return np.array([ones @ f.x.array for f in projection.fields])


@few
@given(data=st.data())
def test_nothing_is_lost(grid, hats, data):
    """∫ ρ_h = Σ m_p for points anywhere, edges and corners included."""
    x, half = data.draw(strewn(hats))
    mass = np.random.default_rng(1).uniform(1, 2, (len(x), 2))
    for integration in (AT_POINTS, DOUBLE_MAPPED):
        for h in (None, half):
            np.testing.assert_allclose(
                integrals(project(grid, integration, mass, x, h)), mass.sum(axis=0), rtol=1e-11
            )


@pytest.mark.parametrize("integration", [AT_POINTS, DOUBLE_MAPPED], ids=lambda i: i.name)
def test_the_quadrature_named_is_exact(grid, points, integration):
    """Mass and stiffness with the degree of the integration equal those with nine."""
    ρ, μ = project(
        grid, integration, points.volume[:, None] * np.array([1.0, 2.0]), points.x
    ).fields
    for integrand in (
        lambda u, w: weak_forms.inertia(ρ, u, w),
        lambda u, w: weak_forms.internal_work(weak_forms.hooke(μ, μ, weak_forms.strain(u)), w),
    ):
        near(matrix(grid, integrand, integration.quadrature), matrix(grid, integrand, 9))


def test_nothing_is_lost_at_an_inward_corner(l_shape, soil):
    points = MaterialPoints.fill(l_shape, soil, 9, jitter=0.45)
    for integration in (AT_POINTS, DOUBLE_MAPPED):
        mass = integrals(
            project(l_shape, integration, points.mass[:, None], points.x, 3 * points.half)
        )
        assert mass[0] == pytest.approx(soil.density * 3.0, rel=1e-12)


@pytest.mark.parametrize("integration", [AT_POINTS, DOUBLE_MAPPED], ids=lambda i: i.name)
def test_bodies_add_up_and_clear_forgets(grid, points, integration):
    both = project(grid, integration, points.mass[:, None], points.x, points.half)
    parts = Projection(grid, integration, 1)
    parts.add(placed(grid, points.x), points.mass[:, None])
    parts.clear()
    for rows in (slice(None, 20), slice(20, None)):
        parts.add(placed(grid, points.x[rows], points.half[rows]), points.mass[rows, None])
    parts.finish()
    near(parts.fields[0].x.array, both.fields[0].x.array)


# -- double mapping --------------------------------------------------------------------------------


def tiles(grid, hats, reach=1.0, seed=0):
    """Support domains without gap or overlap, of random widths that ignore the cells, up to a share
    of the first direction; as centre, half and volume."""
    rng, middle, half = np.random.default_rng(seed), [], []
    for d, line in enumerate(hats.lines):
        width = rng.uniform(0.5, 1.0, 200) * 0.45 * np.diff(line).min()
        end = line[0] + (line[-1] - line[0]) * (reach if d == 0 else 1.0)
        cut = line[0] + np.concatenate(([0.0], np.cumsum(width)))
        cut = np.append(cut[cut < end - 1e-3], end)
        middle.append((cut[1:] + cut[:-1]) / 2)
        half.append(np.diff(cut) / 2)
    x, half = (
        np.stack(np.meshgrid(*v, indexing="ij"), -1).reshape(-1, grid.dim) for v in (middle, half)
    )
    return x, half, (2 * half).prod(axis=1)


def test_a_full_grid_has_the_materials_value_everywhere(grid, hats):
    x, half, volume = tiles(grid, hats)
    for integration in (AT_POINTS, DOUBLE_MAPPED):
        field = project(grid, integration, 5.0 * volume[:, None], x, half).fields[0]
        np.testing.assert_allclose(field.x.array, 5.0, rtol=1e-12)


def test_full_cells_of_evenly_filled_points_have_the_materials_value(grid, soil):
    points = MaterialPoints.fill(grid, soil, per_cell=3**grid.dim)
    for half in (None, points.half):
        λ = project(
            grid, DOUBLE_MAPPED, points.volume[:, None] * soil.lame[0], points.x, half
        ).fields[0]
        np.testing.assert_allclose(λ.x.array, soil.lame[0], rtol=1e-12)


def test_a_partly_filled_cell_has_proportionally_less(grid, hats):
    """The mean of the field over a cell is the material's value times the filled fraction of the
    cell."""
    x, half, volume = tiles(grid, hats, reach=0.618)
    projection = project(grid, DOUBLE_MAPPED, 5.0 * volume[:, None], x, half)
    lattice, line = grid.lattice, hats.lines[0]
    end = line[0] + 0.618 * (line[-1] - line[0])
    h = (lattice.upper - lattice.lower)[:, 0]
    filled = np.clip((end - lattice.lower[:, 0]) / h, 0, 1)
    assert ((filled > 0.05) & (filled < 0.95)).any()
    nodal = projection.fields[0].x.array[projection.dofs]
    np.testing.assert_allclose(nodal.mean(axis=1), 5.0 * filled, rtol=0, atol=1e-12)
    right = (np.arange(2**grid.dim) % 2).astype(bool)  # nodes at the cell's upper end of x
    wanted = np.repeat(5.0 * filled[:, None] ** 2, right.sum(), axis=1)
    np.testing.assert_allclose(nodal[:, right], wanted, rtol=0, atol=1e-12)


def closed_form(lattice, x, half):
    """Local weights S*_ip (cells, n, 2^dim) of the paper, [a, b] the part of the support domain in
    the cell."""
    weights = np.ones((len(lattice.lower), len(x), 1))
    for d in range(x.shape[1]):
        x1, x2 = lattice.lower[:, d, None], lattice.upper[:, d, None]
        a, b = np.clip(x[:, d] - half[:, d], x1, x2), np.clip(x[:, d] + half[:, d], x1, x2)
        four_l_h = 4 * half[:, d] * (x2 - x1)
        first = ((x2 - a) ** 2 - (x2 - b) ** 2) / four_l_h
        second = ((b - x1) ** 2 - (a - x1) ** 2) / four_l_h
        line = np.stack([first, second], -1)
        weights = (line[..., :, None] * weights[..., None, :]).reshape(len(x1), len(x), -1)
    return weights


@pytest.fixture
def within(grid, points):
    """Random points whose support domains lie within the grid, as x, half, volume-weighted
    value."""
    keep = (
        (points.x - points.half >= grid.lower_corner)
        & (points.x + points.half <= grid.upper_corner)
    ).all(axis=1)
    value = np.random.default_rng(9).uniform(1, 2, keep.sum())
    return points.x[keep], points.half[keep], points.volume[keep] * value


def test_double_mapping_is_equation_7(grid, within):
    """D_ci = Σ S*_ip W_p D_p / m_i with W_p = V_p/|J_c|, m_i = ∫ N_i over the reference cell."""
    x, half, value = within
    lattice = grid.lattice
    wanted = (
        np.einsum("cni,n->ci", closed_form(lattice, x, half), value)
        / lattice.volume[:, None]
        * 2**grid.dim
    )
    projection = project(grid, DOUBLE_MAPPED, value[:, None], x, half)
    near(projection.fields[0].x.array[projection.dofs], wanted)


def test_local_weights_sum_to_the_stencils(grid, within):
    x, half, _ = within
    local = closed_form(grid.lattice, x, half)
    total = np.zeros((len(x), grid.nodes))
    for nodes, weights in zip(grid.lattice.nodes, local, strict=True):
        total[:, nodes] += weights
    stencil = placed(grid, x, half)
    weights = np.zeros_like(total)
    np.add.at(weights, (np.arange(len(x))[:, None], stencil.nodes), stencil.values)
    np.testing.assert_allclose(weights, total, rtol=0, atol=1e-13)


def test_double_mapped_mass_lumps_to_the_deposited_mass(grid, hats, points):
    """∫ ρ_h differs from the point sum, but cell by cell Σ_i D_ci m_i |c| is the mass that lies in
    the cell."""
    projection = project(grid, DOUBLE_MAPPED, points.mass[:, None], points.x)
    in_cell = np.bincount(grid.find(points.x), points.mass, minlength=grid.cells)
    mean = projection.fields[0].x.array[projection.dofs].mean(axis=1)
    near(mean * grid.lattice.volume, in_cell)
