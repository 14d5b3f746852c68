"""The weak forms: what they do to exact fields, whoever supplies the coefficients."""

import time

import dense
import inside
import numpy as np
import pytest
import ufl
from dolfinx import fem

from mpm_fenicsx import MAPPINGS, LinearElastic, MaterialPoints, QuasiStatic, Simulation
from mpm_fenicsx.common import tensors
from mpm_fenicsx.grid import dolfinx_versions, weak_forms
from mpm_fenicsx.grid.form_degree import degree, factors
from mpm_fenicsx.mapping.projection import simpson


@pytest.fixture(params=[2, 3])
def grid(request):
    return dense.uneven(request.param)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_hooke_is_the_law_of_the_material(grid, rng):
    dim = grid.dim
    g = rng.normal(size=(dim, dim))
    ε = fem.Constant(grid.mesh, (g + g.T) / 2)
    λ, μ = dense.SOIL.lame
    row = tensors.strain(g[None])
    expected = tensors.matrix(dense.SOIL.update(row, np.zeros_like(row)), dim)[0]
    for i, j in np.ndindex(dim, dim):
        found = dolfinx_versions.assemble_scalar(
            dolfinx_versions.compile_form(weak_forms.hooke(λ, μ, ε)[i, j] * grid.dx)
        )
        assert found == pytest.approx(expected[i, j], rel=1e-12)


@pytest.mark.parametrize("mapping", MAPPINGS, ids=str)
def test_a_rigid_motion_gives_no_force(grid, rng, mapping):
    body = MaterialPoints.fill(
        grid, dense.SOIL, 2**grid.dim, jitter=0.4, inside=lambda x: x[0] < 0.8
    )
    run = Simulation(grid, body, QuasiStatic(1), [], mapping)
    found = inside.equations(inside.prepared(run), assemble=True)
    K = found.matrix
    K[found.idle] = 0.0
    for motion in (lambda x: np.ones_like(x), dense.spin):
        u = dense.at_nodes(grid, motion)
        assert np.abs(K @ u).max() < 1e-14 * np.abs(K).max()
    stretch = dense.at_nodes(grid, lambda x: x)
    assert np.abs(K @ stretch).max() > 1e-3 * np.abs(K).max()


def test_a_constant_and_a_field_of_that_constant_give_one_matrix(grid):
    u, w = ufl.TrialFunction(grid.space), ufl.TestFunction(grid.space)
    field = fem.Function(dolfinx_versions.space(grid.mesh, "DQ", 2))
    field.x.array[:] = 7.5
    constant = fem.Constant(grid.mesh, np.array(7.5))
    dx = grid.dx(metadata={"quadrature_degree": 5})
    for form in (
        lambda c: weak_forms.inertia(c, u, w),
        lambda c: weak_forms.internal_work(weak_forms.hooke(c, c, weak_forms.strain(u)), w),
    ):
        A, B = dense.matrix(form(field) * dx), dense.matrix(form(constant) * dx)
        assert np.abs(A - B).max() < 1e-14 * np.abs(B).max()


def test_inertia_sums_to_the_mass_in_every_direction(grid):
    w = ufl.TestFunction(grid.space)
    M = dense.matrix(weak_forms.inertia(1500.0, ufl.TrialFunction(grid.space), w) * grid.dx)
    volume = (grid.upper_corner - grid.lower_corner).prod()
    for d in range(grid.dim):
        along = dense.at_nodes(grid, lambda x, d=d: np.eye(grid.dim)[np.full(len(x), d)])
        assert along @ M @ along == pytest.approx(1500.0 * volume, rel=1e-12)


def test_the_boundary_tensor_has_the_normal_as_an_axis(grid, rng):
    n = rng.normal(size=grid.dim)
    n /= np.linalg.norm(n)
    across = dense.rotation(rng, grid.dim)[:, 0]
    across -= across @ n * n
    T = weak_forms.along_and_across(fem.Constant(grid.mesh, n), 5.0, 2.0)
    T = (
        np.array(
            [
                [
                    dolfinx_versions.assemble_scalar(
                        dolfinx_versions.compile_form(T[i, j] * grid.dx)
                    )
                    for j in range(grid.dim)
                ]
                for i in range(grid.dim)
            ]
        )
        / (grid.upper_corner - grid.lower_corner).prod()
    )
    np.testing.assert_allclose(T @ n, 5.0 * n, atol=1e-12)
    np.testing.assert_allclose(T @ across, 2.0 * across, atol=1e-12)


