"""What one rank or several compute for the same scene, as JSON keyed by place: ``mpiexec -n 2
python ranks.py out``.

Keys are coordinates of nodes, cells' centres and points' numbers, so that results compare across
partitions.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from mpi4py import MPI

import inside
import numpy as np
from dolfinx import fem

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
FINITE = mpm.Hencky(young=20e6, poisson=0.25, density=1500.0)
CLAY = mpm.VonMises(SOIL, peak=2e3, residual=1e3, softening=1e5, length=0.5)
EXACT = mpm.Solver(petsc={"ksp_rtol": 1e-13, "ksp_max_it": 2000})


def key(x) -> str:
    return ",".join(f"{round(v, 9) + 0.0:.9f}" for v in x)


def nodal(grid: mpm.Grid, values: np.ndarray) -> dict:
    """Rows (nodes, f) of this rank's own nodes."""
    own = grid.space.dofmap.index_map.size_local
    x = grid.space.tabulate_dof_coordinates()[:own, : grid.dim]
    return {key(at): row.tolist() for at, row in zip(x, values[:own], strict=True)}


def grid_of(dim: int) -> mpm.Grid:
    lines = [
        np.array([0, 0.3, 0.8, 1.0, 1.5, 1.7, 2.0]),
        np.array([0, 0.4, 0.7, 1.1, 1.4]),
        np.array([0, 0.5, 1.2]),
    ]
    return mpm.Grid.rectilinear(lines[:dim])


def body_of(
    grid: mpm.Grid, part: Callable = lambda x: x[:, 0] < np.inf
) -> tuple[mpm.MaterialPoints, np.ndarray]:
    """Random points, the same on any number of ranks, and their numbers; the top right corner is
    empty.

    ``part`` maps x (n, dim) to bool (n,) and keeps some.
    """
    rng = np.random.default_rng(3)
    n = 60 if grid.dim == 2 else 150
    span = grid.upper_corner - grid.lower_corner
    x = grid.lower_corner + rng.uniform(0.02, 0.98, (n, grid.dim)) * span
    half = rng.uniform(0.02, 0.09, (n, grid.dim))
    stress = 1e4 * rng.normal(size=(n, 4 if grid.dim == 2 else 6))
    velocity = 1e-3 * rng.normal(size=(n, grid.dim))
    body = (x[:, 0] < 1.45) | (x[:, 1] < 0.65)
    cell = grid.find(x)
    number = np.flatnonzero((cell >= 0) & (cell < grid.owned_cells) & body & part(x))
    here = (v[number] for v in (x, half, (2 * half).prod(axis=1), stress, velocity))
    x, half, volume, stress, velocity = here
    return mpm.MaterialPoints(SOIL, x, half, volume, stress=stress, velocity=velocity), number


def markers_of(grid: mpm.Grid) -> mpm.SurfacePoints:
    """Random surface points of the cells of this rank."""
    rng = np.random.default_rng(4)
    x = grid.lower_corner + rng.uniform(0.05, 0.3, (12, grid.dim)) * (
        grid.upper_corner - grid.lower_corner
    )
    normal = rng.normal(size=x.shape)
    cell = grid.find(x)
    here = (cell >= 0) & (cell < grid.owned_cells)
    return mpm.SurfacePoints(
        x[here], (normal / np.linalg.norm(normal, axis=1)[:, None])[here], np.full(here.sum(), 0.1)
    )


def action(grid: mpm.Grid, A) -> dict:
    """The matrix on a smooth vector."""
    f = fem.Function(grid.space)
    x = grid.space.tabulate_dof_coordinates()[:, : grid.dim]
    f.x.array[:] = np.stack(
        [np.sin(3 * x @ np.arange(1, grid.dim + 1) + d) for d in range(grid.dim)], 1
    ).ravel()
    own = grid.space.dofmap.index_map.size_local * grid.dim
    into, out = A.createVecRight(), A.createVecLeft()
    into.array[:] = f.x.array[:own]
    A.mult(into, out)
    return nodal(grid, out.array.reshape(-1, grid.dim))


def projected(run) -> dict:
    """What cells hold of the first fields, by their centres."""
    grid, values = run.grid, inside.projected(run)
    centre = 0.5 * (grid.lattice.lower + grid.lattice.upper)
    return {key(centre[c]): values[c].ravel().tolist() for c in range(grid.owned_cells)}


