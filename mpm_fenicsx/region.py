"""The cells that forms integrate over: where there is no material there is nothing to add."""

from __future__ import annotations

import numpy as np

from . import fenicsx
from .grid import Grid


class Region:
    """All cells of a grid, until ``cover`` says which ones hold material.

    ``dx`` is the measure for forms, which follow it at once.  On several ranks, and in DOLFINx 0.5, which cannot, they
    go on over all cells.
    """

    def __init__(self, grid: Grid):
        self.grid, self.follows = grid, grid.comm.size == 1 and fenicsx.FORMS_FOLLOW
        self.cells = np.arange(grid.owned_cells, dtype=np.int32)
        self.dx, self._domains = fenicsx.cell_measure(grid.mesh, self.cells)
        self._held: np.ndarray | None = None

    def cover(self, held: np.ndarray) -> None:
        """Only cells that are marked in ``held`` (cells,), or beside one that is, corners included."""
        if not self.follows or (self._held is not None and np.array_equal(held, self._held)):
            return
        self._held = held.copy()
        near = held.astype(bool)
        for d in range(self.grid.dim):
            before = near.copy()
            for beyond in self.grid.lattice.neighbour[:, d].T:
                near |= before[beyond] & (beyond >= 0)
        self.cells = np.flatnonzero(near[: self.grid.owned_cells]).astype(np.int32)
        self._domains[:] = [(fenicsx.MATERIAL, self.cells)]
