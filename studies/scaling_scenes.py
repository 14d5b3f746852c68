"""Scenes of ``scaling``: an elastic block of any number of cells, at rest or sliding, and a column
of soft clay that collapses on a slope.  Units: m, s, kg, Pa."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.pressed_block import pulse, soil

H = 0.0625  # m, a cell of the block
SPEED = 0.1  # of a cell that the sliding block moves in a step
ROOM = 12  # cells that it has for that
CLAY = 20e3 / np.sqrt(3)  # Pa, yield stress in shear
SLOPE, G = -0.25, 10.0  # of the ground, down to the left; m/s²
STEP = 0.01  # s, of the collapse
LENGTH, HEIGHT = 40.0, 10.0  # of the grid of the collapse
COLUMN = (14.0, 22.0, 8.0)  # its sides and its top: three quarters lie in the left half of the grid
JACOBI = {"pc_type": "jacobi", "ksp_max_it": 600}


def block(
    dim: int, counts: Sequence[int], sliding: bool = False, jacobi: bool = False
) -> mpm.Simulation:
    """A block of ``counts`` cells, 2^dim points each, under a pulse on the middle third of its top,
    at Courant number 1; base fixed and rollers at the sides, or ``sliding`` along on rollers.

    ``jacobi``: with the preconditioner that several ranks take.
    """
    room = ROOM if sliding else 0
    lower = [-2.0 * H * (sliding and d == 0) for d in range(dim)]
    number = [n + room * (d == 0) + (d == 1) for d, n in enumerate(counts)]
    upper = [low + H * n for low, n in zip(lower, number, strict=True)]
    length, top = H * counts[0], H * counts[1]
    grid = mpm.Grid.box(lower, upper, number)
    body = mpm.MaterialPoints.fill(
        grid, soil, 2**dim, inside=lambda x: (x[0] > 0.0) & (x[0] < length) & (x[1] < top)
    )
    stepping = mpm.Newmark(H / soil.p_speed)
    strip = body.surface("top", where=lambda x: np.abs(x[0] - length / 2) < length / 6 + 1e-9)
    terms = [
        mpm.Traction(strip, lambda t: tuple(-pulse(t) * (d == 1) for d in range(dim))),
        *([mpm.Fixed(grid.facets("back", "front"), "z")] if dim == 3 else []),
    ]
    if sliding:
        body.velocity = np.tile(SPEED * H / stepping.dt * np.eye(dim)[0], (len(body), 1))
        terms += [mpm.Fixed(grid.facets("bottom"), "y")]
    else:
        terms += [mpm.Fixed(grid.facets("bottom")), mpm.Fixed(grid.facets("left", "right"), "x")]
    solver = mpm.Solver(petsc=JACOBI) if jacobi else None
    return mpm.Simulation(grid, body, stepping, terms, solver=solver)


def collapse(cell: float, repartition: mpm.Repartition | None) -> mpm.Simulation:
    """A column that runs out downhill on a rough base; ``cell`` in m."""
    left, right, top = COLUMN
    grid = mpm.Grid.box((0.0, 0.0), (LENGTH, HEIGHT), (round(LENGTH / cell), round(HEIGHT / cell)))
    law = mpm.VonMises(mpm.Hencky(1e6, 0.3, 1000.0), CLAY, CLAY, 0.0)
    body = mpm.MaterialPoints.fill(
        grid, law, 4, inside=lambda x: (x[0] > left) & (x[0] < right) & (x[1] < top)
    )
    down = np.array([SLOPE, -1.0]) / np.hypot(SLOPE, 1.0)
    terms = [mpm.Fixed(grid.facets("bottom")), mpm.Gravity(tuple(G * down))]
    return mpm.Simulation(grid, body, mpm.Newmark(STEP), terms, repartition=repartition)
