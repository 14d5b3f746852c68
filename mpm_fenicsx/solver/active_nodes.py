"""The part of a system of equations that is solved: nodes that are free and touch material."""

from __future__ import annotations

from functools import reduce

from mpi4py import MPI

import numpy as np
from petsc4py import PETSc

from ..common.ranks import of_all

FEW = 0.15
"""Of the nodes: to copy what the others have costs more than to carry so many along, with a
diagonal of their own."""


def of_nodes(dofs: np.ndarray, size: int) -> np.ndarray:
    """Which nodes (n,) have one of the dofs (n size,), bool; column by column, for NumPy is slow
    along short rows."""
    return reduce(np.logical_or, dofs.reshape(-1, size).T)


class Part:
    """Rows and columns of ``whole``, node by node, with vectors ``b`` and ``x`` of their own;
    ``matrix`` is theirs."""

    def __init__(self, whole: PETSc.Mat, symmetric: bool = True):
        self.whole, self._symmetric = whole, symmetric
        self._take_all()

    def diagonal(self, into: PETSc.Vec) -> None:
        """The diagonal of the whole."""
        self.whole.getDiagonal(into)

    def take(self, used: np.ndarray, diagonal: PETSc.Vec) -> bool:
        """Rows in ``used`` (dofs,), and all others of their nodes, as the whole is now; all, where
        none is used or few are not.

        Their diagonal becomes that of ``diagonal``, given for the whole.  True if these are other
        nodes than before.  Ranks decide together; one may have no such node.  All rows of blocks on
        several ranks are taken, every time: PETSc 3.18 to 3.25 cannot renew a part of such a matrix
        (error 60), and to take it anew costs more than to assemble.
        """
        bs, comm = self.whole.getBlockSize(), self.whole.comm.tompi4py()
        nodes = of_nodes(used, bs)
        taken, changed = self._of_all(comm, nodes)
        if not taken or self.whole.getType() == "mpibaij":
            changed = False
        else:
            rows = self.whole.getSize()[0] // bs
            if (1.0 - FEW) * rows <= taken < rows:
                nodes[:] = True
                taken, changed = self._of_all(comm, nodes)
            if changed and taken == rows:
                self._take_all()
            elif changed:
                self._choose(nodes, bs)
            elif self._nodes is not None:
                self.whole.createSubMatrix(self._nodes, self._nodes, self.matrix)
        others = np.flatnonzero(~used[self._rows])
        if of_all(comm, len(others), MPI.MAX):
            row = (self.matrix.getOwnershipRange()[0] + others).astype(PETSc.IntType)
            value = diagonal.array[self._rows][others]
            one_each = np.arange(len(row) + 1, dtype=PETSc.IntType)
            self.matrix.setValuesIJV(one_each, row, value, rowmap=row)
            self.matrix.assemble()
        return changed

    def _of_all(self, comm: MPI.Comm, nodes: np.ndarray) -> tuple[int, bool]:
        """How many nodes there are in ``nodes`` (nodes,), and whether they are others than before,
        on all ranks."""
        found = np.array([np.count_nonzero(nodes), not np.array_equal(nodes, self._used)])
        if comm.size > 1:
            comm.Allreduce(MPI.IN_PLACE, found)
        return int(found[0]), bool(found[1])

    def load(self, values: np.ndarray) -> None:
        """Right-hand side from values (dofs,) of the whole."""
        self.b.array[:] = values[self._rows]

    def give(self, values: np.ndarray) -> None:
        """Solution into values (dofs,) of the whole, zero elsewhere."""
        values[:] = 0.0
        values[self._rows] = self.x.array

    def _take_all(self) -> None:
        self.matrix = self.whole
        self.b, self.x = self.whole.createVecs()
        self._nodes: PETSc.IS | None = None
        self._used = np.ones(self.whole.getLocalSize()[0] // self.whole.getBlockSize(), dtype=bool)
        self._rows: np.ndarray | slice = slice(None)

    def _choose(self, used: np.ndarray, bs: int) -> None:
        nodes = np.flatnonzero(used)
        self._used, self._rows = used, (bs * nodes[:, None] + np.arange(bs)).ravel()
        first = self.whole.getOwnershipRange()[0] // bs
        numbers = (first + nodes).astype(PETSc.IntType)
        self._nodes = PETSc.IS().createBlock(bs, numbers, comm=self.whole.comm)
        self.matrix = self.whole.createSubMatrix(self._nodes, self._nodes)
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, self._symmetric)
        self.b, self.x = self.matrix.createVecs()
