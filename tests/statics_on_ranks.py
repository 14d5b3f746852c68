"""Bodies at rest on one rank or several, and set free, as JSON: ``mpiexec -n 2 python
statics_on_ranks.py out``.

What fixed edges bore is given by the surfaces' places, what points carry by their numbers.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from migrating import EXACT, Watched, key
from ranks import nodal

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.slope import AtRest

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
WEAK = mpm.VonMises(SOIL, peak=6e3, residual=4e3, softening=20e3)
G = 9.81
WALLS = {2: {"left": "x", "right": "x"}, 3: {"left": "x", "right": "x", "bottom": "y", "top": "y"}}
BASE = {2: "bottom", 3: "back"}
SPEED = G * 1.5 / SOIL.p_speed  # m/s: of a wave that takes all the weight off a base
COMM = MPI.COMM_WORLD


def fastest(run) -> float:
    """Largest velocity (m/s) of all ranks' points."""
    here = max(np.abs(body.velocity).max(initial=0.0) for body in run.bodies)
    return COMM.allreduce(float(here), op=MPI.MAX)


def tractions(terms) -> dict:
    """Tractions of surface points, by their places."""
    return {
        f"{n} {key(x)}": row.tolist()
        for n, term in enumerate(terms)
        for x, row in zip(term.on.x, term.on.of_given(term.value), strict=True)
    }


def boxed(dim: int, room: float, h: float = 0.5) -> mpm.Grid:
    """A grid around a column of 1 m × 1.5 m, with ``room`` (m) beside and below."""
    lower, upper = [-room] * dim, [1.0 + room] * (dim - 1) + [1.5 + 2 * h]
    return mpm.Grid.box(
        lower, upper, [round((b - a) / h) for a, b in zip(lower, upper, strict=True)]
    )


def column(dim: int, mapping, h: float = 0.5, shift: float = 0.0, soil=SOIL) -> dict:
    """A column settles under its weight; ``shift`` (m) aside, and over ranks' borders, it hangs in
    its reactions and dashpots, in 2D twice, and the last time it bears a load besides."""
    grid = boxed(dim, 0.0, h)
    gravity = mpm.Gravity((0.0,) * (dim - 1) + (-G,))
    edges = {BASE[dim]: None, **WALLS[dim]}
    body = mpm.MaterialPoints.fill(grid, soil, 2**dim, inside=lambda x: x[-1] < 1.5)
    fixed = [mpm.Fixed(grid.facets(side), axes) for side, axes in edges.items()]
    solver = mpm.Solver(newton=mpm.Newton(tolerance=1e-12))
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(2), [gravity, *fixed], mapping, solver)
    numbers = Watched(run).numbers
    run.until(1.0)
    assert run.settle() <= 1e-10
    own = grid.space.dofmap.index_map.size_local
    borne = run.balance()[0].reshape(-1, dim)
    weight = COMM.allreduce(float(body.mass.sum())) * G
    assert not borne[own:].any()
    assert abs(abs(COMM.allreduce(float(borne[:, -1].sum())) / weight) - 1.0) < 1e-9
    surfaces = [body.surface(side) for side in edges]
    carried = run.reactions(*surfaces)
    found = {"tractions": tractions(carried), "borne": nodal(grid, borne)}
    for thing in (body, *surfaces):
        thing.x += shift * np.array([1.0] + [0.0] * (dim - 2) + [-1.0])
    for load in (0.0, 0.0, 1e3) if dim == 2 else (0.0, 1e3):
        grid = boxed(dim, 1.5, h)
        terms = [gravity, *carried, *(mpm.ViscousBoundary(s, SOIL) for s in surfaces)]
        terms += [mpm.Traction(surfaces[1], (load,) + (0.0,) * (dim - 1))] if load else []
        run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), terms, mapping, EXACT)
        watched = Watched(run, *surfaces)
        watched.numbers = numbers
        for _ in range(3):
            run.step()
        if not load:
            assert fastest(run) < 1e-9 * SPEED
    assert fastest(run) > 1e-3 * SPEED
    return {**watched.points(), **watched.faces(), **found}