def test_wave_speeds_are_those_of_the_acoustic_tensor(rng):
    soil = LinearElastic(young=2e6, poisson=0.41, density=1000.0)
    λ, μ = soil.lame
    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    acoustic = μ * np.eye(3) + (λ + μ) * np.outer(n, n)
    speeds = np.sqrt(np.linalg.eigvalsh(acoustic) / soil.density)
    np.testing.assert_allclose(speeds, [soil.s_speed, soil.s_speed, soil.p_speed], rtol=1e-12)


def test_of_which_degree_a_form_is_in_a_coefficient():
    grid = dense.uneven(2)
    u, c, w = fem.Function(grid.space), fem.Function(grid.space), ufl.TestFunction(grid.space)
    λ, n = fem.Constant(grid.mesh, np.array(2.0)), ufl.FacetNormal(grid.mesh)
    stress = weak_forms.hooke(λ, λ, weak_forms.strain(u))
    Z = weak_forms.along_and_across(n, λ, λ)
    dx, ds = ufl.dx(domain=grid.mesh), ufl.ds(domain=grid.mesh)
    for form, expected in (
        (ufl.inner(c, w) * dx, 0),
        (weak_forms.internal_work(stress, w) * dx, 1),
        (ufl.inner(λ * u / (1.0 + c[0] ** 2) + c, w) * dx, 1),
        (weak_forms.dashpot(Z, u - c, w) * ds, 1),
        (u[0] * ufl.inner(u, w) * dx, 2),
        (ufl.inner(u, w) * dx + u[0] ** 3 * w[0] * ds, np.inf),
        (ufl.sin(u[0]) * w[0] * dx, np.inf),
        (ufl.inner(c / (1.0 + u[0]), w) * dx, np.inf),
    ):
        assert degree(form, u) == expected


def test_what_multiplies_a_coefficient():
    """Only what its derivative is made of: not loads, not what is added."""
    grid = dense.uneven(2)
    u, c, d, w = *(fem.Function(grid.space) for _ in range(3)), ufl.TestFunction(grid.space)
    λ, k = (fem.Constant(grid.mesh, np.array(2.0)) for _ in range(2))
    dx, ds = ufl.dx(domain=grid.mesh), ufl.ds(domain=grid.mesh)
    stress = weak_forms.hooke(λ, k, weak_forms.strain(u))
    for form, expected in (
        (ufl.inner(λ * c, w) * dx, set()),
        (weak_forms.internal_work(stress, w) * dx, {λ, k}),
        (ufl.inner(k * u / (1.0 + c[0] ** 2) + λ * d, w) * dx, {k, c}),
        (ufl.inner(k * u, w) * dx + ufl.inner(λ * d, w) * ds, {k}),
        (d[0] * ufl.inner(u - c, w) * ds, {d}),
    ):
        assert set(factors(form, u)) == expected


def test_rules_of_surface_points_compile_without_a_word(grid, caplog):
    """Arrays in a measure made UFL of 2022 doubt, for every surface of every run."""
    dx = ufl.dx(grid.mesh, metadata=simpson(grid.dim))
    dolfinx_versions.compile_form(ufl.TestFunction(grid.space)[0] * dx)
    assert not caplog.records


def test_a_form_that_is_compiled_leaves_its_domain_as_it_was():
    """FFCx of 2022 changes the domain's element where it compiles: what was made of it before and
    after would be of two domains, and no form of both could be compiled, in the first run of a
    scene alone."""
    grid = dense.uneven(2)
    before, w = ufl.TrialFunction(grid.space), ufl.TestFunction(grid.space)
    work = time.time_ns() * 1e-19 * ufl.inner(before, w) * ufl.dx
    dolfinx_versions.compile_form(work)
    assert len({before, ufl.TrialFunction(grid.space)}) == 1
