"""Materials of a term's cells: one, or several in regions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..common.checks import chosen
from ..common.ranks import together
from ..grid.grid import Grid

Regions = list[tuple[object, Callable | None]]


def regions_of(material) -> Regions:
    """Pairs of a material and where it is, x (dim, n), m, to bool (n,); None for everywhere."""
    if isinstance(material, Sequence):
        return [(law, where) for law, where in material]
    return [(material, None)]


def held(whose: str, grid: Grid, regions: Regions, x: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Which region (regions, cells), bool, the places x (cells, dim), m, of cells lie in.

    Raises ``ValueError``, on all ranks, where one of ``cells`` (n,) lies in none or in several.
    """
    everywhere = np.ones(len(x), dtype=bool)
    with together(grid.comm, Exception):
        found = [
            everywhere if where is None else chosen(f"where of {whose}", where, x.T)
            for _, where in regions
        ]
    found = np.array([grid.share_cells(here) for here in found])
    with together(grid.comm):
        times = found[:, cells].sum(axis=0)
        if (times != 1).any():
            raise ValueError(
                f"material of {whose}: the cell at x={x[cells[np.argmax(times != 1)]]} lies in "
                "several of the regions, or in none"
            )
    return found


def numbers(regions: Regions, found: np.ndarray) -> np.ndarray:
    """ρ (kg/m³), λ and μ (Pa) of cells (3, cells), zero in those of no region."""
    of = np.array([(law.density, *law.lame) for law, _ in regions])
    return np.einsum("mc,mk->kc", found.astype(float), of)