def slope(mapping, soil=SOIL) -> dict:
    """A slope whose surface cuts cells, so that light nodes are tied, settles and is set free."""
    rest = AtRest("slope", 0.15, mapping, soil)
    assert abs(rest.borne()[1] - 1.0) < 1e-9
    numbers = Watched(rest.static).numbers
    run = rest.release()
    carried = [term for term in run.terms if isinstance(term, mpm.Traction)]
    found = tractions(carried)
    for _ in range(6):
        run.step()
    assert rest.fastest() < 1e-7
    watched = Watched(run)
    watched.numbers = numbers
    points = watched.points()
    return {"tractions": found, **{name: points[name] for name in ("x", "stress")}}


def elements(dim: int) -> dict:
    """The same of finite elements, with facets."""
    lines = [np.array([0.0, 0.3, 0.7, 1.0])] * (dim - 1) + [np.array([0.0, 0.4, 1.0, 1.5])]
    grid = mpm.Grid.rectilinear(lines)
    edges = {BASE[dim]: None, **WALLS[dim]}
    fixed = [mpm.Fixed(grid.facets(side), axes) for side, axes in edges.items()]
    gravity = mpm.Gravity((0.0,) * (dim - 1) + (-G,))
    rest = mpm.FiniteElements(grid, SOIL, mpm.QuasiStatic(1), [gravity, *fixed])
    rest.step()
    assert rest.settle() <= 1e-10
    surfaces = [grid.facets(side) for side in edges]
    carried = rest.reactions(*surfaces)
    found = {"borne": nodal(grid, rest.balance()[0].reshape(-1, dim))}
    dashpots = [mpm.ViscousBoundary(surface, SOIL) for surface in surfaces]
    total = [
        COMM.allreduce(fem.assemble_scalar(fem.form(term.value[c] * term.on.measure)))
        for term in carried
        for c in range(dim)
    ]
    for load in (0.0, 1e3):
        terms = [gravity, *carried, *dashpots]
        terms += [mpm.Traction(surfaces[1], (load,) + (0.0,) * (dim - 1))] if load else []
        run = mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-3), terms, start=rest, solver=EXACT)
        for _ in range(5):
            run.step()
        speed = COMM.allreduce(float(np.abs(run.nodal("velocity")).max(initial=0.0)), op=MPI.MAX)
        assert (speed > 1e-3 * SPEED) if load else (speed < 1e-9 * SPEED)
    return {**found, "total": {"": total}, "velocity": nodal(grid, run.nodal("velocity"))}


def elements_of_bodies() -> dict:
    """Finite elements of bodies that were made on another grid, other parts of which ranks have."""
    bodies_on, grid = (
        mpm.Grid.box((-4.0, 0.0), (2.0, 1.0), (12, 2)),
        mpm.Grid.box((0.0, 0.0), (2.0, 1.0), (4, 2)),
    )
    bodies = [
        mpm.MaterialPoints.fill(
            bodies_on, law, 4, lambda x, low=low: (x[0] > low) & (x[0] < low + 1.0)
        )
        for low, law in ((0.0, SOIL), (1.0, WEAK))
    ]
    before = [body.x.copy() for body in bodies]
    terms = [mpm.Fixed(grid.facets("bottom")), mpm.Traction(grid.facets("top"), (1e3, 0.0))]
    run = mpm.FiniteElements(grid, bodies, mpm.Newmark(5e-3), terms, solver=EXACT)
    run.step()
    assert all(np.array_equal(body.x, x) for body, x in zip(bodies, before, strict=True))
    return {"displacement": nodal(grid, run.nodal("displacement"))}


def given_acceleration() -> dict:
    """An acceleration that is given to points on one rank alone is that of the whole body."""
    grid = boxed(2, 0.0)
    body = mpm.MaterialPoints.fill(grid, SOIL, 4)
    terms = [mpm.Fixed(grid.facets("bottom")), mpm.Gravity((0.0, -G))]
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), terms, mpm.DM_GC, EXACT)
    watched = Watched(run)
    body.acceleration[:, 0] = np.where(body.x[:, 1] > 2.0, 1.0, 0.0)
    run.step()
    return watched.points()


