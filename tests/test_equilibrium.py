"""One step's matrix and right-hand side against eq. (12) by hand, and the nodes that no material
touches."""

from dataclasses import replace

import dense
import inside
import numpy as np
import pytest
import ufl
from ufl import inner

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors

DT = 2e-3
DIRECT = mpm.Solver(petsc={"ksp_type": "preonly", "pc_type": "lu"})


def close(a, b, tolerance=1e-12):
    assert np.abs(b).max() > 0.0
    assert np.abs(a - b).max() < tolerance * np.abs(b).max()


def gravity(dim):
    return np.arange(dim) - 9.0


@pytest.fixture(params=[2, 3])
def scene(request):
    """A random body with facets and turned surface points, all terms at work, stopped within its
    second step."""

    def make(mapping):
        dim, rng = request.param, np.random.default_rng(7)
        grid = dense.uneven(dim)
        body = dense.random_body(grid, rng)
        x = 0.1 + 0.8 * rng.random((6, dim))
        normal = rng.normal(size=x.shape)
        from mpm_fenicsx import SurfacePoints

        on = SurfacePoints(
            x, normal / np.linalg.norm(normal, axis=1)[:, None], rng.uniform(0.1, 0.5, 6)
        )
        terms = [
            mpm.Gravity(tuple(gravity(dim))),
            mpm.Traction(grid.facets("top"), tuple(1e4 * gravity(dim))),
            mpm.ViscoelasticBoundary(on, dense.SOFT, 1.5),
            mpm.ViscousBoundary(grid.facets("left"), dense.SOIL),
        ]
        body.velocity *= 0.1
        body.stress *= 0.1
        run = mpm.Simulation(grid, body, mpm.Newmark(DT), terms, mapping, DIRECT)
        run.step()
        return inside.prepared(run), on

    return make


@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.DM_GC], ids=str)
def test_the_step_is_equation_12(scene, mapping):
    run, on = scene(mapping)
    grid, body = run.grid, run.bodies[0]
    dim, V = grid.dim, grid.space
    u, w = ufl.TrialFunction(V), ufl.TestFunction(V)
    M, K = inside.mass_and_stiffness(run)
    n = ufl.FacetNormal(grid.mesh)
    Zp, Zs = (dense.SOIL.density * c for c in (dense.SOIL.p_speed, dense.SOIL.s_speed))
    Z = Zs * ufl.Identity(dim) + (Zp - Zs) * ufl.outer(n, n)
    C = dense.matrix(inner(Z * u, w) * grid.facets("left").measure)
    N, nn = dense.hats(grid, on.x), on.normal[:, :, None] * on.normal[:, None, :]

    def on_points(along, across):
        T = along * nn + across * (np.eye(dim) - nn)
        return T, np.einsum("p,pi,pj,pab->iajb", on.area, N, N, T).reshape(M.shape)

    C += on_points(*(dense.SOFT.density * c for c in (dense.SOFT.p_speed, dense.SOFT.s_speed)))[1]
    G = dense.SOFT.lame[1]
    k, K_spring = on_points(2 * G / 1.5, G / (2 * 1.5))

    v, a = run.nodal("velocity").ravel(), run.nodal("acceleration").ravel()
    stress = body.volume[:, None, None] * tensors.matrix(body.stress, dim)
    F_int = np.einsum("pij,pkj->ki", stress, inside.shape_functions(run)[1])
    F_ext = M @ np.tile(gravity(dim), grid.nodes)
    F_ext += dense.vector(
        V, inner(ufl.as_vector(list(1e4 * gravity(dim))), w) * grid.facets("top").measure
    )
    F_kin = M @ (-4 * v / DT - a)
    F_vis = C @ (-v)
    F_rec = np.einsum("p,pi,pab,pb->ia", on.area, N, k, on.displacement).ravel()
    assert np.abs(on.displacement).max() > 0.0

    run.solve()
    A = K + 4 / DT**2 * M + 2 / DT * C + K_spring
    b = F_ext - F_int.ravel() - F_kin - F_vis - F_rec
    found = inside.equations(run)
    close(found.matrix, A)
    close(found.residual, b)
    close(A @ run.nodal("increment").ravel(), b, 1e-9)


