"""Means over the material in each cell, and what they give back: volume changes cell by cell.

Over the parts of support domains that lie in cell c, of volumes V_k and centres x_k,

    G_ci = Σ_k V_k ∇N_i(x_k) / Σ_k V_k,    θ_c = Σ_i G_ci · u_i,    P_c = Σ_k V_k p_k.

θ_c is the mean of div u over the material in the cell, whatever part of the cell that fills, and a
point takes the mean of θ over its support domain.  The force Σ_c P_c G_ci is then the adjoint of
that: it works on θ as the points' pressures do on their own changes of volume, and a uniform
pressure pulls as it does by ∇S_ip, wherever the body ends.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem

from ..common.compiled import jit
from ..grid import dolfinx_versions
from ..grid.cell_means import CellMeans
from ..grid.grid import Grid
from ..points.material_points import MaterialPoints
from .shape_functions import Stencil, part


class MaterialMeans(CellMeans):
    """Those of material points, where these are now."""

    def __init__(self, grid: Grid):
        corners, dim = 2**grid.dim, grid.dim
        self._sums = CellSums(grid, corners * dim + 2)
        super().__init__(grid.lattice.nodes, np.zeros((grid.cells, corners, dim)))
        self.grid, self.bulk = grid, np.zeros(grid.cells)

    def place(self, bodies: Sequence[MaterialPoints], stencils: Sequence[Stencil]) -> None:
        """Refresh the means for the points where they are now."""
        sums = self._sums
        sums.clear()
        for body, at in zip(bodies, stencils, strict=True):
            lattice, (λ, μ) = at.lattice, body.material.kinematics.moduli(body)
            _add_slopes(
                (at.cell, *at.cut),
                lattice.bounds,
                (body.volume, np.broadcast_to(λ + 2 * μ / 3, len(body))),
                sums.rows,
            )
        sums.finish()
        volume = sums.rows[:, -2:-1]
        slopes = np.divide(sums.rows[:, :-2], volume, out=self._flat, where=volume > 0.0)
        slopes[volume[:, 0] <= 0.0] = 0.0
        self.bulk[:] = sums.rows[:, -1]

    @property
    def _flat(self) -> np.ndarray:
        cells, corners, dim = self.slopes.shape
        return self.slopes.reshape(cells, corners * dim)

    def pressures(self, stencils: Sequence[Stencil], values: Sequence[np.ndarray]) -> np.ndarray:
        """P (cells,), N m, of volume-weighted mean stresses V_p p_p (n,) of each body: of this
        rank's points, in ghost cells too."""
        found = np.zeros(self.grid.cells)
        for at, value in zip(stencils, values, strict=True):
            at.add_to_cells(value, found)
        return found


class CellSums:
    """``size`` numbers a cell, ``rows`` (cells, size), summed over all ranks."""

    def __init__(self, grid: Grid, size: int):
        self._shared = None
        if grid.comm.size == 1:
            self.rows = np.zeros((grid.cells, size))
            return
        space = dolfinx_versions.space(grid.mesh, "DQ", 0, (size,))
        self._shared = fem.Function(space)
        self._dofs = dolfinx_versions.cell_dofs(space)[:, 0]
        self.rows = np.zeros((grid.cells, size))

    def clear(self) -> None:
        """Zeros."""
        self.rows[:] = 0.0

    def finish(self) -> None:
        """Add up what ranks have of each cell, ghosts included."""
        if self._shared is None:
            return
        numbers = self._shared.x.array.reshape(-1, self.rows.shape[1])
        numbers[self._dofs] = self.rows
        dolfinx_versions.gather(self._shared)
        self.rows[:] = numbers[self._dofs]


@jit
def _add_slopes(cut, cells, points, out):
    """out_c += V_k (∇N_1(x_k), ∇N_2(x_k), …, 1, K) over the parts k in c; ``cut`` (cell, side,
    span, share), ``cells`` (lower, upper, neighbour), ``points`` (V, K)."""
    volume, bulk = points
    cell, side, span, share = cut
    lower, upper, neighbour = cells
    n, dim = side.shape
    corners = 2**dim
    place = np.empty(dim)
    for p in range(n):
        parts = 1
        for d in range(dim):
            if side[p, d] != 0:
                parts = corners
        for corner in range(parts):
            c, weight = part(side, share, neighbour, cell[p], p, corner)
            if weight <= 0.0:
                continue
            weight *= volume[p]
            for d in range(dim):
                s = (corner >> d) & 1
                place[d] = 0.5 * (span[p, d, s, 0] + span[p, d, s, 1])
            for node in range(corners):
                for d in range(dim):
                    slope = weight / (upper[c, d] - lower[c, d])
                    for e in range(dim):
                        up = (node >> e) & 1
                        if d == e:
                            slope *= 1.0 if up else -1.0
                        else:
                            slope *= place[e] if up else 1.0 - place[e]
                    out[c, node * dim + d] += slope
            out[c, corners * dim] += weight
            out[c, corners * dim + 1] += weight * bulk[p]