def still(dim: int, mapping) -> dict:
    """One step: fields, matrix, right-hand side."""
    grid = grid_of(dim)
    body, _ = body_of(grid)
    terms = [
        mpm.Gravity((0.0,) * (dim - 1) + (-9.81,)),
        mpm.Traction(grid.facets("left"), (1e3, *(2e3,) * (dim - 1))),
        mpm.ViscoelasticBoundary(grid.facets("bottom"), SOIL, 3.0),
        mpm.ViscoelasticBoundary(markers_of(grid), SOIL, 2.0),
    ]
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-4), terms, mapping)
    inside.prepared(run).solve()
    dynamic = mpm.Simulation(grid, body_of(grid)[0], mpm.Newmark(1e-4), [], mapping)
    static = mpm.Simulation(grid, body_of(grid)[0], mpm.QuasiStatic(1), [], mapping)
    out = {"fields": projected(run), "internal": {}}
    for name, part in (("all", run), ("inertia", dynamic), ("stiffness", static)):
        A = inside.matrix_of_ranks(inside.prepared(part))
        out[name] = action(grid, A)
        out[f"norm of {name}"] = {"": [A.norm()]}
    force = fem.Function(grid.space)
    force.x.array[:] = run._internal.ravel()
    dolfinx_versions.gather_to_owner(force)
    out["internal"] = nodal(grid, force.x.array.reshape(-1, dim))
    out["residual"] = nodal(grid, inside.equations(run).residual.reshape(-1, dim))
    out["velocity"] = nodal(grid, run.nodal("velocity"))
    out["increment"] = nodal(grid, run.nodal("increment"))
    assert inside.ghosts_agree(run)
    return out


def moving(dim: int, mapping, more: tuple = ()) -> dict:
    """A few steps, with ``more`` terms."""
    grid = grid_of(dim)
    body, number = body_of(grid)
    terms = [
        mpm.Gravity((0.0,) * (dim - 1) + (-9.81,)),
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.ViscoelasticBoundary(grid.facets("bottom"), SOIL, 3.0),
        mpm.ViscoelasticBoundary(markers_of(grid), SOIL, 2.0),
        *more,
    ]
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-4), terms, mapping, EXACT)
    for _ in range(4):
        run.step()
    rows = np.hstack((body.x, 1e-6 * body.stress, body.velocity, 1e-2 * body.acceleration))
    return {"points": {str(n): row.tolist() for n, row in zip(number, rows, strict=True)}}


def settled(dim: int, mapping) -> dict:
    """A body cut by grid lines comes to rest, and what its base bears."""
    grid = grid_of(dim)
    body = mpm.MaterialPoints.fill(grid, SOIL, 2**dim, inside=lambda x: (x[0] < 1.2) & (x[1] < 1.2))
    start = body.x.copy()
    body.x[:, 0] += 0.03
    base = "bottom" if dim == 2 else "back"
    across = [] if dim == 2 else [mpm.Fixed(grid.facets("bottom"), "y")]
    terms = [mpm.Gravity((0.0,) * (dim - 1) + (-9.81,)), mpm.Fixed(grid.facets(base)), *across]
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(1), terms, mapping)
    run.step()
    left = run.settle(1e-5)  # a few steps
    own = grid.space.dofmap.index_map.size_local
    weight, borne = (
        grid.comm.allreduce(value)
        for value in (
            9.81 * body.mass.sum(),
            run.balance()[0].reshape(-1, dim)[:own].sum(axis=0)[-1],
        )
    )
    assert left <= 1e-5 and abs(borne / weight - 1) < 1e-4
    assert grid.comm.allreduce(int(inside.tied(run).any())) > 0
    free = mpm.Simulation(grid, body, mpm.QuasiStatic(1), terms[:1], mapping)
    try:
        free.step()
        heard = 0
    except ValueError as error:
        heard = int("nothing keeps the body from moving along x and y" in str(error))
    rows = np.hstack((body.x, 1e-6 * body.stress))
    return {
        "points": {key(x): row.tolist() for x, row in zip(start, rows, strict=True)},
        "refused": {"": [grid.comm.allreduce(heard) / grid.comm.size]},
    }


def rows_of(body: mpm.MaterialPoints) -> np.ndarray:
    """What points of a dynamic run carry, brought to sizes that compare."""
    return np.hstack((body.x, 1e-6 * body.stress, body.velocity, 1e-2 * body.acceleration))


