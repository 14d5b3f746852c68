"""Bars and blocks on which nothing acts, free all round, between rollers or on dashpots.

Exact: they keep their momentum and, without dashpots, their energy, so that of the linear map of a
step no eigenvalue is larger than 1; in ``stressed_bar`` the stress stays what it is.  In cells of
0.25 m, four points each.  Units: m, s, kg, Pa.

    run = block(DM_GC, step_of(0.5))
    run.bodies[0].velocity[:, 0] = 1e-3
    run.until(100 * run.stepping.dt)
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import mpm_fenicsx as mpm

FACTOR = mpm.Solver(petsc={"ksp_type": "preonly", "pc_type": "lu"})
soil, h = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0), 0.25


def step_of(courant: float, material=soil) -> mpm.Newmark:
    """Newmark at a Courant number of the P wave."""
    return mpm.Newmark(courant * h / material.p_speed)


def at_rest(body: mpm.MaterialPoints) -> mpm.MaterialPoints:
    """The body with velocity and acceleration of its own, zero, so that no run takes a start for
    it."""
    body.velocity, body.acceleration = np.zeros_like(body.x), np.zeros_like(body.x)
    return body


def run_of(grid, body, stepping, terms, mapping) -> mpm.Simulation:
    """A run in which every node is on its own, and matrices are factored in full."""
    return mpm.Simulation(
        grid, body, stepping, terms, replace(mapping, hold_cut_cells=False), solver=FACTOR
    )


def bar(
    mapping: mpm.Mapping,
    stepping: mpm.Newmark,
    cells: int = 12,
    fixed: bool = False,
    viscous: bool = False,
    offset: float = 0.0,
    material: mpm.LinearElastic = soil,
    before: int = 2,
    after: int = 2,
) -> mpm.Simulation:
    """A bar between rollers, its left end free, fixed or on dashpots, ``offset`` cells off the grid
    lines.

    ``before``, ``after``: cells of room at its ends; where it is fixed, there is none before.
    """
    before = 0 if fixed else before
    grid = mpm.Grid.box((-before * h, 0), ((cells + after) * h, h), (cells + after + before, 1))
    body = at_rest(
        mpm.MaterialPoints.fill(grid, material, 4, inside=lambda x: (x[0] > 0) & (x[0] < cells * h))
    )
    body.x[:, 0] += offset * h
    terms = [mpm.Fixed(grid.facets("bottom", "top"), "y")]
    terms += [mpm.Fixed(grid.facets("left"), "x")] if fixed else []
    terms += [mpm.ViscousBoundary(body.surface("left"), material)] if viscous else []
    return run_of(grid, body, stepping, terms, mapping)


def block(
    mapping: mpm.Mapping,
    stepping: mpm.Newmark,
    cells: tuple[int, int] = (4, 3),
    viscous: bool = False,
    offset: float = 0.0,
    material: mpm.LinearElastic = soil,
) -> mpm.Simulation:
    """A block, free all round or on dashpots, ``offset`` cells off the grid lines both ways."""
    nx, ny = cells
    grid = mpm.Grid.box((-2 * h, -2 * h), ((nx + 3) * h, (ny + 3) * h), (nx + 5, ny + 5))
    body = at_rest(
        mpm.MaterialPoints.fill(
            grid,
            material,
            4,
            inside=lambda x: ((x > 0) & (x.T < np.array(cells) * h).T).all(axis=0),
        )
    )
    body.x += offset * h
    terms = [mpm.ViscousBoundary(body.surface("bottom"), material)] if viscous else []
    return run_of(grid, body, stepping, terms, mapping)


def stressed_bar(
    mapping: mpm.Mapping,
    stepping: mpm.Newmark,
    stress: float,
    steps: int,
    cells: int = 20,
    moves: float = 0.3,
    disturbed: float = 0.0,
) -> mpm.Simulation:
    """A bar between rollers under a uniform pressure ``stress`` (Pa) that its ends bear, on its way
    over ``moves`` cells a step, with room for so many ``steps``.

    ``disturbed``: amplitude, over ``stress``, of the third wave along the bar, as velocities.
    """
    before, length = 2, cells * h
    count = int(moves * steps) + cells + 6
    grid = mpm.Grid.box((-before * h, 0), ((count - before) * h, h), (count, 1))
    body = mpm.MaterialPoints.fill(grid, soil, 4, inside=lambda x: (x[0] > 0) & (x[0] < length))
    body.stress[:, :3] = -stress * np.array([1.0, 1 / 3, 1 / 3])
    wave = disturbed * stress / (soil.density * soil.p_speed)
    wave = wave * np.cos(3 * np.pi * body.x[:, 0] / length)
    body.velocity = np.stack((moves * h / stepping.dt + wave, 0.0 * wave), axis=1)
    terms = [mpm.Fixed(grid.facets("bottom", "top"), "y")]
    terms += [
        mpm.Traction(body.surface(side), (push, 0.0))
        for side, push in (("left", stress), ("right", -stress))
    ]
    return mpm.Simulation(grid, body, stepping, terms, mapping)
