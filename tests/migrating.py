"""Scenes in which points and surfaces cross from rank to rank, as JSON keyed by the points'
numbers: ``mpiexec -n 2 python migrating.py out few``."""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np

import mpm_fenicsx as mpm
from mpm_fenicsx.common.errors import RunError, SolverError
from mpm_fenicsx.points.location import numbers_of
from mpm_fenicsx.scenes import column as paper_column
from mpm_fenicsx.scenes import foundation as paper_foundation

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
LIGHT = mpm.LinearElastic(young=2e3, poisson=0.25, density=1.0)
SOFT_SOIL = mpm.LinearElastic(young=2e5, poisson=0.25, density=1500.0)
SOFT = mpm.Hencky(young=2e5, poisson=0.25, density=1500.0)
CLAY = mpm.VonMises(mpm.Hencky(young=2e5, poisson=0.25, density=1500.0), 2e3, 1e3, 5e3)
EXACT = mpm.Solver(
    newton=mpm.Newton(tolerance=1e-12), petsc={"ksp_rtol": 1e-13, "ksp_max_it": 2000}
)


def key(x) -> str:
    return ",".join(f"{round(v, 6) + 0.0:.6f}" for v in x)


def together(comm: MPI.Comm, found: dict) -> dict:
    """What all ranks have found."""
    whole: dict = {}
    for part in comm.allgather(found):
        for quantity, rows in part.items():
            whole.setdefault(quantity, {}).update(rows)
    return whole


class Crossing:
    """How many points have come to a rank that were not there before."""

    def __init__(self):
        self.count, self.numbers = 0, None

    def attach(self, run) -> None:
        """Who is here at the start."""
        self(run)

    def __call__(self, run) -> None:
        """Who has come since."""
        now = [body.number for body in run.bodies]
        if run.grid.comm.size > 1:
            if self.numbers is not None:
                self.count += sum(
                    len(np.setdiff1d(a, b)) for a, b in zip(now, self.numbers, strict=True)
                )
            self.numbers = [number.copy() for number in now]


class Watched:
    """A run with the numbers that its points have on any number of ranks, and the places at which
    its surface points began."""

    def __init__(self, run, *surfaces: mpm.SurfacePoints):
        self.run, self.surfaces = run, surfaces
        self.numbers = [
            numbers_of(run.grid, body.x, run.grid.find(body.x))
            if body.number is None
            else body.number
            for body in run.bodies
        ]
        comm = run.grid.comm
        starts = [
            comm.allgather(list(zip(self._numbers_of(surface), surface.x.tolist(), strict=True)))
            for surface in surfaces
        ]
        self.places = [{n: x for part in parts for n, x in part} for parts in starts]
        self.crossing = run.record(Crossing())

    def _numbers_of(self, surface: mpm.SurfacePoints) -> list:
        return range(len(surface)) if surface.number is None else surface.number.tolist()

    def points(self) -> dict:
        """What points carry, by body and number."""
        found = {}
        for n, (body, own) in enumerate(zip(self.run.bodies, self.numbers, strict=True)):
            number = own if body.number is None else body.number
            for name, value in body.state().items():
                if name == "number":
                    continue
                rows = value.reshape(len(body), int(np.prod(value.shape[1:]))).astype(float)
                found.setdefault(name, {}).update(
                    {f"{n} {k}": row.tolist() for k, row in zip(number, rows, strict=True)}
                )
        return found

    def faces(self) -> dict:
        """What surface points carry, by the place where they began."""
        found = {}
        for n, (surface, start) in enumerate(zip(self.surfaces, self.places, strict=True)):
            number = self._numbers_of(surface)
            for name, value in surface.rows().items():
                if name == "number":
                    continue
                rows = value.reshape(len(surface), int(np.prod(value.shape[1:])))
                found.setdefault(f"surface {name}", {}).update(
                    {
                        f"{n} {key(start[k])}": row.tolist()
                        for k, row in zip(number, rows, strict=True)
                    }
                )
        return found

    def result(self, *probes) -> dict:
        """All of it, and whether points have crossed."""
        comm = self.run.grid.comm
        crossed = comm.allreduce(self.crossing.count) if comm.size > 1 else 1
        series = {
            f"probe {k}": {"": probe.values.ravel().tolist()} for k, probe in enumerate(probes)
        }
        return {
            **self.points(),
            **self.faces(),
            **series,
            "crossed": {"": [float(crossed > 0)]},
        }


