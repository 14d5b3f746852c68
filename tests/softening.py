"""Scenes that soften over a length, for tests; as a script what several ranks compute: ``mpiexec -n
2 python softening.py out``."""

from __future__ import annotations

import json
import sys

from mpi4py import MPI

import numpy as np

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical import shear_band
from mpm_fenicsx.points.location import numbers_of

SOIL = mpm.LinearElastic(young=75e6, poisson=0.25, density=1800.0)
HEIGHT, LENGTH, PEAK, SOFTENING = 4.0, 0.25, 2e3, 2.5e6
OVER = mpm.OverNonlocal(LENGTH)
CLAY = mpm.VonMises(SOIL, PEAK, residual=20.0, softening=SOFTENING, averaging=OVER)
STIFFLY = mpm.Solver(newton=mpm.Newton(tolerance=1e-9))
DIRECT = mpm.Solver(
    newton=mpm.Newton(tolerance=1e-9), petsc={"ksp_type": "preonly", "pc_type": "lu"}
)


class Layer:
    """A layer of ``HEIGHT`` (m), ``across`` cells wide and deep, that is sheared from its top by
    ``strain`` times what it bears elastically; its middle is weakened by a stress across the shear,
    along the layer, which nothing has to balance.  Nothing moves but along x."""

    def __init__(
        self,
        mapping,
        cell=0.05,
        law=CLAY,
        strain=6.4,
        steps=60,
        dim=2,
        across=2,
        seed=2e3,
        solver=None,
        **options,
    ):
        rows, wide = round(HEIGHT / cell), across * cell
        low, high, cells = [0.0, -HEIGHT / 2], [wide, HEIGHT / 2], [across, rows]
        if dim == 3:
            low, high, cells = [*low, 0.0], [*high, cell], [*cells, 1]
        grid = self.grid = mpm.Grid.box(low, high, cells)
        bears = PEAK * HEIGHT / law.lame[1]
        sides = ("left", "right", "bottom", "top", "front", "back")[: 2 * dim]
        held = "y" if dim == 2 else "yz"
        terms = [
            mpm.Fixed(grid.facets("bottom"), "x"),
            mpm.Fixed(grid.facets("top"), "x", lambda t: strain * bears * t),
        ]
        for axis in held:
            terms.append(mpm.Fixed(grid.facets(*sides), axis))
            terms.append(mpm.Fixed(grid.inner_facets(lambda x: x[0] < np.inf), axis))

        def stress(x):
            rows = np.zeros((x.shape[1], 4 if dim == 2 else 6))
            rows[:, 2] = seed * np.exp(-((x[1] / LENGTH) ** 2))
            return rows

        stepping = mpm.QuasiStatic(steps)
        self.points = None
        if mapping is None:
            self.run = mpm.FiniteElements(
                grid, law, stepping, terms, stress=stress, solver=solver, **options
            )
        else:
            self.points = mpm.MaterialPoints.fill(grid, law, 2**dim)
            self.points.stress[:] = stress(self.points.x.T)
            self.run = mpm.Simulation(
                grid, self.points, stepping, terms, mapping, solver, **options
            )
        self._moved = strain * bears

    def state(self):
        """Height (n,), m, shear stress (n,), Pa, and history (n, k) of points or Gauss points."""
        if self.points is not None:
            return self.points.x[:, 1], self.points.stress[:, 3], self.points.history
        run = self.run
        return run.gauss_places()[:, 1], run.gauss_stress()[:, 3], run.gauss_history()

    def step(self):
        """One step: displacement of the top (m) and mean shear stress (Pa)."""
        self.run.step()
        return self._moved * self.run.time, self.state()[1].mean()


def band_of(moved, stress, law=CLAY):
    """Width (m) of the band of even strain that softens as the layer does from one of two steps to
    the other: displacements (2,), m, and shear stresses (2,), Pa."""
    compliance = (moved[1] - moved[0]) / (stress[1] - stress[0])
    return (HEIGHT / law.lame[1] - compliance) * SOFTENING / np.sqrt(3.0)


def exact_band():
    """That of the exact solution (m)."""
    return shear_band.softening_width(LENGTH)


# -- biaxial compression ---------------------------------------------------------------------------

PRESSED = mpm.VonMises(
    mpm.LinearElastic(young=200e6, poisson=0.3, density=1800.0),
    peak=20e3,
    residual=5e3,
    softening=4e6,
    averaging=mpm.OverNonlocal(0.2),
)