def of_two_bodies(dim: int, mapping) -> dict:
    """Bodies that share cells, of one of which a rank may hold no point."""
    grid = grid_of(dim)
    both = [body_of(grid, part) for part in (lambda x: x[:, 0] < 0.55, lambda x: x[:, 0] >= 0.55)]
    terms = [mpm.Gravity((0.0,) * (dim - 1) + (-9.81,)), mpm.Fixed(grid.facets("left"))]
    bodies = [body for body, _ in both]
    run = mpm.Simulation(grid, bodies, mpm.Newmark(1e-4), terms, mapping, EXACT)
    for _ in range(3):
        run.step()
    return {
        "points": {
            str(n): row.tolist()
            for body, number in both
            for n, row in zip(number, rows_of(body), strict=True)
        }
    }


def jittered(dim: int) -> dict:
    """Random places, by the even ones that they were moved from."""
    body = mpm.MaterialPoints.fill(
        grid_of(dim), SOIL, 2**dim, lambda x: x[0] < 1.6, jitter=0.4, seed=5
    )
    return {"points": {key(seat): x.tolist() for seat, x in zip(body.seat, body.x, strict=True)}}


def faces_by_hand(grid: mpm.Grid) -> mpm.SurfacePoints:
    """All of a surface, on each rank: faces along the bottom, some of them across grid lines or in
    the corner of four cells, whose Gauss points lie in the cells of several ranks."""
    dim, rng = grid.dim, np.random.default_rng(6)
    on_lines = np.array(
        [[0.3, 0.4, 0.5], [0.8, 0.4, 0.5], [1.0, 0.7, 0.5], [1.5, 0.4, 0.5], [0.8, 0.2, 0.5]]
    )
    centre = np.concatenate((on_lines, rng.uniform(0.15, 0.6, (9, 3)) * [2.2, 1.0, 1.2]))[:, :dim]
    normal = np.zeros_like(centre)
    normal[:, 1] = -1.0
    half = 0.11 * np.ones(dim)
    half[1] = 0.0
    sign = np.insert(
        2.0 * np.array(list(np.ndindex((2,) * (dim - 1))))[:, ::-1] - 1.0, 1, 0.0, axis=1
    )
    x = centre[:, None] + sign * half / np.sqrt(3.0)
    k = len(sign)
    return mpm.SurfacePoints(
        x.reshape(-1, dim), np.repeat(normal, k, axis=0), np.full(k * len(centre), 0.1), per_face=k
    )


def surfaces_by_hand(dim: int) -> dict:
    """Surfaces that each rank is given whole, with loads row by row, in two runs one after the
    other."""
    grid, rng = grid_of(dim), np.random.default_rng(8)
    body, number = body_of(grid)
    x = grid.lower_corner + rng.uniform(0.05, 0.6, (14, dim)) * (
        grid.upper_corner - grid.lower_corner
    )
    x[:4] = np.array([[0.3, 0.4, 0.5], [0.8, 0.7, 0.5], [1.0, 0.4, 0.2], [0.8, 0.2, 0.5]])[
        :, :dim
    ]  # on grid lines
    x[5] = x[4]  # given twice: acts twice
    normal = rng.normal(size=x.shape)
    points = mpm.SurfacePoints(
        x, normal / np.linalg.norm(normal, axis=1)[:, None], rng.uniform(0.1, 0.2, len(x))
    )
    faces = faces_by_hand(grid)
    loads = [1e4 * rng.normal(size=s.x.shape) for s in (points, faces)]
    for _ in range(2):
        terms = [mpm.Fixed(grid.facets("left"), "x"), mpm.DeadLoad(points, lambda t, x: 1e4 * x)]
        terms += [mpm.ViscoelasticBoundary(faces, SOIL, 0.5)] if dim == 2 else []
        terms += [mpm.Traction(s, load) for s, load in zip((points, faces), loads, strict=True)]
        run = mpm.Simulation(grid, body, mpm.Newmark(1e-4), terms, solver=EXACT)
        for _ in range(2):
            run.step()
    out = {"points": {str(n): row.tolist() for n, row in zip(number, rows_of(body), strict=True)}}
    for name, s in (("single", points), ("faces", faces)):
        rows = np.hstack((s.x, s.normal, s.area[:, None]))
        at = np.arange(len(s)) if s.number is None else s.number
        out[name] = {str(n): row.tolist() for n, row in zip(at, rows, strict=True)}
    if dim == 2:
        out["springs"] = {
            str(n): row.tolist() for n, row in zip(at, faces.displacement, strict=True)
        }
    return out


