"""Scenes that yield, for tests; as a script what several ranks compute: ``mpiexec -n 2 python
plastic.py out``."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

from mpi4py import MPI

import dense
import inside
import numpy as np
import ranks

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.grid.gauss_points import GaussField, GaussPoints

ELASTIC = mpm.LinearElastic(young=20e6, poisson=0.3, density=1500.0)
LAW = mpm.VonMises(ELASTIC, peak=10e3, residual=4e3, softening=200e3)
DIRECT = mpm.Solver(petsc={"ksp_type": "preonly", "pc_type": "lu"})
STIFFLY = mpm.Newton(tolerance=1e-11)
EXACT = replace(DIRECT, newton=STIFFLY)


def unrest(rng, stress: np.ndarray, history: np.ndarray, law=LAW) -> None:
    """Random stress inside or on the yield surface, pressure on top, and a random history."""
    history[:] = rng.uniform(0.0, 0.05, history.shape)
    stress[:] = rng.normal(size=stress.shape)
    stress[:, :3] -= stress[:, :3].mean(axis=1, keepdims=True)
    stress *= (
        rng.uniform(0.5, 1.0, len(stress)) * law.strength(history) / tensors.von_mises(stress)
    )[:, None]
    stress[:, :3] += rng.uniform(-2e4, 2e4, (len(stress), 1))


def run_of(kind, grid, stepping, terms, body=None, law=LAW, b_bar=False, **keywords):
    """A run of finite elements (``kind`` None) or of points, evenly placed if none are given, with
    strain as it is at each place unless ``b_bar``."""
    if kind is None:
        return mpm.FiniteElements(grid, law, stepping, terms, b_bar=b_bar, **keywords)
    body = mpm.MaterialPoints.fill(grid, law, 2**grid.dim) if body is None else body
    return mpm.Simulation(grid, body, stepping, terms, replace(kind, b_bar=b_bar), **keywords)


def loads(grid, size=1.0):
    """A fixed base, smooth walls, and ``size`` times 3 kPa of shear and 45 kPa of pressure, uneven
    along the top: plastic flow is held in, so that statics has an answer."""
    dim = grid.dim
    top = np.array([3e3, -45e3]) if dim == 2 else np.array([2e3, 2e3, -45e3])
    on, base = ("top", "bottom") if dim == 2 else ("front", "back")
    held = {"left": "x", "right": "x", "bottom": "y", "top": "y"}
    walls = [mpm.Fixed(grid.facets(side), held[side]) for side in list(held)[: 2 * dim - 2]]
    return [
        *walls,
        mpm.Fixed(grid.facets(base)),
        mpm.Gravity((0.0,) * (dim - 1) + (-9.81,)),
        mpm.Traction(grid.facets(on), lambda t, x: size * t * (0.6 + 0.8 * x[:, :1]) * top),
    ]


def static(kind, newton, dim=2, steps=1, size=1.0):
    """Quasi-static push of a block of 3^dim uneven cells that yields."""
    grid, solver = dense.uneven(dim), replace(DIRECT, newton=newton)
    return run_of(kind, grid, mpm.QuasiStatic(steps), loads(grid, size), solver=solver)


# -- several ranks ---------------------------------------------------------------------------------

SEVERAL = ((None, 2), (None, 3), (mpm.GIMP, 2), (mpm.DM_GC, 2), (mpm.DM_GC, 3))


def rows_by_place(grid, rows) -> dict:
    """Rows of this rank's own cells' Gauss points, in order, by the centre of their cell."""
    centre = 0.5 * (grid.lattice.lower + grid.lattice.upper)
    rows = rows.reshape(grid.cells, -1)
    return {ranks.key(centre[c]): rows[c].tolist() for c in range(grid.owned_cells)}


def gathered(dim) -> dict:
    """How many ranks hold each cell: 1 from every holder, gathered at the owner; and whether ghosts
    know it."""
    grid = ranks.grid_of(dim)
    field = GaussField(grid, 2)
    field.rows[:] = 1.0
    field.gather()
    mine = float(field.rows[: 2**dim * grid.owned_cells, 0].sum()) / 2**dim
    return {
        "held": [mine],
        "cells": [float(grid.cells)],
        "volume": [float(GaussPoints(grid).volume[: 2**dim * grid.owned_cells].sum())],
    }


def plastic_step(kind, dim) -> dict:
    """Two steps of random points, or of finite elements, that yield."""
    grid = ranks.grid_of(dim)
    law = mpm.VonMises(ELASTIC, peak=10e3, residual=4e3, softening=50e3)
    pull = np.array([15e3, 9e3, 9e3])[:dim]
    terms = [
        mpm.Fixed(grid.facets("bottom")),
        mpm.Gravity((0.0,) * (dim - 1) + (-9.81,)),
        mpm.Traction(grid.facets("left"), pull),
    ]
    if kind is None:
        run = mpm.FiniteElements(
            grid, law, mpm.Newmark(0.02), terms, solver=mpm.Solver(newton=STIFFLY)
        )
    else:
        elastic, number = ranks.body_of(grid)
        elastic.stress *= 0.1
        body = mpm.MaterialPoints(
            law, elastic.x, elastic.half, elastic.volume, stress=elastic.stress
        )
        # random stress is out of balance: a start that knows it throws points out of the grid
        run = mpm.Simulation(
            grid,
            body,
            mpm.Newmark(5e-3),
            terms,
            kind,
            mpm.Solver(newton=mpm.Newton(tolerance=1e-9), petsc={"ksp_rtol": 1e-13}),
            mpm.InitialAcceleration.ZERO,
        )
    solves = []
    for _ in range(2):
        run.step()
        solves.append(run.solves)
    out = {"solves": {"": solves}, "increment": ranks.nodal(grid, run.nodal("increment"))}
    if kind is None:
        out["stress"] = rows_by_place(grid, inside.response(run, anew=False).stress)
    else:
        out["points"] = {
            str(n): [*x, *(1e-6 * s), 10 * k]
            for n, x, s, k in zip(
                number, body.x.tolist(), body.stress, body.history[:, 0], strict=True
            )
        }
        if kind is mpm.DM_GC:
            out["tangent"] = rows_by_place(grid, inside.response(run, anew=False).tangent)
    return out


def everything(comm: MPI.Comm = MPI.COMM_WORLD) -> dict:
    """All of it, on rank 0."""
    cases = {f"{kind or 'FE'} {dim}D": plastic_step(kind, dim) for kind, dim in SEVERAL}
    for dim in (2, 3):
        cases[f"gather {dim}D"] = {
            name: {str(comm.rank): rows} for name, rows in gathered(dim).items()
        }
    whole: dict = {}
    for part in comm.gather(cases) or []:
        for case, quantities in part.items():
            for quantity, rows in quantities.items():
                whole.setdefault(case, {}).setdefault(quantity, {}).update(rows)
    return whole


if __name__ == "__main__":
    found = everything()
    if MPI.COMM_WORLD.rank == 0:
        with open(sys.argv[1], "w") as file:
            json.dump(found, file)