def block(dim: int, cells: int = 4, jitter: float = 0.0, material=SOIL, per_cell=None):
    """A block, a cell or two wide, in the middle of a grid of ``cells`` along each direction."""
    grid = mpm.Grid.box((0.0,) * dim, (cells * 0.5,) * dim, (cells,) * dim)
    middle = cells * 0.25
    body = mpm.MaterialPoints.fill(
        grid,
        material,
        per_cell or 2**dim,
        lambda x: (np.abs(x - middle) < 0.5).all(axis=0),
        jitter=jitter,
        seed=3,
    )
    return grid, body, middle


def spinning(dim: int, material=SOFT, mapping=mpm.DM_GC, terms: tuple = ()) -> dict:
    """A block that turns about the corner where ranks meet, and drifts."""
    grid, body, middle = block(dim, 4 if dim == 3 else 6, 0.2, material)
    away = body.x - middle
    body.velocity = np.zeros_like(body.x)
    body.velocity[:, 0], body.velocity[:, 1] = -3.0 * away[:, 1] + 1.0, 3.0 * away[:, 0] + 0.5
    if dim == 3:
        body.velocity[:, 2] = 2.0 * away[:, 0]
    run = mpm.Simulation(grid, body, mpm.Newmark(2e-2), terms, mapping, EXACT)
    watched = Watched(run)
    probes = [
        run.record(mpm.Probe(field, (middle + 0.1,) * dim))
        for field in ("displacement", "stress", "velocity", "grid_stress")
    ]
    for _ in range(12 if dim == 2 else 6):
        run.step()
    return watched.result(*probes)


def flying(dim: int, speed: float, mapping=mpm.DM_GC) -> dict:
    """A block that crosses the grid, ``speed`` cells a step, with loads on its surfaces that go
    with it: springs, dead loads, tractions row by row."""
    across = (0.0,) * (dim - 1)
    grid = mpm.Grid.box((0.0,) * dim, (6.0,) + (1.0,) * (dim - 1), (12,) + (2,) * (dim - 1))
    body = mpm.MaterialPoints.fill(
        grid, SOFT_SOIL, 2**dim, lambda x: (x[0] > 0.75) & (x[0] < 1.75) & (x[1] < 0.75)
    )
    stepping = mpm.Newmark(2e-2)
    body.velocity = np.tile((0.5 * speed / stepping.dt, *across), (len(body), 1))
    top, side, end = body.surface("top"), body.surface("left"), body.surface("right")
    rows = 1e3 * np.sin(7.0 * top.x)
    terms = [
        mpm.Traction(top, rows),
        mpm.DeadLoad(end, lambda t, x: 1e3 * np.cos(3.0 * x)),
        mpm.ViscoelasticBoundary(side, LIGHT, 3.0),
    ]
    run = mpm.Simulation(grid, body, stepping, terms, mapping, EXACT)
    watched = Watched(run, top, side, end)
    probe = run.record(mpm.Probe("velocity", (1.25,) + (0.25,) * (dim - 1)))
    energy = run.record(mpm.Energy())
    for _ in range(int(7 / speed)):
        run.step()
    found = watched.result(probe)
    if run.grid.comm.rank == 0:
        found["energy"] = {"": energy.values.ravel().tolist()}
    return found


