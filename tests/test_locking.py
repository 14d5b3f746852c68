"""B-bar: volume changes by the mean of a cell, in the forms, at Gauss points and at material
points."""

from dataclasses import replace

import dense
import inside
import numpy as np
import pytest
import ufl
from dolfinx import fem

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.grid import dolfinx_versions, weak_forms
from mpm_fenicsx.grid.gauss_points import GaussPoints
from mpm_fenicsx.mapping.projection import DOUBLE_MAPPED
from mpm_fenicsx.mapping.shape_functions import Stencil
from mpm_fenicsx.terms.body import elastic_work

DOUBLE = [m for m in mpm.MAPPINGS if m.integrate is DOUBLE_MAPPED]
AT_POINTS = [m for m in mpm.MAPPINGS if m not in DOUBLE]


def random_motion(grid, seed=0):
    return np.random.default_rng(seed).normal(size=(grid.nodes, grid.dim))


def strain_rows(slopes):
    """B (components, nodes × dim) of slopes (nodes, dim): rows xx, yy, zz, xy (yz, xz)."""
    nodes, dim = slopes.shape
    B = np.zeros((tensors.components(dim), nodes, dim))
    for i in range(dim):
        B[i, :, i] = slopes[:, i]
    for k, (i, j) in enumerate(tensors.SHEAR[dim]):
        B[3 + k, :, i], B[3 + k, :, j] = slopes[:, j], slopes[:, i]
    return B.reshape(len(B), -1)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_form_is_b_bar_by_hand_on_one_cell(dim):
    size = np.array([0.7, 0.4, 1.1])[:dim]
    grid = mpm.Grid.box((0,) * dim, size, (1,) * dim)
    soil = mpm.LinearElastic(young=3e6, poisson=0.49, density=1.0)
    scene, u = dense.bare_scene(grid, mpm.QuasiStatic(1)), ufl.TrialFunction(grid.space)
    scene.lame, scene.stiffness_dx = soil.lame, scene.dx
    w = ufl.TestFunction(grid.space)
    plain = dense.matrix(elastic_work(scene, u, w))
    scene.b_bar = True
    K = dense.matrix(elastic_work(scene, u, w))
    ξ = np.rint(grid.space.tabulate_dof_coordinates()[:, :dim] / size)  # of nodes, 0 or 1
    gauss = 0.5 + (
        np.stack(np.meshgrid(*[[-1, 1]] * dim, indexing="ij"), -1).reshape(-1, dim)
    ) / np.sqrt(12)
    C = soil.tangent(
        np.zeros((1, tensors.components(dim))), np.zeros((1, tensors.components(dim))), None
    )[2][0]
    volume = np.zeros(tensors.components(dim))
    volume[:3] = 1.0
    B = []
    for x in gauss:
        one = np.where(ξ == 1, x, 1 - x)
        B.append(
            strain_rows(
                np.stack(
                    [
                        (2 * ξ[:, d] - 1) * np.delete(one, d, 1).prod(1) / size[d]
                        for d in range(dim)
                    ],
                    -1,
                )
            )
        )
    mean = sum(volume @ b for b in B) / len(B)
    by_hand = np.zeros_like(K)
    for b in B:
        bar = b + np.outer(volume, mean - volume @ b) / 3
        by_hand += size.prod() / len(B) * bar.T @ C @ bar
    assert np.abs(K - by_hand).max() < 1e-14 * np.abs(K).max()
    assert np.abs(plain - by_hand).max() > 0.1 * np.abs(K).max()