def test_point_sums_by_hand_are_the_matrix_of_mpm(scene):
    run, _ = scene(mpm.MPM)
    grid, body, dim = run.grid, run.bodies[0], run.grid.dim
    N, (_, B) = dense.hats(grid, body.x), inside.shape_functions(run)
    M = np.einsum("p,pi,pj,ab->iajb", body.mass, N, N, np.eye(dim))
    l, m = body.material.lame
    K = (
        l * np.einsum("p,pia,pjb->iajb", body.volume, B, B)
        + m * np.einsum("p,pib,pja->iajb", body.volume, B, B)
        + m * np.einsum("p,pic,pjc,ab->iajb", body.volume, B, B, np.eye(dim))
    )
    size = grid.nodes * dim
    M_form, K_form = inside.mass_and_stiffness(run)
    close(M_form, M.reshape(size, size))
    close(K_form, K.reshape(size, size))


def test_the_matrix_is_symmetric_and_positive(scene):
    run, _ = scene(mpm.DM_GC)
    A = inside.equations(run, assemble=True).solved
    close(A, A.T, 1e-14)
    assert np.linalg.eigvalsh(A).min() > 0.0


# -- nodes without material ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "stepping", [mpm.Newmark(1e-3), mpm.QuasiStatic(1)], ids=["dynamic", "static"]
)
@pytest.mark.parametrize("mapping", mpm.MAPPINGS, ids=str)
def test_nodes_without_material_stay_and_are_not_solved_for(mapping, stepping):
    grid = mpm.Grid.box((0, 0), (6, 4), (6, 4))
    body = mpm.MaterialPoints.fill(
        grid, dense.SOIL, 4, jitter=0.3, inside=lambda x: (x[0] < 3) & (x[1] < 2)
    )
    terms = [mpm.Fixed(grid.facets("bottom")), mpm.Gravity((1.0, -1.0))]
    mapping = replace(mapping, hold_cut_cells=False)
    run = mpm.Simulation(grid, body, stepping, terms, mapping, DIRECT)
    run.step()
    x, u = grid.space.tabulate_dof_coordinates()[:, :2], run.nodal("increment")
    weight = inside.shape_functions(run)[0].sum(axis=0)
    touched = weight > 0.0
    found = inside.equations(run)
    idle = found.idle.reshape(-1, 2)
    base = x[:, 1] < 1e-12
    assert touched.sum() < grid.nodes
    assert not idle[touched & ~base].any()
    assert idle[~touched & ~base].all()
    assert (u[idle.any(axis=1)] == 0.0).all()
    assert len(found.solved) == 2 * (touched & ~base).sum()
    assert (found.solved.diagonal() > 0.0).all()


@pytest.mark.parametrize("fill", [(1e-2, 1e-2), (1e-4, 1e-4), (1e-6, 0.0), (1e-8, 0.0)], ids=str)
@pytest.mark.parametrize("mapping", mpm.MAPPINGS, ids=str)
def test_a_node_with_hardly_any_mass_falls_like_the_rest(mapping, fill):
    grid, g, dt = mpm.Grid.box((0, 0), (4, 4), (4, 4)), np.array([3.0, -9.81]), 1e-3
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4, inside=lambda x: (x[0] < 2) & (x[1] < 2))
    body.x += (
        np.array(fill) if mapping.support else 0.25 + np.array(fill)
    )  # domains or points reach into next cells
    run = mpm.Simulation(grid, body, mpm.Newmark(dt), [mpm.Gravity(tuple(g))], mapping, DIRECT)
    run.step()
    weight = inside.shape_functions(run)[0].sum(axis=0)
    touched = weight > 0.0
    assert 0.0 < weight[touched].min() < 1.1 * fill[0]
    assert not inside.equations(run).idle.reshape(-1, 2)[touched].any()
    np.testing.assert_allclose(
        run.nodal("increment")[touched],
        np.tile(g * dt**2 / 2, (touched.sum(), 1)),
        rtol=1e-5,
    )


