"""Newton's iteration: when it stops, what it does when it gets stuck, and how a step that fails is
cut."""

from dataclasses import replace
from types import SimpleNamespace

import dense
import inside
import numpy as np
import plastic
import pytest
import ufl
from plastic import DIRECT, LAW, STIFFLY

import mpm_fenicsx as mpm
from mpm_fenicsx.common.errors import SolverError
from mpm_fenicsx.grid import weak_forms


class Scalar:
    """R(u) = 0 in one unknown, with the names of ``Equilibrium``; ``evaluations`` of the law are
    counted."""

    def __init__(self, residual, slope, start):
        self.residual, self.slope = residual, slope
        self.motion = SimpleNamespace(u=SimpleNamespace(x=SimpleNamespace(array=np.array([start]))))
        self.increment = SimpleNamespace(x=SimpleNamespace(array=np.zeros(1)))
        self.yielding, self.evaluations, self.solves = self, 0, 0

    @property
    def u(self):
        return self.motion.u.x.array

    def evaluate(self):
        self.evaluations += 1
        return True

    def scale(self, internal):
        return 2.0

    def refresh(self, internal):
        return float(abs(self.residual(self.u)[0]))

    def largest(self):
        return "in its one unknown"

    def bend(self):
        self._slope = self.slope(self.u)

    def correct(self):
        self.solves += 1
        self.increment.x.array[:] = -self.residual(self.u) / self._slope
        self.u[:] += self.increment.x.array


def arctan(start):
    """Newton runs away from |u| > 1.39."""
    return Scalar(np.arctan, lambda u: 1 / (1 + u**2), start)


def test_steps_that_do_not_help_are_halved():
    far = arctan(3.0)
    mpm.Newton(tolerance=1e-10).iterate(far, None)
    assert abs(far.u[0]) <= 2e-10
    assert far.evaluations > far.solves + 1
    near = arctan(1.0)
    mpm.Newton(tolerance=1e-10).iterate(near, None)
    assert near.evaluations == near.solves + 1
    with pytest.raises(SolverError, match="does not converge"):
        mpm.Newton(tolerance=1e-10, iterations=6, halvings=0).iterate(arctan(3.0), None)


def test_halving_ends():
    """Uphill there is nothing to find: each step is halved as often as allowed, and no more."""
    uphill = Scalar(lambda u: 1 + u**2, lambda u: -1 - 0 * u, 1.0)
    with pytest.raises(SolverError):
        mpm.Newton(tolerance=1e-10, iterations=3, halvings=4).iterate(uphill, None)
    assert uphill.solves == 2
    assert uphill.evaluations == 1 + 2 * (1 + 4)


def test_the_tolerance_is_relative_to_the_forces():
    for tolerance in (1e-1, 1e-3, 1e-6):
        problem = arctan(1.0)
        mpm.Newton(tolerance=tolerance).iterate(problem, None)
        assert abs(problem.residual(problem.u[0])) <= 2.0 * tolerance
    loose = arctan(0.19)
    mpm.Newton(tolerance=0.1).iterate(loose, None)
    assert loose.solves == 0


@pytest.mark.parametrize(
    "spoil", [lambda u: 0 * u + np.nan, lambda u: np.where(u == 1.0, u, np.nan)]
)
def test_what_is_not_a_number_has_not_converged(spoil):
    with pytest.raises(SolverError):
        mpm.Newton(iterations=4).iterate(Scalar(spoil, lambda u: 1 + 0 * u, 1.0), None)


# -- in runs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [None, mpm.DM_GC], ids=["FE", "DM-GC"])
def test_a_run_is_solved_to_its_tolerance(kind):
    solves = []
    for tolerance in (1e-2, 1e-6, 1e-11):
        run = inside.prepared(plastic.static(kind, mpm.Newton(tolerance=tolerance)))
        norm, scale = inside.solved_imbalance(run)
        assert 0.0 < norm <= tolerance * scale
        solves.append(run.solves)
    assert 1 < solves[0] < solves[1] < solves[2]


