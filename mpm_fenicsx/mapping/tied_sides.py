"""Opposite sides of a grid whose nodes move together: the grid goes on over them.

Nodes that lie opposite each other are one node of the system, of which the grid has two copies, or
four at the edges of two pairs of sides: u = S u, S taking each copy to the first one of its class.
Forces on all copies act on that, Sᵀ r.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from mpi4py import MPI

import numpy as np
from petsc4py import PETSc

from ..common.ranks import anywhere
from ..grid.cells import SIDES, Lattice, patches
from ..grid.grid import Grid

HAIR = 1e-6
"""Of the smallest cell: nodes that far apart lie opposite each other."""


class TiedSides:
    """Which nodes move together, in each direction.

    ``pairs``: direction of each pair of sides, and which components (dim,), bool, are tied there.
    ``nodes`` (m,): those of this rank, ghosts included, that lie on tied sides; ``of`` (m, dim):
    the number of the class that each component of them is in, the same on all ranks.
    ``whole``: all components are tied everywhere.
    Collective.  Raises ``ValueError``, on all ranks, where nodes of two sides are not opposite.
    """

    def __init__(self, grid: Grid, pairs: Sequence[tuple[int, np.ndarray]]):
        self.grid, self._pairs = grid, list(pairs)
        self.whole = all(tied.all() for _, tied in pairs)
        owned = grid.space.dofmap.index_map.size_local
        x = grid.space.tabulate_dof_coordinates()[:, : grid.dim]
        self.nodes = np.flatnonzero(np.any([_at(grid, x, d) for d, _ in pairs], axis=(0, 2)))
        self._own = self.nodes < owned
        mine = self.nodes[self._own]
        number = _numbers(grid)
        places, numbers = (np.concatenate(grid.comm.allgather(a)) for a in (x[mine], number[mine]))
        order = np.argsort(numbers)
        places, self._numbers = places[order], numbers[order]
        self.joined = _joined(grid, places, pairs)  # rows (k,) and (k,), components (k, dim)
        labels = _classes(len(places), self.joined, grid.dim)
        self._first = np.stack(
            [self._numbers[np.unique(of, return_index=True)[1]][of] for of in labels.T], axis=1
        )
        rows = np.searchsorted(self._numbers, number[self.nodes])
        self.of, self._classes = labels[rows], labels.max(axis=0, initial=-1) + 1
        self._first = self._first[rows]

    def __str__(self) -> str:
        pairs = ", ".join(
            " and ".join(name for name, (along, _) in SIDES.items() if along == d)
            for d, _ in self._pairs
        )
        return f"{pairs}: {len(self.joined[0])} pairs of nodes"

    @property
    def directions(self) -> list[int]:
        """The directions across the pairs of sides."""
        return [d for d, _ in self._pairs]

    @property
    def opposite(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Global numbers (k,) and (k,) of nodes that lie opposite each other, of all ranks, and
        which components (k, dim) of them move together."""
        a, b, tied = self.joined
        return self._numbers[a], self._numbers[b], tied

    @cached_property
    def first(self) -> np.ndarray:
        """Global numbers (nodes,) of this rank's nodes, those of the first of their class for
        all copies."""
        number = _numbers(self.grid)
        number[self.nodes] = self._first[:, 0]
        return number

    # -- cells and places --------------------------------------------------------------------------

    @cached_property
    def lattice(self) -> Lattice:
        """The grid's cells, which go on over tied sides.

        Raises ``ValueError``, on all ranks, where a cell beside a tied side is not known to the
        rank that owns the one opposite.  Collective when it is first asked for.
        """
        grid, lat = self.grid, self.grid.lattice
        neighbour, index, message = lat.neighbour.copy(), grid.index, None
        for d in self.directions:
            size = lat.upper[:, d] - lat.lower[:, d]
            low = np.flatnonzero(lat.lower[:, d] - grid.lower_corner[d] < HAIR * size)
            high = np.flatnonzero(grid.upper_corner[d] - lat.upper[:, d] < HAIR * size)
            along = np.delete(index, d, axis=1)
            number = along @ np.cumprod([1, *(1 + along.max(axis=0, initial=0))])[:-1]
            _, a, b = np.intersect1d(number[low], number[high], return_indices=True)
            neighbour[low[a], d, 0], neighbour[high[b], d, 1] = high[b], low[a]
            for cells, end in ((low, 0), (high, 1)):
                if (neighbour[cells[cells < grid.owned_cells], d, end] < 0).any():
                    message = (
                        "Tied: material points on several ranks need a grid whose ranks know the "
                        "cells over its tied sides: Grid.box(..., periodic=...) names these"
                    )
        message = anywhere(grid.comm, message)
        if message:
            raise ValueError(message)
        lower, upper = lat.lower, lat.upper
        patch = patches(neighbour, lat.nodes)
        return Lattice(lower, upper, lat.nodes, neighbour, patch, lat.volume, lat.size)

    def inside(self, x: np.ndarray) -> np.ndarray:
        """Places x (n, dim), m, those beyond a tied side where they come in on the other."""
        x = x.copy()
        self._bring_in(x)
        return x

    def bring_in(self, x: np.ndarray, cell: np.ndarray) -> np.ndarray | None:
        """Points that have left through a tied side come in on the other: x (n, dim), m, and
        ``cell`` (n,), of those in the last cell there, change in place.  Returns how far they jump
        (n, dim), m, or None where none does."""
        known, beyond = self.grid.lattice.neighbour, self.lattice.neighbour
        before = x.copy()
        found = self._bring_in(x)
        for row, d, end in found:
            last = known[cell[row], d, end] < 0
            cell[row[last]] = beyond[cell[row[last]], d, end]
        return x - before if found else None

    def _bring_in(self, x: np.ndarray) -> list[tuple[np.ndarray, int, int]]:
        """Rows that were beyond a side, the direction and the end of it, side by side."""
        low, high, found = self.grid.lower_corner, self.grid.upper_corner, []
        for d in self.directions:
            width = high[d] - low[d]
            for end, beyond in enumerate((x[:, d] < low[d], x[:, d] >= high[d])):
                row = np.flatnonzero(beyond)
                if len(row):
                    x[row, d] -= width * np.floor((x[row, d] - low[d]) / width)
                    found.append((row, d, end))
        return found

    # -- what copies have together -----------------------------------------------------------------

    def add_up(self, nodal: np.ndarray) -> None:
        """Each copy gets the sum of all copies' values (nodes, f), which ghosts have from their
        owners.  Collective."""
        total = np.zeros((self._classes[0], nodal.shape[1]))
        np.add.at(total, self.of[self._own, 0], nodal[self.nodes[self._own]])
        self.grid.comm.Allreduce(MPI.IN_PLACE, total)
        nodal[self.nodes] = total[self.of[:, 0]]

    def largest(self, values: np.ndarray) -> np.ndarray:
        """Values (nodes,) of which each copy has the largest of all copies'.  Collective."""
        total = np.full(self._classes[0], -np.inf)
        np.maximum.at(total, self.of[self._own, 0], values[self.nodes[self._own]])
        self.grid.comm.Allreduce(MPI.IN_PLACE, total, op=MPI.MAX)
        values = values.copy()
        values[self.nodes] = total[self.of[:, 0]]
        return values

    def with_copies(self, dofs: np.ndarray) -> np.ndarray:
        """Dofs (n,) and those that move with them, in order.  Collective."""
        dim = self.grid.dim
        marks = np.zeros((self.grid.nodes, dim), dtype=bool)
        marks.reshape(-1)[dofs] = True
        for c in range(dim):
            total = np.zeros(self._classes[c], dtype=np.int8)
            np.maximum.at(total, self.of[:, c], marks[self.nodes, c].astype(np.int8))
            self.grid.comm.Allreduce(MPI.IN_PLACE, total, op=MPI.MAX)
            marks[self.nodes, c] = total[self.of[:, c]] > 0
        return np.flatnonzero(marks).astype(np.int32)

    def differs(self, values: np.ndarray) -> float:
        """By how much the copies' values (nodes, dim) differ at most.  Collective."""
        most = 0.0
        for c in range(self.grid.dim):
            ends = np.full((2, self._classes[c]), -np.inf)
            for end, sign in zip(ends, (1.0, -1.0), strict=True):
                np.maximum.at(end, self.of[:, c], sign * values[self.nodes, c])
            self.grid.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
            most = max(most, float(ends.sum(axis=0).max(initial=0.0)))
        return most

    def matrix(self, fixed: np.ndarray) -> tuple[PETSc.Mat, np.ndarray]:
        """S (dofs, dofs), and which dofs (dofs,) follow others.  Those that are ``fixed`` (dofs,),
        with all their copies, stay as they are."""
        grid, numbers = self.grid, self.grid.space.dofmap.index_map
        dim, owned = grid.dim, grid.dim * numbers.size_local
        follows = np.zeros((grid.nodes, dim), dtype=bool)
        follows[self.nodes] = self._first != _numbers(grid)[self.nodes, None]
        follows &= ~fixed.reshape(-1, dim)
        first = dim * _numbers(grid)[:, None] + np.arange(dim)
        first[self.nodes] = dim * self._first + np.arange(dim)
        rows = np.flatnonzero(follows.ravel()[:owned])
        S = PETSc.Mat().create(grid.comm)
        S.setSizes(((owned, None), (owned, None)))
        S.setType("aij")
        S.setBlockSizes(dim, dim)
        S.setPreallocationNNZ((2, 1))
        start = S.getOwnershipRange()[0]
        diagonal = np.arange(start, start + owned, dtype=PETSc.IntType)
        ones = np.ones(owned)
        ones[rows] = 0.0  # zeros too: SᵀAS needs a whole diagonal
        _add(S, diagonal, diagonal, ones)
        _add(S, diagonal[rows], first.ravel()[rows].astype(PETSc.IntType), np.ones(len(rows)))
        S.assemble()
        return S, follows.ravel()


