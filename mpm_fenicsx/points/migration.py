"""Points, and faces of surfaces, go to the ranks that own the cells they have come to.

All that a point carries is a row of bytes, with the global number of its cell in front.  Ghost
cells are those of neighbours, and rows go to neighbours alone; only where a point has come farther
than the ghosts reach are all ranks asked for its cell.  One sum over all ranks says whether
anything moves, and whether anything is lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from ..common.exchange import packed, send, unpacked
from ..grid.grid import Grid


@dataclass(frozen=True)
class Destinations:
    """Where the points of several clouds belong.

    ``cells``: for each cloud the global numbers (n,) of the cells, -1 where no rank has one;
    ``moving``: for each cloud whether a point leaves its rank, on any rank; ``lost``: whether any
    point, on any rank, lies in no cell; ``far``: whether any may go to a rank that is no neighbour.
    """

    cells: list[np.ndarray]
    moving: list[bool]
    lost: bool
    far: bool


class Migration:
    """The way of rows between the ranks of a grid, until it is partitioned anew.  Every method is
    collective."""

    def __init__(self, grid: Grid):
        self.grid, comm = grid, grid.comm
        cells = grid.mesh.topology.index_map(grid.dim)
        here = np.arange(grid.cells, dtype=np.int32)
        number = cells.local_to_global(here) if grid.cells else here
        self._number = np.append(np.asarray(number, np.int64), -1)  # of cell -1 it is -1
        self._first = np.array(comm.allgather(int(cells.local_range[0])))
        self._beside, self._neighbours = grid.neighbours

    def _owner(self, number: np.ndarray) -> np.ndarray:
        """Ranks that own cells of these global numbers; this one for -1."""
        owner = np.searchsorted(self._first, number, side="right") - 1
        return np.where(number >= 0, owner, self.grid.comm.rank)

    def destinations(self, clouds: Sequence[tuple[np.ndarray, np.ndarray]]) -> Destinations:
        """Where points x (n, dim), m, in local cells (n,), -1 for none, belong, cloud by cloud."""
        cells = [self._number[cell] for _, cell in clouds]
        counts = np.array(
            [
                (
                    np.count_nonzero(cell < 0),
                    np.count_nonzero((cell < 0) | (cell >= self.grid.owned_cells)),
                )
                for _, cell in clouds
            ]
        ).reshape(-1, 2)
        self.grid.comm.Allreduce(MPI.IN_PLACE, counts)
        far, lost = bool(counts[:, 0].any()), False
        if far:
            lost = self._search([x for x, _ in clouds], cells)
        return Destinations(cells, (counts[:, 1] > 0).tolist(), lost, far)

    def _search(self, places: Sequence[np.ndarray], cells: Sequence[np.ndarray]) -> bool:
        """Ask all ranks for the cells that are -1; True where some are in none."""
        comm, grid = self.grid.comm, self.grid
        rows = [np.flatnonzero(number < 0) for number in cells]
        mine = np.concatenate([x[at] for x, at in zip(places, rows, strict=True)])
        asked = comm.allgather(mine)
        found = grid.find(np.concatenate(asked))
        found[found >= grid.owned_cells] = -1
        found = self._number[found]
        comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
        start = sum(map(len, asked[: comm.rank]))
        for number, at in zip(cells, rows, strict=True):
            number[at] = found[start : start + len(at)]
            start += len(at)
        return bool((found < 0).any())

    def send(
        self, arrays: Mapping[str, np.ndarray], cells: np.ndarray, far: bool
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
        """Rows of ``arrays`` (n, …), the same names on all ranks, to the owners of ``cells`` (n,).

        Returns the arrays with the rows that are here then, which rows of these are new, and their
        local cells.  What leaves makes room for what comes: the other rows stay where they are,
        unless more leave than come, and the last ones take the places that are left.
        """
        comm = self.grid.comm
        to = self._owner(cells)
        leaving = np.flatnonzero(to != comm.rank)
        order = leaving[np.argsort(to[leaving], kind="stable")]
        rows = packed([cells, *arrays.values()], order)
        came = self._exchange(rows, to[order], far)
        number, *new = unpacked(came, [cells, *arrays.values()])
        found = {
            name: _replaced(array, leaving, come)
            for (name, array), come in zip(arrays.items(), new, strict=True)
        }
        count = len(cells) - len(leaving)
        filled = leaving[: len(came)]
        new_rows = np.append(filled, np.arange(count + len(filled), count + len(came)))
        return found, new_rows, (number - self._first[comm.rank]).astype(np.int32)

    def _exchange(self, rows: np.ndarray, to: np.ndarray, far: bool) -> np.ndarray:
        """Send rows of bytes (n, width) to ranks ``to`` (n,), sorted; returns those that come."""
        if far:
            return send(self.grid.comm, rows, to)[0]
        count, width = np.bincount(to, minlength=self.grid.comm.size), rows.shape[1]
        count = count[self._beside].astype(np.int32)
        back = np.empty_like(count)
        if len(count):
            self._neighbours.Neighbor_alltoall(count, back)
        came = np.empty((back.sum(), width), np.uint8)
        if not len(count):
            return came
        row = MPI.BYTE.Create_contiguous(width).Commit()
        start, end = (np.concatenate(([0], np.cumsum(n)[:-1])) for n in (count, back))
        self._neighbours.Neighbor_alltoallv([rows, (count, start), row], [came, (back, end), row])
        row.Free()
        return came


def resized(arrays: Mapping[str, np.ndarray], rows: int) -> dict[str, np.ndarray]:
    """Empty arrays of the same kinds for so many rows."""
    return {name: np.empty((rows, *a.shape[1:]), a.dtype) for name, a in arrays.items()}


def _replaced(a: np.ndarray, leaving: np.ndarray, new: np.ndarray) -> np.ndarray:
    """``a`` (n, …) without the rows ``leaving``, sorted, and with ``new`` ones in their places;
    written into."""
    filled = min(len(leaving), len(new))
    a[leaving[:filled]] = new[:filled]
    if len(new) > filled:
        return np.concatenate((a, new[filled:]))
    if len(leaving) == filled:
        return a
    end = len(a) - len(leaving) + filled
    stays = np.ones(len(a), bool)
    stays[leaving[filled:]] = False
    a[:end][~stays[:end]] = a[end:][stays[end:]]
    return a[:end]