def by_hand(folder: Path) -> dict:
    """Surfaces that every rank is given whole, with rows for all of it, in two runs one after the
    other, the second on another grid; and pictures of both."""
    body, watched, found = None, None, {}
    x = np.array([0.6, 0.75]) + 0.05 * np.arange(8)[:, None] * [1.0, 0.0]
    faces = mpm.SurfacePoints(x, np.tile((0.0, 1.0), (8, 1)), np.full(8, 0.05), per_face=2)
    load = 1e3 * np.sin(5.0 * x)
    for lines in (np.linspace(0.0, 4.0, 9), np.linspace(-2.0, 4.0, 13)):
        grid = mpm.Grid.rectilinear([lines, np.linspace(0.0, 1.0, 3)])
        if body is None:
            body = mpm.MaterialPoints.fill(
                grid, SOFT_SOIL, 4, lambda x: (np.abs(x[0] - 0.75) < 0.25) & (x[1] < 0.75)
            )
            body.velocity = np.tile((14.0, 0.0), (len(body), 1))
        terms = [mpm.Traction(faces, load), mpm.ViscoelasticBoundary(faces, LIGHT, 3.0)]
        run = mpm.Simulation(grid, body, mpm.Newmark(2e-2), terms, mpm.DM_GC, EXACT)
        before, watched = watched, Watched(run)
        if before is not None:
            watched.numbers, watched.crossing.count = before.numbers, before.crossing.count
        shots = folder / f"by_hand_{len(lines)}"
        run.record(mpm.Snapshots(shots, every=4))
        for _ in range(6):
            run.step()
        suffix = "vtu" if grid.comm.size == 1 else "pvtu"
        assert shots.with_name(f"{shots.name}_points_000004.{suffix}").exists()
        rows = np.hstack((faces.x, faces.displacement, faces.area[:, None]))
        number = np.arange(len(faces)) if faces.number is None else faces.number
        found[f"faces {len(lines)}"] = {
            str(n): row.tolist() for n, row in zip(number, rows, strict=True)
        }
    return {**watched.result(), **found}


def lacking() -> dict:
    """A body that goes from the first of two cells to the second: ranks have one cell, or none."""
    grid = mpm.Grid.box((0.0, 0.0), (2.0, 1.0), (2, 1))
    body = mpm.MaterialPoints.fill(grid, SOFT_SOIL, 16, lambda x: (x[0] < 0.75) & (x[1] < 0.5))
    body.velocity = np.tile((10.0, 1.0), (len(body), 1))
    terms = [mpm.Traction(body.surface("top"), (1e3, 2e2))]
    run = mpm.Simulation(grid, body, mpm.Newmark(2e-2), terms, mpm.DM_GC, EXACT)
    watched = Watched(run, terms[0].on)
    probe = run.record(mpm.Probe("velocity", (0.4, 0.2)))
    for _ in range(6):
        run.step()
    return watched.result(probe)


def two_bodies(mapping=mpm.GIMP) -> dict:
    """Two bodies of different material that fly together, one of which yields."""
    grid = mpm.Grid.box((0.0, 0.0), (6.0, 1.0), (12, 2))
    halves = (lambda x: (x[0] > 0.5) & (x[0] < 1.0), lambda x: (x[0] > 1.0) & (x[0] < 2.0))
    clay = mpm.VonMises(SOIL, 2e3, 1e3, 1e4)
    bodies = [
        mpm.MaterialPoints.fill(grid, law, 4, lambda x, half=half: half(x) & (x[1] < 0.75))
        for law, half in zip((SOIL, clay), halves, strict=True)
    ]
    for n, body in enumerate(bodies):
        body.velocity = np.tile((60.0 - 0.4 * n, 0.0), (len(body), 1))
    run = mpm.Simulation(grid, bodies, mpm.Newmark(2e-3), [], mapping, EXACT)
    watched = Watched(run)
    probe = run.record(mpm.Probe("stress", (1.0, 0.3)))
    for _ in range(16):
        run.step()
    assert grid.comm.allreduce(float(bodies[1].history.max(initial=0.0)), op=MPI.MAX) > 0.0
    return watched.result(probe)


