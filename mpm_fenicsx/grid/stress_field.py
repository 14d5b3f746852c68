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
    ``fill``: a dolfinx function of DQ1, the part of the cell that material fills, 1 in a full cell:
    what integrals are weighted with where the body's edge cuts cells.
    ``filled`` (cells,): which cells hold material.
    The field is that of the time at which the run was asked for it.
    """

    def __init__(self, grid: Grid):
        self.grid, columns = grid, tensors.components(grid.dim)
        space = dolfinx_versions.space(grid.mesh, "DQ", 1, (columns,))
        self.function = fem.Function(space, name="stress")
        self.filled = np.ones(grid.cells, dtype=bool)
        self.fill = fem.Function(dolfinx_versions.space(grid.mesh, "DQ", 1), name="fill")
        self.fill.x.array[:] = 1.0
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

    def around(self, place: np.ndarray) -> np.ndarray:
        """Mean stress row (components,), Pa, over a box of one cell's size around a place x (dim,),
        m, as far as cells there hold material; NaN where the place lies in no such cell of this
        rank.

        It does not jump where the place crosses a grid line, as the field does, and is exact in
        equal full cells where stress is linear.
        """
        (c,) = self.grid.find(np.asarray(place, dtype=float)[None])
        lattice, dim = self.grid.lattice, self.grid.dim
        if not (0 <= c < self.grid.owned_cells and self.filled[c]):
            return np.full(self._rows.shape[1], np.nan)
        half = 0.5 * (lattice.upper[c] - lattice.lower[c])
        side = (place > lattice.lower[c] + half).astype(int)  # of the neighbours that it reaches
        total, volume = 0.0, 0.0
        for parts in digits(2, dim):
            cell = c
            for d in np.flatnonzero(parts):
                cell = lattice.neighbour[cell, d, side[d]] if cell >= 0 else -1
            if cell < 0 or not self.filled[cell]:
                continue
            low = np.maximum(place - half, lattice.lower[cell])
            high = np.minimum(place + half, lattice.upper[cell])
            size = np.prod(np.maximum(high - low, 0.0))
            extent = lattice.upper[cell] - lattice.lower[cell]
            centre = (0.5 * (low + high) - lattice.lower[cell]) / extent
            weight = np.where(digits(2, dim), centre, 1.0 - centre).prod(axis=1)
            total = total + size * (weight @ self._rows[self._dofs[cell]])
            volume += size
        return total / volume

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
