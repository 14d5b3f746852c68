"""Scenes of finite strain, for tests; as a script what ranks compute: ``mpiexec -n 2 python
stretched.py out``."""

from __future__ import annotations

import json
import sys

from mpi4py import MPI

import plastic
import ranks

import mpm_fenicsx as mpm

SOIL = mpm.Hencky(young=20e6, poisson=0.3, density=1500.0)
LAW = mpm.VonMises(SOIL, peak=300e3, residual=100e3, softening=800e3)

SEVERAL = ((None, 2), (mpm.GIMP, 2), (mpm.DM_GC, 2), (mpm.DM_GC, 3))


def two_steps(kind, dim) -> dict:
    """Two steps of 5 ms of random points, or of finite elements, under loads that strain them by
    some per cent."""
    grid = ranks.grid_of(dim)
    terms = [*plastic.loads(grid, 30.0)]
    if kind is None:
        solver = mpm.Solver(newton=mpm.Newton(tolerance=1e-10))
        run = plastic.run_of(None, grid, mpm.Newmark(5e-3), terms, law=LAW, solver=solver)
    else:
        elastic, number = ranks.body_of(grid)
        body = mpm.MaterialPoints(
            LAW, elastic.x, elastic.half, elastic.volume, stress=elastic.stress
        )
        solver = mpm.Solver(newton=mpm.Newton(tolerance=1e-10), petsc={"ksp_rtol": 1e-13})
        run = mpm.Simulation(grid, body, mpm.Newmark(5e-3), terms, kind, solver)
    for _ in range(2):
        run.step()
    out = {"increment": ranks.nodal(grid, run.nodal("increment"))}
    if kind is None:
        rows = run.gauss_stress().reshape(grid.cells, -1)
        centre = 0.5 * (grid.lattice.lower + grid.lattice.upper)
        out["stress"] = {ranks.key(centre[c]): rows[c].tolist() for c in range(grid.owned_cells)}
    else:
        out["points"] = {
            str(n): [*x, *(1e-6 * s), *h]
            for n, x, s, h in zip(number, body.x.tolist(), body.stress, body.history, strict=True)
        }
    return out


def everything(comm: MPI.Comm = MPI.COMM_WORLD) -> dict:
    """All of it, on rank 0."""
    whole: dict = {}
    for part in (
        comm.gather({f"{kind or 'FE'} {dim}D": two_steps(kind, dim) for kind, dim in SEVERAL}) or []
    ):
        for case, quantities in part.items():
            for quantity, rows in quantities.items():
                whole.setdefault(case, {}).setdefault(quantity, {}).update(rows)
    return whole


if __name__ == "__main__":
    found = everything()
    if MPI.COMM_WORLD.rank == 0:
        with open(sys.argv[1], "w") as file:
            json.dump(found, file)
