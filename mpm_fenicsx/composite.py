"""Strain recovered from composite patches of cells (CMPM; González Acosta et al. 2017)."""

from __future__ import annotations

import numpy as np

from .grid import Grid
from .kernels import digits, jit


class Composite:
    """Gradients from the composite patch of up to four nodes a direction (CMPM).

    A patch reaches into cells that hold material points and no others.
    """

    def __init__(self, grid: Grid):
        self.grid = grid
        self.table = digits(4, grid.dim)
        self.extent = np.zeros((grid.cells, grid.dim, 2), dtype=np.int8)
        self.whole = np.zeros(grid.cells, dtype=np.int8)

    def place(self, filled: np.ndarray) -> None:
        """Refresh for the cells that hold points, ``filled`` (cells,) of 0 and 1."""
        patch_extent(filled, self.grid.lattice.neighbour, self.extent, self.whole)

    def gradient_at_points(self, x: np.ndarray, cell: np.ndarray, nodal: np.ndarray) -> np.ndarray:
        """Gradients (n, dim, dim) at points x (n, dim) in cells (n,) of nodal vectors (nodes, dim)."""
        lat = self.grid.lattice
        out = np.empty((len(x), self.grid.dim, self.grid.dim))
        composite_gradient(x, cell, lat.lower, lat.upper, lat.neighbour, self.extent, self.whole,
                                   lat.patch, self.table, nodal, out)
        return out


@jit
def patch_extent(filled, neighbour, extent, whole):
    """How far each cell's composite patch reaches: ``extent`` (cells, dim, 2) where the neighbour has material.

    ``whole``: 1 where all cells of the tensor-product patch have material, corners included.
    """
    n, dim, _ = neighbour.shape
    for c in range(n):
        whole[c] = 1
        for d in range(dim):
            for s in range(2):
                beyond = neighbour[c, d, s]
                extent[c, d, s] = beyond >= 0 and filled[beyond]
        for d in range(dim):
            for s in range(2):
                if extent[c, d, s]:
                    for e in range(dim):
                        for t in range(2):
                            if e != d and extent[c, e, t]:
                                corner = neighbour[neighbour[c, d, s], e, t]
                                if corner < 0 or not filled[corner]:
                                    whole[c] = 0
                                elif dim == 3:
                                    f = 3 - d - e
                                    for r in range(2):
                                        if extent[c, f, r]:
                                            last = neighbour[corner, f, r]
                                            if last < 0 or not filled[last]:
                                                whole[c] = 0


@jit
def lagrange(t, at, present, value, slope):
    """Values and slopes at t of the Lagrange polynomials through those of four places that are present."""
    for i in range(4):
        value[i] = slope[i] = 0.0
        if present[i]:
            v, s = 1.0, 0.0
            for j in range(4):
                if j != i and present[j]:
                    r = 1.0 / (at[i] - at[j])
                    s = (s * (t - at[j]) + v) * r
                    v *= (t - at[j]) * r
            value[i], slope[i] = v, s


@jit
def composite_gradient(x, cell, lower, upper, neighbour, extent, whole, patch, table, field, out):
    """Gradients at points of the composite interpolation over up to four nodes a direction (CMPM).

    ``table`` (4^dim, dim) digits of the patch, ``field`` (nodes, dim), ``out`` (n, dim, dim).  Where a corner of
    the patch has no material, the derivative along d is composite along d and linear across.
    """
    n, dim = x.shape
    value = np.zeros((dim, 4))
    slope = np.zeros((dim, 4))
    linear = np.zeros((dim, 4))
    at = np.array([0.0, 0.0, 1.0, 0.0])
    present = np.ones(4, np.bool_)
    for p in range(n):
        c = cell[p]
        for d in range(dim):
            h = upper[c, d] - lower[c, d]
            t = (x[p, d] - lower[c, d]) / h
            for s in range(2):
                present[3 * s] = extent[c, d, s]
                if extent[c, d, s]:
                    beyond = neighbour[c, d, s]
                    ratio = (upper[beyond, d] - lower[beyond, d]) / h
                    at[3 * s] = -ratio if s == 0 else 1.0 + ratio
            lagrange(t, at, present, value[d], slope[d])
            for i in range(4):
                slope[d, i] /= h
            linear[d, 1], linear[d, 2] = 1 - t, t
        across = value if whole[c] else linear
        for i in range(dim):
            for j in range(dim):
                out[p, i, j] = 0.0
        for m in range(len(table)):
            node = patch[c, m]
            if node >= 0:
                for j in range(dim):
                    g = slope[j, table[m, j]]
                    for e in range(dim):
                        if e != j:
                            g *= across[e, table[m, e]]
                    for i in range(dim):
                        out[p, i, j] += g * field[node, i]
