"""A grid that is divided anew in mid-run computes what one rank computes, and goes on bit for bit.

As a script: ``mpiexec -n N python test_repartitioning.py out``.
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from pages import HOME, blocks
from test_ranks import on_ranks
from test_restart_on_ranks import CLAY, EXACT, SOFT, STRETCHED

import mpm_fenicsx as mpm
from mpm_fenicsx.points.location import numbers_of
from mpm_fenicsx.runs.repartitioning import imbalance, work

STEPS, HALF = 24, 14
LAWS = {"elastic": SOFT, "von Mises": CLAY, "finite von Mises": STRETCHED}
ANEW = mpm.Repartition(above=1.2, every=5)
TOLERANCE = 1e-9


def scene(law):
    """A block in a corner of a wide grid, that slides."""
    grid = mpm.Grid.box((0.0, 0.0), (6.0, 2.0), (24, 8))
    body = mpm.MaterialPoints.fill(
        grid, law, 4, lambda x: (x[0] > 0.5) & (x[0] < 2.0) & (x[1] < 1.0), jitter=0.2
    )
    body.velocity = np.tile((12.0, 0.0), (len(body), 1))
    terms = [
        mpm.Fixed(grid.facets("bottom"), "y"),
        mpm.Gravity((0.0, -9.81)),
        mpm.ViscousBoundary(body.surface("left"), SOFT),
        mpm.ViscoelasticBoundary(body.surface("top"), SOFT, 3.0),
    ]
    run = mpm.Simulation(grid, body, mpm.Newmark(5e-3), terms, solver=EXACT, repartition=ANEW)
    run.record(mpm.Probe("velocity", (1.2, 0.6)))
    run.record(mpm.Probe("displacement", (1.2, 0.6)))
    run.record(mpm.Energy())
    return run


def found(law, folder) -> dict:
    """Fields by the points' numbers and what was recorded, and whether a restart is bit for bit."""
    run = scene(law)
    body = run.bodies[0]
    number = body.number
    if number is None:  # on one rank, where rows stay
        number = numbers_of(run.grid, body.x, run.grid.find(body.x))
    first = imbalance(run.grid.comm, work(run, ANEW.cell))
    keep = run.record(mpm.Checkpoint(folder / "state.npz", every=HALF))
    for _ in range(STEPS):
        run.step()
        if run.steps == HALF:
            run.recorders.remove(keep)
    again, comm = scene(law), run.grid.comm
    again.restart(keep.path)
    while again.steps < STEPS:
        again.step()
    here = all(np.array_equal(a, run.state()[name]) for name, a in again.state().items()) and all(
        np.array_equal(a.values, b.values)
        for a, b in zip(again.recorders, run.recorders, strict=True)
    )
    rows = comm.allgather(
        (
            number if body.number is None else body.number,
            body.x,
            body.velocity,
            body.acceleration,
            body.stress,
        )
    )
    number, *fields = (np.concatenate(of_ranks) for of_ranks in zip(*rows, strict=True))
    order = np.argsort(number)
    return {
        "fields": [values[order].tolist() for values in fields],
        "series": [recorder.values.tolist() for recorder in run.recorders],
        "bit for bit": bool(comm.allreduce(int(here)) == comm.size),
        "imbalance": [first, imbalance(comm, work(run, ANEW.cell))],
        "divisions": int(run.state()["repartition"][1]),
    }


def everything(comm) -> dict:
    """All laws."""
    folder = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None)
    return {name: found(law, Path(folder)) for name, law in LAWS.items()}


@pytest.fixture(scope="module")
def serial():
    from mpi4py import MPI

    return everything(MPI.COMM_SELF)


@pytest.fixture(scope="module")
def divided(tmp_path_factory):
    out = tmp_path_factory.mktemp("anew") / "out.json"
    on_ranks(2, __file__, out)
    return json.loads(out.read_text())


@pytest.mark.ranks
@pytest.mark.parametrize("law", LAWS)
def test_a_grid_divided_anew_computes_the_same(law, serial, divided):
    assert serial[law]["divisions"] == 0 and divided[law]["divisions"] > 0
    for kind in ("fields", "series"):
        for a, b in zip(divided[law][kind], serial[law][kind], strict=True):
            assert np.abs(np.subtract(a, b)).max() <= TOLERANCE * np.abs(b).max()


@pytest.mark.ranks
@pytest.mark.parametrize("law", LAWS)
def test_work_is_even_then(law, divided):
    before, after = divided[law]["imbalance"]
    assert before > 1.5 and after < ANEW.above


@pytest.mark.ranks
@pytest.mark.parametrize("law", LAWS)
def test_it_goes_on_bit_for_bit_from_a_checkpoint(law, divided):
    assert divided[law]["bit for bit"]


@pytest.mark.parametrize(
    "given, words",
    [
        ({"above": 1.0}, "above must be more than 1, which is balance, got 1.0"),
        ({"every": 0}, "every must be a whole number of at least 1, got 0"),
        ({"every": True}, "every must be a whole number of at least 1, got True"),
        ({"cell": -1.0}, "cell must be at least 0 points' worth, got -1.0"),
    ],
)
def test_what_is_none_is_refused(given, words):
    with pytest.raises(ValueError, match=words):
        mpm.Repartition(**given)


