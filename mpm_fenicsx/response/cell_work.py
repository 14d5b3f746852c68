"""Work and stiffness at Gauss points where volume changes go cell by cell (B-bar, F-bar).

Strain at a Gauss point is ε - ⅓ (tr ε) 1 + ⅓ θ 1, θ the cell's own number (``CellMeans``).  It is
taken as that of the gradient there and one component more, θ, so that stress is its deviator in
the plane and the mean stress, and the tangent a matrix of as many rows:

    f_i = Σ_g V_g (B_giᵀ s_g + G_i p_g),    K_ij = Σ_g V_g [B_gi; G_i]ᵀ D_g [B_gj; G_j].

θ at a place depends on what is at others: no form, whose integrand knows one place, can say it, and
the sums are taken here, cell by cell (Hughes, Int. J. Numer. Meth. Engng 15, 1980; Simo and Hughes,
Computational Inelasticity, 1998, section 4.5.2).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from ..common import tensors
from ..common.compiled import jit
from ..grid.cell_means import CellMeans
from ..grid.gauss_points import GaussField, GaussPoints

FEW = 4096
"""Cells whose matrices are made at a time."""


class CellWork:
    """Fields at Gauss points that work on strain, row by row of ``pairs``, and on θ.

    ``pairs``: for each row of the gradient's the components (i, j) of ∂u_i/∂x_j that it adds up.
    ``stress`` and ``tangent`` are fields of as many numbers, and one more; those of a symmetric
    tangent the upper triangle.
    """

    def __init__(
        self,
        gauss: GaussPoints,
        means: CellMeans,
        pairs: tuple[tuple[tuple[int, int], ...], ...],
        symmetric: bool,
    ):
        grid = self.grid = gauss.grid
        self.gauss, self.means, self.symmetric = gauss, means, symmetric
        self._slopes = gauss.slopes_at(means.nodes)
        self._pairs = np.full((len(pairs), 2, 2), -1)
        for row, parts in enumerate(pairs):
            self._pairs[row, : len(parts)] = parts
        size = len(pairs) + 1
        self._entries = tensors.entries(size, symmetric)
        self.stress = GaussField(grid, size)
        self.tangent = GaussField(grid, len(self._entries[0]))
        self.slopes: np.ndarray | None = None  # of θ, where they are others than in ``means``
        self.beside: list[tuple[np.ndarray, np.ndarray]] = []  # pressures (cells,) and slopes
        self.turns = False
        self._own = means.nodes[: grid.owned_cells].astype(np.int32)
        self._cell_volume = gauss.volume.reshape(grid.cells, gauss.digit.shape[1])

    @property
    def _theta(self) -> np.ndarray:
        return self.means.slopes if self.slopes is None else self.slopes

    def add_force(self, u: np.ndarray, nodal: np.ndarray) -> None:
        """Add the force at displacements u (nodes, dim) to ``nodal`` (nodes, dim), N, of this
        rank's own cells."""
        _add_forces(
            self._own,
            (self._slopes, self._theta, self._cell_volume),
            self._pairs,
            self.stress.rows,
            nodal,
        )
        self.means.add_elastic_force(u, nodal, len(self._own))
        for pressure, slopes in self.beside:
            self.means.add_force(pressure[: len(self._own)], nodal, slopes)

    def add_stiffness(self, A: PETSc.Mat, fixed: np.ndarray) -> None:
        """Add K to the matrix, but for the rows and columns of ``fixed`` dofs (dofs,), bool."""
        works = self.tangent.rows.any(axis=1)
        if self.turns:  # at the apex of a cone pressure is all there is
            works |= self.stress.rows[:, -1] != 0.0
        there = works.reshape(self._cell_volume.shape).any(axis=1)

        def matrices(cells: np.ndarray, out: np.ndarray) -> None:
            _stiffness(
                cells,
                (self._slopes, self._theta, self._cell_volume),
                self._pairs,
                (*self._entries, self.symmetric),
                (self.stress.rows, self.tangent.rows, self.turns),
                out,
            )

        insert(A, self._own, np.flatnonzero(there[: len(self._own)]), matrices, fixed)
        add_elastic_stiffness(A, self.means, self._own, fixed)


