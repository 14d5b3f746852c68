"""What one rank or several compute for the same scene, as JSON keyed by place: ``mpiexec -n 2 python ranks.py out``.

Keys are coordinates of nodes, cells' centres and points' numbers, so that results compare across partitions.
"""

from __future__ import annotations

import json
import sys

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from mpm_fenicsx import (
    DM_GC,
    GIMP,
    MPM,
    FiniteElements,
    Fixed,
    GhostPenalty,
    Gravity,
    Grid,
    LinearElastic,
    MaterialPoints,
    Newmark,
    QuasiStatic,
    RunError,
    Simulation,
    SurfacePoints,
    Traction,
    Viscoelastic,
    fenicsx,
)

SOIL = LinearElastic(young=20e6, poisson=0.25, density=1500.0)


def key(x) -> str:
    return ",".join(f"{round(v, 9) + 0.0:.9f}" for v in x)


def nodal(grid: Grid, values: np.ndarray) -> dict:
    """Rows (nodes, f) of this rank's own nodes."""
    own = grid.space.dofmap.index_map.size_local
    x = grid.space.tabulate_dof_coordinates()[:own, : grid.dim]
    return {key(at): row.tolist() for at, row in zip(x, values[:own], strict=True)}


def grid_of(dim: int) -> Grid:
    lines = [np.array([0, 0.3, 0.8, 1.0, 1.5, 1.7, 2.0]), np.array([0, 0.4, 0.7, 1.1, 1.4]), np.array([0, 0.5, 1.2])]
    return Grid.rectilinear(lines[:dim])


def body_of(grid: Grid) -> tuple[MaterialPoints, np.ndarray]:
    """Random points, the same on any number of ranks, and their numbers; the top right corner is empty."""
    rng = np.random.default_rng(3)
    n = 60 if grid.dim == 2 else 150
    span = grid.upper_corner - grid.lower_corner
    x = grid.lower_corner + rng.uniform(0.02, 0.98, (n, grid.dim)) * span
    half = rng.uniform(0.02, 0.09, (n, grid.dim))
    stress = 1e4 * rng.normal(size=(n, 4 if grid.dim == 2 else 6))
    velocity = 1e-3 * rng.normal(size=(n, grid.dim))
    body = (x[:, 0] < 1.45) | (x[:, 1] < 0.65)
    cell = grid.find(x)
    number = np.flatnonzero((cell >= 0) & (cell < grid.owned_cells) & body)
    here = (v[number] for v in (x, half, (2 * half).prod(axis=1), stress, velocity))
    x, half, volume, stress, velocity = here
    return MaterialPoints(SOIL, x, half, volume, stress=stress, velocity=velocity), number


def markers_of(grid: Grid) -> SurfacePoints:
    """Random surface points of the cells of this rank."""
    rng = np.random.default_rng(4)
    x = grid.lower_corner + rng.uniform(0.05, 0.3, (12, grid.dim)) * (grid.upper_corner - grid.lower_corner)
    normal = rng.normal(size=x.shape)
    cell = grid.find(x)
    here = (cell >= 0) & (cell < grid.owned_cells)
    return SurfacePoints(x[here], (normal / np.linalg.norm(normal, axis=1)[:, None])[here], np.full(here.sum(), 0.1))


def action(grid: Grid, A) -> dict:
    """The matrix on a smooth vector."""
    f = fem.Function(grid.space)
    x = grid.space.tabulate_dof_coordinates()[:, : grid.dim]
    f.x.array[:] = np.stack([np.sin(3 * x @ np.arange(1, grid.dim + 1) + d) for d in range(grid.dim)], 1).ravel()
    own = grid.space.dofmap.index_map.size_local * grid.dim
    into, out = A.createVecRight(), A.createVecLeft()
    into.array[:] = f.x.array[:own]
    A.mult(into, out)
    return nodal(grid, out.array.reshape(-1, grid.dim))


def projected(grid: Grid, projection) -> dict:
    centre = 0.5 * (grid.lattice.lower + grid.lattice.upper)
    values = np.stack([f.x.array[projection.dofs] for f in projection.fields], -1)
    return {key(centre[c]): values[c].ravel().tolist() for c in range(grid.owned_cells)}