def lacking(cells: tuple[int, ...], material, stepping, mapping, end: float, folder: Path) -> dict:
    """A body that ends at ``end`` of the grid's length: a rank may hold none of it, or not even a
    cell."""
    dim = len(cells)
    grid = mpm.Grid.box((0.0,) * dim, tuple(map(float, cells)), cells)
    body = mpm.MaterialPoints.fill(
        grid, material, 2**dim, lambda x: (x[0] < end) & (x[1] < cells[1] - 0.25)
    )
    across, dynamic, whole = (0.0,) * (dim - 2), stepping.dynamic, (material, dim) == (SOIL, 2)
    terms = [
        mpm.Gravity((0.0, -9.81, *across)),
        mpm.Fixed(grid.facets("left"), "x"),
        mpm.Fixed(grid.facets("bottom")),
        mpm.Traction(body.surface("top"), (0.0, -1e3, *across)),
    ]
    if whole:
        terms += [mpm.ViscoelasticBoundary(body.surface("right"), SOIL, 3.0), mpm.GhostPenalty()]
    solver = replace(EXACT if dynamic else mpm.Solver(), newton=mpm.Newton(1e-12))
    run = mpm.Simulation(grid, body, stepping, terms, mapping, solver)
    energy = run.record(mpm.Energy()) if whole else None
    probe = run.record(mpm.Probe("stress", (0.5,) * dim))
    run.record(mpm.Snapshots(folder / "shot"))
    run.record(mpm.Checkpoint(folder / "check"))
    for _ in range(2):
        run.step()
    run.restart(folder / "check")
    rows = np.hstack((body.x, 1e-6 * body.stress))
    out = {
        "points": {
            key(at): row.tolist() for at, row in zip(np.round(body.x, 2), rows, strict=True)
        },
        "probe": {"": probe.values[-1].tolist()},
    }
    if whole:
        out["energy"] = {"": energy.values[-1].tolist()}
    if not dynamic:
        out["balance"] = {"": [1.0 + run.balance()[1]]}
    return out


def twin(
    dim: int, stepping, b_bar: bool = False, grid: mpm.Grid | None = None, material=SOIL
) -> dict:
    """Finite elements."""
    grid = grid or grid_of(dim)
    across, up = (0.0,) * (dim - 1), "xyz"[dim - 1]
    terms = [
        mpm.Fixed(grid.facets("left"), "x"),
        mpm.Fixed(grid.facets("bottom" if dim == 2 else "back"), up),
        mpm.Traction(grid.facets("right"), lambda t, x: 1e3 * x + t),
        mpm.Gravity((*across, -9.81)),
    ]
    if stepping.dynamic:
        terms.append(mpm.ViscoelasticBoundary(grid.facets("top"), SOIL, 3.0))
    elif dim == 3:
        terms.append(mpm.Fixed(grid.facets("bottom"), "y"))
    solver = mpm.Solver(newton=mpm.Newton(1e-12))
    run = mpm.FiniteElements(grid, material, stepping, terms, solver=solver, b_bar=b_bar)
    for _ in range(3):
        run.step()
    return {"displacement": nodal(grid, run.nodal("displacement"))}