def points_by_hand() -> dict:
    """Points that every rank is given whole, one of them twice, count once, and twice; and so they
    do in a second run on another grid."""
    rng, grid = np.random.default_rng(5), boxed(2, 0.0)
    x = rng.uniform(0.1, 0.9, (40, 2)) * [1.0, 1.5]
    x[1] = x[0]
    half = np.full_like(x, 0.05)
    body = mpm.MaterialPoints(SOIL, x, half, (2.0 * half).prod(axis=1))
    body.velocity = 1e-2 * np.sin(x)
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [], mpm.DM_GC, EXACT)
    watched = Watched(run)
    numbers = watched.numbers
    run.step()
    mass = COMM.allreduce(float(body.mass.sum()))
    run = mpm.Simulation(boxed(2, 1.5), body, mpm.Newmark(1e-3), [], mpm.DM_GC, EXACT)
    watched = Watched(run)
    watched.numbers = numbers
    run.step()
    return {**watched.points(), "mass": {"": [mass]}}


def refused() -> dict:
    """What cannot be is refused on all ranks, wherever it is seen."""
    grid = boxed(2, 0.0)
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: x[1] < 1.5)
    fixed = [mpm.Fixed(grid.facets("bottom")), mpm.Fixed(grid.facets("left", "right"), "x")]
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(1), [mpm.Gravity((0.0, -G)), *fixed])
    run.step()
    run.settle()
    elements = mpm.FiniteElements(grid, SOIL, mpm.QuasiStatic(1), fixed)
    elements.step()
    few = mpm.SurfacePoints(np.array([[0.3, 0.0]]), np.array([[0.0, -1.0]]), np.array([1.0]))
    wanted = {
        "on no fixed edge": lambda: run.reactions(body.surface("bottom"), body.surface("top")),
        "too few": lambda: run.reactions(few),
        "meet in a corner": lambda: elements.reactions(grid.facets("bottom", "left")),
        "all be surface points": lambda: run.reactions(few, grid.facets("bottom")),
    }
    heard = []
    for words, call in wanted.items():
        try:
            call()
            heard.append(0)
        except ValueError as error:
            heard.append(int(words in str(error)))
    return {"heard": {"": [COMM.allreduce(n) / COMM.size for n in heard]}}


@dataclass(frozen=True)
class Failing(mpm.OnElastic):
    """A law that the last rank alone cannot ask once it is ``armed``, or not at the end of a
    step."""

    elastic: mpm.LinearElastic
    at_end: bool = False

    armed = False

    def _look(self) -> None:
        if Failing.armed and COMM.rank == COMM.size - 1:
            raise KeyError("void ratio")

    def tangent(self, strain, stress, history, given=()):
        """That of the elastic soil."""
        if not self.at_end:
            self._look()
        D = np.tile(mpm.stiffness(self.lame, 2), (len(strain), 1, 1))
        return mpm.hooke(self.lame, strain, stress), history, D

    def respond(self, strain, stress, history, given=()):
        """The same without the tangent."""
        if self.at_end:
            self._look()
        return mpm.hooke(self.lame, strain, stress), history

    def plastic_work(self, history, given=()):
        """None (n,), J/m³."""
        return np.zeros(len(history))


def on_the_last_rank(x: np.ndarray) -> np.ndarray:
    """A function of places that raises on one rank."""
    if COMM.rank == COMM.size - 1:
        raise ZeroDivisionError("no such place")
    return x[0] < np.inf


FINITE = mpm.Hencky(young=2e5, poisson=0.25, density=1500.0)
LAWS = {
    "double-mapped": (SOIL, mpm.DM_GC),
    "at points, of finite strain": (FINITE, mpm.GIMP),
    "in elements": (SOIL, None),
    "at points": (SOIL, mpm.GIMP),
    "double-mapped, of finite strain": (FINITE, mpm.DM_GC),
    "in elements, of finite strain": (FINITE, None),
}
"""Elastic soils, and mappings or None for finite elements: in each laws are asked elsewhere."""


