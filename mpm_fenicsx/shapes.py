"""Shape functions at points: linear, or averaged over support domains (GIMP)."""

from __future__ import annotations

import numpy as np

from . import kernels
from .grid import Grid


class Stencil:
    """Weights of points on the grid's nodes: linear shape functions, or their means over support domains.

    The linear case is that of support domains without extent.  Arrays are made once and refreshed by ``place``:
    ``nodes`` (n, k), ``values`` (n, k), ``gradients`` (n, k, dim), 1/m; k = 2^dim, or 3^dim with support domains.
    ``side``, ``span``, ``share`` say how each support domain is cut at the cell's edges (see ``kernels.spans``).
    """

    def __init__(self, grid: Grid, points: int, support: bool):
        dim = grid.dim
        self.grid = grid
        self.table = kernels.digits(3 if support else 2, dim)
        self.side = np.zeros((points, dim), dtype=np.int8)
        self.span = np.zeros((points, dim, 2, 2))
        self.share = np.zeros((points, dim, 2))
        self.nodes = np.zeros((points, len(self.table)), dtype=np.int32)
        self.values = np.zeros((points, len(self.table)))
        self.gradients = np.zeros((points, len(self.table), dim))
        self.cell = np.zeros(points, dtype=np.int32)
        self._no_extent = None if support else np.zeros((points, dim))

    def place(self, x: np.ndarray, half: np.ndarray | None, cell: np.ndarray) -> None:
        """Refresh for points at x (n, dim) in cells (n,), with half support domains (n, dim) where there are any."""
        lat, axes = self.grid.lattice, self.grid.axes
        half = half if self._no_extent is None else self._no_extent
        self.cell = cell
        kernels.spans(axes, x, half, cell, lat.lower, lat.upper, lat.neighbour, self.side, self.span, self.share)
        kernels.nodal_weights(axes, self.side, self.span, self.share, cell, lat.lower, lat.upper, lat.neighbour,
                              lat.patch, self.table, self.nodes, self.values, self.gradients)

    def deposit(self, values: np.ndarray, nodal: np.ndarray) -> None:
        """Add Σ_p S_ip q_p of values (n, f) to ``nodal`` (nodes, f)."""
        kernels.scatter(self.nodes, self.values, values, nodal)

    def deposit_divergence(self, stress: np.ndarray, nodal: np.ndarray) -> None:
        """Add Σ_p σ_p ∇S_ip of volume-weighted stress tensors (n, dim, dim), N m, to ``nodal`` (nodes, dim)."""
        kernels.scatter_divergence(self.grid.axes, self.nodes, self.gradients, stress, nodal)

    def at_points(self, nodal: np.ndarray) -> np.ndarray:
        """Nodal values (nodes, f) at the points (n, f)."""
        out = np.empty((len(self.nodes), nodal.shape[1]))
        kernels.interpolate(self.nodes, self.values, nodal, out)
        return out

    def mean_of_cells(self, values: np.ndarray) -> np.ndarray:
        """Means (n,) over the support domains of one value a cell (cells,)."""
        out = np.empty(len(self.nodes))
        _mean_of_cells(self.side, self.share, self.cell, self.grid.lattice.neighbour, values, out)
        return out

    def gradient_at_points(self, nodal: np.ndarray) -> np.ndarray:
        """Gradients (n, dim, dim) at the points of nodal vectors (nodes, dim)."""
        out = np.empty((len(self.nodes), self.grid.dim, self.grid.dim))
        kernels.interpolate_gradient(self.grid.axes, self.nodes, self.gradients, nodal, out)
        return out


@kernels.jit
def _mean_of_cells(side, share, cell, neighbour, values, out):
    """out_p = Σ_c (share of p's support domain in c) q_c; see ``kernels.spans``."""
    n, dim = side.shape
    for p in range(n):
        out[p] = 0.0
        for corner in range(2**dim):
            c, weight = cell[p], 1.0
            for d in range(dim):
                s = (corner >> d) & 1
                weight *= share[p, d, s]
                if s == 1 and weight > 0.0:
                    c = neighbour[c, d, (side[p, d] + 1) // 2]
            if weight > 0.0:
                out[p] += weight * values[c]