@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_G, mpm.DM_GC], ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_the_scaled_matrix_stays_well_conditioned_wherever_the_body_is_cut(dim, mapping):
    """After division by its diagonal; random points seen without their support domains leave it
    singular in 3D."""
    for cut in (0.1, 1e-2, 1e-3, 1e-4):
        grid = mpm.Grid.box((0,) * dim, (4,) * dim, (4,) * dim)
        body = mpm.MaterialPoints.fill(
            grid, dense.SOIL, 2**dim, jitter=0.4, inside=lambda x: (x < 2).all(axis=0)
        )
        body.x += cut
        run = mpm.Simulation(grid, body, mpm.Newmark(0.02), [], mapping)
        run.locate()
        run.project()
        A = inside.equations(run, assemble=True).solved
        d = 1 / np.sqrt(A.diagonal())
        eigenvalues = np.linalg.eigvalsh(d[:, None] * A * d)
        assert eigenvalues.min() > 1e-2
        assert eigenvalues.max() < 10.0


# -- the solver ------------------------------------------------------------------------------------


def test_a_solver_that_stops_early_is_an_error():
    grid = dense.uneven(2)
    body = dense.random_body(grid, np.random.default_rng(0))
    impatient = mpm.Solver(petsc={"ksp_max_it": 1, "ksp_rtol": 1e-14})
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], solver=impatient)
    with pytest.raises(mpm.RunError, match=r"step 1, t = 0\.001.*reason -3 after 1 iterations"):
        run.step()


def test_options_reach_their_own_solver_only():
    grid = dense.uneven(2)
    runs = [
        mpm.Simulation(
            grid,
            mpm.MaterialPoints.fill(grid, dense.SOIL, 4),
            mpm.Newmark(1e-3),
            [],
            solver=mpm.Solver(petsc=options),
        )
        for options in ({"ksp_rtol": 1e-3}, None, {"ksp_type": "minres"})
    ]
    solvers = [inside.linear_solver(run) for run in runs]
    assert [solver.getTolerances()[0] for solver in solvers] == [1e-3, 1e-11, 1e-11]
    assert [solver.getType() for solver in solvers] == ["cg", "cg", "minres"]


@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.DM_GC], ids=str)
def test_solvers_agree(mapping):
    found = []
    for solver in (None, DIRECT):
        grid = dense.uneven(2)
        body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4, jitter=0.3)
        run = mpm.Simulation(
            grid,
            body,
            mpm.Newmark(1e-3),
            [mpm.Fixed(grid.facets("bottom")), mpm.Gravity((1.0, -9.81))],
            mapping,
            solver,
        )
        run.until(5e-3)
        found.append(body.x - 0.0)
    np.testing.assert_allclose(found[0], found[1], atol=1e-13)


def test_a_factor_comes_to_the_rescue_of_an_iteration_that_fails():
    grid = dense.uneven(2)
    found = []
    for most in (300, 1):
        body = dense.random_body(grid, np.random.default_rng(7))
        run = mpm.Simulation(
            grid,
            body,
            mpm.Newmark(DT),
            [mpm.Gravity((1.0, -9.0)), mpm.Fixed(grid.facets("bottom"))],
            replace(mpm.DM_GC, correction=mpm.AccelerationCorrection.OFF),
        )
        inside.linear_solver(run).setTolerances(max_it=most)
        run.step()
        found.append(run.nodal("increment").ravel().copy())
        assert run.rescues == (most == 1) == (run.iterations == 1)
    close(found[1], found[0], 1e-8)
