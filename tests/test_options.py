"""Options as releases before had them: each works, says what to write now, and is the same run."""

import re
from dataclasses import replace

import dense
import numpy as np
import plastic
import pytest

import mpm_fenicsx
import mpm_fenicsx as mpm
from mpm_fenicsx.mapping.projection import DOUBLE_MAPPED

LUMPED, OFF = mpm.AccelerationCorrection.LUMPED, mpm.AccelerationCorrection.OFF
NEWTON, FACTOR = mpm.Newton(tolerance=1e-3, cuts=1), {"ksp_type": "preonly", "pc_type": "lu"}


def points(law=dense.SOIL, mapping=mpm.DM_GC, solver=None, **old):
    """Points that move at random under gravity and pressure."""
    grid = dense.uneven(2)
    body = mpm.MaterialPoints.fill(grid, law, 4, jitter=0.2)
    body.velocity = np.random.default_rng(1).normal(size=body.x.shape)
    terms = plastic.loads(grid, 10.0)
    return mpm.Simulation(grid, body, mpm.Newmark(1e-3), terms, mapping, solver, **old)


def elements(law=dense.SOIL, solver=None, **old):
    """Finite elements under the same loads, and more of them."""
    grid = dense.uneven(2)
    return mpm.FiniteElements(
        grid, law, mpm.Newmark(1e-3), plastic.loads(grid, 1e4), solver=solver, **old
    )


def says(now):
    return pytest.warns(DeprecationWarning, match=re.escape(f" is now {now}"))


def told(heard) -> int:
    """How many of the warnings say what is now another way: compilers have theirs."""
    return sum(" is now " in str(warning.message) for warning in heard)


def same(*runs):
    """Three steps of both are alike to the last bit."""
    for run in runs:
        for _ in range(3):
            run.step()
    one, other = (run.state() for run in runs)
    assert one.keys() == other.keys()
    for name, value in one.items():
        np.testing.assert_array_equal(value, other[name], err_msg=name)