def _add(S: PETSc.Mat, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
    """Add one value (m,) in each of rows (m,) and columns (m,)."""
    starts = np.arange(len(rows) + 1, dtype=PETSc.IntType)
    S.setValuesIJV(starts, columns, values, PETSc.InsertMode.ADD_VALUES, rows)


def _numbers(grid: Grid) -> np.ndarray:
    """Global numbers (nodes,) of this rank's nodes, ghosts included."""
    numbers = grid.space.dofmap.index_map
    return numbers.local_to_global(np.arange(grid.nodes, dtype=np.int32)).astype(np.int64)


def _at(grid: Grid, x: np.ndarray, d: int) -> np.ndarray:
    """Whether places x (n, dim), m, lie on the lower and on the upper side across direction d
    (n, 2)."""
    ends = np.array([grid.lower_corner[d], grid.upper_corner[d]])
    return np.abs(x[:, d, None] - ends) < HAIR * grid.smallest


def _joined(grid: Grid, x: np.ndarray, pairs: Sequence) -> tuple[np.ndarray, ...]:
    """Rows (k,) and (k,) of places x (n, dim) that are opposite, and components (k, dim)."""
    from scipy.spatial import cKDTree

    one, other, tied = [], [], []
    for d, components in pairs:
        low, high = (np.flatnonzero(side) for side in _at(grid, x, d).T)
        along = np.delete(x, d, axis=1)
        for a, b, end in ((low, high, 0), (high, low, 1)):
            distance, row = cKDTree(along[b]).query(along[a])
            if (distance > HAIR * grid.smallest).any():
                names = [name for name, (axis, _) in SIDES.items() if axis == d]
                at = x[a[np.argmax(distance)]]
                raise ValueError(
                    f"Tied: opposite the node x={at.round(9) + 0.0} on the side {names[end]!r} no "
                    f"node lies on {names[1 - end]!r}: the cells on both sides must end at the "
                    "same places"
                )
        one.append(high)
        other.append(low[row] if end == 0 else low[cKDTree(along[low]).query(along[high])[1]])
        tied.append(np.repeat(components[None], len(high), axis=0))
    return np.concatenate(one), np.concatenate(other), np.concatenate(tied)


def _classes(count: int, joined: tuple, dim: int) -> np.ndarray:
    """Number (count, dim) of the class of each row, component by component."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    a, b, tied = joined
    out = np.empty((count, dim), dtype=np.int64)
    for c in range(dim):
        links = a[tied[:, c]], b[tied[:, c]]
        graph = coo_matrix((np.ones(len(links[0])), links), shape=(count, count))
        out[:, c] = connected_components(graph, False)[1]
    return out
