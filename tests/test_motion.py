"""Newmark's factors on the grid: what UFL sees is what the nodes get."""

import dense
import numpy as np
import pytest
import ufl
from ufl import inner

from mpm_fenicsx import Newmark, QuasiStatic
from mpm_fenicsx.dynamics.motion import Motion
from mpm_fenicsx.grid import dolfinx_versions

STEPPINGS = [Newmark(0.02), Newmark(0.02, beta=0.36, gamma=0.7)]


@pytest.fixture(params=[2, 3])
def grid(request):
    return dense.uneven(request.param)


def randomise(motion, seed=0):
    rng = np.random.default_rng(seed)
    for f in (motion.u, motion.v, motion.a):
        f.x.array[:] = rng.normal(size=len(f.x.array))


@pytest.mark.parametrize("stepping", STEPPINGS, ids=["trapezoidal", "damped"])
def test_the_expressions_are_the_nodal_values_at_the_end(grid, stepping):
    motion = Motion(grid, stepping)
    randomise(motion)
    M = dense.matrix(inner(ufl.TrialFunction(grid.space), motion.w) * grid.dx)
    for expression, nodal in zip((motion.velocity, motion.acceleration), motion.end(), strict=True):
        b = dense.vector(grid.space, inner(expression, motion.w) * grid.dx)
        np.testing.assert_allclose(b, M @ nodal.ravel(), rtol=1e-10, atol=1e-12 * np.abs(b).max())


def test_the_trapezoidal_rule_is_the_one_of_the_paper(grid):
    motion, dt = Motion(grid, Newmark(0.02)), 0.02
    randomise(motion)
    u, v, a = (motion.nodal(f) for f in (motion.u, motion.v, motion.a))
    v1, a1 = motion.end()
    np.testing.assert_allclose(v1, 2 * u / dt - v, rtol=1e-12)
    np.testing.assert_allclose(a1, 4 * u / dt**2 - 4 * v / dt - a, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(v1, v + dt / 2 * (a + a1), atol=1e-9)
    np.testing.assert_allclose(u, dt * v + dt**2 / 4 * (a + a1), atol=1e-12)


@pytest.mark.parametrize("stepping", STEPPINGS, ids=["trapezoidal", "damped"])
def test_newmarks_own_formulae_hold(grid, stepping):
    motion, (dt, β, γ) = Motion(grid, stepping), (stepping.dt, stepping.beta, stepping.gamma)
    randomise(motion)
    u, v, a = (motion.nodal(f) for f in (motion.u, motion.v, motion.a))
    v1, a1 = motion.end()
    np.testing.assert_allclose(u, dt * v + dt**2 * ((0.5 - β) * a + β * a1), atol=1e-12)
    np.testing.assert_allclose(v1, v + dt * ((1 - γ) * a + γ * a1), atol=1e-9)


def test_the_derivative_supplies_the_factors(grid):
    motion = Motion(grid, Newmark(0.02))
    trial = ufl.TrialFunction(grid.space)
    M = dense.matrix(inner(trial, motion.w) * grid.dx)
    for expression, factor in ((motion.velocity, 2 / 0.02), (motion.acceleration, 4 / 0.02**2)):
        A = dense.matrix(ufl.derivative(inner(expression, motion.w) * grid.dx, motion.u, trial))
        np.testing.assert_allclose(A, factor * M, rtol=1e-12, atol=1e-14 * np.abs(A).max())


def test_another_time_step_needs_no_new_form(grid):
    motion = Motion(grid, Newmark(0.02))
    randomise(motion)
    form = dolfinx_versions.compile_form(inner(motion.velocity, motion.w) * grid.dx)
    motion.use(Newmark(0.005))
    from dolfinx import fem

    b = fem.Function(grid.space)
    dolfinx_versions.assemble_vector(b, form)
    M = dense.matrix(inner(ufl.TrialFunction(grid.space), motion.w) * grid.dx)
    expected = M @ (2 * motion.u.x.array / 0.005 - motion.v.x.array)
    np.testing.assert_allclose(b.x.array, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())


def test_a_step_starts_without_displacement(grid):
    motion = Motion(grid, Newmark(0.02))
    randomise(motion)
    motion.clear()
    assert (motion.u.x.array == 0.0).all()
    assert (motion.v.x.array != 0.0).all()


def test_statics_has_an_increment_and_nothing_else(grid):
    motion = Motion(grid, QuasiStatic(3))
    assert motion.u.x.array.shape == (grid.nodes * grid.dim,)
    for name in ("v", "a", "velocity", "acceleration", "dt"):
        assert not hasattr(motion, name)


def test_nodal_values_are_a_view(grid):
    motion = Motion(grid, Newmark(0.02))
    motion.nodal(motion.u)[3] = 7.0
    assert motion.u.x.array[3 * grid.dim] == 7.0