@pytest.mark.parametrize("kind", [mpm.MPM, mpm.DM_GC], ids=["MPM", "DM-GC"])
def test_an_impact_without_load_or_stress_has_a_scale(kind):
    grid = dense.uneven(2)
    body = mpm.MaterialPoints.fill(grid, LAW, 4, jitter=0.2)
    body.velocity = -3.0 * body.x * np.array([0.0, 1.0])
    run = plastic.run_of(kind, grid, mpm.Newmark(1e-3), [mpm.Fixed(grid.facets("bottom"))], body)
    run.step()
    assert 1 < run.solves < 8
    assert body.history.max() > 1e-4


def test_the_scale_is_that_of_the_stress_and_not_of_what_elasticity_would_bear():
    """A block of finite elements sheared to twenty-five times its elastic strain."""
    grid = dense.uneven(2)
    run = mpm.FiniteElements(grid, LAW, mpm.QuasiStatic(25), [])
    for _ in range(25):
        run.nodal("increment").ravel()[:] = dense.at_nodes(
            grid, lambda x: 1e-3 * x[:, ::-1] * np.array([1.0, 0.0])
        )
        run.carry()
    shear = run.gauss_stress()[0, 3]
    assert shear < 0.04 * LAW.lame[1] * 25e-3
    τ = ufl.as_matrix([[0.0, shear], [shear, 0.0]])
    work = weak_forms.internal_work(τ, ufl.TestFunction(grid.space)) * grid.dx
    exact = np.linalg.norm(dense.vector(grid.space, work))
    assert inside.scale(run) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("kind", [None, mpm.MPM, mpm.DM_GC], ids=["FE", "MPM", "DM-GC"])
def test_without_a_tolerance_a_step_is_one_solve(kind):
    run = plastic.static(kind, mpm.Newton(tolerance=None), steps=4)
    for step in range(1, 5):
        run.step()
        assert run.solves == step
    history = run.bodies[0].history if run.bodies else run.gauss_history()
    assert history.max() > 1e-4


@pytest.mark.parametrize("kind", [None, mpm.DM_GC], ids=["FE", "DM-GC"])
def test_a_step_that_fails_says_why_and_leaves_everything_as_it_was(kind):
    run = plastic.static(kind, mpm.Newton(iterations=2, cuts=0), steps=4)
    probe, energy = run.record(mpm.Probe("displacement", (0.5, 0.9))), run.record(mpm.Energy())
    message = (
        rf"^{run.name}, step (?P<step>\d), t = 0\.(25|5|75): Newton does not converge, relative "
        r"residuals "
        r"\d\.\de-\d\d, \d\.\de-\d\d; allowed 1\.0e-06; largest residual \d.* N at the node "
        r"x=\[.*\]$"
    )
    kept = []

    def go_on():
        while True:
            kept[:] = [a.copy() for a in state(run)]
            run.step()

    with pytest.raises(mpm.RunError, match=message) as error:
        go_on()
    steps = run.steps
    assert f"step {steps + 1}," in str(error.value)
    assert isinstance(error.value.__cause__, SolverError)
    assert 1 <= steps < 4  # the first step is elastic
    for before, after in zip(kept, state(run), strict=True):
        np.testing.assert_array_equal(after, before)
    assert len(probe.times) == len(energy.times) == steps + 1
    assert np.isfinite(probe.values).all()
    assert energy["work"][-1] > 0.0


def state(run):
    """What makes up the state of a run."""
    if run.bodies:
        return [
            getattr(run.bodies[0], name) for name in ("x", "half", "volume", "stress", "history")
        ]
    return [run.displacement.x.array, run.gauss_stress(), run.gauss_history()]


# -- cuts ------------------------------------------------------------------------------------------


def shaken(kind, dt, newton):
    """A dynamic scene with every kind of term."""
    grid = dense.uneven(2)
    terms = [
        mpm.Fixed(grid.facets("bottom")),
        mpm.Gravity(lambda t: (0.0, -300 * t)),
        mpm.Traction(
            grid.facets("top"), lambda t, x: t * 1e6 * np.array([1.0, -1.0]) * (1 + x[:, :1])
        ),
        mpm.ViscoelasticBoundary(grid.facets("right"), LAW, 2.0),
    ]
    return plastic.run_of(kind, grid, mpm.Newmark(dt), terms, solver=replace(DIRECT, newton=newton))


