"""Cell tensors of forms that are linear in fields: those of unit fields, once for each kind of
cell."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import ufl

from ..common.compiled import jit
from ..common.ranks import of_all
from . import dolfinx_versions
from .grid import Grid

AT_ONCE = 64
"""Cells, an even number, whose tensors are taken together: they stay in the cache until they are
used."""
FOUR = 4
"""Unit tensors that are added up at a time."""
MANY = 2000
"""Unit tensors of all kinds of cells: to ask the kernels for more, whenever a constant of the form
has changed, costs more than a step."""
LARGE = 2**23
"""Bytes of unit tensors: above, to read them costs what they save."""
LOUD = 2.0**60
"""A field's value beside which what a form has without fields is nothing; a power of two, so that
products with it are exact."""
AFFINE = 1e-11
"""Of a kernel's largest entry: how far one that is affine in its fields may be off by round-off."""


class UnitTensors:
    """The tensor of each cell as a sum over the values w that its fields have there,

        A_c = T_0 + Σ_q w_q(c) T_q,

    where the T are those of fields that are one at one place, from the kernel that the form is
    compiled to: the same for all cells of a kind (``Grid.kinds``).

    ``fields`` whose values count, ``dofs`` of them (cells, k) one array each, places in their
    arrays; ``tables`` (q + 1, entries), one a kind, T_0 last if there is one, as they are for the
    constants of the form when it was last ``refresh``ed.  Of a tensor, laid out row by row, the
    ``entries`` (m,) are kept.
    """

    def __init__(self, grid: Grid, kernels: list[dolfinx_versions.CellKernel], entries: np.ndarray):
        self.grid, self._kernels, self._entries = grid, kernels, entries
        self.fields = list(dict.fromkeys(f for kernel in kernels for f in kernel.coefficients))
        self.dofs = tuple(_places(f.function_space) for f in self.fields)
        ends = np.cumsum([0, *(places.shape[1] for places in self.dofs)])
        self._first, self._constant = dict(zip(self.fields, ends[:-1], strict=True)), int(ends[-1])
        self._of: bytes | None = None
        self._cells: np.ndarray | None = None
        corners = grid.kinds.corners
        self._make_room(any(_by_chance(k, at, 0.0).any() for k in kernels for at in corners))

    def _make_room(self, constant: bool) -> None:
        """Make tables, with a place for T_0 if there is one, and room for cells at once."""
        values = self._constant + int(constant)
        values += -values % FOUR  # of nothing, at the end
        self.tables = np.zeros((len(self.grid.kinds.corners), values, len(self._entries)))
        self._room = np.zeros((AT_ONCE, values)), np.zeros((AT_ONCE, len(self._entries)))
        self._has_constant = constant
        if constant:
            self._room[0][:, self._constant] = 1.0

    @classmethod
    def of(cls, grid: Grid, form: ufl.Form, entries: np.ndarray) -> UnitTensors | None:
        """Those of a form over cells that is affine in fields (see ``affine_in_fields``; kernels
        that contradict are not taken), or None where the grid is not rectilinear, or has so many
        kinds of cells that their tensors are too many.  Collective; ranks decide together."""
        kernels = [dolfinx_versions.cell_kernel(part) for part in dolfinx_versions.kernels(form)]
        can = None not in kernels and grid.kinds is not None
        if can:
            fields = dict.fromkeys(f for kernel in kernels for f in kernel.coefficients)
            values = sum(dolfinx_versions.values_in_cell(f.function_space) for f in fields)
            tensors_of_all = len(grid.kinds.corners) * (1 + values)
            can = tensors_of_all <= MANY and tensors_of_all * len(entries) * 8 <= LARGE
            can = can and all(_affine(k, at) for k in kernels for at in grid.kinds.corners[:1])
        if not grid.comm.allreduce(int(can), op=MPI.MIN):
            return None
        return cls(grid, kernels, entries)

    @property
    def symmetric(self) -> bool:
        """Whether the tensors of a bilinear form are so, whatever fields and constants: seen at
        numbers by chance.  Collective."""
        return bool(of_all(self.grid.comm, int(self._looks_symmetric()), MPI.MIN))

    def _looks_symmetric(self) -> bool:
        if not len(self.grid.kinds.corners):
            return True
        found = sum(_by_chance(kernel, self.grid.kinds.corners[0], 1.0) for kernel in self._kernels)
        size = round(len(found) ** 0.5)
        A = found.reshape(size, size)
        return bool(np.abs(A - A.T).max() <= AFFINE * np.abs(A).max())

    def refresh(self) -> None:
        """Bring the tables to what the form's constants are now."""
        now = b"".join(kernel.constants().tobytes() for kernel in self._kernels)
        if now == self._of:
            return
        self._of, self.tables[:] = now, 0.0
        for table, corners in zip(self.tables, self.grid.kinds.corners, strict=True):
            for kernel in self._kernels:
                # so large that nothing of it is lost beside T_0, which is taken off again
                w = np.vstack((np.zeros(kernel.width), LOUD * np.eye(kernel.width)))
                rest, *of_one = kernel(corners, w, kernel.constants())[:, self._entries]
                if rest.any():
                    if not self._has_constant:  # a constant of the form was zero until now
                        self._make_room(True)
                        self._of = None
                        return self.refresh()
                    table[self._constant] += rest
                rows = iter(of_one)
                for f in kernel.coefficients:
                    wide = dolfinx_versions.values_in_cell(f.function_space)
                    for row in table[self._first[f] :][:wide]:
                        row += (next(rows) - rest) / LOUD

    def by_kind(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The tables; the cells (n,) kind by kind; and where each kind starts (kinds + 1,)."""
        if len(self.tables) == 1:
            return self.tables, cells, np.array([0, len(cells)])
        if self._cells is not cells:
            kind = self.grid.kinds.of[cells]
            order = cells[np.argsort(kind, kind="stable")]
            start = np.searchsorted(np.sort(kind), np.arange(len(self.tables) + 1))
            self._cells, self._by_kind = cells, (order, start)
        return self.tables, *self._by_kind

    def of_cells(self, cells: np.ndarray) -> np.ndarray:
        """The tensors (n, entries) of cells (n,)."""
        *given, out = self.arguments()
        found, kind = np.empty((len(cells), out.shape[1])), self.grid.kinds.of[cells]
        for k, table in enumerate(self.tables):
            rows = np.flatnonzero(kind == k)
            for first in range(0, len(rows), len(out)):
                some = rows[first : first + len(out)]
                tensors(table, cells[some], *given, out)
                found[some] = out[: len(some)]
        return found

    def arguments(self) -> tuple:
        """What ``tensors`` asks for besides a table and cells: values of fields, their places, and
        room for as many cells as it takes at once."""
        if not self.fields:  # compiled loops want to know what a tuple holds
            none = np.zeros((self.grid.cells, 0), dtype=np.int32)
            return (np.zeros(0),), (none,), *self._room
        return tuple(f.x.array for f in self.fields), self.dofs, *self._room


@jit
def tensors(table, cells, values, dofs, weights, out):
    """A_c (n, entries) into ``out`` for the cells (n,), at most so many as there is room for in
    ``weights`` (n, q + 1), where the one of T_0 is already: A = W T."""
    for row in range(len(cells)):
        q = 0
        for f in range(len(values)):
            for k in range(dofs[f].shape[1]):
                weights[row, q] = values[f][dofs[f][cells[row], k]]
                q += 1
    for row in range(0, len(cells), 2):
        _two(weights, table, row, out)


@jit
def _two(weights, table, row, out):
    """Two rows of W T: four products for each number that is read from memory."""
    i, j = np.uint64(row), np.uint64(row + 1)
    for e in range(table.shape[1]):
        out[i, e] = out[j, e] = 0.0
    for q in range(0, len(table), FOUR):
        k, l, m, n = np.uint64(q), np.uint64(q + 1), np.uint64(q + 2), np.uint64(q + 3)
        u0, u1, u2, u3 = weights[i, k], weights[i, l], weights[i, m], weights[i, n]
        v0, v1, v2, v3 = weights[j, k], weights[j, l], weights[j, m], weights[j, n]
        for e in range(table.shape[1]):
            t0, t1, t2, t3 = table[k, e], table[l, e], table[m, e], table[n, e]
            out[i, e] += u0 * t0 + u1 * t1 + u2 * t2 + u3 * t3
            out[j, e] += v0 * t0 + v1 * t1 + v2 * t2 + v3 * t3


def _places(V) -> np.ndarray:
    """Places (cells, k) in its array of the values that a field has in each cell, in the order of
    kernels."""
    size = V.dofmap.index_map_bs
    dofs = dolfinx_versions.cell_dofs(V)
    if size > 1:
        blocks = size * dofs[:, :, None] + np.arange(size, dtype=dofs.dtype)
        dofs = blocks.reshape(len(dofs), size * dofs.shape[1])
    places = dofs.view()
    places.flags.writeable = False  # all of them: compiled loops want arrays of one kind
    return places


def _by_chance(
    kernel: dolfinx_versions.CellKernel, corners: np.ndarray, factor: float
) -> np.ndarray:
    """The tensor (entries,) of constants and, times a factor, of fields by chance."""
    rng = np.random.default_rng(2)
    w, constants = (rng.uniform(0.5, 1.5, n) for n in (kernel.width, len(kernel.constants())))
    return kernel(corners, factor * w[None], constants)[0]


def _affine(kernel: dolfinx_versions.CellKernel, corners: np.ndarray) -> bool:
    """Whether a kernel is affine in its coefficients, whatever its constants: seen at numbers by
    chance, small and ``LOUD``."""
    rng = np.random.default_rng(1)
    constants = rng.uniform(0.5, 1.5, len(kernel.constants()))
    a, b = rng.uniform(0.5, 1.5, (2, kernel.width))
    for factor in (1.0, LOUD):
        values = factor * np.stack((0.0 * a, a, b, a + b))
        at_zero, at_a, at_b, at_both = kernel(corners, values, constants)
        size = np.abs(at_both).max(initial=0.0)
        off = np.abs(at_both + at_zero - at_a - at_b).max(initial=0.0)
        if not (np.isfinite(size) and off <= AFFINE * size):
            return False
    return True
