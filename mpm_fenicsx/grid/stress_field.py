"""Stress as a discontinuous field on the grid, for forms, files and places between points."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from ..common import tensors
from ..common.compiled import digits
from . import dolfinx_versions, weak_forms
from .grid import Grid


class StressField:
    """Stress on the grid, bilinear (trilinear) in each cell and discontinuous between cells.

    ``function``: a dolfinx function of DQ1, its components in the order of stress rows, (xx, yy,
    zz, xy) in plane strain and (xx, yy, zz, xy, yz, xz) in 3D, Pa; zero in cells without material.
    ``tensor``: the same as a UFL matrix (dim, dim), what a form multiplies with a gradient.
    ``filled`` (cells,): which cells hold material.
    The field is that of the time at which the run was asked for it.
    """

    def __init__(self, grid: Grid):
        self.grid, columns = grid, tensors.components(grid.dim)
        space = dolfinx_versions.space(grid.mesh, "DQ", 1, (columns,))
        self.function = fem.Function(space, name="stress")
        self.filled = np.ones(grid.cells, dtype=bool)
        self._rows = self.function.x.array.reshape(-1, columns)
        self._dofs = grid.tensor_order(space, 1)
        plane = [self.function[int(k)] for k in tensors.in_plane(grid.dim)]
        self.tensor = weak_forms.tensor(plane, grid.dim)

    @property
    def values(self) -> np.ndarray:
        """Stress rows (cells, 2^dim, components), Pa, at the corners of cells, x fastest; of local
        and ghost cells."""
        return self._rows[self._dofs]

    def put(self, values: np.ndarray) -> None:
        """Take over ``values`` as that property gives them."""
        self._rows[self._dofs] = values

    def at(self, places: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa, at places x (n, dim), m; NaN where no cell of this rank
        that holds material lies.  On the edge of two cells the upper one answers."""
        x = np.atleast_2d(np.asarray(places, dtype=float))
        if x.ndim != 2 or x.shape[1] != self.grid.dim:
            raise ValueError(f"places must be (n, {self.grid.dim}), got {np.shape(places)}")
        cell, lattice = self.grid.find(x), self.grid.lattice
        known = (cell >= 0) & (cell < self.grid.owned_cells)
        known[known] = self.filled[cell[known]]
        found = np.full((len(x), self._rows.shape[1]), np.nan)
        c = cell[known]
        place = (x[known] - lattice.lower[c]) / (lattice.upper[c] - lattice.lower[c])
        corner = digits(2, self.grid.dim)
        weight = np.where(corner, place[:, None], 1.0 - place[:, None]).prod(axis=2)
        found[known] = np.einsum("nk,nkf->nf", weight, self._rows[self._dofs[c]])
        return found
