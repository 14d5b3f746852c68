"""Cell tensors written straight into the array of a matrix, at places that are found once."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from ..common.compiled import jit
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from ..grid.unit_tensors import UnitTensors, tensors
from .blocks import Blocks, corner


class Pairs:
    """Pairs of the nodes of a cell, i ≤ j where tensors are symmetric.

    ``of`` (m, 2): which; ``entries``: those of their blocks in a tensor that is laid out row by
    row, one block after the other, each column by column.
    """

    def __init__(self, nodes: int, size: int, symmetric: bool):
        i, j = (a.ravel() for a in np.meshgrid(*[np.arange(nodes)] * 2, indexing="ij"))
        self.of = np.stack((i, j), axis=1)[i <= j if symmetric else slice(None)]
        row, column = (size * a[:, None, None] for a in self.of.T)
        down, along = np.arange(size)[None, None, :], np.arange(size)[None, :, None]
        self.entries = ((row + down) * nodes * size + column + along).ravel()
        self.symmetric = symmetric


class Insertion:
    """Adds the tensors of this rank's own cells to a matrix, of rows or of blocks.

    ``unit``: the tensors, of the entries of ``pairs``.  Rows and columns that are ``fixed`` (dofs,)
    stay empty but for a unit diagonal, as DOLFINx assembles them.  Cells with a node of another
    rank are handed to PETSc, which sends what it has to.
    """

    def __init__(
        self, grid: Grid, A: PETSc.Mat, unit: UnitTensors, pairs: Pairs, fixed: np.ndarray
    ):
        self._unit, self._pairs, self._axes = unit, pairs.of, grid.axes
        self._symmetric, self._blocks = pairs.symmetric, Blocks(_own(A), grid.dim)
        # from an entry of a block to the one below, and to the one beside it
        self._steps = self._blocks.down, self._blocks.along
        self._nodes, owned = dolfinx_versions.cell_dofs(grid.space), len(self._blocks.start) - 1
        self._inner = (self._nodes < owned).all(axis=1)
        self._inner[grid.owned_cells :] = False
        self._own_cells = grid.owned_cells
        self._place = np.zeros((grid.cells, len(pairs.of), 2), dtype=np.uint32)
        _find(self._nodes, pairs.of, self._inner, self._blocks.of, self._place)
        self._fixed = fixed.reshape(-1, grid.dim)
        self._blank, self._one = _of_fixed(self._blocks.of, self._fixed)
        self._cells: np.ndarray | None = None

    def add(self, A: PETSc.Mat, cells: np.ndarray) -> None:
        """Add the tensors of cells (n,), of what their fields are now."""
        self._unit.refresh()
        own = _own(A)
        inner, edge = (cells, None) if own is A else self._parted(cells)
        where = self._place, self._nodes, self._pairs
        with self._blocks.values(own) as values:
            given = self._unit.by_kind(inner), self._unit.arguments()
            _add(self._axes, *given, where, self._steps, self._symmetric, values)
            values[self._blank] = 0.0
            values[self._one] = 1.0
        if edge is not None:
            A.stateIncrease()
            self._hand_over(A, edge)

    def _parted(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Those of the cells whose nodes are all of this rank, and its others."""
        if self._cells is not cells:
            mine = cells[cells < self._own_cells]
            inner = self._inner[mine]
            self._cells, self._split = cells, (mine[inner], mine[~inner])
        return self._split

    def _hand_over(self, A: PETSc.Mat, cells: np.ndarray) -> None:
        """Add the tensors of cells (n,) as PETSc adds them."""
        nodes = self._nodes[cells]
        matrices = self._unit.of_cells(cells)
        (n, corners), size = nodes.shape, self._fixed.shape[1]
        # entries are those of pairs of nodes, column by column
        blocks = matrices.reshape(n, len(self._pairs), size, size).transpose(0, 1, 3, 2)
        whole = np.empty((n, corners, size, corners, size))
        for (i, j), block in zip(self._pairs, blocks.transpose(1, 0, 2, 3), strict=True):
            whole[:, i, :, j] = block
            if self._symmetric:
                whole[:, j, :, i] = block.transpose(0, 2, 1)
        free = ~self._fixed[nodes]
        whole *= free[:, :, :, None, None] & free[:, None, None]
        wide = corners * size
        for at, values in zip(nodes, whole.reshape(n, wide, wide), strict=True):
            A.setValuesBlockedLocal(at, at, values, PETSc.InsertMode.ADD_VALUES)