def ghosts_agree(grid: Grid, f: fem.Function) -> float:
    """Largest difference between ghost values and their owners'."""
    before = f.x.array.copy()
    fenicsx.share(f)
    return float(np.abs(f.x.array - before).max(initial=0.0))


def still(dim: int, mapping) -> dict:
    """One step: fields, matrix, right-hand side."""
    grid = grid_of(dim)
    body, _ = body_of(grid)
    terms = [Gravity((0.0,) * (dim - 1) + (-9.81,)), Traction(grid.facets("left"), (1e3, *(2e3,) * (dim - 1))),
             Viscoelastic(grid.facets("bottom"), SOIL, 3.0), Viscoelastic(markers_of(grid), SOIL, 2.0)]
    run = Simulation(grid, body, Newmark(1e-4), terms, mapping)
    run.locate()
    run.project()
    run.scene.prepare(run.time, run.next_time)
    run.predict()
    run.solve()
    dynamic = Simulation(grid, body_of(grid)[0], Newmark(1e-4), [], mapping)
    static = Simulation(grid, body_of(grid)[0], QuasiStatic(1), [], mapping)
    out = {"fields": projected(grid, run.properties.projections[0]), "internal": {}}
    for name, part in (("all", run), ("inertia", dynamic), ("stiffness", static)):
        part.locate()
        part.project()
        part.scene.prepare(part.time, part.next_time)
        part.equilibrium.assemble_tangent()
        A = part.equilibrium.matrix
        diagonal = A.getDiagonal()  # of rows without material: a matter of the solver
        diagonal.array[part.equilibrium.idle] = 0.0
        A.setDiagonal(diagonal)
        out[name] = action(grid, A)
        out[f"norm of {name}"] = {"": [A.norm()]}
    force = fem.Function(grid.space)
    force.x.array[:] = run._internal.ravel()
    fenicsx.gather_to_owner(force)
    out["internal"] = nodal(grid, force.x.array.reshape(-1, dim))
    out["residual"] = nodal(grid, run.equilibrium.force.x.array.reshape(-1, dim))
    out["velocity"] = nodal(grid, run.motion.nodal(run.motion.v))
    out["increment"] = nodal(grid, run.motion.nodal(run.motion.u))
    for name in ("u", "v", "a"):
        assert ghosts_agree(grid, getattr(run.motion, name)) == 0.0
    return out


def moving(dim: int, mapping, b_bar: bool = False, more: tuple = ()) -> dict:
    """A few steps, with ``more`` terms."""
    grid = grid_of(dim)
    body, number = body_of(grid)
    terms = [Gravity((0.0,) * (dim - 1) + (-9.81,)), Fixed(grid.facets("left", "right"), "x"),
             Viscoelastic(grid.facets("bottom"), SOIL, 3.0), Viscoelastic(markers_of(grid), SOIL, 2.0), *more]
    run = Simulation(grid, body, Newmark(1e-4), terms, mapping, solver={"ksp_rtol": 1e-13}, b_bar=b_bar)
    for _ in range(4):
        run.step()
    rows = np.hstack((body.x, 1e-6 * body.stress, body.velocity, 1e-2 * body.acceleration))
    return {"points": {str(n): row.tolist() for n, row in zip(number, rows, strict=True)}}


