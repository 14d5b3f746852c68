"""Discs and balls cut at their edge, with level sets, circles and lines, as JSON by place:
``mpiexec -n 2 python surfaces_on_ranks.py out``."""

from __future__ import annotations

import json
import sys

from mpi4py import MPI

import numpy as np
import slopes

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
EXACT = mpm.Solver(petsc={"ksp_rtol": 1e-13, "ksp_max_it": 2000})


def gathered(places: np.ndarray, rows: np.ndarray) -> dict:
    """Rows of all ranks by their places at the start."""
    here = {
        ",".join(f"{round(v, 7) + 0.0:.7f}" for v in x): row.tolist()
        for x, row in zip(places, rows, strict=True)
    }
    parts = MPI.COMM_WORLD.allgather(here)
    assert sum(map(len, parts)) == len({k for part in parts for k in part})  # each on one rank
    return {k: row for part in parts for k, row in part.items()}


def moving(dim: int, shape: str) -> dict:
    """A ball that flies over two cells and is pressed on, with dashpots on it."""
    h = 0.5 if dim == 3 else 0.25
    made = slopes.Ball(dim, h, SOIL)
    on = made.edge() if shape == "level set" else mpm.SurfacePoints.circle(made.centre, 1.0, h / 2)
    faces = gathered(on.x, np.column_stack((on.normal, on.area))) if shape == "level set" else None
    made.body.velocity = np.tile(np.array([2.0, 1.0, 0.5])[:dim], (len(made.body), 1))
    terms = [mpm.Pressure(on, lambda t, x: 1e3 * (2 + x[:, 0])), mpm.ViscousBoundary(on, SOIL)]
    run = mpm.Simulation(made.grid, made.body, mpm.Newmark(h / 8), terms, solver=EXACT)
    for _ in range(4 if dim == 2 else 2):
        run.step()
    body = made.body
    found = {f"{dim}D {shape}": gathered(body.x, np.hstack((body.velocity, body.stress / 1e6)))}
    found[f"{dim}D {shape}, surface"] = gathered(on.x, np.column_stack((on.normal, on.area)))
    if faces is not None:
        found[f"{dim}D {shape}, faces"] = faces
    return found


def lacking(dim: int) -> dict:
    """One cell, of which other ranks have nothing, cut aslant."""
    grid = mpm.Grid.box((0.0,) * dim, (1.0,) * dim, (1,) * dim)
    body = mpm.MaterialPoints.fill(grid, SOIL, 2**dim, lambda x: level(x) < 0, cut=True)
    on = mpm.SurfacePoints.level_set(grid, level)
    terms = [mpm.Fixed(grid.facets("left"), "x"), mpm.Pressure(on, 1e3)]
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), terms, solver=EXACT)
    run.step()
    return {f"{dim}D, one cell": gathered(body.x, np.hstack((body.velocity, body.stress / 1e6)))}


def level(x: np.ndarray) -> np.ndarray:
    """Zero on a slanted line or plane."""
    return x[0] + 0.3 * x[1] - 0.7


def everything() -> dict:
    """All scenes."""
    flying = {**moving(2, "level set"), **moving(2, "circle"), **moving(3, "level set")}
    return {**flying, **lacking(2), **lacking(3)}


if __name__ == "__main__":
    result = everything()
    if MPI.COMM_WORLD.rank == 0:
        with open(sys.argv[1], "w") as file:
            json.dump(result, file)