def _own(A: PETSc.Mat) -> PETSc.Mat:
    """The part of a matrix that couples this rank's nodes with one another."""
    return A if A.comm.size == 1 else A.getDiagonalBlock()


@jit
def _add(axes, cells, given, where, steps, symmetric, values):
    """values += A_c of the cells, block by block of its pairs of nodes, and of those turned round.

    ``cells`` of ``UnitTensors.by_kind``, ``given`` its ``arguments``; ``where`` (place, nodes,
    pairs); ``steps`` (down of each node, along).
    """
    tables, of, start = cells
    fields, dofs, weights, found = given
    for kind in range(len(tables)):
        for first in range(start[kind], start[kind + 1], len(weights)):
            some = of[first : min(first + len(weights), start[kind + 1])]
            tensors(tables[kind], some, fields, dofs, weights, found)
            _write(axes, some, found, where, steps, symmetric, values)


@jit
def _write(axes, cells, found, where, steps, symmetric, values):
    """The tensors ``found`` (n, entries) of some cells (n,) into the matrix."""
    place, nodes, pairs = where
    down, along = steps[0], np.uint64(steps[1])
    size = len(axes)
    for row in range(len(cells)):
        c = cells[row]
        for p in range(len(pairs)):
            i, j, entry = pairs[p, 0], pairs[p, 1], np.uint64(p * size * size)
            step, turned = np.uint64(down[nodes[c, i]]), np.uint64(down[nodes[c, j]])
            at, across = np.uint64(place[c, p, 0]), np.uint64(place[c, p, 1])
            for b in range(size):
                for a in range(size):
                    value = found[row, entry]
                    entry += np.uint64(1)
                    values[at + np.uint64(a) * step + np.uint64(b) * along] += value
                    if symmetric and i != j:
                        values[across + np.uint64(b) * turned + np.uint64(a) * along] += value


@jit
def _find(nodes, pairs, inner, blocks, place):
    """Where the blocks of pairs of nodes, and of those turned round, begin, of the cells that are
    ``inner`` (cells,): ``place`` (cells, m, 2); ``blocks`` is ``Blocks.of``."""
    start, near, _, layout = blocks
    for c in range(len(nodes)):
        if not inner[c]:
            continue
        for p in range(len(pairs)):
            for turned in range(2):
                i, j = nodes[c, pairs[p, turned]], nodes[c, pairs[p, 1 - turned]]
                k = np.searchsorted(near[start[i] : start[i + 1]], j)
                place[c, p, turned] = corner(start, layout, i, k)


@jit
def _of_fixed(blocks, fixed):
    """Places of entries in rows or columns that are ``fixed`` (nodes, size), and of those on the
    diagonal."""
    start, near, down, layout = blocks
    whole, size = layout
    along = size if whole else 1
    blank, one = [np.int64(0) for _ in range(0)], [np.int64(0) for _ in range(0)]
    held = np.zeros(len(fixed), np.bool_)
    for i in range(len(fixed)):
        for a in range(size):
            held[i] |= fixed[i, a]
    for i in range(len(start) - 1):
        for k in range(start[i + 1] - start[i]):
            j = near[start[i] + k]
            if not (held[i] or held[j]):
                continue
            at = corner(start, layout, i, k)
            for a in range(size):
                for b in range(size):
                    if fixed[i, a] or fixed[j, b]:
                        blank.append(at + a * down[i] + b * along)
                        if i == j and a == b:
                            one.append(at + a * down[i] + b * along)
    return np.array(blank), np.array(one)
