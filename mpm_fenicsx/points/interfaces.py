"""Where bodies of different material meet inside cells, which a scene is told of before its first
step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common.ranks import anywhere, warn
from ..grid.grid import Grid
from .material_points import MaterialPoints

WHOLE = 1e-6  # of a cell: so much may be lacking


def warn_of_interfaces(
    grid: Grid, bodies: Sequence[MaterialPoints], cells: Sequence[np.ndarray]
) -> None:
    """Warn of interfaces inside cells, and of bodies that are thinner than the cells that they
    share.

    ``cells`` (n,) of each body's points.  A displacement that is linear in a cell cannot bend
    there: stress at such an interface converges at first order, and a thin body is strained like
    the material around it, whatever its stiffness. Collective.
    """
    if len(bodies) < 2:
        return
    held = np.zeros((len(bodies), grid.cells), dtype=bool)
    for body, cell in zip(held, cells, strict=True):
        body[cell] = True
    held = np.array([grid.share_cells(body.astype(np.int8)).astype(bool) for body in held])
    each = (_thin(grid, bodies, cells, held, k) for k in range(len(bodies)))
    thin = anywhere(grid.comm, next(filter(None, each), None))
    shared = grid.comm.allreduce(int(_shared(bodies, held).any(axis=0)[: grid.owned_cells].sum()))
    if thin:
        warn(grid.comm, thin, 2)
    elif shared:
        warn(
            grid.comm,
            f"bodies of different material share {shared} cells: stress is of first order only at "
            "an interface inside a cell; put grid lines on interfaces (Grid.rectilinear)",
            2,
        )


def _shared(bodies: Sequence[MaterialPoints], held: np.ndarray) -> np.ndarray:
    """Cells (bodies, cells) that each body shares with one of another material."""
    shared = np.zeros_like(held)
    for k, body in enumerate(bodies):
        for m, other in enumerate(bodies):
            if other.material != body.material:
                shared[k] |= held[k] & held[m]
    return shared


def _across(grid: Grid, body: MaterialPoints, cells: np.ndarray, cell: int, axis: int) -> bool:
    """Whether a body reaches across a cell along an axis."""
    rows, lattice = np.flatnonzero(cells == cell), grid.lattice
    x, half = body.x[rows, axis], body.half[rows, axis]
    hair = WHOLE * (lattice.upper[cell, axis] - lattice.lower[cell, axis])
    return (x - half).min() <= lattice.lower[cell, axis] + hair and (
        x + half
    ).max() >= lattice.upper[cell, axis] - hair


def _thin(
    grid: Grid,
    bodies: Sequence[MaterialPoints],
    cells: Sequence[np.ndarray],
    held: np.ndarray,
    number: int,
) -> str | None:
    """What to say of a body that ends on both sides of a cell which it does not fill."""
    neighbour, lattice = grid.lattice.neighbour, grid.lattice
    mine = np.append(held[number], False)  # beyond the grid there is none
    alone = (~mine[neighbour]).all(axis=2)  # (cells, dim): no neighbour along it on either side
    inside = (neighbour >= 0).any(axis=2)
    found = np.argwhere(
        (alone & inside & _shared(bodies, held)[number][:, None])[: grid.owned_cells]
    )
    found = next(
        (
            (cell, axis)
            for cell, axis in found
            if not _across(grid, bodies[number], cells[number], cell, axis)
        ),
        None,
    )
    if found is None:
        return None
    cell, axis = found
    centre = 0.5 * (lattice.lower[cell] + lattice.upper[cell])
    return (
        f"body {number} is thinner than a cell along {'xyz'[axis]} at x={centre}: it is strained "
        "like what shares the cell with it and bears a multiple of its stress; take grid lines "
        "along its edges (Grid.rectilinear)"
    )
