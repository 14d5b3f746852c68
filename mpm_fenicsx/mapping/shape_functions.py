"""Shape functions at points: linear, or averaged over support domains (GIMP)."""

from __future__ import annotations

import numpy as np

from ..common.compiled import digits, jit, once
from ..grid.grid import Grid
from . import kernels


class Stencil:
    """Weights of points on the grid's nodes: linear shape functions, or their means over support
    domains.

    The linear case is that of support domains without extent.  Weights are products of those of the
    directions, and these are what is kept: ``line`` and ``slope`` (n, dim, k), 1/m, refreshed by
    ``place``; k = 2, or 3 with support domains.  ``side``, ``span``, ``share`` say how each support
    domain is cut at the cell's edges (``kernels.place``).
    """

    def __init__(self, grid: Grid, points: int, support: bool):
        self.grid, self.reach, self._support = grid, once(3 if support else 2), support
        self.resize(points)

    def resize(self, points: int) -> None:
        """Make room for so many points, to be placed."""
        dim, k = self.grid.dim, len(self.reach)
        self.side = np.zeros((points, dim), dtype=np.int8)
        self.span = np.zeros((points, dim, 2, 2))
        self.share = np.zeros((points, dim, 2))
        self.first = np.zeros(points, dtype=np.uint64)
        self.line, self.slope = np.zeros((points, dim, k)), np.zeros((points, dim, k))
        self.cell = np.zeros(points, dtype=np.int32)
        self._no_extent = None if self._support else np.zeros((points, dim))

    def __len__(self) -> int:
        return len(self.first)

    def place(self, x: np.ndarray, half: np.ndarray | None, cell: np.ndarray) -> None:
        """Refresh for points at x (n, dim) in cells (n,), with half support domains (n, dim) where
        there are any."""
        half = half if self._no_extent is None else self._no_extent
        self.cell = cell
        weights = self.first, self.line, self.slope
        kernels.place(self.grid.axes, (x, half, cell), self.grid.lattice.bounds, self.cut, weights)

    @property
    def cut(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How support domains are cut at the edges of cells: side, span, share."""
        return self.side, self.span, self.share

    @property
    def weights(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What kernels want to know of nodes and their weights: around, first, line."""
        return self.grid.lattice.around, self.first, self.line

    @property
    def nodes(self) -> np.ndarray:
        """The nodes (n, k^dim) of each point, x fastest; one that is not there, without weight,
        reads 0."""
        k, dim = len(self.reach), self.grid.dim
        return self.grid.lattice.around[
            self.first[:, None] + digits(k, dim).astype(np.uint64) @ self._strides
        ]

    @property
    def values(self) -> np.ndarray:
        """Their weights (n, k^dim)."""
        return self._products(range(self.grid.dim), ())

    @property
    def gradients(self) -> np.ndarray:
        """The weights' gradients (n, k^dim, dim), 1/m."""
        return np.stack(
            [self._products(set(range(self.grid.dim)) - {d}, {d}) for d in range(self.grid.dim)], -1
        )

    @property
    def _strides(self) -> np.ndarray:
        return 4 ** np.arange(self.grid.dim, dtype=np.uint64)

    def _products(self, plain, derived) -> np.ndarray:
        digit = digits(len(self.reach), self.grid.dim)
        return np.prod(
            [self.line[:, d, digit[:, d]] for d in plain]
            + [self.slope[:, d, digit[:, d]] for d in derived],
            axis=0,
        )

    # -- to the nodes and back ---------------------------------------------------------------------

    def deposit(self, values: np.ndarray, nodal: np.ndarray) -> None:
        """Add Σ_p S_ip q_p of values (n, f) to ``nodal`` (nodes, f)."""
        axes, columns = self.grid.axes, once(values.shape[1])
        kernels.scatter(axes, self.reach, columns, self.weights, values, nodal)

    def deposit_motion(
        self, mass: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, nodal: np.ndarray
    ) -> None:
        """Add mass (kg), momentum and mass times acceleration of the points to ``nodal`` (nodes, 1
        + 2 dim)."""
        points = mass, velocity, acceleration
        kernels.scatter_motion(self.grid.axes, self.reach, self.weights, points, nodal)

    def deposit_divergence(self, stress: np.ndarray, nodal: np.ndarray) -> None:
        """Add Σ_p σ_p ∇S_ip of volume-weighted stress tensors (n, dim, dim), N m, to ``nodal``
        (nodes, dim)."""
        axes = self.grid.axes
        kernels.scatter_divergence(axes, self.reach, self.weights, self.slope, stress, nodal)

    def at_points(self, nodal: np.ndarray, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Nodal values (nodes, f) at the points (n, f), or at ``rows`` of them."""
        around, first, line = self.weights
        weights = around, first[rows], line[rows]
        out = np.empty((len(weights[1]), nodal.shape[1]))
        columns = once(nodal.shape[1])
        kernels.interpolate(self.grid.axes, self.reach, columns, weights, nodal, out)
        return out

    def gradient_at_points(self, nodal: np.ndarray) -> np.ndarray:
        """Gradients (n, dim, dim) at the points of nodal vectors (nodes, dim)."""
        dim, axes = self.grid.dim, self.grid.axes
        out = np.empty((len(self), dim, dim))
        kernels.interpolate_gradient(axes, self.reach, self.weights, self.slope, nodal, out)
        return out

    def mean_of_cells(self, values: np.ndarray) -> np.ndarray:
        """Means (n,) over the support domains of one value a cell (cells,)."""
        out = np.empty(len(self))
        _mean_of_cells(self.side, self.share, self.cell, self.grid.lattice.neighbour, values, out)
        return out


@jit
def _mean_of_cells(side, share, cell, neighbour, values, out):
    """out_p = Σ_c (share of p's support domain in c) q_c; see ``kernels.place``."""
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
