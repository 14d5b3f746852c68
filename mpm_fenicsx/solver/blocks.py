"""The blocks of a matrix of one rank, a row and a column of them a node, and the array they lie
in."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from petsc4py import PETSc

from ..common.compiled import jit

_PETSC = ctypes.CDLL(PETSc.__file__)  # with the library that it was linked to
_FORMATS = {"seqaij": "SeqAIJ", "seqbaij": "SeqBAIJ"}
POSSIBLE = PETSc.ScalarType is np.float64 and all(
    hasattr(_PETSC, f"Mat{kind}{call}Array")
    for kind in _FORMATS.values()
    for call in ("Get", "Restore")
)
"""Whether PETSc hands out arrays of matrices, of numbers that are ours."""


class Blocks:
    """Where the blocks of ``A``, of ``size`` rows and columns, lie in its array.

    ``start`` (nodes + 1,) and ``near`` (blocks,): the first block of each node's rows, and the
    columns.  ``layout``: whether PETSc keeps blocks, column by column, or rows; and the size.
    ``down`` (nodes,) and ``along``: how far the next entry of a block is, below and beside.
    ``entries``: all numbers in the array.
    Raises ``RuntimeError`` where rows of one node have columns of their own.
    """

    def __init__(self, A: PETSc.Mat, size: int):
        whole = A.getType() == "seqbaij"
        first, column = A.getRowIJ(compressed=whole)
        self.start, self.near = (first, column) if whole else _of_nodes(first, column, size)
        if not whole and size**2 * len(self.near) != len(column):
            raise RuntimeError("the matrix is not of blocks: rows of a node differ in columns")
        self.layout = whole, size
        down = np.ones_like(self.start[1:]) if whole else size * np.diff(self.start)
        self.down, self.along = down.astype(np.int32), size if whole else 1
        self.entries = size**2 * len(self.near)

    @property
    def of(self) -> tuple:
        """``start``, ``near``, ``down``, ``layout``, for compiled loops."""
        return self.start, self.near, self.down, self.layout

    @contextmanager
    def values(self, A: PETSc.Mat, change: bool = True) -> Iterator[np.ndarray]:
        """The array (entries,) of a matrix that has been assembled, to read or to ``change``."""
        if not self.entries:  # of a rank without nodes
            yield np.zeros(0)
            return
        kind, matrix = _FORMATS[A.getType()], ctypes.c_void_p(A.handle)
        pointer = ctypes.POINTER(ctypes.c_double)()
        for call in ("Get", "Restore"):
            function = getattr(_PETSC, f"Mat{kind}{call}Array")
            if function(matrix, ctypes.byref(pointer)):
                raise RuntimeError(
                    f"PETSc does not {call.lower()} the array of a {A.getType()} matrix"
                )
            if call == "Get":
                yield np.ctypeslib.as_array(pointer, (self.entries,))
        if change:
            A.stateIncrease()


@jit
def _of_nodes(first, column, size):
    """Of a matrix of rows: where the blocks of each node start (nodes + 1,), and their columns."""
    nodes = (len(first) - 1) // size
    start = np.zeros(nodes + 1, first.dtype)
    for i in range(nodes):
        start[i + 1] = start[i] + (first[size * i + 1] - first[size * i]) // size
    near = np.empty(start[nodes], first.dtype)
    for i in range(nodes):
        for k in range(start[i + 1] - start[i]):
            near[start[i] + k] = column[first[size * i] + size * k] // size
    return start, near


@jit
def corner(start, layout, i, k):
    """The place of the first entry of the k-th block of a node's rows."""
    blocks, size = layout
    return size * size * (start[i] + k) if blocks else size * (size * start[i] + k)
