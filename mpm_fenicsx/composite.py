"""Strain recovered from composite patches of cells (CMPM; González Acosta et al. 2017)."""

from __future__ import annotations

import numpy as np

from .grid import Grid
from .kernels import interpolate_gradient, jit, once


class Composite:
    """Gradients from the composite patch of up to four nodes a direction (CMPM).

    A patch reaches into cells that hold material points and no others.  Along each direction the shape functions
    are the Lagrange polynomials through its nodes; their coefficients belong to the cell and are refreshed only
    where the patch has changed.
    """

    def __init__(self, grid: Grid):
        self.grid = grid
        self.extent = np.full((grid.cells, grid.dim, 2), -1, dtype=np.int8)
        self.whole = np.zeros(grid.cells, dtype=np.int8)
        self.power = np.zeros((grid.cells, grid.dim, 4, 4))

    def place(self, filled: np.ndarray) -> None:
        """Refresh for the cells that hold points, ``filled`` (cells,) of 0 and 1."""
        lat = self.grid.lattice
        coefficients(filled, lat.neighbour, lat.lower, lat.upper, self.extent, self.power)
        patch_whole(filled, lat.neighbour, self.extent, self.whole)

    def gradient_at_points(self, x: np.ndarray, cell: np.ndarray, nodal: np.ndarray) -> np.ndarray:
        """Gradients (n, dim, dim) at points x (n, dim) in cells (n,) of nodal vectors (nodes, dim)."""
        grid, lat = self.grid, self.grid.lattice
        line, slope = (np.empty((len(x), grid.dim, 4)) for _ in range(2))
        first, out = np.empty(len(x), np.uint64), np.empty((len(x), grid.dim, grid.dim))
        polynomials(grid.axes, x, cell, lat.lower, lat.upper, self.whole, self.power, first, line, slope)
        interpolate_gradient(grid.axes, once(4), lat.around, first, line, slope, nodal, out)
        return out


@jit
def coefficients(filled, neighbour, lower, upper, extent, power):
    """How far each cell's patch reaches, ``extent`` (cells, dim, 2), and for each direction the coefficients
    ``power`` (cells, dim, 4, 4) of t⁰ … t³ of the Lagrange polynomials at its four places; t from 0 to 1 in the cell.
    """
    at = np.array([0.0, 0.0, 1.0, 0.0])
    there = np.array([False, True, True, False])
    for c in range(len(neighbour)):
        for d in range(neighbour.shape[1]):
            same = True
            for s in range(2):
                beyond = neighbour[c, d, s]
                reach = 1 if beyond >= 0 and filled[beyond] else 0
                same = same and reach == extent[c, d, s]
                extent[c, d, s] = reach
                there[3 * s] = reach == 1
                if reach:
                    ratio = (upper[beyond, d] - lower[beyond, d]) / (upper[c, d] - lower[c, d])
                    at[3 * s] = -ratio if s == 0 else 1.0 + ratio
            if same:
                continue
            power[c, d] = 0.0
            for i in range(4):
                if there[i]:
                    a = power[c, d, i]
                    a[0] = 1.0
                    for j in range(4):
                        if j != i and there[j]:  # times (t - at_j) / (at_i - at_j)
                            r = 1.0 / (at[i] - at[j])
                            for k in range(3, 0, -1):
                                a[k] = (a[k - 1] - at[j] * a[k]) * r
                            a[0] *= -at[j] * r


@jit
def patch_whole(filled, neighbour, extent, whole):
    """Mark cells whose tensor-product patch has material in all its cells, corners included."""
    n, dim, _ = neighbour.shape
    for c in range(n):
        whole[c] = 1
        for d in range(dim):
            for e in range(dim):
                if d == e:
                    continue
                for s in range(2):
                    for t in range(2):
                        if extent[c, d, s] and extent[c, e, t]:
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
def polynomials(axes, x, cell, lower, upper, whole, power, first, line, slope):
    """At points x: ``slope`` (n, dim, 4), 1/m, of the four polynomials of each direction; ``line``, their values,
    which are those of linear functions where a corner of the patch has no material; ``first`` as in ``kernels``."""
    dim = len(axes)
    for p in range(len(x)):
        c = cell[p]
        first[p] = c * 4**dim
        for d in range(dim):
            per_h = 1.0 / (upper[c, d] - lower[c, d])
            t = (x[p, d] - lower[c, d]) * per_h
            for i in range(4):
                a0, a1, a2, a3 = power[c, d, i, 0], power[c, d, i, 1], power[c, d, i, 2], power[c, d, i, 3]
                slope[p, d, i] = (a1 + t * (2.0 * a2 + t * 3.0 * a3)) * per_h
                line[p, d, i] = a0 + t * (a1 + t * (a2 + t * a3)) if whole[c] else 0.0
            if not whole[c]:
                line[p, d, 1], line[p, d, 2] = 1.0 - t, t