# -- arguments -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "now", "mapping"),
    [
        ({"sweeps": 2}, "replace(mapping, sweeps=...)", replace(mpm.DM_GC, sweeps=2)),
        (
            {"transfer": mpm.flip},
            "replace(mapping, transfer=...)",
            replace(mpm.DM_GC, transfer=mpm.flip),
        ),
        (
            {"correction": OFF},
            "replace(mapping, correction=...)",
            replace(mpm.DM_GC, correction=OFF),
        ),
        ({"b_bar": True}, "replace(mapping, b_bar=...)", replace(mpm.DM_GC, b_bar=True)),
        (
            {"hold_cut_cells": False},
            "replace(mapping, hold_cut_cells=...)",
            replace(mpm.DM_GC, hold_cut_cells=False),
        ),
        ({"balanced": True}, "replace(mapping, correction=", replace(mpm.DM_GC, correction=LUMPED)),
        ({"balanced": False}, "replace(mapping, correction=", replace(mpm.DM_GC, correction=OFF)),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_is_of_the_mapping_now(old, now, mapping):
    with says(f"mapping={now}") as heard:
        before = points(**old)
    assert told(heard) == 1
    assert before.mapping == mapping != mpm.DM_GC and before.solver == mpm.Solver()
    same(before, points(mapping=mapping))


@pytest.mark.parametrize(
    ("old", "now", "solver"),
    [
        ({"newton": NEWTON}, "Solver(newton=...)", mpm.Solver(newton=NEWTON)),
        ({"newton": None}, "Solver(newton=...)", mpm.Solver()),
        ({"solver": FACTOR}, "Solver(petsc={...})", mpm.Solver(petsc=FACTOR)),
    ],
    ids=["newton", "no newton", "solver"],
)
@pytest.mark.parametrize("kind", [points, elements])
def test_what_is_of_the_solver_now(kind, old, now, solver):
    with says(f"solver={now}") as heard:
        before = kind(plastic.LAW, **old)
    assert told(heard) == 1
    assert before.solver == solver
    same(before, kind(plastic.LAW, solver=solver))
    assert before.solves > 3  # it yields


def test_reuse_is_of_the_solver_now():
    with says("solver=Solver(reuse=...)"):
        before = points(reuse=1e-2)
    now = points(solver=mpm.Solver(reuse=1e-2))
    assert (before.mapping, before.solver) == (now.mapping, now.solver)
    same(before, now)


def test_old_arguments_go_with_each_other_and_with_objects():
    mapping, solver = replace(mpm.GIMP, sweeps=3), mpm.Solver(petsc=FACTOR)
    with pytest.warns(DeprecationWarning) as heard:
        run = points(plastic.LAW, mapping, solver, transfer=mpm.flip, correction=OFF, newton=NEWTON)
    assert told(heard) == 3
    assert run.mapping == replace(mpm.GIMP, sweeps=3, transfer=mpm.flip, correction=OFF)
    assert run.solver == mpm.Solver(newton=NEWTON, petsc=FACTOR)


@pytest.mark.parametrize(
    ("old", "words"),
    [
        ({"sweeps": -1}, "^sweeps must be a whole number of at least 0, got -1$"),
        ({"balanced": "yes"}, "^balanced must be True or False, got 'yes'$"),
        ({"newton": 1e-6}, r"^newton must be Newton\(tolerance\), got 1e-06$"),
        ({"solver": {"-ksp_type": "cg"}}, "^petsc: names of PETSc options are texts .*'-ksp_type'"),
    ],
)
def test_old_arguments_are_refused_as_new_ones_are(old, words):
    with pytest.warns(DeprecationWarning), pytest.raises(ValueError, match=words):
        points(**old)


def test_an_argument_that_there_never_was_is_named():
    with pytest.raises(TypeError, match=r"^Simulation takes no argument sweep; see help\("):
        points(sweep=2)
    with pytest.raises(TypeError, match=r"^FiniteElements takes no argument sweeps, transfer; see"):
        elements(sweeps=2, transfer=mpm.flip)


# -- names -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Viscous", "Viscoelastic"])
def test_the_old_name_of_a_boundary_is_its_new_one(name):
    with pytest.warns(DeprecationWarning, match=rf"^mpm_fenicsx\.{name} is now {name}Boundary$"):
        found = getattr(mpm_fenicsx, name)
    assert found is getattr(mpm_fenicsx, f"{name}Boundary")
    assert name not in mpm_fenicsx.__all__


def test_the_warning_of_an_old_name_is_of_the_line_that_has_it():
    with pytest.warns(DeprecationWarning) as heard:
        from mpm_fenicsx import Viscous  # noqa: F401
    assert heard[0].filename == __file__


def test_a_name_that_there_never_was_is_none():
    with pytest.raises(AttributeError, match="module 'mpm_fenicsx' has no attribute 'Viscose'"):
        _ = mpm_fenicsx.Viscose


# -- the paper -------------------------------------------------------------------------------------


def test_the_papers_step_is_a_mapping_and_a_start():
    paper = replace(mpm.DM_GC, mass=DOUBLE_MAPPED, b_bar=False)
    mapping = replace(paper, sweeps=0, correction=OFF, hold_cut_cells=False)
    start = {"initial_acceleration": mpm.InitialAcceleration.ZERO}
    assert mpm.PAPER == {"mapping": mapping, **start}
    with pytest.warns(DeprecationWarning):
        before = points(mapping=paper, sweeps=0, correction=OFF, hold_cut_cells=False, **start)
    same(before, points(**mpm.PAPER))


@pytest.mark.parametrize(
    "call",
    [
        "Simulation(grid, body, step, [], sweeps=2)",
        "Simulation(grid, body, step, [], balanced=True)",
        "Simulation(grid, body, step, [], newton=None)",
        "Simulation(grid, body, step, [], solver={})",
        "FiniteElements(grid, body, step, [], newton=None)",
        "FiniteElements(grid, body, step, [], solver={})",
    ],
)
def test_the_warning_is_of_the_line_that_has_the_old_argument(call):
    """Of any other line Python shows a script no DeprecationWarning."""
    names = {"grid": dense.uneven(2), "step": mpm.Newmark(1e-3)}
    names["body"] = mpm.MaterialPoints.fill(names["grid"], dense.SOIL, 4)
    with pytest.warns(DeprecationWarning) as heard:
        exec(compile(call, "script", "exec"), {**vars(mpm_fenicsx), **names})
    assert heard[0].filename == "script"


def test_points_by_their_old_name_are_bodies():
    grid = dense.uneven(2)
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
    with pytest.warns(DeprecationWarning, match="points of Simulation is now bodies"):
        run = mpm.Simulation(grid, stepping=mpm.Newmark(1e-3), terms=[], points=body)
    assert run.bodies == [body]
    with pytest.raises(ValueError, match="bodies must be MaterialPoints"):
        mpm.Simulation(grid)


def test_a_mapping_prints_on_one_line():
    text = repr(mpm.DM_GC)
    assert "\n" not in text and "integrate=Gauss points" in text and "mass=points" in text