def biaxial(mapping, cell, law=PRESSED, shortened=0.0012, steps=36):
    """A block of 1 m × 2 m between rough plates, which is shortened by that part of its height;
    at its left edge a stress out of the plane weakens it.  The plates move by a tenth of the finest
    cells: they are nodes of the grid, through which points go."""
    side = 0.0 if mapping is None else 0.2  # room for points
    cells = round((1.0 + 2 * side) / cell), round(2.0 / cell)
    grid = mpm.Grid.box((-side, 0.0), (1.0 + side, 2.0), cells)
    terms = [
        mpm.Fixed(grid.facets("bottom")),
        mpm.Fixed(grid.facets("top"), "x"),
        mpm.Fixed(grid.facets("top"), "y", lambda t: -2.0 * shortened * t),
    ]

    def stress(x):
        rows = np.zeros((x.shape[1], 4))
        rows[:, 2] = 8e3 * np.exp(-((x[0] ** 2 + (x[1] - 0.6) ** 2) / 0.25**2))
        return rows

    stepping = mpm.QuasiStatic(steps)
    if mapping is None:
        return mpm.FiniteElements(grid, law, stepping, terms, stress=stress)
    points = mpm.MaterialPoints.fill(grid, law, 4, lambda x: (x[0] > 0) & (x[0] < 1))
    points.stress[:] = stress(points.x.T)
    return mpm.Simulation(grid, points, stepping, terms, mapping)


# -- several ranks ---------------------------------------------------------------------------------


def block(kind, stretched=False, repartition=None):
    """A dynamic block that is pressed in at its top, of two bodies of one material and one of
    another; its points drift over the grid."""
    elastic = (
        mpm.Hencky(young=2e6, poisson=0.3, density=1800.0)
        if stretched
        else mpm.LinearElastic(young=2e6, poisson=0.3, density=1800.0)
    )
    law = mpm.VonMises(elastic, 2e3, 5e2, 2e4, averaging=mpm.OverNonlocal(0.5))
    other = mpm.VonMises(elastic, 3e3, 5e2, 2e4, averaging=mpm.OverNonlocal(0.6))
    grid = mpm.Grid.box((0.0, 0.0), (3.0, 2.0), (12, 8))
    halves = [
        (law, lambda x: (x[0] < 0.75) & (x[1] < 1.5)),
        (law, lambda x: (x[0] > 0.75) & (x[0] < 1.5) & (x[1] < 1.5)),
        (other, lambda x: (x[0] > 1.5) & (x[0] < 2.25) & (x[1] < 1.5)),
    ]

    def push(t, x):
        value = np.zeros_like(x)
        value[:, 1] = -8e3 * (1.0 + 0.3 * x[:, 0])
        return value

    base = [mpm.Fixed(grid.facets("bottom"), "y"), mpm.Gravity((0.0, -9.81))]
    if kind is None:
        grid = mpm.Grid.box((0.0, 0.0), (2.25, 1.5), (9, 6))
        base = [mpm.Fixed(grid.facets("bottom"), "y"), mpm.Gravity((0.0, -9.81))]
        pairs = [
            (law, lambda x: x[0] < 1.5),
            (other, lambda x: x[0] > 1.5),
        ]
        terms = [*base, mpm.Traction(grid.facets("top"), push)]
        return mpm.FiniteElements(grid, pairs, mpm.Newmark(4e-3), terms, solver=TIGHT)
    bodies = [mpm.MaterialPoints.fill(grid, one, 4, inside, jitter=0.3) for one, inside in halves]
    for body in bodies:
        body.number = numbers_of(grid, body.x, grid.find(body.x))
        body.velocity = np.tile((8.0, 0.0), (len(body), 1))
    terms = [*base, *(mpm.Traction(body.surface("top"), push) for body in bodies)]
    return mpm.Simulation(
        grid, bodies, mpm.Newmark(4e-3), terms, kind, TIGHT, repartition=repartition
    )


TIGHT = mpm.Solver(
    newton=mpm.Newton(tolerance=1e-12), petsc={"ksp_rtol": 1e-13, "ksp_max_it": 2000}
)
CASES = {
    "FE": lambda: block(None),
    "DM-GC": lambda: block(mpm.DM_GC),
    "Hencky": lambda: block(mpm.DM_GC, True),
    "cut anew": lambda: block(mpm.DM_GC, repartition=mpm.Repartition(above=1.05, every=2)),
}
STEPS = 5


def columns(run) -> dict:
    """κ, plastic work and κ̄ by place or number of what this rank has."""
    if run.bodies:
        return {
            f"{n}/{number}": row.tolist()
            for n, body in enumerate(run.bodies)
            for number, row in zip(body.number, body.history, strict=True)
        }
    grid = run.grid
    own = grid.owned_cells * 2**grid.dim
    places = run.gauss_places()[:own].round(6) + 0.0
    return {
        str(x.tolist()): row.tolist()
        for x, row in zip(places, run.gauss_history()[:own], strict=True)
    }


def everything(comm: MPI.Comm = MPI.COMM_WORLD) -> dict:
    """All cases on all ranks."""
    whole: dict = {}
    for case, make in CASES.items():
        run = make()
        for _ in range(STEPS):
            run.step()
        for part in comm.allgather(columns(run)):
            whole.setdefault(case, {}).update(part)
    return whole


if __name__ == "__main__":
    found = everything()
    if MPI.COMM_WORLD.rank == 0:
        with open(sys.argv[1], "w") as file:
            json.dump(found, file)
