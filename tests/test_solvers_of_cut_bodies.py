"""Where the solver or the matrix changes while nodes are tied: numbers stay those of a full factor,
and of what is known."""

import inside
import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions
from mpm_fenicsx.solver import solver_choice

G = 9.81
FULL = mpm.Solver(petsc={"ksp_type": "preonly", "pc_type": "lu"})


def sheared(law, dim=2, solver=None, dt=5e-3, h=0.125, depth=0.25):
    """A block, 0.3 of a cell over its grid lines, that is sheared as it falls on its base."""
    size = (1.5, 1.25, depth)[:dim]
    grid = mpm.Grid.box((0.0,) * dim, size, tuple(round(s / h) for s in size))
    body = mpm.MaterialPoints.fill(grid, law, 2**dim, lambda x: (x[:2] < 1.0).all(axis=0))
    body.x[:, :2] += 0.3 * h
    body.velocity = np.zeros_like(body.x)
    body.velocity[:, 0] = 0.3 * body.x[:, 1]
    body.stress[:, 2] += 1e-9  # a body that bears stress is tied like one at rest
    terms = [mpm.Gravity((0.0, -G, 0.0)[:dim]), mpm.Fixed(grid.facets("bottom"))]
    return mpm.Simulation(grid, body, mpm.Newmark(dt), terms, solver=solver)


def after(run, steps):
    for _ in range(steps):
        run.step()
    return run.bodies[0].velocity


def test_tied_sides_stay_tied_when_the_matrix_grows():
    """A layer between them falls freely under a pressure on its top: v_y is exact."""
    grid = mpm.Grid.box((0.0, 0.0), (3.0, 3.0), (6, 12))
    soil = mpm.LinearElastic(20e6, 0.25, 1500.0)
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: (x[1] > 2.0) & (x[1] < 2.5))
    body.velocity = np.tile((0.0, -12.0), (len(body), 1))
    terms = [
        mpm.Tied("left", "right"),
        mpm.GhostPenalty(),
        mpm.Traction(body.surface("top"), (0.0, -1e3)),
        mpm.Gravity((0.0, -G)),
    ]
    run = mpm.Simulation(grid, body, mpm.Newmark(2e-3), terms, solver=FULL)
    matrix, grown = run.equilibrium.matrix, False
    for _ in range(6):
        run.step()
        grown |= run.equilibrium.matrix is not matrix
        exact = -12.0 - (G + 1e3 / (1500.0 * 0.5)) * run.time
        assert abs(body.velocity[:, 1].mean() - exact) < 1e-5
    assert grown == dolfinx_versions.FORMS_FOLLOW


def test_multigrid_that_is_chosen_within_a_step_gets_rows(monkeypatch):
    """So many unknowns are there only once nodes are tied or freed, after the first choice."""
    monkeypatch.setitem(solver_choice.MANY, 2, 159)  # 144 to 162 come, as ties do and go
    monkeypatch.setattr(solver_choice, "STIFF_ON_ONE", 0.1)
    run = sheared(mpm.LinearElastic(20e6, 0.25, 1500.0))
    kinds = set()
    for _ in range(8):
        run.bodies[0].velocity[:, 1] = 8.0
        run.step()
        kinds.add((run.equilibrium.choice.multigrid, inside.in_blocks(run)))
    assert kinds == {(True, False), (False, True)}


@pytest.mark.parametrize("dim", [2, 3])
def test_pivots_that_break_down_are_shifted_in_rows(dim, tmp_path):
    """Nearly incompressible soil: no full factor comes to the rescue, and a run goes on from a
    checkpoint bit for bit, with rows from its first step on."""
    soil = mpm.LinearElastic(20e6, 0.49, 1500.0)
    runs = [sheared(soil, dim) for _ in range(2)]
    after(runs[0], 2)
    mpm.Checkpoint(tmp_path / "state.npz")(runs[0])
    runs[1].restart(tmp_path / "state.npz")
    found = [after(run, 3).copy() for run in runs]
    assert np.array_equal(*found)
    assert [run.rescues for run in runs] == [0, 0]
    assert not inside.in_blocks(runs[0]) and not inside.in_blocks(runs[1])
    exact = after(sheared(soil, dim, FULL), 5)
    assert np.abs(found[0] - exact).max() < 1e-7 * np.abs(exact).max()


@pytest.mark.parametrize("method", ["gmres", "richardson", "bcgs", "tfqmr"])
def test_a_users_own_method_gets_nothing_of_gmres(method):
    """Sand that dilates less than it rubs has an askew matrix."""
    sand = mpm.MohrCoulomb(mpm.LinearElastic(20e6, 0.25, 1500.0), 5e3, 30.0, 0.0)
    found = after(sheared(sand, solver=mpm.Solver(petsc={"ksp_type": method}), dt=1e-3), 2)
    exact = after(sheared(sand, solver=FULL, dt=1e-3), 2)
    assert np.abs(found - exact).max() < 1e-7 * np.abs(exact).max()


def test_gmres_is_stopped_by_the_residual_itself():
    """Undrained sand, of an askew tangent: an incomplete factor that is no good makes all residuals
    small once it is applied to them."""
    sand = mpm.MohrCoulomb(mpm.LinearElastic(20e6, 0.25, 1500.0), 5e3, 30.0, 0.0)
    law = mpm.Undrained(sand, 5e8)
    found, exact = (after(sheared(law, 3, solver, 2e-3, 0.1, 0.5), 1) for solver in (None, FULL))
    assert np.abs(found - exact).max() < 1e-6 * np.abs(exact).max()
