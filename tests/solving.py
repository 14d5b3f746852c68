"""Scenes for the linear solvers on one rank or several, as JSON: ``mpiexec -n 2 python solving.py
out``."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace

from mpi4py import MPI

import inside
import numpy as np

import mpm_fenicsx as mpm
from mpm_fenicsx.points.location import numbers_of
from mpm_fenicsx.solver import solver_choice

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
ROCK = mpm.LinearElastic(young=2e11, poisson=0.25, density=1500.0)
JACOBI = {"pc_type": "jacobi"}
EXACT = {"ksp_rtol": 1e-13}
AT_REST = ("DM-GC", "B-bar")
CUT = replace(mpm.DM_GC, hold_cut_cells=False)


@dataclass(frozen=True)
class Coriolis:
    """Inertia in a frame that turns by ``rate`` (1/s), whose matrix is not symmetric."""

    rate: float

    def bind(self, scene) -> mpm.Contribution:
        v, w = scene.motion.velocity, scene.motion.w
        work = 2.0 * scene.density * self.rate * (v[1] * w[0] - v[0] * w[1]) * scene.dx
        return mpm.Contribution(work, symmetric=False)


def down(dim: int, value: float) -> tuple[float, ...]:
    return (0.1 * value, value) + (0.0,) * (dim - 2)


def block(dim: int, courant: float, options=None, mapping=mpm.DM_GC, more=(), cut: float = 0.0):
    """A block under its weight, cut by a part of a cell, at a Courant number."""
    cells = (8, 6) if dim == 2 else (5, 4, 4)
    grid = mpm.Grid.box((0.0,) * dim, tuple(0.5 * n for n in cells), cells)
    body = mpm.MaterialPoints.fill(grid, SOIL, 2**dim, lambda x: x[0] < 0.5 * (cells[0] - 2))
    body.x[:, 0] += 0.5 * cut
    terms = [
        mpm.Gravity(down(dim, -9.81)),
        mpm.Fixed(grid.facets("bottom")),
        mpm.ViscousBoundary(grid.facets("left"), SOIL),
        *more,
    ]
    stepping = mpm.Newmark(courant * 0.5 / SOIL.p_speed)
    solver = mpm.Solver(petsc=options) if options else None
    return mpm.Simulation(grid, body, stepping, terms, mapping, solver)


def resting(dim: int, kind: str):
    """A block that sags under its weight, its top and side inside cells; finite elements on its
    grid."""
    n = 12 if dim == 2 else 5
    poisson = 0.49 if kind == "B-bar" else 0.25
    law = mpm.LinearElastic(young=20e6, poisson=poisson, density=1500.0)
    grid = mpm.Grid.box((0.0,) * dim, (1.0,) * dim, (n,) * dim)
    weight = mpm.Gravity((0.0, -9.81) + (0.0,) * (dim - 2))
    terms = [mpm.Fixed(grid.facets("bottom")), mpm.Fixed(grid.facets("left"), "x"), weight]
    if kind == "FE":
        return mpm.FiniteElements(grid, law, mpm.QuasiStatic(1), terms)
    body = mpm.MaterialPoints.fill(grid, law, 2**dim, lambda x: (x[:2] < 0.7).all(axis=0))
    mapping = replace(mpm.DM_GC, b_bar=kind == "B-bar")
    if kind == "GhostPenalty":
        terms.append(mpm.GhostPenalty())
    return mpm.Simulation(grid, body, mpm.QuasiStatic(1), terms, mapping)


def stepped(run, steps: int = 3, settle: bool = False) -> dict:
    """Iterations of each step, and what points carry in the order of their numbers."""
    body, grid = run.bodies[0], run.grid
    number = numbers_of(grid, body.x, grid.find(body.x)) if body.number is None else body.number
    iterations = []
    if settle:
        run.settle(1e-11)
    for _ in range(steps):
        run.step()
        iterations.append(run.iterations)
    number = number if body.number is None else body.number
    velocity = np.zeros_like(body.x) if body.velocity is None else body.velocity
    rows = np.hstack((body.x, velocity, 1e-6 * body.stress))
    pairs = zip(map(str, number), rows, strict=True)
    parts = grid.comm.allgather([(n, row.tolist()) for n, row in pairs])
    found = dict(sorted(pair for part in parts for pair in part))
    solver = inside.linear_solver(run)
    said = [line for line in str(run).splitlines() if line.startswith("solver: ")]
    return {
        "iterations": iterations,
        "points": list(found.values()),
        "kind": [solver.getType(), solver.getPC().getType()],
        "rescues": run.rescues,
        "said": sorted({line for part in grid.comm.allgather(said) for line in part}),
    }


def everything(comm: MPI.Comm = MPI.COMM_WORLD) -> dict:
    """Cases by name; on one rank with Jacobi's preconditioner, which several ranks choose."""
    jacobi = {**JACOBI, "ksp_max_it": 600} if comm.size == 1 else {}
    gmres = {**EXACT, **jacobi}
    found = {}
    if comm.size > 1:
        solver_choice.MANY.update({2: 0, 3: 0})
    for dim in (2, 3):
        for name, mapping in (("DM-GC", mpm.DM_GC), ("GIMP", mpm.GIMP)):
            found[f"{dim}D {name}"] = stepped(block(dim, 1.0, {**EXACT, **jacobi}, mapping))
        found[f"{dim}D long steps"] = stepped(block(dim, 10.0, {**EXACT, **jacobi}))
        found[f"{dim}D light nodes"] = stepped(block(dim, 1.0, {**EXACT, **jacobi}, CUT, cut=1e-4))
        found[f"{dim}D unsymmetric"] = stepped(block(dim, 1.0, gmres, more=[Coriolis(100.0)]))
        multigrid = {"pc_type": "gamg"} if comm.size == 1 else {}
        found[f"{dim}D stiff"] = stepped(block(dim, 50.0, {**EXACT, **multigrid}))
        for kind in AT_REST if comm.size <= 2 else ():  # slow where cores are fewer
            found[f"{dim}D {kind} at rest"] = stepped(resting(dim, kind), 1, settle=True)
        found[f"{dim}D as it comes"] = stepped(block(dim, 1.0))
    return found


if __name__ == "__main__":
    everything_found = everything()
    if MPI.COMM_WORLD.rank == 0:
        with open(sys.argv[1], "w") as file:
            json.dump(everything_found, file)
