"""The strip on an elastic block, for clocks: any grid, any mapping, and the finite element twins.

6 m × 4 m in plane strain, 6 m × 3 m × 3 m in 3D; base fixed, rollers at the sides, a half-sine of
26 kPa on 1 m (1 m²) of the top; 2^dim points a cell; the paper's Courant number.
"""

from __future__ import annotations

import numpy as np

from mpm_fenicsx import (
    DM_G,
    DM_GC,
    MPM,
    FiniteElements,
    Fixed,
    Grid,
    LinearElastic,
    MaterialPoints,
    Newmark,
    Probe,
    Simulation,
    Traction,
)

soil = LinearElastic(young=2e6, poisson=0.41, density=1000.0)
BODY = {2: (6.0, 4.0), 3: (6.0, 3.0, 3.0)}  # m
CELLS = {2: (0.125, 0.0625, 0.03125, 0.015625), 3: (0.375, 0.25, 0.1875)}  # m
COURANT = soil.p_speed * 5e-3 / 0.0625  # 5.5
REUSE = "DM-GC, reuse"
MAPPINGS = {
    **{m.name: {"mapping": m} for m in (MPM, DM_G, DM_GC)},
    REUSE: {"mapping": DM_GC, "reuse": 1e-3},
}
CHOLESKY = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
    "ksp_diagonal_scale": False,
    "ksp_diagonal_scale_fix": False,
}
TWINS = {
    "FE": {"reassemble": True},
    "FE, Cholesky": {"reassemble": True, "solver": CHOLESKY},
    "FE, frozen": {"reassemble": False},
}
METHODS = (*MAPPINGS, *TWINS)


def under_strip(x):
    """Whether x lies within 1 m around the middle of the top."""
    return np.all(
        [np.abs(x[d] - BODY[len(x)][d] / 2) < 0.5 + 1e-9 for d in range(len(x)) if d != 1], axis=0
    )


def terms(dim: int, surface, grid: Grid) -> list:
    """Boundaries and the pulse."""

    def pressure(t):
        return tuple(
            -26e3 * np.sin(np.pi * t / 0.2) * (t < 0.2) if d == 1 else 0.0 for d in range(dim)
        )

    depth = [Fixed(grid.facets("back", "front"), "z")] if dim == 3 else []
    return [
        Fixed(grid.facets("left", "right"), "x"),
        *depth,
        Fixed(grid.facets("bottom")),
        Traction(surface, pressure),
    ]


def counts(dim: int, cell: float) -> list[int]:
    """Cells of the body in each direction."""
    return [round(length / cell) for length in BODY[dim]]


def scene(method: str, dim: int, cell: float, empty: int = 1, **options):
    """A run, with a stress probe; ``empty``: rows of cells above the body on the grid of material
    points; ``options`` of ``Simulation`` on top of the method's."""
    body, number, stepping = BODY[dim], counts(dim, cell), Newmark(COURANT * cell / soil.p_speed)
    if method in TWINS:
        grid = Grid.box(
            [0.0] * dim,
            body,
            number,
            facets={"strip": lambda x: under_strip(x[:dim]) & (np.abs(x[1] - body[1]) < 1e-9)},
        )
        run = FiniteElements(
            grid, soil, stepping, terms(dim, grid.facets("strip"), grid), **TWINS[method]
        )
    else:
        number[1] += empty
        upper = [length + (d == 1) * empty * cell for d, length in enumerate(body)]
        grid = Grid.box([0.0] * dim, upper, number)
        points = MaterialPoints.fill(grid, soil, 2**dim, inside=lambda x: x[1] < body[1])
        strip = points.surface("top", where=under_strip)
        run = Simulation(
            grid, points, stepping, terms(dim, strip, grid), **{**MAPPINGS[method], **options}
        )
    run.record(Probe("stress", [0.5 * length for length in body]))
    return run