@pytest.mark.parametrize("order", [1, -1])
def test_one_point_rules_leave_other_rules_alone(order):
    """FFCx hands the coefficients of a one-point rule to every rule of its kernel: it has to have
    its own."""
    grid = dense.uneven(2)
    u, w = fem.Function(grid.space), ufl.TestFunction(grid.space)
    u.x.array[:] = random_motion(grid).ravel()
    parts = [
        integrand * grid.dx(metadata={"quadrature_degree": degree})
        for degree, integrand in (
            (3, weak_forms.distortion_work(1.0, u, w)),
            (1, weak_forms.dilation_work(2.0, 1.0, u, w)),
        )
    ]
    together = dense.vector(grid.space, sum(parts[::order]))
    apart = sum(dense.vector(grid.space, part) for part in parts)
    assert np.abs(together - apart).max() < 1e-13 * np.abs(apart).max()
    energy = [ufl.replace(part, {w: u}) for part in parts[::order]]
    assert dolfinx_versions.assemble_scalar(
        dolfinx_versions.compile_form(sum(energy))
    ) == pytest.approx(apart @ u.x.array, rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_gauss_points_and_material_points_see_the_mean_of_their_cells(dim):
    grid = dense.uneven(dim)
    gauss = GaussPoints(grid)
    lat, u = grid.lattice, random_motion(grid)
    mean = gauss.means().divergence(u)
    plain = gauss.strain(u)
    by_hand = plain[:, :3].sum(axis=1).reshape(grid.cells, -1).mean(axis=1)
    np.testing.assert_allclose(mean, by_hand, atol=1e-13 * np.abs(by_hand).max())
    np.testing.assert_allclose(
        gauss.strain(u, gauss.means()),
        tensors.dilate(plain, np.repeat(by_hand, 2**dim)),
        atol=1e-13 * np.abs(plain).max(),
    )
    body = dense.tiles(grid, np.random.default_rng(3))
    stencil = Stencil(grid, len(body), support=True)
    stencil.place(body.x, body.half, grid.find(body.x))
    a, b = (body.x - body.half)[:, None], (body.x + body.half)[:, None]
    overlap = np.clip(np.minimum(b, lat.upper) - np.maximum(a, lat.lower), 0.0, None).prod(axis=2)
    assert ((overlap > 1e-12).sum(axis=1) == 2**dim).any()
    np.testing.assert_allclose(
        stencil.mean_of_cells(mean), overlap @ mean / body.volume, atol=1e-12
    )
    linear = Stencil(grid, len(body), support=False)
    linear.place(body.x, None, grid.find(body.x))
    np.testing.assert_array_equal(linear.mean_of_cells(mean), mean[grid.find(body.x)])


@pytest.mark.parametrize("mapping", DOUBLE, ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_points_and_gauss_points_agree_on_a_uniform_strain(dim, mapping):
    grid = dense.uneven(dim)
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 2**dim, jitter=0.4)
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(1), [], replace(mapping, b_bar=True))
    run.locate()
    g = np.random.default_rng(5).normal(size=(dim, dim)) * 1e-7
    run.nodal("increment").ravel()[:] = dense.at_nodes(grid, lambda x: x @ g.T)
    gauss = GaussPoints(grid)
    at_gauss = gauss.strain(run.nodal("increment"), gauss.means())
    run.project()
    run.carry()
    expected = dense.SOIL.update(at_gauss[:1], np.zeros_like(at_gauss[:1]))
    np.testing.assert_allclose(
        at_gauss, np.repeat(at_gauss[:1], len(at_gauss), 0), atol=1e-13 * np.abs(g).max()
    )
    np.testing.assert_allclose(
        body.stress, np.repeat(expected, len(body), 0), atol=1e-10 * np.abs(expected).max()
    )


SIDES = {"left": "x", "right": "x", "back": "z", "front": "z"}


def oedometer(grid, value):
    """Terms of a block between rollers under a smooth plate."""
    rollers = [
        mpm.Fixed(grid.facets(name), axis)
        for name, axis in SIDES.items()
        if grid.dim == 3 or axis == "x"
    ]
    return [
        *rollers,
        mpm.Fixed(grid.facets("bottom"), "y"),
        mpm.Fixed(grid.facets("top"), "y", value),
    ]


