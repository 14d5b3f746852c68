"""Scenes on a grid that is half empty: what is computed, and how much of the grid it takes, as
JSON: ``mpiexec -n 2 python following.py out``."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

from mpi4py import MPI

import inside
import migrating
import numpy as np

import mpm_fenicsx as mpm


def scene(
    stepping, terms: Callable = lambda grid, body: (), mapping=mpm.DM_GC, reuse: float = 0.0
) -> mpm.Simulation:
    """A block at one end of a grid, pressed from above, which moves over grid lines of both
    directions; of three ranks one holds nothing of it."""
    grid = mpm.Grid.box((0.0, 0.0), (8.0, 2.5), (16, 5))
    body = mpm.MaterialPoints.fill(
        grid, migrating.SOFT_SOIL, 4, lambda x: (np.abs(x[0] - 2.75) < 2.0) & (x[1] < 1.5)
    )
    if stepping.dynamic:
        body.velocity = np.tile((3.0, 1.0), (len(body), 1))
    top = body.surface("top")
    load = mpm.Traction(top, 1e3 * np.sin(3.0 * top.x))
    rows = {"pc_type": "asm", "pc_asm_type": "basic", "sub_pc_type": "icc"}  # not blocks
    petsc = {**migrating.EXACT.petsc, **rows}
    solver = mpm.Solver(newton=migrating.EXACT.newton, petsc=petsc, reuse=reuse)
    if not stepping.dynamic:
        solver = mpm.Solver(newton=migrating.EXACT.newton)
    return mpm.Simulation(grid, body, stepping, [load, *terms(grid, body)], mapping, solver)


def went(run, steps: int) -> dict:
    """So many steps of a run: its points, and what each step went over."""
    watched, taken = migrating.Watched(run, run.terms[0].on), []
    for _ in range(steps):
        run.step()
        taken += inside.gone_over(run)
    found = {**watched.points(), **watched.faces()}
    return {**migrating.together(run.grid.comm, found), "gone over": {"": taken}}


def again(make: Callable[[], mpm.Simulation], steps: int) -> dict:
    """From how many of its states a run goes on bit for bit."""
    run, states, same = make(), [], []
    for _ in range(steps):
        run.step()
        states.append({name: value.copy() for name, value in run.state().items()})
    for k, (before, after) in enumerate(pairwise(states)):
        other = make()
        other.restore(before)
        other.resume(k + 1)
        other.step()
        here = all(np.array_equal(value, after[name]) for name, value in other.state().items())
        same.append(float(run.grid.comm.allreduce(int(here), op=MPI.MIN)))
    return {"the same": {"": same}}


def turning() -> mpm.Simulation:
    """A block that turns and flies, so that facets between cells come and go."""
    grid = mpm.Grid.box((0.0, 0.0), (6.0, 4.0), (12, 8))
    body = mpm.MaterialPoints.fill(
        grid, migrating.SOFT_SOIL, 4, lambda x: (np.abs(x[0] - 2) < 0.9) & (np.abs(x[1] - 2) < 0.7)
    )
    body.velocity = np.array((5.0, 1.0)) + (body.x - (2.0, 1.7)) @ ((0.0, 1.0), (-1.0, 0.0))
    surface = mpm.ViscousBoundary(body.surface("bottom"), migrating.SOFT_SOIL)
    return mpm.Simulation(grid, body, mpm.Newmark(2e-2), [mpm.GhostPenalty(), surface])


def held(grid, body) -> tuple:
    """Supports, for statics."""
    return (mpm.Fixed(grid.facets("bottom")),)


AGAIN = 12
"""Steps from all of which a run goes on."""
DYNAMIC = mpm.Newmark(2e-2)
CASES = {
    "DM-GC": lambda: went(scene(DYNAMIC), 8),
    "GIMP": lambda: went(scene(DYNAMIC, mapping=mpm.GIMP), 8),
    "GhostPenalty": lambda: went(scene(DYNAMIC, lambda *_: (mpm.GhostPenalty(),)), 8),
    "statics": lambda: went(scene(mpm.QuasiStatic(3), held), 3),
    "reuse": lambda: went(scene(mpm.Newmark(2e-3), reuse=3e-2), 20),
    "restart": lambda: again(turning, AGAIN),
}


def everything(comm: MPI.Comm = MPI.COMM_WORLD) -> dict:
    """All cases."""
    return {name: case() for name, case in CASES.items()}


if __name__ == "__main__":
    cases = everything()
    if MPI.COMM_WORLD.rank == 0:
        Path(sys.argv[1]).write_text(json.dumps(cases))