def layers(dim: int, finite: bool) -> dict:
    """Finite elements of three materials, two of which yield, on springs that a second run has."""
    grid = grid_of(dim)
    elastic = mpm.Hencky(20e6, 0.25, 1500.0) if finite else mpm.LinearElastic(20e6, 0.25, 1500.0)
    scaled = mpm.VonMises(elastic, 12e3, 6e3, 40e3, length=0.5)
    parts = (
        (mpm.VonMises(elastic, 10e3, 4e3, 50e3), lambda x: x[0] < 0.8),
        (SOIL, lambda x: (x[0] > 0.8) & (x[0] < 1.5)),
        (scaled, lambda x: x[0] > 1.5),
    )
    bodies = [mpm.MaterialPoints.fill(grid, law, 2**dim, inside) for law, inside in parts]
    pull = np.array([15e3, 9e3, 9e3])[:dim]
    terms = [
        mpm.ViscoelasticBoundary(grid.facets("bottom"), SOIL, 3.0),
        mpm.Gravity((0.0,) * (dim - 1) + (-9.81,)),
        mpm.Traction(grid.facets("left", "right"), pull),
    ]
    solver, start = mpm.Solver(newton=mpm.Newton(tolerance=1e-11)), None
    for _ in range(2):
        run = mpm.FiniteElements(grid, bodies, mpm.Newmark(0.02), terms, solver=solver, start=start)
        energy = run.record(mpm.Energy())
        run.step()
        run.step()
        start = run
    centre = 0.5 * (grid.lattice.lower + grid.lattice.upper)
    own = range(grid.owned_cells)
    stress, κ = run.stress(np.arange(grid.cells)), run.gauss_history().reshape(grid.cells, -1)
    assert grid.comm.allreduce(float(κ.max())) > 1e-5
    return {
        "displacement": nodal(grid, run.nodal("displacement")),
        "stress": {key(centre[c]): stress[c].tolist() for c in own},
        "history": {key(centre[c]): sorted(κ[c].tolist()) for c in own},
        "energy": {"": energy.values[-1].tolist()},
    }


def refusals(comm: MPI.Comm) -> dict:
    """Every rank hears of what is wrong on one."""
    out = {}
    grid = grid_of(2)
    body, _ = body_of(grid)
    if comm.rank == comm.size - 1:
        body.x[0] = 99.0
    try:
        mpm.Simulation(grid, body, mpm.Newmark(1e-4), [])
        heard = 0
    except ValueError as error:
        heard = int("outside the grid" in str(error))
    out["outside"] = {"": [comm.allreduce(heard) / comm.size]}
    try:
        body = mpm.MaterialPoints.fill(grid, SOIL, 4, lambda x: x[0] > 0.3)
        mpm.FiniteElements(grid, body, mpm.Newmark(1e-4), [])
        heard = 0
    except ValueError as error:
        heard = int("holds no material points" in str(error))
    out["empty"] = {"": [comm.allreduce(heard) / comm.size]}
    body, _ = body_of(grid)
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-4), [])
    run.step()
    if comm.rank == 0:
        body.x[0] = np.nan
    try:
        run.step()
        heard = 0
    except mpm.RunError as error:
        heard = int("step 2" in str(error))
    out["lost"] = {"": [comm.allreduce(heard) / comm.size]}
    body, _ = body_of(grid)
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-4), [])
    if comm.rank == comm.size - 1:
        body.half[:] = np.nan
        body.stretches = lambda *_: (_ for _ in ()).throw(ValueError("turns inside out"))
    try:
        run.carry()
        heard = 0
    except mpm.RunError as error:
        heard = int("inside out" in str(error))
    out["inverted"] = {"": [comm.allreduce(heard) / comm.size]}
    x = np.array([[0.5, 0.5], [1.2, 0.5], [0.5, 1.7]])
    heard = 0
    try:
        mpm.Simulation(
            grid,
            body_of(grid)[0],
            mpm.Newmark(1e-4),
            [
                mpm.Traction(
                    mpm.SurfacePoints(x, np.tile((0.0, 1.0), (3, 1)), np.ones(3)), (0.0, 1.0)
                )
            ],
        )
    except ValueError as error:
        heard = int("surface point 2" in str(error))
    out["surface outside"] = {"": [comm.allreduce(heard) / comm.size]}
    body = mpm.MaterialPoints.fill(grid, CLAY, 4)
    if comm.rank == comm.size - 1:
        body.parameters["size"][:] = 1e6
    heard = 0
    try:
        mpm.Simulation(grid, body, mpm.Newmark(1e-4), [])
    except ValueError as error:
        heard = int("size must stay below" in str(error))
    out["size"] = {"": [comm.allreduce(heard) / comm.size]}
    return out