@pytest.mark.parametrize("method", ["FE", mpm.DM, mpm.DM_G, mpm.DM_C, mpm.DM_GC], ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_patch_under_a_moved_plate_strains_evenly(dim, method):
    """And by what was asked for, whatever the steps."""
    grid = dense.uneven(dim)
    soil = mpm.LinearElastic(young=1e7, poisson=0.499, density=1e3)
    settlement = 1e-7
    terms = oedometer(grid, lambda t: 1.0 - settlement * t**2)
    if method == "FE":
        run = mpm.FiniteElements(grid, soil, mpm.QuasiStatic(2), terms, b_bar=True)
    else:
        body = mpm.MaterialPoints.fill(grid, soil, 2**dim)
        run = mpm.Simulation(grid, body, mpm.QuasiStatic(2), terms, replace(method, b_bar=True))
    run.until(1.0)
    stress = run.stress(np.arange(grid.cells)) if method == "FE" else body.stress
    strain = np.zeros((1, tensors.components(dim)))
    strain[0, 1] = -settlement
    exact = np.repeat(soil.update(strain, np.zeros_like(strain)), len(stress), 0)
    # between the two steps of points geometry changes by the settlement; in finite elements it does
    # not
    np.testing.assert_allclose(
        stress, exact, atol=(1e-9 if method == "FE" else 10 * settlement) * np.abs(exact).max()
    )


def test_the_twins_energy_is_balanced():
    grid, soil = dense.uneven(2), mpm.LinearElastic(young=20e6, poisson=0.49, density=1500.0)
    run = mpm.FiniteElements(
        grid,
        soil,
        mpm.Newmark(1e-3),
        [
            mpm.Fixed(grid.facets("bottom")),
            mpm.Gravity(lambda t: np.sin(300 * t) * np.array([1.0, 2.0])),
            mpm.Traction(grid.facets("top"), lambda t, x: 1e3 * np.sin(200 * t) * x),
            mpm.ViscousBoundary(grid.facets("right"), dense.SOFT),
        ],
        b_bar=True,
    )
    energy = run.record(mpm.Energy())
    run.until(0.03)
    assert np.abs(energy.lost).max() < 1e-10 * np.abs(energy["work"]).max()
    assert energy["strain"].max() > 0.1 * energy["work"].max()


def block_under_strip(method, ν, b_bar, n=16, m=12):
    """Pressure (2 m, 2 n) of points in rows (of Gauss points by halves of cells in finite
    elements), and settlement; symmetric half of an elastic block, strip on top."""
    h = 4.0 / n
    grid = mpm.Grid.box(
        (0, 0),
        (n * h, m * h),
        (n, m),
        facets={"strip": lambda x: (np.abs(x[1] - m * h) < 1e-9) & (x[0] < 1.25 + 1e-9)},
    )
    soil = mpm.LinearElastic(young=1e7, poisson=ν, density=1e3)
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom")),
        mpm.Traction(grid.facets("strip"), (0.0, -10.0)),
    ]
    if method == "FE":
        run = mpm.FiniteElements(grid, soil, mpm.QuasiStatic(1), terms, b_bar=b_bar)
        run.step()
        gauss, centre = GaussPoints(grid), 0.5 * (grid.lattice.lower + grid.lattice.upper)
        strain = gauss.strain(run.nodal("displacement"), gauss.means() if b_bar else None)
        stress = soil.update(strain, np.zeros_like(strain))
        x = (centre[:, None] + (gauss.digit - 0.5) * h / 2).reshape(-1, 2)
    else:
        body = mpm.MaterialPoints.fill(grid, soil, 4)
        x = body.x.copy()
        run = mpm.Simulation(grid, body, mpm.QuasiStatic(1), terms, replace(method, b_bar=b_bar))
        run.step()
        stress = body.stress
    row, column = np.rint(x[:, ::-1].T / (h / 2) - 0.5).astype(int)
    pressure = np.full((2 * m, 2 * n), np.nan)
    pressure[row, column] = -tensors.mean(stress)
    return pressure, run.nodal("increment").ravel().min()


def scatter(p):
    """Mean jump of pressures (rows, columns) from point to point."""
    return 0.5 * (np.abs(np.diff(p, axis=0)).mean() + np.abs(np.diff(p, axis=1)).mean())