class Halving(mpm.Simulation):
    """A run whose whole steps, and parts of them that ``fails`` names, are not solved."""

    fails = ()

    def attempt(self, start: float, end: float, stepping) -> None:
        """Fail where asked to, after points have been located."""
        super().attempt(start, end, stepping)
        part = (start - self.time) / self.stepping.dt, (end - self.time) / self.stepping.dt
        if any(np.allclose(part, bad) for bad in ((0.0, 1.0), *self.fails)):
            raise SolverError("asked to fail")


def halved(folder: Path) -> dict:
    """Steps in halves, between which points cross; one that fails in its last part is taken back;
    and the run of a checkpoint goes on bit for bit."""

    def scene():
        grid = mpm.Grid.box((0.0, 0.0), (4.0, 1.0), (8, 2))
        body = mpm.MaterialPoints.fill(
            grid, SOFT, 4, lambda x: (np.abs(x[0] - 1.25) < 0.7) & (np.abs(x[1] - 0.5) < 0.3)
        )
        body.velocity = np.tile((12.0, 0.0), (len(body), 1))
        terms = [mpm.ViscoelasticBoundary(body.surface("bottom"), LIGHT, 3.0)]
        run = Halving(grid, body, mpm.Newmark(2e-2), terms, mpm.DM_GC, EXACT)
        return run, run.record(mpm.Probe("displacement", (1.2, 0.4)))

    run, probe = scene()
    watched = Watched(run)
    run.record(mpm.Checkpoint(folder / "halved", every=3))
    for _ in range(4):
        run.step()
    before = together(run.grid.comm, watched.points())
    whole = {name: value.copy() for name, value in run.state().items()}
    Halving.fails = ((0.5, 1.0), (0.75, 1.0), (0.875, 1.0), (0.9375, 1.0))
    try:
        run.step()
        heard = 0
    except RunError as error:
        heard = int("step 5" in str(error))
    Halving.fails = ()
    assert heard and together(run.grid.comm, watched.points()) == before
    found = watched.result(probe)
    again, second = scene()
    again.restart(folder / "halved")
    again.step()
    assert all(np.array_equal(value, whole[name]) for name, value in again.state().items())
    assert np.array_equal(second.values, probe.values)
    run.step()
    again.step()
    after = run.state()
    assert all(np.array_equal(value, after[name]) for name, value in again.state().items())
    return found


def lost() -> dict:
    """A point that leaves the grid on one rank stops all, and so does a face of a surface."""
    grid = mpm.Grid.box((0.0, 0.0), (4.0, 1.0), (8, 2))
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, lambda x: x[0] > 3.0)
    body.velocity = np.tile((100.0, 0.0), (len(body), 1))
    run, heard = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], mpm.GIMP), 0
    try:
        for _ in range(12):
            run.step()
    except RunError as error:
        heard = int("outside the grid" in str(error))
    comm = grid.comm
    return {"heard": {"": [comm.allreduce(heard) / comm.size]}, "crossed": {"": [1.0]}}


def column(base: str, cell: float, step: float, until: float) -> dict:
    """The paper's column at 300 kPa."""
    run = paper_column.material_points(base, paper_column.peak, cell=cell, step=step, solver=EXACT)
    watched = Watched(run)
    probe = run.record(mpm.Probe("stress", (0.5, 10.0)))
    run.until(until)
    return watched.result(probe)


