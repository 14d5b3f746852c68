"""Scenes with a far field and an absorbing layer; run as a script, on several ranks, what one of
them computes."""

import sys

from mpi4py import MPI

import numpy as np
from inside import at_nodes, plain

from mpm_fenicsx import (
    AbsorbingLayer,
    Energy,
    FarField,
    FiniteElements,
    Fixed,
    Grid,
    LinearElastic,
    MaterialPoints,
    Newmark,
    Simulation,
    Solver,
    ViscousBoundary,
)

soil = LinearElastic(young=2.5, poisson=0.25, density=1.0)  # c_s = 1 m/s
stiff = LinearElastic(young=5.0, poisson=0.25, density=1.2)
TIGHT = Solver(petsc={"ksp_rtol": 1e-13})


def column(wave, cells, courant, half, fair=False, stepping=Newmark):
    """A packet of P or S waves, ``cells`` a wavelength, runs down a column of which the lower half
    is a far field, if ``half``; the run, and the time when what comes back lies in the upper half.
    """
    d, c = {"P": (1, soil.p_speed), "S": (0, soil.s_speed)}[wave]
    length, wide = 16.0 * cells, 2.7 * cells  # m, cells of 1 m
    grid = Grid.box((0.0, 0.0), (2.0, length), (2, int(length)))
    body = MaterialPoints.fill(grid, soil, 4, lambda x: x[1] > (0.5 * length if half else 0.0))
    y = body.x[:, 1] - 0.75 * length
    shape = 1e-5 * np.exp(-4.0 * (y / wide) ** 2) * np.cos(2 * np.pi * y / cells)
    body.velocity, λ, μ = np.zeros_like(body.x), *soil.lame
    body.velocity[:, d] = shape
    rows = {"P": (λ, λ + 2 * μ, λ, 0.0), "S": (0.0, 0.0, 0.0, μ)}[wave]
    body.stress = (shape / c)[:, None] * np.array(rows)
    far = [FarField(lambda x: x[1] < 0.5 * length, soil, fair=fair)] if half else []
    sides = Fixed(grid.facets("left", "right"), "xy"[1 - d])
    terms = [*far, sides, ViscousBoundary(grid.facets("bottom"), soil)]
    run = Simulation(grid, body, stepping(courant / c), terms, solver=TIGHT)
    return run, 0.65 * length / c


def block(dim, points=True, far=True, follows=False, fair=False):
    """A block that is struck, on a far field of two materials, in a layer that ends at its top."""
    n = 14 if dim == 2 else 10
    grid = Grid.box((0.0,) * dim, (float(n),) * dim, (n,) * dim)

    def inside(x):
        return (x[[0, 2] if dim == 3 else [0]] > 3).all(0) & (x < n - 3).all(0) & (x[1] > 3)

    sides = ("left", "right", "bottom") + (("back", "front") if dim == 3 else ())
    terms = [AbsorbingLayer(sides, soil, absorbing=2, elastic=1)]
    middle = np.array([n / 2, 0.6 * n, n / 2][:dim])

    def struck(x):
        shape = 1e-2 * np.exp(-((x - middle) ** 2).sum(axis=1) / 4)
        return shape[:, None] * np.array([0.3, 1.0, 0.2][:dim])

    if not points:
        run = FiniteElements(grid, soil, Newmark(0.3), terms)
        run.nodal("velocity")[:] = struck(grid.space.tabulate_dof_coordinates()[:, :dim])
        return run
    level = n // 2 if far else 3
    if far:
        layers = [(soil, lambda x: x[1] < level - 1), (stiff, lambda x: x[1] > level - 1)]
        lower = FarField(lambda x: inside(x) & (x[1] < level), layers, fair, follows)
        terms = [lower, *terms]
    body = MaterialPoints.fill(grid, soil, 2**dim, lambda x: inside(x) & (x[1] > level))
    body.velocity = struck(body.x)
    return Simulation(grid, body, Newmark(0.3), terms, solver=TIGHT)


def fields(run):
    """Points and displacement of the plain cells in the order of their places, energies; on the
    first rank, else None."""
    grid, body = run.grid, run.bodies[0]
    owned = grid.space.dofmap.index_map.size_local
    order, number = np.round(body.x, 3), grid.node_numbers[:owned]
    moved = [at_nodes(run, part.U)[:owned] for part in plain(run)]
    kinds = [body.x, body.velocity, body.stress]
    got = grid.comm.gather((order, number, np.hstack(moved), *kinds))
    if grid.comm.rank:
        return None
    order, number, moved, *kinds = (np.concatenate(each) for each in zip(*got, strict=True))
    at = np.lexsort(order.T)
    return {
        "moved": moved[np.argsort(number)],
        **{name: kind[at] for name, kind in zip("xvs", kinds, strict=True)},
    }


if __name__ == "__main__":
    dim, steps, out = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    run = block(dim, fair="fair" in sys.argv, follows="follows" in sys.argv)
    energy = run.record(Energy())
    for _ in range(steps):
        run.step()
    found = fields(run)
    if MPI.COMM_WORLD.rank == 0:
        names = ("kinetic", "strain", "absorbed")
        np.savez(out, energy=[energy[name][-1] for name in names], **found)
