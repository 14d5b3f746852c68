"""Linear solvers: which is chosen, that all lead to the same numbers on any number of ranks, and
that PETSc's options reach them."""

import json
import warnings

import inside
import numpy as np
import pytest
import solving
from petsc4py import PETSc
from test_ranks import on_ranks

import mpm_fenicsx as mpm
from mpm_fenicsx.solver import solver_choice
from mpm_fenicsx.solver.solver_choice import System

SOIL = solving.SOIL
JACOBI_CASES = [
    f"{dim}D {what}"
    for dim in (2, 3)
    for what in ("DM-GC", "GIMP", "long steps", "light nodes", "unsymmetric")
]


@pytest.fixture(scope="module")
def serial() -> dict:
    return solving.everything()


@pytest.fixture(scope="module", params=[2, 3, 4])
def several(request, tmp_path_factory) -> dict:
    out = tmp_path_factory.mktemp("ranks") / "out.json"
    on_ranks(request.param, solving.__file__, out)
    return json.loads(out.read_text())


@pytest.mark.ranks
@pytest.mark.parametrize("case", JACOBI_CASES)
def test_jacobi_takes_as_many_iterations_on_any_number_of_ranks(several, serial, case):
    assert several[case]["kind"] == ["gmres" if "unsymmetric" in case else "cg", "jacobi"]
    few = np.subtract(several[case]["iterations"], serial[case]["iterations"])
    assert np.abs(few).max() <= 1
    assert several[case]["rescues"] == serial[case]["rescues"] == 0


@pytest.mark.ranks
@pytest.mark.parametrize("case", [*JACOBI_CASES, "2D stiff", "3D stiff"])
def test_points_carry_the_same_numbers(several, serial, case):
    dim = int(case[0])
    a, b = (np.array(found[case]["points"]) for found in (several, serial))
    for columns in (slice(0, dim), slice(dim, 2 * dim), slice(2 * dim, None)):
        size = np.abs(b[:, columns]).max()
        assert np.abs(a[:, columns] - b[:, columns]).max() < 1e-9 * size


@pytest.mark.ranks
@pytest.mark.parametrize("dim", [2, 3])
def test_what_a_run_says_of_its_solver_is_the_same_on_all_ranks(several, serial, dim):
    case = several[f"{dim}D as it comes"]
    (line,) = case["said"]
    assert line.startswith("solver: conjugate gradients, Jacobi (Courant number 1, ")
    assert serial[f"{dim}D as it comes"]["kind"] == ["cg", "icc"]
    (stiff,) = several[f"{dim}D stiff"]["said"]
    assert "algebraic multigrid (Courant number 50, " in stiff and "with ksp_rtol=1e-13" in stiff
    assert several[f"{dim}D stiff"]["kind"] == ["cg", "gamg"]
    assert max(several[f"{dim}D stiff"]["iterations"]) <= 30


# -- which is chosen -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("system", "name"),
    [
        (System(1, 3, True, 2_000), "full Cholesky factor of PETSc"),
        (System(2, 3, True, 2_000), "full Cholesky factor of MUMPS"),
        (System(1, 3, False, 9_000), "full LU factor of MUMPS"),
        (System(1, 3, True, 11_000), "conjugate gradients, algebraic multigrid"),
        (System(4, 2, False, 61_000), "GMRES, algebraic multigrid"),
        (System(4, 2, True, 61_000, hard=True), "full Cholesky factor of MUMPS"),
        (
            System(1, 3, True, 10**6, dynamic=True, courant=5.0),
            "conjugate gradients, incomplete Cholesky factor",
        ),
        (
            System(1, 3, True, 2_000, dynamic=True, courant=90.0),
            "conjugate gradients, incomplete Cholesky factor",
        ),
        (
            System(1, 3, True, 10**6, dynamic=True, courant=50.0),
            "conjugate gradients, algebraic multigrid",
        ),
        (System(8, 2, False, 10**6, dynamic=True, courant=5.0), "GMRES, Jacobi"),
        (
            System(8, 2, True, 10**6, dynamic=True, courant=20.0),
            "conjugate gradients, algebraic multigrid",
        ),
        (
            System(1, 2, True, 90_000, dynamic=True, courant=1.0, constant=True),
            "full Cholesky factor of MUMPS",
        ),
        (
            System(2, 3, True, 10**6, dynamic=True, courant=1.0, constant=True),
            "conjugate gradients, Jacobi",
        ),
    ],
)
def test_size_courant_number_and_ranks_decide(system, name):
    assert system.choice.name.startswith(name)
    assert f"{system.unknowns} unknowns" in system.choice.why


def test_another_step_may_want_another_solver(monkeypatch):
    monkeypatch.setitem(solver_choice.MANY, 2, 10)
    run = solving.block(2, 1.0)
    run.step()
    assert "incomplete Cholesky factor (Courant number 1, " in str(run)
    run.change_step(mpm.Newmark(50.0 * run.stepping.dt))
    run.step()
    assert "algebraic multigrid (Courant number 50, " in str(run)
    assert inside.linear_solver(run).getPC().getType() == "gamg"
    assert run.rescues == 0 and run.iterations < 30


# -- statics ---------------------------------------------------------------------------------------


