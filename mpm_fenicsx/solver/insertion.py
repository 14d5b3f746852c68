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
    """Adds the tensors of cells to a matrix of one rank, of rows or of blocks.

    ``unit``: the tensors, of the entries of ``pairs``.  Rows and columns that are ``fixed`` (dofs,)
    stay empty but for a unit diagonal, as DOLFINx assembles them.
    """

    def __init__(
        self, grid: Grid, A: PETSc.Mat, unit: UnitTensors, pairs: Pairs, fixed: np.ndarray
    ):
        self._unit, self._pairs, self._axes = unit, pairs.of, grid.axes
        self._symmetric, self._blocks = pairs.symmetric, Blocks(A, grid.dim)
        # from an entry of a block to the one below, and to the one beside it
        self._steps = self._blocks.down, self._blocks.along
        self._nodes = dolfinx_versions.cell_dofs(grid.space)
        self._place = np.empty((grid.cells, len(pairs.of), 2), dtype=np.uint32)
        _find(self._nodes, pairs.of, self._blocks.of, self._place)
        self._blank, self._one = _of_fixed(self._blocks.of, fixed.reshape(-1, grid.dim))

    def add(self, A: PETSc.Mat, cells: np.ndarray) -> None:
        """Add the tensors of cells (n,), of what their fields are now."""
        self._unit.refresh()
        where = self._place, self._nodes, self._pairs
        with self._blocks.values(A) as values:
            given = self._unit.by_kind(cells), self._unit.arguments()
            _add(self._axes, *given, where, self._steps, self._symmetric, values)
            values[self._blank] = 0.0
            values[self._one] = 1.0


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
def _find(nodes, pairs, blocks, place):
    """Where the blocks of each cell's pairs of nodes, and of those turned round, begin:
    ``place`` (cells, m, 2); ``blocks`` is ``Blocks.of``."""
    start, near, _, layout = blocks
    for c in range(len(nodes)):
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
