"""A strip on an elastic block, in plane strain or 3D, of any fineness: a scene for clocks, without
an exact answer; material points are compared with their finite element twin.

6 m × 4 m in plane strain, 6 m × 3 m × 3 m in 3D; base fixed, rollers at the sides, a half-sine of
26 kPa on 1 m (1 m²) of the top; 2^dim points a cell; the Courant number of the foundation in
``scenes.foundation``.  Units: m, s, kg, Pa.

    run = material_points(2, 0.125)
    run.until(0.2)
"""

from __future__ import annotations

import numpy as np

import mpm_fenicsx as mpm

soil = mpm.LinearElastic(young=2e6, poisson=0.41, density=1000.0)
BODY = {2: (6.0, 4.0), 3: (6.0, 3.0, 3.0)}  # m
COURANT = soil.p_speed * 5e-3 / 0.0625  # 5.5


def pulse(t):
    """Pressure (Pa) at times t (s)."""
    return 26e3 * np.sin(np.pi * t / 0.2) * (t < 0.2)


def under_strip(x):
    """Whether x lies within 1 m around the middle of the top."""
    return np.all(
        [np.abs(x[d] - BODY[len(x)][d] / 2) < 0.5 + 1e-9 for d in range(len(x)) if d != 1], axis=0
    )


def terms(dim: int, surface, grid: mpm.Grid) -> list:
    """Boundaries and the pulse."""

    def pressure(t):
        return tuple(-pulse(t) if d == 1 else 0.0 for d in range(dim))

    depth = [mpm.Fixed(grid.facets("back", "front"), "z")] if dim == 3 else []
    return [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        *depth,
        mpm.Fixed(grid.facets("bottom")),
        mpm.Traction(surface, pressure),
    ]


def counts(dim: int, cell: float) -> list[int]:
    """Cells of the body in each direction."""
    return [round(length / cell) for length in BODY[dim]]


def step_of(cell: float) -> mpm.Newmark:
    """Newmark at the Courant number of the scene."""
    return mpm.Newmark(COURANT * cell / soil.p_speed)


def finite_elements(dim: int, cell: float, **options) -> mpm.FiniteElements:
    """The twin; ``options`` of ``FiniteElements``."""
    body = BODY[dim]
    grid = mpm.Grid.box(
        [0.0] * dim,
        body,
        counts(dim, cell),
        facets={"strip": lambda x: under_strip(x[:dim]) & (np.abs(x[1] - body[1]) < 1e-9)},
    )
    scene = terms(dim, grid.facets("strip"), grid)
    return mpm.FiniteElements(grid, soil, step_of(cell), scene, **options)


def material_points(
    dim: int, cell: float, mapping: mpm.Mapping = mpm.DM_GC, empty: int = 1, **options
) -> mpm.Simulation:
    """Material points; ``empty``: rows of cells above the body; ``options`` of ``Simulation``."""
    body, number = BODY[dim], counts(dim, cell)
    number[1] += empty
    upper = [length + (d == 1) * empty * cell for d, length in enumerate(body)]
    grid = mpm.Grid.box([0.0] * dim, upper, number)
    points = mpm.MaterialPoints.fill(grid, soil, 2**dim, inside=lambda x: x[1] < body[1])
    strip = points.surface("top", where=under_strip)
    return mpm.Simulation(grid, points, step_of(cell), terms(dim, strip, grid), mapping, **options)