def add_elastic_stiffness(
    A: PETSc.Mat, means: CellMeans, nodes: np.ndarray, fixed: np.ndarray
) -> None:
    """Add Σ_c K_c V_c G_c ⊗ G_c of cells with ``nodes`` (cells, k), the first of ``means``, where
    these bear what is elastic."""
    if means.bulk is None:
        return

    def matrices(cells: np.ndarray, out: np.ndarray) -> None:
        G = means.slopes[cells].reshape(len(cells), out.shape[1])
        np.multiply((means.bulk[cells, None] * G)[:, :, None], G[:, None, :], out=out)

    insert(A, nodes, np.flatnonzero(means.bulk[: len(nodes)]), matrices, fixed)


def insert(
    A: PETSc.Mat, nodes: np.ndarray, cells: np.ndarray, matrices: Callable, fixed: np.ndarray
) -> None:
    """Add matrices of some ``cells`` (n,) with ``nodes`` (all cells, k) to A, but for the rows and
    columns of ``fixed`` dofs (dofs,), bool; ``matrices`` writes those of a few cells."""
    held = fixed.reshape(-1, A.getBlockSize())
    for start in range(0, len(cells), FEW):
        some = cells[start : start + FEW]
        at = nodes[some]
        free = (~held[at]).reshape(len(some), -1).astype(float)
        out = np.empty((len(some), free.shape[1], free.shape[1]))
        matrices(some, out)
        out *= free[:, :, None]
        out *= free[:, None, :]
        A.setValuesBlockedLocalRCV(at, at, out, addv=PETSc.InsertMode.ADD_VALUES)


@jit
def _operator(slopes, theta, pairs, out):
    """Write the rows of B at a Gauss point, and that of θ, (rows + 1, k dim)."""
    k, dim = slopes.shape
    out[:] = 0.0
    last = len(pairs)
    for node in range(k):
        for row in range(last):
            for part in range(2):
                i, j = pairs[row, part]
                if i >= 0:
                    out[row, node * dim + i] += slopes[node, j]
        for i in range(dim):
            out[last, node * dim + i] = theta[node, i]


@jit
def _add_forces(nodes, operators, pairs, stress, out):
    """out_i += Σ_g V_g (B_giᵀ s_g + G_i p_g)."""
    slopes, theta, volume = operators
    k, dim = slopes.shape[2:]
    last, points = len(pairs), slopes.shape[1]
    for c in range(len(nodes)):
        mean = 0.0
        for g in range(points):
            row, V = stress[c * points + g], volume[c, g]
            mean += V * row[last]
            for r in range(last):
                s = V * row[r]
                if s != 0.0:
                    for part in range(2):
                        i, j = pairs[r, part]
                        if i >= 0:
                            for node in range(k):
                                out[nodes[c, node], i] += s * slopes[c, g, node, j]
        if mean != 0.0:
            for node in range(k):
                for i in range(dim):
                    out[nodes[c, node], i] += mean * theta[c, node, i]


@jit
def _stiffness(cells, operators, pairs, entries, fields, out):
    """Write the matrices (n, k dim, k dim) of ``cells`` (n,).  ``entries`` (rows, columns,
    symmetric) of what is carried; ``fields`` (stress, tangent, turns): where θ is ln det F of a
    cell that turns, its second derivative takes -P_c tr(l l), l = ∇u F⁻¹."""
    slopes, theta, volume = operators
    row, column, symmetric = entries
    stress, tangent, turns = fields
    points, k, dim = slopes.shape[1], slopes.shape[2], slopes.shape[3]
    size, n = len(pairs) + 1, k * dim
    B, DB, D = np.empty((size, n)), np.empty((size, n)), np.zeros((size, size))
    for place in range(len(cells)):
        c, K = cells[place], out[place]
        K[:] = 0.0
        mean = 0.0
        for g in range(points):
            q, V, some = c * points + g, volume[c, g], False
            mean += V * stress[q, size - 1]
            for e in range(len(row)):
                value = V * tangent[q, e]
                some |= value != 0.0
                D[row[e], column[e]] = value
                if symmetric:
                    D[column[e], row[e]] = value
            if not some:
                continue
            _operator(slopes[c, g], theta[c], pairs, B)
            for i in range(size):
                for j in range(n):
                    total = 0.0
                    for m in range(size):
                        total += D[i, m] * B[m, j]
                    DB[i, j] = total
            for m in range(size):
                for i in range(n):
                    b = B[m, i]
                    if b != 0.0:
                        for j in range(n):
                            K[i, j] += b * DB[m, j]
        if turns and mean != 0.0:
            for i in range(n):
                for j in range(n):
                    across = theta[c, i // dim, j % dim] * theta[c, j // dim, i % dim]
                    K[i, j] -= mean * across
