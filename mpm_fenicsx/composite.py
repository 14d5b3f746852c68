"""Strain recovered from composite patches of cells (CMPM; González Acosta et al. 2017)."""

from __future__ import annotations

import numpy as np

from .grid import Grid
from .kernels import jit


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
        lat = self.grid.lattice
        out = np.empty((len(x), self.grid.dim, self.grid.dim))
        kernel = gradient_2d if self.grid.dim == 2 else gradient_3d
        kernel(x, cell, lat.lower, lat.upper, self.whole, self.power, lat.patch, nodal, out)
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
def along(power, t, h, whole, value, slope, across):
    """Values, slopes (1/m) and values across at t of the four polynomials of a direction.

    Across is linear where a corner of the patch has no material.
    """
    for i in range(4):
        a0, a1, a2, a3 = power[i, 0], power[i, 1], power[i, 2], power[i, 3]
        value[i] = a0 + t * (a1 + t * (a2 + t * a3))
        slope[i] = (a1 + t * (2.0 * a2 + t * 3.0 * a3)) / h
        across[i] = value[i] if whole else 0.0
    if not whole:
        across[1], across[2] = 1.0 - t, t


@jit
def gradient_2d(x, cell, lower, upper, whole, power, patch, field, out):
    """Gradients (n, 2, 2) at points x of the composite interpolation of ``field`` (nodes, 2)."""
    value, slope, across = np.zeros((2, 4)), np.zeros((2, 4)), np.zeros((2, 4))
    for p in range(len(x)):
        c = cell[p]
        for d in range(2):
            h = upper[c, d] - lower[c, d]
            along(power[c, d], (x[p, d] - lower[c, d]) / h, h, whole[c], value[d], slope[d], across[d])
        xx = xy = yx = yy = 0.0
        for j in range(4):
            ux = uy = sx = sy = 0.0
            for i in range(4):
                node = patch[c, i + 4 * j]
                if node >= 0:
                    ux += across[0, i] * field[node, 0]
                    uy += across[0, i] * field[node, 1]
                    sx += slope[0, i] * field[node, 0]
                    sy += slope[0, i] * field[node, 1]
            xx += across[1, j] * sx
            yx += across[1, j] * sy
            xy += slope[1, j] * ux
            yy += slope[1, j] * uy
        out[p, 0, 0], out[p, 0, 1], out[p, 1, 0], out[p, 1, 1] = xx, xy, yx, yy


@jit
def gradient_3d(x, cell, lower, upper, whole, power, patch, field, out):
    """Gradients (n, 3, 3) at points x of the composite interpolation of ``field`` (nodes, 3)."""
    value, slope, across = np.zeros((3, 4)), np.zeros((3, 4)), np.zeros((3, 4))
    for p in range(len(x)):
        c = cell[p]
        for d in range(3):
            h = upper[c, d] - lower[c, d]
            along(power[c, d], (x[p, d] - lower[c, d]) / h, h, whole[c], value[d], slope[d], across[d])
        out[p] = 0.0
        for k in range(4):
            for j in range(4):
                y, z, flat = slope[1, j] * across[2, k], across[1, j] * slope[2, k], across[1, j] * across[2, k]
                for i in range(4):
                    node = patch[c, i + 4 * j + 16 * k]
                    if node >= 0:
                        gx, gy, gz = slope[0, i] * flat, across[0, i] * y, across[0, i] * z
                        for e in range(3):
                            out[p, e, 0] += gx * field[node, e]
                            out[p, e, 1] += gy * field[node, e]
                            out[p, e, 2] += gz * field[node, e]
