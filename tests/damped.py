"""Damped scenes; run as a script, on several ranks, where one of them comes to."""

import json
import sys

from mpi4py import MPI

import numpy as np
from open_ground import TIGHT, soil, stiff

from mpm_fenicsx import (
    Energy,
    FarField,
    FiniteElements,
    Grid,
    MaterialPoints,
    Newmark,
    RayleighDamping,
    Simulation,
)


def block(dim, points=True):
    """A free block of two layers of their own damping, the lower one a far field, that is struck;
    its run and its energy."""
    grid = Grid.box((0.0,) * dim, (4.0,) * dim, (4,) * dim)
    layers = [(soil, lambda x: x[1] < 1.0), (stiff, lambda x: x[1] > 1.0)]
    terms = [
        FarField(lambda x: x[1] < 2.0, layers),
        RayleighDamping(0.2, (0.1, 0.5), material=soil),
        RayleighDamping(alpha=0.1, beta=0.2, material=stiff),
    ]

    def struck(x):
        return 1e-3 * np.exp(-((x - 2.5) ** 2).sum(axis=1))[:, None] * np.arange(1.0, dim + 1.0)

    if points:
        body = MaterialPoints.fill(grid, stiff, 2**dim, lambda x: x[1] > 2.0)
        body.velocity = struck(body.x)
        run = Simulation(grid, body, Newmark(0.3), terms, solver=TIGHT)
    else:
        run = FiniteElements(grid, stiff, Newmark(0.3), terms, solver=TIGHT)
        run.nodal("velocity")[:] = struck(grid.space.tabulate_dof_coordinates()[:, :dim])
    return run, run.record(Energy())


def numbers():
    """Energies of the scenes after six steps, J."""
    found = {}
    for dim in (2, 3):
        for points in (True, False):
            run, energy = block(dim, points)
            for _ in range(6):
                run.step()
            found[f"{dim}D {points}"] = [energy[n][-1] for n in ("kinetic", "strain", "damped")]
    return found


if __name__ == "__main__":
    result = numbers()
    if MPI.COMM_WORLD.rank == 0:
        with open(sys.argv[1], "w") as out:
            json.dump(result, out)