@pytest.fixture(scope="module")
def refined():
    """The same on a grid four times as fine, averaged over the places of the points."""
    found = {}
    for ν in (0.3, 0.499):
        pressure, settlement = block_under_strip("FE", ν, True, 64, 48)
        found[ν] = pressure.reshape(24, 4, 32, 4).mean(axis=(1, 3)), settlement
    return found


@pytest.mark.parametrize(
    "method, fall", [("FE", 50), (mpm.DM, 50), (mpm.DM_G, 50), (mpm.DM_GC, 4)], ids=str
)
def test_the_checkerboard_of_pressures_vanishes(refined, method, fall):
    """The composite patch of DM-GC sees little of it; the stiffness that it stands for is in all of
    them."""
    exact, settlement = refined[0.499]
    locked, free = (block_under_strip(method, 0.499, b_bar) for b_bar in (False, True))
    assert fall * scatter(free[0] - exact) < scatter(locked[0] - exact)
    assert scatter(free[0] - exact) < 0.02 * exact.max()
    assert free[1] == pytest.approx(settlement, rel=0.01)
    assert locked[1] / settlement < 0.7


@pytest.mark.parametrize("method", ["FE", mpm.DM, mpm.DM_G, mpm.DM_GC], ids=str)
def test_where_nothing_locks_little_changes(refined, method):
    plain, free = (block_under_strip(method, 0.3, b_bar) for b_bar in (False, True))
    assert free[1] == pytest.approx(plain[1], rel=0.01)
    cells = [p.reshape(12, 2, 16, 2).mean(axis=(1, 3)) for p, _ in (plain, free)]
    assert np.abs(cells[1] - cells[0]).mean() < 0.01 * np.abs(cells[0]).mean()


def test_flow_of_points_is_that_of_finite_elements_in_the_first_step():
    """Full cells without history: the double-mapped law is the law, so is its cure."""
    found = []
    soil = mpm.VonMises(mpm.LinearElastic(young=1e7, poisson=0.499, density=1e3), 10.0, 10.0, 0.0)
    grid = mpm.Grid.box(
        (0, 0), (2, 1), (8, 4), facets={"strip": lambda x: (x[1] > 1 - 1e-9) & (x[0] < 0.5 + 1e-9)}
    )
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom")),
        mpm.Fixed(grid.facets("strip"), "y", lambda t: -4e-6 * t),
    ]
    body = mpm.MaterialPoints.fill(grid, soil, 4)
    for run in (
        mpm.FiniteElements(grid, soil, mpm.QuasiStatic(1), terms, b_bar=True),
        mpm.Simulation(grid, body, mpm.QuasiStatic(1), terms, replace(mpm.DM_G, b_bar=True)),
    ):
        run.step()
        assert run.solves > 1
        found.append(run.nodal("increment").ravel().copy())
    np.testing.assert_allclose(found[1], found[0], atol=1e-8 * np.abs(found[0]).max())


@pytest.mark.parametrize("mapping", AT_POINTS, ids=str)
def test_mappings_that_integrate_at_points_refuse_it_by_name(mapping):
    with pytest.raises(ValueError, match=rf"b_bar .*{mapping}\b"):
        replace(mapping, b_bar=True)


def test_without_it_nothing_of_it_is_there():
    grid = dense.uneven(2)
    run = mpm.Simulation(grid, mpm.MaterialPoints.fill(grid, dense.SOIL, 4), mpm.QuasiStatic(1), [])
    assert "B-bar" not in str(run)
    assert inside.bill(run).tangents == 1


@pytest.mark.parametrize("value", [lambda t: "deep", lambda t: np.nan, lambda t: (0.0, -t)])
def test_a_displacement_that_is_no_number_is_refused(value):
    grid = dense.uneven(2)
    with pytest.raises(ValueError, match="value of Fixed"):
        mpm.FiniteElements(grid, dense.SOIL, mpm.QuasiStatic(1), oedometer(grid, value))
