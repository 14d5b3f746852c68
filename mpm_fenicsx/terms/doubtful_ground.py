"""Plain cells that hardly go on as the body does: looked at when a run is built."""

from __future__ import annotations

import numpy as np

from ..common.ranks import anywhere, warn
from ..grid import dolfinx_versions
from .scene import Scene

LACKING = 1e-3
"""Of a cell beside a far field: so much may be empty."""
UNLIKE = 0.02
"""Of the ground's impedance: by so much that of a layer beside it may be another."""
IN_FRONT = 1e-6
"""Of a cell, from a surface along its normal: what lies there is in front of it."""


def warn_of_gaps(scene: Scene, filled: np.ndarray) -> None:
    """Warn where points end before the far field beside them does begin, or where none are beside.

    ``filled`` (cells,): what part of each of this rank's own cells material points fill.
    Collective.
    """
    grid = scene.grid
    filled = grid.share_cells(np.append(filled, np.zeros(grid.cells - len(filled))))
    for part in scene.plain:
        if not part.heavy:
            continue
        beside, others = _beside(grid, part.marks), scene.filled() & ~scene.occupied
        bonded = grid.comm.allreduce(int((beside & others).any()))
        beside &= scene.occupied
        count = grid.comm.allreduce(int(beside[: grid.owned_cells].sum()))
        if not count and not bonded:
            warn(
                grid.comm,
                "FarField has no side in common with a cell that holds material points or is "
                "plain: nothing goes from one to the other; let it begin where they end",
                4,
            )
            continue
        lacking = beside & (filled < 1.0 - LACKING)
        lacking[grid.owned_cells :] = False
        many = grid.comm.allreduce(int(lacking.sum()))
        at = anywhere(grid.comm, grid.centres[np.argmax(lacking)] if lacking.any() else None)
        if many:
            warn(
                grid.comm,
                f"FarField: {many} of the {count} cells beside it are partly filled with points, "
                f"the first at x={at}: the gap is bridged by a cell that is as stiff as what "
                "fills it; let points end where the far field begins",
                4,
            )


def warn_of_other_ground(scene: Scene, numbers: np.ndarray) -> None:
    """Warn where an absorbing layer is of other ground than what it stands beside.

    ``numbers`` (3, cells): ρ (kg/m³), λ and μ (Pa) of the material in each cell, zero where there
    is none.  Collective.
    """
    grid, numbers = scene.grid, numbers.copy()
    for part in scene.plain:
        if part.heavy:
            numbers[:, part.marks] = _numbers(part)[:, part.marks]
    for part in scene.plain:
        if part.heavy:
            continue
        layer, fault = _impedances(_numbers(part)), None
        ground = _impedances(numbers)
        neighbour = grid.lattice.neighbour.reshape(grid.cells, -1)
        cell, k = np.nonzero(part.marks[:, None] & (neighbour >= 0))
        other = neighbour[cell, k]
        known = (ground[0, other] > 0.0) & ~part.marks[other]
        cell, other = cell[known], other[known]
        off = np.abs(layer[:, cell] / ground[:, other] - 1.0).max(axis=0, initial=0.0)
        if (off > UNLIKE).any():
            one = int(np.argmax(off))
            here, there = layer[:, cell[one]], ground[:, other[one]]
            fault = (
                f"AbsorbingLayer is of impedances ρc_p, ρc_s = {_words(here)} at "
                f"x={grid.centres[cell[one]]}, and the ground beside it of {_words(there)} Pa s/m: "
                "waves come back from where they meet; give it the material of the ground"
            )
        fault = anywhere(grid.comm, fault)
        if fault:
            warn(grid.comm, fault, 4)


def in_front(scene: Scene, x: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Which surface points (n,), bool, at x (n, dim), m, have plain cells that are a body's in
    front of them, along ``normal`` (n, dim)."""
    found = np.zeros(len(x), dtype=bool)
    heavy = [part.marks for part in scene.plain if part.heavy]
    if heavy and len(x):
        cell = scene.grid.find(x + IN_FRONT * scene.grid.lattice.size.min() * normal)
        found = (cell >= 0) & np.any(heavy, axis=0)[cell]
    return found


def _beside(grid, marks: np.ndarray) -> np.ndarray:
    """Cells (cells,), bool, that have a side in common with those that are marked."""
    neighbour = grid.lattice.neighbour.reshape(grid.cells, -1)
    return grid.share_cells((np.append(marks, False)[neighbour]).any(axis=1) & ~marks)


def _numbers(part) -> np.ndarray:
    """ρ, λ and μ (3, cells) of plain cells."""
    fields = (part.density, part.λ, part.μ)
    dofs = dolfinx_versions.cell_dofs(part.density.function_space)[:, 0]
    return np.array([field.x.array[dofs] for field in fields])


def _impedances(numbers: np.ndarray) -> np.ndarray:
    """ρ c_p and ρ c_s (2, n), Pa s/m, of ρ, λ and μ (3, n)."""
    ρ, λ, μ = numbers
    return np.sqrt(ρ * np.array([λ + 2 * μ, μ]))


def _words(pair: np.ndarray) -> str:
    return " and ".join(f"{value:.4g}" for value in pair)