def test_a_field_on_the_mesh_is_refused():
    from dolfinx import fem

    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (2, 2))
    body = mpm.MaterialPoints.fill(grid, SOFT, 4, lambda x: x[1] < 2.0)
    load = mpm.Traction(grid.facets("top"), fem.Function(grid.space))
    with pytest.raises(
        ValueError, match=r"repartition: the load on the facets .* is a field on the"
    ):
        mpm.Simulation(grid, body, mpm.Newmark(1e-3), [load], repartition=ANEW)


SWITCHED = """
import sys
import numpy as np, mpm_fenicsx as mpm
soil = mpm.LinearElastic(young=2e6, poisson=0.25, density=1500.0)


def scene(repartition):
    grid = mpm.Grid.box((0.0, 0.0), (4.0, 1.0), (16, 4))
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: (x[0] < 1.5) & (x[1] < 0.5))
    body.velocity = np.tile((20.0, 0.0), (len(body), 1))
    solver = mpm.Solver(petsc={"ksp_rtol": 1e-13})
    run = mpm.Simulation(
        grid, body, mpm.Newmark(5e-3), [mpm.Gravity((0.0, -9.81))], mpm.DM_GC, solver,
        repartition=repartition,
    )
    run.record(mpm.Probe("velocity", (0.6, 0.3)))
    return run


often = mpm.Repartition(above=1.05, every=2)
for before, after in ((None, often), (often, None)):
    run = scene(before)
    keep = run.record(mpm.Checkpoint(sys.argv[1], every=8))
    for _ in range(8):
        run.step()
    run.recorders.remove(keep)
    again = scene(after)
    again.restart(keep.path)
    for _ in range(8):
        run.step()
        again.step()
    a, b = (one.recorders[0].values for one in (run, again))
    assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()
    print("goes on", flush=True)
"""


@pytest.mark.ranks
def test_it_can_be_switched_on_and_off_at_a_restart(tmp_path):
    assert on_ranks(2, "-c", SWITCHED, tmp_path / "state.npz").count("goes on") == 4


GATHERED = """
import sys
import numpy as np, mpm_fenicsx as mpm
soil = mpm.LinearElastic(young=2e6, poisson=0.25, density=1500.0)
grid = mpm.Grid.box((0.0, 0.0), (4.0, 1.0), (16, 4))
body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: (x[0] < 1.5) & (x[1] < 0.5))
body.velocity = np.tile((20.0, 0.0), (len(body), 1))
recipe, out = sys.argv[1:]
exec(recipe)
run = mpm.Simulation(
    grid,
    body,
    mpm.Newmark(5e-3),
    [load],
    solver=mpm.Solver(petsc={"ksp_rtol": 1e-13}),
    repartition=mpm.Repartition(above=1.05, every=2),
)
probe = run.record(mpm.Probe("velocity", (0.6, 0.3)))
for _ in range(16):
    run.step()
divisions = run.state()["repartition"][1]
if grid.comm.rank == 0:
    np.savez(out, velocity=probe.values, divisions=divisions)
"""


@pytest.mark.ranks
def test_loads_row_by_row_go_on_where_the_surface_is_gathered(tmp_path):
    """The recipe of docs/how_to/several_ranks.md."""
    page = (HOME / "docs" / "how_to" / "several_ranks.md").read_text()
    (recipe,) = (block.source for block in blocks(page) if "allgather" in block.source)
    found = []
    for ranks in (1, 2):
        out = tmp_path / f"{ranks}.npz"
        on_ranks(ranks, "-c", GATHERED, recipe, out)
        found.append(np.load(out))
    one, two = found
    assert one["divisions"] == 0 and two["divisions"] > 0
    difference = np.abs(two["velocity"] - one["velocity"]).max()
    assert difference < TOLERANCE * np.abs(one["velocity"]).max()


OWN_ROWS = """
import numpy as np, mpm_fenicsx as mpm
soil = mpm.LinearElastic(young=2e6, poisson=0.25, density=1500.0)
grid = mpm.Grid.box((0.0, 0.0), (2.0, 1.0), (8, 4))
body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: x[1] < 0.5)
top = body.surface("top")
load = mpm.Traction(top, np.zeros_like(top.x))
try:
    mpm.Simulation(grid, body, mpm.Newmark(1e-3), [load], repartition=mpm.Repartition())
except ValueError as error:
    print("refused" if "give all rows on every rank" in str(error) else error)
run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], repartition=mpm.Repartition())
field = run.stress_field().function
run.divide(1.0 + np.arange(grid.owned_cells))
print("gone" if np.isnan(field.x.array).all() else "stays")
"""


@pytest.mark.ranks
def test_rows_of_a_rank_are_refused_and_fields_of_before_are_no_numbers():
    said = on_ranks(2, "-c", OWN_ROWS)
    assert said.count("refused") == said.count("gone") == 2


if __name__ == "__main__":
    from mpi4py import MPI

    result = everything(MPI.COMM_WORLD)
    if MPI.COMM_WORLD.rank == 0:
        Path(sys.argv[1]).write_text(json.dumps(result))
