"""Shape functions at points: linear, or averaged over support domains (GIMP)."""

from __future__ import annotations

import numpy as np

from ..common.compiled import digits, jit, once
from ..dynamics.time_stepping import Newmark
from ..grid.cells import Lattice
from ..grid.grid import Grid
from ..points.material_points import MaterialPoints
from . import kernels


class Stencil:
    """Weights of points on the grid's nodes: linear shape functions, or their means over support
    domains.

    The linear case is that of support domains without extent.  Weights are products of those of the
    directions, and these are what is kept: ``line`` and ``slope`` (n, dim, k), 1/m, refreshed by
    ``place``; k = 2, or 3 with support domains.  ``side``, ``span``, ``share`` say how each support
    domain is cut at the cell's edges (``kernels.place``).  ``lattice``: the cells, if not those of
    the grid alone.
    """

    def __init__(self, grid: Grid, points: int, support: bool, lattice: Lattice | None = None):
        self.lattice = grid.lattice if lattice is None else lattice
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
        kernels.place(self.grid.axes, (x, half, cell), self.lattice.bounds, self.cut, weights)

    @property
    def cut(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How support domains are cut at the edges of cells: side, span, share."""
        return self.side, self.span, self.share

    @property
    def weights(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What kernels want to know of nodes and their weights: around, first, line."""
        return self.lattice.around, self.first, self.line

    @property
    def nodes(self) -> np.ndarray:
        """The nodes (n, k^dim) of each point, x fastest; one that is not there, without weight,
        reads 0."""
        k, dim = len(self.reach), self.grid.dim
        return self.lattice.around[
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

    def deposit_stress(self, volume: np.ndarray, stress: np.ndarray, nodal: np.ndarray) -> None:
        """The same of volumes (n,), m³, and stress rows (n, components), Pa."""
        axes, points = self.grid.axes, (volume, stress)
        kernels.scatter_stress(axes, self.reach, self.weights, self.slope, points, nodal)

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

    def stretch_at_points(self, nodal: np.ndarray) -> np.ndarray:
        """Ratios (n, dim) of the extents of support domains for nodal displacements (nodes,
        dim)."""
        out, axes = np.empty((len(self), self.grid.dim)), self.grid.axes
        kernels.interpolate_stretch(axes, self.reach, self.weights, self.slope, nodal, out)
        return out

    def advance(
        self,
        body: MaterialPoints,
        u: np.ndarray,
        acceleration: np.ndarray,
        stepping: Newmark,
        J: np.ndarray,
        stretch: np.ndarray,
    ) -> None:
        """Do in one pass what ``velocities.trapezoidal`` and ``MaterialPoints.deform`` do, of nodal
        displacements and accelerations at the end of the step (nodes, dim)."""
        nodal = np.hstack((u, acceleration))
        points = body.x, body.velocity, body.acceleration
        rule = stepping.dt * (1.0 - stepping.gamma), stepping.dt * stepping.gamma
        shapes = body.volume, body.half, J, stretch
        if body.seat is not None:
            body.seat += self.at_points(u)
        kernels.advance(self.grid.axes, self.reach, self.weights, nodal, points, rule, shapes)

    def mean_of_cells(self, values: np.ndarray) -> np.ndarray:
        """Means (n,) over the support domains of one value a cell (cells,)."""
        out = np.empty(len(self))
        _mean_of_cells(self.side, self.share, self.cell, self.lattice.neighbour, values, out)
        return out

    def add_to_cells(self, values: np.ndarray, out: np.ndarray) -> None:
        """Add to one number a cell, ``out`` (cells,), the part of each point's value (n,) that its
        support domain has of it there."""
        neighbour = self.lattice.neighbour
        _add_to_cells(self.side, self.share, self.cell, neighbour, values, out)


@jit
def part(side, share, neighbour, cell, p, corner):
    """The cell that a part of p's support domain lies in, and how large a part of it that is; see
    ``kernels.place``."""
    c, weight = cell, 1.0
    for d in range(side.shape[1]):
        s = (corner >> d) & 1
        weight *= share[p, d, s]
        if s == 1 and weight > 0.0:
            c = neighbour[c, d, (side[p, d] + 1) // 2]
    return c, weight


@jit
def _mean_of_cells(side, share, cell, neighbour, values, out):
    """out_p = Σ_c (share of p's support domain in c) q_c."""
    n, dim = side.shape
    for p in range(n):
        out[p] = 0.0
        for corner in range(2**dim):
            c, weight = part(side, share, neighbour, cell[p], p, corner)
            if weight > 0.0:
                out[p] += weight * values[c]


@jit
def _add_to_cells(side, share, cell, neighbour, values, out):
    """out_c += (share of p's support domain in c) q_p."""
    n, dim = side.shape
    for p in range(n):
        for corner in range(2**dim):
            c, weight = part(side, share, neighbour, cell[p], p, corner)
            if weight > 0.0:
                out[c] += weight * values[p]