def foundation(boundary: str, cell: float, steps: int) -> dict:
    """The paper's foundation at 36 kPa, of finite strain."""
    law = mpm.VonMises(mpm.Hencky(2e6, 0.41, 1000.0), 10e3, 3e3, 50e3)
    scene = paper_foundation.Foundation(
        boundary, load=36e3, cell=cell, law=law, loading=mpm.DeadLoad
    )
    rows = round(8.0 / cell)  # so high that ranks meet under the strip
    grid = mpm.Grid.box((-0.5, -0.5), (6.5, 7.5), (round(7.0 / cell), rows))

    def lowered(grid, body, stepping, terms, mapping, **options):
        """Points a hair over grid lines: the strip presses them through."""
        for thing in {id(thing): thing for thing in (body, *(t.on for t in terms))}.values():
            thing.x[:, 1] -= 0.245 * cell
        return mpm.Simulation(grid, body, stepping, terms, mapping, **options)

    run = scene.material_points(grid=grid, kind=lowered, solver=EXACT)
    watched = Watched(run)
    probe = run.record(mpm.Probe("stress", paper_foundation.point_1))
    for _ in range(steps):
        run.step()
    return watched.result(probe)


def collapse(steps: int) -> dict:
    """A column of soft clay that collapses under its weight, of finite strain."""
    grid = mpm.Grid.box((0.0, 0.0), (5.0, 2.5), (20, 10))
    body = mpm.MaterialPoints.fill(grid, CLAY, 4, lambda x: (x[0] < 1.0) & (x[1] < 2.0))
    terms = [
        mpm.Gravity((0.0, -9.81)),
        mpm.Fixed(grid.facets("left"), "x"),
        mpm.Fixed(grid.facets("bottom")),
    ]
    run = mpm.Simulation(grid, body, mpm.Newmark(5e-3), terms, mpm.DM_GC, EXACT)
    watched = Watched(run)
    probe = run.record(mpm.Probe("displacement", (0.8, 1.6)))
    for _ in range(steps):
        run.step()
    return watched.result(probe)


def few(folder: Path) -> dict:
    """Scenes of a second or two each."""
    return {
        "spinning 2D": lambda: spinning(2),
        "spinning 2D, linear": lambda: spinning(2, SOIL, mpm.GIMP),
        "spinning 3D": lambda: spinning(3, SOIL, mpm.DM_GCL),
        "flying 2D": lambda: flying(2, 0.4),
        "flying 2D, far jumps": lambda: flying(2, 3.5, mpm.GIMP),
        "flying 3D": lambda: flying(3, 0.7, mpm.DM_GC),
        "spinning 2D, Hencky at points": lambda: spinning(2, SOFT, mpm.GIMP),
        "spinning 2D, B-bar": lambda: spinning(
            2, SOFT_SOIL, replace(mpm.DM_GC, b_bar=True), (mpm.GhostPenalty(),)
        ),
        "two bodies": two_bodies,
        "two bodies, double mapping": lambda: two_bodies(mpm.DM_GC),
        "by hand": lambda: by_hand(folder),
        "two cells": lacking,
        "halved": lambda: halved(folder),
        "lost": lost,
    }


def long(folder: Path) -> dict:
    """The paper's scenes, and a collapse."""
    return {
        **{
            f"column, {base}": lambda base=base: column(base, 0.5, 4e-3, 1.0)
            for base in paper_column.BASES
        },
        **{
            f"foundation, {boundary}": lambda boundary=boundary: foundation(boundary, 0.5, 185)
            for boundary in ("viscous", "viscoelastic")
        },
        "collapse": lambda: collapse(200),
    }


def everything(which: str = "few", names: tuple = (), comm: MPI.Comm = MPI.COMM_WORLD) -> dict:
    """All of it, on rank 0; cases by name, each a dict of quantity -> key -> numbers."""
    folder = Path(comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None))
    cases = {"few": few, "long": long}[which](folder)
    found = {name: make() for name, make in cases.items() if not names or name in names}
    whole: dict = {}
    for part in comm.gather(found) or []:
        for case, quantities in part.items():
            for quantity, rows in quantities.items():
                whole.setdefault(case, {}).setdefault(quantity, {}).update(rows)
    return whole


if __name__ == "__main__":
    out, which, *names = sys.argv[1:]
    found = everything(which, tuple(names))
    if MPI.COMM_WORLD.rank == 0:
        with open(out, "w") as file:
            json.dump(found, file)