def failing(laws: tuple) -> dict:
    """What raises on one rank, whatever the error, stops all: laws, functions of places and loads;
    and contact is refused before the first step."""
    grid, heard = boxed(2, 0.0), {}
    fixed = [mpm.Fixed(grid.facets("bottom")), mpm.Gravity((0.0, -G))]

    def body(law=SOIL, **more) -> mpm.MaterialPoints:
        return mpm.MaterialPoints.fill(grid, law, 4, **more)

    def listen(name: str, words: str, call) -> None:
        try:
            call()
            heard[name] = 0
        except Exception as error:
            heard[name] = int(words in str(error))

    for name in laws:
        elastic, mapping = LAWS[name]
        for at_end in (False, True):
            law, stepping = Failing(elastic, at_end), mpm.Newmark(1e-3)
            Failing.armed = False
            if mapping is None:
                run = mpm.FiniteElements(grid, law, stepping, fixed)
            else:
                run = mpm.Simulation(grid, body(law), stepping, fixed, mapping)
            run.step()
            Failing.armed = True
            listen(f"{name} {at_end}", "void ratio", run.step)
    Failing.armed = False
    listen(
        "facets",
        "no such place",
        lambda: mpm.Grid.box((0, 0), (2, 1), (4, 2), {"a": on_the_last_rank}),
    )
    listen("inside", "no such place", lambda: body(inside=on_the_last_rank))
    listen(
        "parameters",
        "no such place",
        lambda: body(Failing(SOIL), parameters={"e": on_the_last_rank}),
    )
    load = mpm.Traction(grid.facets("top"), lambda t, x: 1e3 * x * on_the_last_rank(x) if t else x)
    run = mpm.Simulation(grid, body(), mpm.Newmark(1e-3), [*fixed, load])
    listen("load", "no such place", run.step)
    if COMM.size > 1:
        runs = [mpm.Simulation(grid, body(), mpm.Newmark(1e-3), fixed) for _ in range(2)]
        pairs = [(run, run.bodies[0].surface("top")) for run in runs]
        listen(
            "contact",
            f"Contact runs on one rank, and here are {COMM.size}",
            lambda: mpm.Contact(*pairs),
        )
    return {"heard": {"": [COMM.allreduce(sum(heard.values())) / (COMM.size * len(heard))]}}


CASES = {
    "column 2D": lambda: column(2, mpm.DM_GC, 0.25, shift=1.0),
    "column 2D, GIMP": lambda: column(2, mpm.GIMP, shift=0.5),
    "block 3D": lambda: column(3, mpm.DM_GC, shift=0.5),
    "slope": lambda: slope(mpm.DM_GC),
    "slope, von Mises": lambda: slope(mpm.DM_GC, WEAK),
    "elements 2D": lambda: elements(2),
    "elements 3D": lambda: elements(3),
    "elements of bodies": elements_of_bodies,
    "given acceleration": given_acceleration,
    "points by hand": points_by_hand,
    "refused": refused,
    "failing": lambda: failing(tuple(LAWS)[:3]),
    "failing in other places": lambda: failing(tuple(LAWS)[3:]),
}


def everything(names: tuple = tuple(CASES)) -> dict:
    """All of it, on rank 0; cases by name, each a dict of quantity -> key -> numbers."""
    whole: dict = {}
    for part in COMM.gather({name: CASES[name]() for name in names}) or []:
        for case, quantities in part.items():
            for quantity, rows in quantities.items():
                whole.setdefault(case, {}).setdefault(quantity, {}).update(rows)
    return whole


if __name__ == "__main__":
    out, *names = sys.argv[1:]
    found = everything(tuple(names) or tuple(CASES))
    if COMM.rank == 0:
        with open(out, "w") as file:
            json.dump(found, file)