def settled(dim: int, mapping) -> dict:
    """A body cut by grid lines comes to rest, and what its base bears."""
    grid = grid_of(dim)
    body = MaterialPoints.fill(grid, SOIL, 2**dim, inside=lambda x: (x[0] < 1.2) & (x[1] < 1.2))
    start = body.x.copy()
    body.x[:, 0] += 0.03
    base = "bottom" if dim == 2 else "back"
    across = [] if dim == 2 else [Fixed(grid.facets("bottom"), "y")]
    terms = [Gravity((0.0,) * (dim - 1) + (-9.81,)), Fixed(grid.facets(base)), *across]
    run = Simulation(grid, body, QuasiStatic(1), terms, mapping)
    run.step()
    left = run.settle(1e-5)  # a few steps
    own = grid.space.dofmap.index_map.size_local
    weight, borne = (grid.comm.allreduce(value) for value in (
        9.81 * body.mass.sum(), run.balance()[0].reshape(-1, dim)[:own].sum(axis=0)[-1]))
    assert left <= 1e-5 and abs(borne / weight - 1) < 1e-4 and run.holding.ties.P is not None
    free = Simulation(grid, body, QuasiStatic(1), terms[:1], mapping)
    try:
        free.step()
        heard = 0
    except ValueError as error:
        heard = int("nothing keeps the body from moving along x and y" in str(error))
    rows = np.hstack((body.x, 1e-6 * body.stress))
    return {"points": {key(x): row.tolist() for x, row in zip(start, rows, strict=True)},
            "refused": {"": [grid.comm.allreduce(heard) / grid.comm.size]}}


def twin(dim: int, stepping, b_bar: bool = False) -> dict:
    """Finite elements."""
    grid = grid_of(dim)
    across, up = (0.0,) * (dim - 1), "xyz"[dim - 1]
    terms = [Fixed(grid.facets("left"), "x"), Fixed(grid.facets("bottom" if dim == 2 else "back"), up),
             Traction(grid.facets("right"), lambda t, x: 1e3 * x + t), Gravity((*across, -9.81))]
    if stepping.dynamic:
        terms.append(Viscoelastic(grid.facets("top"), SOIL, 3.0))
    elif dim == 3:
        terms.append(Fixed(grid.facets("bottom"), "y"))
    run = FiniteElements(grid, SOIL, stepping, terms, b_bar=b_bar)
    for _ in range(3):
        run.step()
    return {"displacement": nodal(grid, run.motion.nodal(run.displacement))}


def refusals(comm: MPI.Comm) -> dict:
    """Every rank hears of what is wrong on one."""
    out = {}
    grid = grid_of(2)
    body, _ = body_of(grid)
    if comm.rank == comm.size - 1:
        body.x[0] = 99.0
    try:
        Simulation(grid, body, Newmark(1e-4), [])
        heard = 0
    except ValueError as error:
        heard = int("outside the grid" in str(error))
    out["outside"] = {"": [comm.allreduce(heard) / comm.size]}
    body, _ = body_of(grid)
    run = Simulation(grid, body, Newmark(1e-4), [])
    run.step()
    if comm.rank == 0:
        body.x[0] = np.nan
    try:
        run.step()
        heard = 0
    except RunError as error:
        heard = int("step 2" in str(error))
    out["lost"] = {"": [comm.allreduce(heard) / comm.size]}
    body, _ = body_of(grid)
    run = Simulation(grid, body, Newmark(1e-4), [])
    if comm.rank == comm.size - 1:
        body.half[:] = np.nan
        body.stretches = lambda *_: (_ for _ in ()).throw(ValueError("turns inside out"))
    try:
        run.carry()
        heard = 0
    except RunError as error:
        heard = int("inside out" in str(error))
    out["inverted"] = {"": [comm.allreduce(heard) / comm.size]}
    return out


def everything(comm: MPI.Comm = MPI.COMM_WORLD) -> dict:
    """All of it, on rank 0; cases by name, each a dict of quantity -> key -> numbers."""
    cases = {"refusals": refusals(comm)}
    for dim in (2, 3):
        for mapping in (MPM, GIMP, DM_GC):
            cases[f"still {dim}D {mapping}"] = still(dim, mapping)
            cases[f"moving {dim}D {mapping}"] = moving(dim, mapping)
        cases[f"moving {dim}D B-bar"] = moving(dim, DM_GC, b_bar=True)
        cases[f"moving {dim}D GhostPenalty"] = moving(dim, DM_GC, more=(GhostPenalty(),))
        cases[f"settled {dim}D"] = settled(dim, DM_GC)
        cases[f"static twin {dim}D B-bar"] = twin(dim, QuasiStatic(3), b_bar=True)
        cases[f"twin {dim}D"] = twin(dim, Newmark(1e-3))
        cases[f"static twin {dim}D"] = twin(dim, QuasiStatic(3))
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