@pytest.mark.ranks
@pytest.mark.parametrize("kind", solving.AT_REST)
@pytest.mark.parametrize("dim", [2, 3])
def test_multigrid_on_ranks_brings_bodies_to_the_rest_of_a_factor(several, serial, dim, kind):
    case = f"{dim}D {kind} at rest"
    if case not in several:
        pytest.skip("bodies come to rest on two ranks")
    assert several[case]["kind"] == ["cg", "gamg"] and several[case]["rescues"] == 0
    assert serial[case]["kind"] == ["preonly", "cholesky"]
    a, b = (np.array(found[case]["points"]) for found in (several, serial))
    assert np.abs(a - b)[:, 2 * dim :].max() < 1e-9 * np.abs(b[:, 2 * dim :]).max()


def choose(monkeypatch, which: str) -> str:
    """Make statics of any size take a solver; its type in PETSc."""
    few, many = {"petsc": (10**9, 10**9), "mumps": (0, 10**9), "multigrid": (0, 0)}[which]
    for dim in (2, 3):
        monkeypatch.setitem(solver_choice.FEW, dim, few)
        monkeypatch.setitem(solver_choice.MANY, dim, many)
    return "gamg" if which == "multigrid" else "cholesky"


@pytest.mark.parametrize(
    ("dim", "kind"),
    [(2, "DM-GC"), (2, "B-bar"), (2, "GhostPenalty"), (2, "FE"), (3, "DM-GC"), (3, "FE")],
)
def test_solvers_of_statics_agree_and_bring_bodies_to_rest(dim, kind, monkeypatch):
    found = {}
    for which in ("petsc", "mumps", "multigrid"):
        with monkeypatch.context() as patched:
            name = choose(patched, which)
            run = solving.resting(dim, kind)
            run.step()
            assert run.settle(1e-10) <= 1e-10
            assert inside.linear_solver(run).getPC().getType() == name
            assert run.rescues == 0
        body = run.nodal("displacement") if kind == "FE" else run.bodies[0].stress
        found[which] = body.copy(), run.balance()[0]
    for other in ("mumps", "multigrid"):
        for a, b in zip(found[other], found["petsc"], strict=True):
            assert np.abs(a - b).max() < 1e-9 * np.abs(b).max()


def test_where_multigrid_fails_a_factor_comes_to_the_rescue_and_stays(monkeypatch):
    choose(monkeypatch, "multigrid")
    run, exact = solving.resting(2, "DM-GC"), solving.resting(2, "DM-GC")
    inside.linear_solver(run).setTolerances(max_it=2)
    assert "algebraic multigrid" in str(run)
    run.step()
    assert run.rescues == 1
    run.step()
    assert run.rescues == 1 and "full Cholesky factor of MUMPS" in str(run)
    assert "multigrid has failed" in str(run)
    exact.step()
    exact.step()
    a, b = (one.bodies[0].stress for one in (run, exact))
    assert np.abs(a - b).max() < 1e-9 * np.abs(b).max()


# -- PETSc's options -------------------------------------------------------------------------------


@pytest.fixture
def table():
    """PETSc's table of options, cleared of what a test has put there under "soil_"."""
    store = PETSc.Options("soil_")
    yield store
    for key in store.getAll():
        store.delValue(key)


def test_options_by_prefix_are_on_top_of_those_by_hand_and_stay(table):
    table["ksp_rtol"], table["pc_type"], table["sub_pc_type"] = 1e-7, "asm", "icc"
    solver = mpm.Solver(petsc={"ksp_rtol": 1e-5, "ksp_max_it": 77}, prefix="soil_")
    bodies = [solving.block(2, 1.0), solving.block(2, 1.0)]
    runs = [
        mpm.Simulation(run.grid, run.bodies[0], run.stepping, run.terms, solver=one)
        for run, one in zip(bodies, (solver, None), strict=True)
    ]
    table["ksp_rtol"] = 1e-2  # too late for these runs
    for run in runs:
        run.step()
        run.step()
    ksp, other = (inside.linear_solver(run) for run in runs)
    assert ksp.getTolerances()[0] == 1e-7 and ksp.getTolerances()[3] == 77
    assert ksp.getOptionsPrefix().endswith("soil_")
    assert [pc.getPC().getType() for pc in ksp.getPC().getASMSubKSP()] == ["icc"]
    assert (other.getTolerances()[0], other.getPC().getType()) == (1e-11, "icc")
    assert "with ksp_rtol=1e-07, ksp_max_it=77, pc_type=asm, sub_pc_type=icc" in str(runs[0])
    assert sorted(table.getAll()) == ["ksp_rtol", "pc_type", "sub_pc_type"]


@pytest.mark.skipif(not hasattr(PETSc.Options(), "used"), reason="PETSc does not tell")
def test_options_that_nobody_asks_for_are_named():
    run = solving.block(2, 1.0, {"ksp_rtoll": 1e-8, "ksp_rtol": 1e-10})
    with pytest.warns(UserWarning, match="PETSc has not asked for ksp_rtoll: misspelt") as said:
        run.step()
        run.step()
    assert len(said) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solving.block(2, 1.0, {"pc_type": "asm", "sub_pc_type": "icc"}).step()


@pytest.mark.parametrize("prefix", [3, "-soil_", "soil", "so il_", "soil-", "_"])
def test_a_prefix_that_is_none_is_refused(prefix):
    with pytest.raises(ValueError, match=r"^prefix must be a text .* such as \"soil_\", got "):
        mpm.Solver(prefix=prefix)
