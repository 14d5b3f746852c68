"""On several ranks: the matrix that our loop writes beside the one that DOLFINx assembles, of grids
with many cells and with few, so that ranks have one or none.

Prints the norm of the difference over that of the matrix, scene by scene.
"""

import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import inside

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=2e7, poisson=0.3, density=1500.0)
WEAK = mpm.VonMises(SOIL, 1e3, 1e3, 0.0)


def run_of(dim, lines, law, points):
    """A block under its weight, one corner of it loaded, held at two sides."""
    grid = mpm.Grid.rectilinear([np.array(lines)] * dim)
    weight = mpm.Gravity((0.0, -9.81, 0.0)[:dim])
    held = mpm.Fixed(grid.facets("bottom")), mpm.Fixed(grid.facets("left"), "x")
    if not points:
        return mpm.FiniteElements(grid, law, mpm.Newmark(1e-3), [weight, *held])
    body = mpm.MaterialPoints.fill(grid, law, 2**dim, inside=lambda x: (x < points).all(axis=0))
    return mpm.Simulation(grid, body, mpm.Newmark(1e-3), [weight, *held])


EVEN, UNEVEN = np.linspace(0.0, 1.0, 7), (0.0, 0.2, 0.4, 1.0)
SCENES = {
    f"{dim}D {name}": (dim, lines, law, points)
    for dim in (2, 3)
    for name, (lines, law, points) in {
        "blocks": (EVEN, SOIL, 2.0),
        "rows of a cut body": (EVEN, SOIL, 0.7),
        "cells of many kinds": (UNEVEN, SOIL, 2.0),
        "soil that yields": (EVEN, WEAK, 0.7),
        "elements": (EVEN, SOIL, None),
        "two cells a side": ((0.0, 0.5, 1.0), SOIL, 2.0),
        "one cell": ((0.0, 1.0), SOIL, 2.0),
    }.items()
}


if __name__ == "__main__":
    for name, scene in SCENES.items():
        run = run_of(*scene)
        run.step()
        difference, size = inside.inserted_apart(run)
        if MPI.COMM_WORLD.rank == 0:
            print(f"{name}: {difference / size:.3e}")
