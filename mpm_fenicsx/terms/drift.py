"""How far material has come from the plain cells that it is bonded to, and a grid that follows.

Material points move over the grid, plain cells lie on it.  Where the material beside them has moved
by a part of a cell the two no longer fit: .1 of a cell sends back 1.6e-3 of the energy of a wave of
16 cells, .3 of a cell 1 to 2 %.  What all of it moves by together the grid can follow, in which
everything on it stays as it is; what it moves by unequally it cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from ..common.compiled import jit
from ..common.errors import RunError
from ..common.ranks import warn
from ..dynamics.motion import Motion
from ..grid.grid import Grid
from .plain_cells import PlainCells

NEAR = 0.02
"""Of a cell: what is told of material beside a layer."""
FAR = 0.1
"""Of a cell: what material may have moved from plain cells beside it, all of it together."""
APART = 0.25
"""Of a cell: what one part of it may have moved more than another."""


@dataclass
class Drift:
    """The displacement of the nodes that plain cells share with material points.

    ``follows``: whether the grid moves with their mean, ``offset`` (dim,), m, from where it was.
    """

    grid: Grid
    motion: Motion
    parts: Sequence[PlainCells]
    nodes: np.ndarray
    follows: bool

    def __post_init__(self) -> None:
        owned = self.grid.space.dofmap.index_map.size_local
        self._mine = self.nodes[self.nodes < owned]
        self._count = max(self.grid.comm.allreduce(len(self._mine)), 1)
        self.offset = self.grid.offset.copy()
        self.moved = np.zeros(self.grid.nodes * self.grid.dim)
        for part in self.parts:  # one that goes on from another run has moved there
            if part.U.x.array.any():
                of_part = self.motion.nodal(part.U)[part.nodes] - self.offset
                self.moved.reshape(-1, self.grid.dim)[part.nodes] = of_part
        self._near_layer = any(not part.heavy for part in self.parts)
        self.names = " and ".join(dict.fromkeys(part.owner for part in self.parts))

    def prepare(self) -> None:
        """The grid lies where this run has left it."""
        self.grid.move_to(self.offset)

    def check(self) -> None:
        """Raise ``RunError``, on all ranks, where the step that is solved moves material too
        far."""
        comm, u = self.grid.comm, self.motion.nodal(self.motion.u)
        low, high, total = _extent(self._mine, self.moved.reshape(u.shape), u)
        if comm.size > 1:
            comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
            comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
            comm.Allreduce(MPI.IN_PLACE, total)
        mean = total / self._count
        spread = np.maximum(high - mean, mean - low).max()
        cell = self.grid.smallest
        if spread > APART * cell:
            raise RunError(
                f"parts of the material beside {self.names} have moved by {spread / cell:.2g} of a "
                "cell more than others: leave more points between it and what moves"
            )
        if not self.follows and self._near_layer and np.abs(mean).max() > NEAR * cell:
            self._near_layer = False
            warn(
                comm,
                f"the material beside {self.names} has moved by {np.abs(mean).max() / cell:.2g} of "
                "a cell away from it, and what a layer sends back grows with that: let the grid "
                "follow, follows=True, or put a far field between",
            )
        if not self.follows and np.abs(mean).max() > FAR * cell:
            raise RunError(
                f"the material beside {self.names} has moved by {np.abs(mean).max() / cell:.2g} of "
                "a cell away from it: let the grid follow, follows=True"
            )

    def carry(self) -> None:
        """Remember what has moved, and follow."""
        u = self.motion.nodal(self.motion.u)
        self.moved.reshape(u.shape)[self.nodes] += u[self.nodes]
        if self.follows:
            self.offset += self.grid.comm.allreduce(u[self._mine].sum(axis=0)) / self._count
            self.grid.move_to(self.offset)


@jit
def _extent(nodes, moved, u):
    """Least and largest of ``moved`` + u (nodes, dim) at some nodes, and their sum, (dim,) each."""
    dim = u.shape[1]
    low, high, total = np.full(dim, np.inf), np.full(dim, -np.inf), np.zeros(dim)
    for i in nodes:
        for d in range(dim):
            value = moved[i, d] + u[i, d]
            low[d], high[d] = min(low[d], value), max(high[d], value)
            total[d] += value
    return low, high, total
