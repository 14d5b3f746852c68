"""Strain recovered from composite patches of cells (CMPM; González Acosta et al. 2017)."""

from __future__ import annotations

import numpy as np

from ..common.compiled import jit
from ..grid.cells import Lattice
from ..grid.grid import Grid


class Composite:
    """Gradients from composite patches of up to four nodes (CMPM), for the points of one material.

    The derivative along a direction is that of the Lagrange polynomial through the nodes of the
    cell and of those neighbours along it that hold points of the same material, at the cell's rows
    of nodes; between the rows it is linear.  Strain jumps where two materials meet, and a
    polynomial through cells of both is wrong by construction. With polynomials across as well (a
    tensor product) a free body gains energy, and is less accurate: see studies/composite_across.py.
    Coefficients belong to the cell and are refreshed only where the patch has changed.
    ``lattice``: the cells, if not those of the grid alone.
    """

    def __init__(self, grid: Grid, lattice: Lattice | None = None):
        self.grid, self._lattice = grid, grid.lattice if lattice is None else lattice
        self.extent = np.full((grid.cells, grid.dim, 2), -1, dtype=np.int8)
        self.power = np.zeros((grid.cells, grid.dim, 4, 4))

    def place(self, filled: np.ndarray) -> None:
        """Refresh for the cells that hold points of the material, ``filled`` (cells,) of 0 and
        1."""
        lat = self._lattice
        coefficients(filled, lat.neighbour, lat.size, self.extent, self.power)

    def gradient_at_points(self, x: np.ndarray, cell: np.ndarray, nodal: np.ndarray) -> np.ndarray:
        """Gradients (n, dim, dim) at points x (n, dim) in cells (n,) of nodal vectors (nodes,
        dim)."""
        grid, lat = self.grid, self._lattice
        out = np.empty((len(x), grid.dim, grid.dim))
        bounds = lat.lower, lat.upper
        gradients(grid.axes, (x, cell), bounds, (self.power, lat.around), nodal, out)
        return out


@jit
def coefficients(filled, neighbour, size, extent, power):
    """How far each cell's patch reaches, ``extent`` (cells, dim, 2), and for each direction the
    coefficients ``power`` (cells, dim, 4, 4) of t⁰ … t³ of the Lagrange polynomials at its four
    places; t from 0 to 1 in the cell.
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
                    ratio = size[beyond, d] / size[c, d]
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
def gradients(axes, points, bounds, patches, field, out):
    """out_p,ed = ∂_d u_e at points x, of nodal vectors ``field`` (nodes, dim).

    ``points`` (x, cell); ``bounds`` (lower, upper) of cells; ``patches`` (power, around).
    """
    x, cell = points
    lower, upper = bounds
    power, around = patches
    dim = len(axes)
    slope, line = np.empty((dim, 4)), np.empty((dim, 2))
    for p in range(len(x)):
        c = cell[p]
        for d in range(dim):
            per_h = 1.0 / (upper[c, d] - lower[c, d])
            t = (x[p, d] - lower[c, d]) * per_h
            line[d, 0], line[d, 1] = 1.0 - t, t
            for i in range(4):
                a = power[c, d, i]
                slope[d, i] = (a[1] + t * (2.0 * a[2] + t * 3.0 * a[3])) * per_h
        first = np.uint64(c * 4**dim)
        for d in range(dim):
            along, q = np.uint64(4**d), np.uint64(4 ** ((d + 1) % dim))
            r = np.uint64(4 ** ((d + 2) % dim)) if dim == 3 else np.uint64(0)
            gx = gy = gz = 0.0
            for k in range(2 if dim == 3 else 1):
                for j in range(2):
                    w = line[(d + 1) % dim, j] * (line[(d + 2) % dim, k] if dim == 3 else 1.0)
                    row = first + np.uint64(1 + j) * q + np.uint64(1 + k) * r
                    for i in range(4):
                        node, g = around[row + np.uint64(i) * along], w * slope[d, i]
                        gx += g * field[node, 0]
                        gy += g * field[node, 1]
                        gz += g * field[node, 2] if dim == 3 else 0.0
            out[p, 0, d], out[p, 1, d] = gx, gy
            if dim == 3:
                out[p, 2, d] = gz
