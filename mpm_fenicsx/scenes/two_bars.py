"""Two elastic bars that meet.

Exact are d'Alembert's waves.  Bars of length L meet at ±v: a stress −ρ c v at the faces for 2L/c,
after which the bars have exchanged their velocities and part at 2v.  A bar at 2v that meets one of
twice its length at rest is at rest from 2L/c on, and the other goes on with v, its end beside it at
rest as well until 4L/c.  Bars touch at t = 0, on a line of the grid or off it.  The strain is 1e-3.
Units: m, s, kg, Pa.

    run = bars("equal", DM_GC, n=20, courant=0.5)
    run.until(3 * LENGTH / C)
    [body.velocity.mean(axis=0) / (SPEED * C) for body in run.bodies], CASES["equal"][2]
"""

from __future__ import annotations

import numpy as np

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=20e6, poisson=0.0, density=1500.0)
C, LENGTH, SPEED = SOIL.p_speed, 2.5, 1e-3
CASES = {"equal": ((1, 1), (1.0, -1.0), (-1.0, 1.0)), "unequal": ((1, 2), (2.0, 0.0), (0.0, 1.0))}
"""Lengths over L, velocities over v before and, exactly, after."""


def bars(
    case: str,
    mapping: mpm.Mapping,
    n: int,
    courant: float,
    places: float = 0.0,
    gap: float = 0.0,
    speed: float = SPEED,
    radius: float | None = None,
) -> mpm.Contact:
    """Bars with ``n`` cells over L, ``gap`` cells apart and ``places`` cells off the grid's lines.

    ``radius``: of GeneralizedAlpha instead of Newmark; ``speed`` v over c.
    """
    lengths, velocities, _ = CASES[case]
    h, dt, before = LENGTH / n, courant * LENGTH / n / C, n // 2
    stepping = (
        mpm.Newmark(dt) if radius is None else mpm.GeneralizedAlpha(dt, spectral_radius=radius)
    )
    cells = (sum(lengths) + 1) * n + 4 + int(np.ceil(gap))
    grid = mpm.Grid.box((0, 0), (cells * h, h), (cells, 1))
    runs, start = [], before
    for k, length in enumerate(lengths):
        end = start + length * n
        body = mpm.MaterialPoints.fill(
            grid, SOIL, 4, inside=lambda x, a=start, b=end: (x[0] > a * h) & (x[0] < b * h)
        )
        body.x[:, 0] += (places + k * (gap - 1.0)) * h
        body.velocity = np.tile([velocities[k] * speed * C, 0.0], (len(body), 1))
        runs.append(
            mpm.Simulation(
                grid, body, stepping, [mpm.Fixed(grid.facets("bottom", "top"), "y")], mapping
            )
        )
        start = end + 1
    left, right = runs
    return mpm.Contact(
        (left, left.bodies[0].surface("right")), (right, right.bodies[0].surface("left"))
    )