class Impatient(mpm.Newton):
    """Gives up whole steps."""

    def iterate(self, equilibrium, internal, first):
        """Newton, but not over more than 6 ms."""
        dt, yields = inside.under_way(equilibrium)
        if dt > 6e-3 and yields:
            raise SolverError("too long")
        super().iterate(equilibrium, internal, first)


@pytest.mark.parametrize("kind", [None, mpm.MPM, mpm.DM_GC], ids=["FE", "MPM", "DM-GC"])
def test_a_step_that_is_cut_is_two_half_steps(kind):
    whole, halves = shaken(kind, 1e-2, Impatient(tolerance=1e-11)), shaken(kind, 5e-3, STIFFLY)
    found = []
    for run, steps in ((whole, 3), (halves, 6)):
        recorders = [run.record(r) for r in (mpm.Energy(), mpm.Probe("displacement", (0.5, 0.9)))]
        for _ in range(steps):
            run.step()
        found.append((run, *recorders))
    assert whole.time == pytest.approx(halves.time)
    for a, b in zip(state(whole), state(halves), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())
    assert state(whole)[-1].max() > 1e-3
    (_, energy, probe), (_, energies, probes) = found
    np.testing.assert_allclose(probe.values, probes.values[::2], rtol=1e-9)
    assert len(energy.times) == 4
    for name in mpm.Energy.USUAL:
        np.testing.assert_allclose(energy[name], energies[name][::2], rtol=1e-9)
    assert energy["work"][-1] > 0.0
    assert energy["stored"][-1] > 0.0


def test_a_step_too_large_for_newton_is_cut_until_it_can_be_solved():
    """Three solves do not do for the whole step; they do for parts of it, and those end where small
    steps end."""
    found = []
    for steps, newton in (
        (1, mpm.Newton(tolerance=1e-4, iterations=3)),
        (8, mpm.Newton(tolerance=1e-4)),
    ):
        run = plastic.static(None, newton, steps=steps)
        run.until(1.0)
        found.append(run.displacement.x.array)
    with pytest.raises(mpm.RunError, match="Newton does not converge"):
        plastic.static(None, mpm.Newton(tolerance=1e-4, iterations=3, cuts=0)).step()
    np.testing.assert_allclose(found[0], found[1], atol=0.05 * np.abs(found[1]).max())


@pytest.mark.parametrize("cuts", [0, 1, 3])
def test_a_step_is_halved_no_more_often_than_allowed(cuts):
    class Never(mpm.Newton):
        def iterate(self, equilibrium, internal, first):
            """Fail, and note how long the step was."""
            lengths.append(inside.under_way(equilibrium)[0])
            raise SolverError("no")

    lengths = []
    run = shaken(None, 8e-3, Never(cuts=cuts))
    with pytest.raises(mpm.RunError, match=r"FE, step 1, t = 0\.008: no"):
        run.step()
    np.testing.assert_allclose(lengths, 8e-3 * 0.5 ** np.arange(cuts + 1))


def test_an_elastic_scene_is_never_cut():
    grid = dense.uneven(2)
    run = plastic.run_of(
        mpm.DM_GC,
        grid,
        mpm.QuasiStatic(1),
        plastic.loads(grid),
        law=dense.SOIL,
        solver=mpm.Solver(petsc={"ksp_type": "cg", "pc_type": "none", "ksp_max_it": 1}),
    )
    tries = []
    solve = run.solve
    run.solve = lambda: (tries.append(1), solve())
    with pytest.raises(mpm.RunError, match="PETSc reason"):
        run.step()
    assert len(tries) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tolerance": 0.0}, r"tolerance must be positive, got 0\.0"),
        ({"tolerance": float("nan")}, "tolerance must be finite, got nan"),
        ({"tolerance": "small"}, "tolerance must be a number, got 'small'"),
        ({"iterations": 0}, "iterations must be a whole number of at least 1, got 0"),
        ({"iterations": 2.5}, r"iterations must be a whole number of at least 1, got 2\.5"),
        ({"halvings": -1}, "halvings must be a whole number of at least 0, got -1"),
        ({"cuts": -2}, "cuts must be a whole number of at least 0, got -2"),
        ({"cuts": None}, "cuts must be a number, got None"),
    ],
)
def test_refusals(change, message):
    with pytest.raises(ValueError, match=message):
        mpm.Newton(**change)
