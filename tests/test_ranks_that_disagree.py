"""What one rank says otherwise than another, or raises alone, is refused on all."""

import re

import pytest
from test_checkpoint import SOFT, elements
from test_ranks import on_ranks

import mpm_fenicsx as mpm

SCENES = """
import sys
import numpy as np, mpm_fenicsx as mpm
soil = mpm.LinearElastic(young=2e6, poisson=0.25, density=1500.0)
grid = mpm.Grid.box((0.0, 0.0), (2.0, 1.0), (8, 4))
comm = grid.comm
fill = lambda: mpm.MaterialPoints.fill(grid, soil, 4, lambda x: x[1] < 0.5)


def heard(name, words, call):
    try:
        call()
    except (ValueError, mpm.RunError) as error:
        assert words in str(error), (name, str(error))
        print(name, flush=True)


def terms():
    body = fill()
    some = [mpm.Gravity((0.0, -9.81))] if comm.rank else []
    mpm.Simulation(grid, body, mpm.Newmark(1e-3), some)


def step():
    mpm.Simulation(grid, fill(), mpm.Newmark(1e-3 * (1 + comm.rank)))


def elements():
    some = [mpm.Fixed(grid.facets("bottom"))] * (2 - comm.rank)
    mpm.FiniteElements(grid, soil, mpm.Newmark(1e-3), some)


def unseeded():
    one = fill()
    x = np.concatenate(comm.allgather(one.x))
    half, volume = np.full(x.shape, 0.0625), np.full(len(x), 0.125**2)
    x += 1e-3 * np.random.default_rng(comm.rank).uniform(-1.0, 1.0, x.shape)
    mpm.Simulation(grid, mpm.MaterialPoints(soil, x, half, volume), mpm.Newmark(1e-3))


def moved():
    late = lambda t: 1.0 / 0.0 if t > 2.5e-3 and comm.rank == 0 else 0.0
    fixed = mpm.Fixed(grid.facets("bottom"), "y", value=late)
    mpm.Simulation(grid, fill(), mpm.Newmark(1e-3), [fixed]).until(5e-3)


heard("terms", "rank 0 makes a run with no terms, and rank 1 one with Gravity", terms)
heard("step", "rank 0 makes a run with Newmark(dt=0.001", step)
heard("elements", "rank 0 makes a run with Fixed, Fixed, and rank 1 one with Fixed", elements)
heard("unseeded", "body 0 fills the cell at x=", unseeded)
heard("moved", "value of Fixed raises ZeroDivisionError at t = 0.003", moved)
"""

ROWS = """
import sys
import numpy as np, mpm_fenicsx as mpm
soil = mpm.LinearElastic(young=2e6, poisson=0.25, density=1500.0)


def scene(pressure=1e3):
    grid = mpm.Grid.box((0.0, 0.0), (4.0, 1.0), (16, 4))
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: (x[0] < 1.5) & (x[1] < 0.5))
    body.velocity = np.tile((20.0, 0.0), (len(body), 1))
    top = body.surface("top")
    load = mpm.Traction(top, np.column_stack((0.0 * top.x[:, 0], -pressure * top.x[:, 0])))
    return mpm.Simulation(grid, body, mpm.Newmark(5e-3), [load])


run = scene()
keep = run.record(mpm.Checkpoint(sys.argv[1], every=10))
for _ in range(10):
    run.step()
run.recorders.remove(keep)
for _ in range(5):
    run.step()
again = scene()
again.restart(keep.path)
for _ in range(5):
    again.step()
same = all(np.array_equal(a, run.state()[name]) for name, a in again.state().items())
try:
    scene(2e3).restart(keep.path)
except ValueError as error:
    same = same and "Traction" in str(error)
else:
    same = False
print("same" if same else "other", flush=True)
"""