def options(comm: MPI.Comm) -> dict:
    """Solvers of blocks and factors of other packages get their options."""
    grid, found = grid_of(2), {}
    blocks = mpm.Solver(petsc={"pc_type": "asm", "pc_asm_type": "basic", "sub_pc_type": "icc"})
    run = mpm.Simulation(grid, body_of(grid)[0], mpm.Newmark(1e-4), [], solver=blocks)
    run.step()
    inner = inside.linear_solver(run).getPC().getASMSubKSP()[0].getPC().getType()
    found["blocks"] = {"": [float(inner == "icc")]}
    if comm.size == 1:
        return {**found, "factor": {"": [1.0]}}
    run = mpm.FiniteElements(
        grid,
        SOIL,
        mpm.QuasiStatic(1),
        [mpm.Fixed(grid.facets("bottom"))],
        solver=mpm.Solver(petsc={"mat_mumps_icntl_14": 77}),
    )
    run.step()
    factor = inside.linear_solver(run).getPC().getFactorMatrix()
    return {**found, "factor": {"": [float(factor.getMumpsIcntl(14) == 77)]}}


def cases(folder: Path, comm: MPI.Comm = MPI.COMM_WORLD) -> dict[str, Callable[[], dict]]:
    """What to compute, by name."""
    dynamic, static, long = mpm.Newmark(1e-3), mpm.QuasiStatic(2), (7, 1)
    found = {"refusals": lambda: refusals(comm), "options": lambda: options(comm)}
    for name, case in {
        "Hencky, empty": (long, FINITE, dynamic, mpm.DM_GC, 1.9),
        "Hencky at points, empty": (long, FINITE, dynamic, mpm.GIMP, 1.9),
        "Hencky in statics, empty": (long, FINITE, static, mpm.DM_GC, 1.9),
        "von Mises, empty": (long, CLAY, dynamic, mpm.DM_GC, 1.9),
        "von Mises at points, empty": (long, CLAY, dynamic, mpm.GIMP, 1.9),
        "one cell": ((1, 1), FINITE, dynamic, mpm.DM_GC, 0.6),
        "two cells": ((2, 1), SOIL, dynamic, mpm.DM_GC, 1.4),
        "two cells in statics": ((2, 1), FINITE, static, mpm.DM_GC, 1.4),
        "one cell in 3D": ((1, 1, 1), SOIL, dynamic, mpm.DM_GCL, 0.6),
    }.items():
        found[name] = partial(lacking, *case, folder)
    for name, material in (
        ("one cell", SOIL),
        ("one cell, Hencky", FINITE),
        ("one cell, von Mises", CLAY),
    ):
        found[f"twin, {name}"] = lambda material=material: twin(
            2, dynamic, grid=mpm.Grid.box((0, 0), (1, 1), (1, 1)), material=material
        )
    for dim in (2, 3):
        for mapping in (mpm.MPM, mpm.GIMP, mpm.DM_GC):
            found[f"still {dim}D {mapping}"] = partial(still, dim, mapping)
            found[f"moving {dim}D {mapping}"] = partial(moving, dim, mapping)
        b_bar, ghosts = replace(mpm.DM_GC, b_bar=True), (mpm.GhostPenalty(),)
        found |= {
            f"two bodies {dim}D DM-GCL": partial(of_two_bodies, dim, mpm.DM_GCL),
            f"jitter {dim}D": partial(jittered, dim),
            f"surfaces by hand {dim}D": partial(surfaces_by_hand, dim),
            f"moving {dim}D B-bar": partial(moving, dim, b_bar),
            f"moving {dim}D GhostPenalty": partial(moving, dim, mpm.DM_GC, more=ghosts),
            f"settled {dim}D": partial(settled, dim, mpm.DM_GC),
            f"static twin {dim}D B-bar": partial(twin, dim, mpm.QuasiStatic(3), b_bar=True),
            f"layers {dim}D": partial(layers, dim, finite=dim == 2),
            f"twin {dim}D": partial(twin, dim, mpm.Newmark(1e-3)),
            f"static twin {dim}D": partial(twin, dim, mpm.QuasiStatic(3)),
        }
    return found


def everything(names: Sequence[str] = (), comm: MPI.Comm = MPI.COMM_WORLD) -> dict:
    """All of it, or what is named, on rank 0; cases by name, each a dict of quantity -> key ->
    numbers."""
    folder = Path(comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None))
    known = cases(folder, comm)
    found = {name: known[name]() for name in names or known}
    whole: dict = {}
    for part in comm.gather(found) or []:
        for case, quantities in part.items():
            for quantity, rows in quantities.items():
                whole.setdefault(case, {}).setdefault(quantity, {}).update(rows)
    return whole


if __name__ == "__main__":
    found = everything(sys.argv[2:])
    if MPI.COMM_WORLD.rank == 0:
        with open(sys.argv[1], "w") as file:
            json.dump(found, file)