FUNCTIONS = """
import numpy as np
soil = mpm.LinearElastic(young=2e6, poisson=0.25, density=1500.0)
grid = mpm.Grid.box((0.0, 0.0), (2.0, 1.0), (8, 4))
bad = grid.comm.rank == 1
body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: x[1] < 0.5)
top = body.surface("top")


def one_of(wrong, right):
    return wrong if bad else right


def raising(answer):
    def function(*arguments):
        if bad:
            raise KeyError("mine")
        return answer(*arguments)

    return function


down = lambda t, x: np.tile((0.0, -1e3), (len(x), 1))
still, half = lambda t: 0.0, lambda x: x[1] < 0.5
WRONG = {
    "shape": (lambda t, x: np.zeros((len(x) + 1, 2)), "must give 2 finite numbers, got"),
    "nan": (lambda t, x: np.full((len(x), 2), np.nan), "must give 2 finite numbers, got"),
    "text": (lambda t, x: "abc", "must give 2 finite numbers, got 'abc' at t=0"),
    "raises": (raising(down), "which says at t=0: KeyError: 'mine'"),
    "no function": ("abc", "must give 2 finite numbers, got 'abc'"),
    "of time alone": (lambda t: (0.0, -1e3), "one of time and place on rank 0 and one of time"),
}
TERMS = {
    "value of Traction": lambda f: mpm.Traction(top, f),
    "value of DeadLoad": lambda f: mpm.DeadLoad(top, f),
    "g of Gravity": lambda f: mpm.Gravity(f),
    "value of Traction ": lambda f: mpm.Traction(grid.facets("bottom"), f),
}


def run(term):
    mpm.Simulation(grid, body, mpm.Newmark(1e-3), [term])


for name, term in TERMS.items():
    for wrong, words in WRONG.values():
        heard(name.strip(), words, lambda: run(term(one_of(wrong, down))))
rows = np.zeros((len(top), 2))
mixed, unknown = (mpm.Traction(top, one_of(load, rows)) for load in (down, rows + np.nan))
heard("of one kind", "an array of rows on rank 0 and", lambda: run(mixed))
heard("a load on surface points must be", "nan", lambda: run(unknown))
for value, words in ((lambda t: "abc", "got 'abc'"), (raising(still), "KeyError"), (None, "kind")):
    fixed = mpm.Fixed(grid.facets("bottom"), "y", value=one_of(value, still))
    heard("Fixed", words, lambda: run(fixed))
two = [
    mpm.Fixed(grid.facets("bottom"), "y", value=still),
    mpm.Fixed(grid.facets("left"), "y", value=one_of(lambda t: t, lambda t: 0.0 * t)),
]
heard("share the node", "Fixed", lambda: mpm.Simulation(grid, body, mpm.Newmark(1e-3), two))
for function, words in (
    (raising(half), " raises KeyError: 'mine'"),
    (lambda x: one_of(np.ones(1 + x.shape[1], bool), half(x)), " must map (dim, n) to (n,)"),
    (lambda x: one_of(np.full(x.shape[1], "a"), half(x)), " must say True or False"),
):
    heard("where" + words, "", lambda: body.surface("top", where=function))
    heard("inside" + words, "", lambda: mpm.MaterialPoints.fill(grid, soil, 4, function))
    box = lambda: mpm.Grid.box((0.0, 0.0), (2.0, 1.0), (8, 4), facets={"part": function})
    heard("facets: 'part'" + words, "", box)
    regions = [(soil, function), (soil, lambda x: ~half(x))]
    heard("where" + words, "", lambda: mpm.FiniteElements(grid, regions, mpm.Newmark(1e-3), []))
edge = lambda x: half(x) if one_of(np.allclose(x[1] % 0.25, 0.125), True) else 1 / 0
regions = [(soil, edge), (soil, lambda x: ~half(x))]
elements = lambda: mpm.FiniteElements(grid, regions, mpm.Newmark(1e-3), [])
heard("where raises ZeroDivisionError", "", elements)
column = mpm.MaterialPoints.fill
clay = mpm.VonMises(soil, peak=1e4, residual=1e4, softening=0.0)
for function, words in (
    (raising(lambda x: 1e4 + x[0]), " raises KeyError: 'mine'"),
    (lambda x: one_of("abc", 1e4 + x[0]), " must map (dim, n) to (n,), gave 'abc'"),
):
    given = {"peak": function}
    heard("parameters: peak" + words, "", lambda: column(grid, clay, 4, parameters=given))
print("done", flush=True)
"""

HEARD = """
from mpi4py import MPI
import mpm_fenicsx as mpm


def heard(name, words, call):
    error = None
    try:
        call()
    except ValueError as refusal:
        error = str(refusal)
    said = MPI.COMM_WORLD.allgather(error)
    assert error and name in error and words in error, (name, words, said)
    assert len(set(said)) == 1, said
"""

WARNED = """
import sys, warnings
import mpm_fenicsx as mpm
soil = mpm.LinearElastic(young=2e6, poisson=0.25, density=1500.0)
grid = mpm.Grid.box((0.0, 0.0), (2.0, 1.0), (8, 4))
body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: x[1] < 0.5)
solver = mpm.Solver(petsc={"ksp_rtoll": 1e-8})
terms = [mpm.Fixed(grid.facets("bottom")), mpm.Fixed(grid.facets("top"))]
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    run = mpm.Simulation(grid, body, mpm.Newmark(10.0), terms, solver=solver)
    run.step()
print("".join(f"{grid.comm.rank}: {str(w.message)[:40]}\\n" for w in said), flush=True)
"""


@pytest.mark.ranks
def test_a_load_or_a_function_of_place_that_fails_on_one_rank_fails_on_all():
    assert on_ranks(2, "-c", HEARD + FUNCTIONS).count("done") == 2


@pytest.mark.ranks
def test_what_all_ranks_find_is_warned_of_once():
    said = on_ranks(2, "-c", WARNED)
    assert said.count("0: with Newmark") == said.count("0: Fixed acts on the facets top") == 1
    assert not re.search("^1: ", said, re.MULTILINE), said


@pytest.mark.ranks
def test_other_scenes_and_what_one_rank_raises_are_refused_on_all():
    said = on_ranks(2, "-c", SCENES)
    for name in ("terms", "step", "elements", "unseeded", "moved"):
        assert said.count(name) == 2, name


@pytest.mark.ranks
def test_loads_row_by_row_of_each_rank_go_on_and_are_compared(tmp_path):
    assert on_ranks(2, "-c", ROWS, tmp_path / "state.npz").count("same") == 2


@pytest.mark.ranks
def test_files_of_ranks_that_are_damaged_or_mixed_up_are_named(tmp_path):
    path = tmp_path / "state.npz"
    on_ranks(2, "-c", ROWS, path)
    first, second = sorted(tmp_path.glob("state.npz.*"))
    run = elements(SOFT)
    whole = first.read_bytes()
    first.write_bytes(second.read_bytes())
    with pytest.raises(OSError, match=rf"{re.escape(first.name)} is the file of another rank"):
        run.restart(path)
    first.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(OSError, match=rf"{re.escape(first.name)} is damaged"):
        run.restart(path)


def test_a_motion_that_raises_names_itself_step_and_time():
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (2, 2))
    moved = mpm.Fixed(grid.facets("bottom"), "y", value=lambda t: 1.0 / (t < 1.5e-3))
    run = mpm.FiniteElements(grid, SOFT, mpm.Newmark(1e-3), [moved])
    with pytest.raises(mpm.RunError, match=r"step 1, t = 0\.001: value of Fixed raises Zero"):
        run.until(3e-3)
