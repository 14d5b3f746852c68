"""Cells of a rectilinear grid as arrays: bounds, neighbours, patches."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..common.compiled import digits, jit

EDGE = 1e-10  # of a cell: a point that far outside the grid still lies in its last cell


@jit
def walk(x, cell, lower, upper, neighbour):
    """Move each entry of ``cell`` to the cell that holds x; -1 where that leaves the local grid.

    A point on an edge lies in the cell above it, at the end of the grid in the last one.
    ``neighbour`` (cells, dim, 2), -1 for none.
    """
    n, dim = x.shape
    for p in range(n):
        c = cell[p]
        d = 0
        while c >= 0 and d < dim:
            slack = EDGE * (upper[c, d] - lower[c, d])
            if x[p, d] < lower[c, d]:
                beyond = neighbour[c, d, 0]
                if beyond < 0 and x[p, d] >= lower[c, d] - slack:
                    d += 1
                else:
                    c = beyond
            elif x[p, d] >= upper[c, d]:
                beyond = neighbour[c, d, 1]
                if beyond < 0 and x[p, d] <= upper[c, d] + slack:
                    d += 1
                else:
                    c = beyond
            elif x[p, d] == x[p, d]:
                d += 1
            else:
                c = -1  # NaN
        cell[p] = c


@jit
def over_corner(cell, side, neighbour):
    """Whether one of the cells diagonally across ``side`` (dim,) of a cell is not there."""
    for corner in range(2 ** len(side)):
        c = cell
        for d in range(len(side)):
            if c >= 0 and side[d] != 0 and (corner >> d) & 1:
                c = neighbour[c, d, (side[d] + 1) // 2]
        if c < 0:
            return True
    return False


SIDES = {
    "left": (0, 0),
    "right": (0, 1),
    "bottom": (1, 0),
    "top": (1, 1),
    "back": (2, 0),
    "front": (2, 1),
}
"""Direction and end of the sides that every grid and body has."""


@dataclass(frozen=True)
class Lattice:
    """Where the cells of a rectilinear grid lie, for the local and ghost cells of one rank.

    ``lower``, ``upper`` (cells, dim), m; ``nodes`` (cells, 2^dim) in tensor order, x fastest;
    ``neighbour`` (cells, dim, 2) and ``patch`` (cells, 4^dim), -1 where there is none; ``volume``
    (cells,); ``size`` (cells, dim), m, as the cells were made.
    """

    lower: np.ndarray
    upper: np.ndarray
    nodes: np.ndarray
    neighbour: np.ndarray
    patch: np.ndarray
    volume: np.ndarray
    size: np.ndarray

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lower and upper corners, and neighbours: what kernels want to know of cells."""
        return self.lower, self.upper, self.neighbour

    @cached_property
    def around(self) -> np.ndarray:
        """The patches one after the other, for the compiled loops: without sign, and 0 where there
        is no node."""
        return np.maximum(self.patch, 0).astype(np.uint32).ravel()

    def spread(self, values: np.ndarray) -> np.ndarray:
        """The largest of each cell's value (cells,) and those of the cells beside it, corners
        included.

        In ghost cells only of those that this rank knows.
        """
        out = values.copy()
        for d in range(self.lower.shape[1]):
            before = out.copy()
            for beyond in self.neighbour[:, d].T:
                there = beyond >= 0
                out[there] = np.maximum(out[there], before[beyond[there]])
        return out


def neighbours(nodes: np.ndarray, dim: int) -> np.ndarray:
    """Neighbours (cells, dim, 2) of cells across facets, through shared ``nodes`` (cells, 2^dim);
    -1 for none."""
    cells = len(nodes)
    neighbour = np.full((cells, dim, 2), -1, dtype=np.int32)
    digit = digits(2, dim)
    count = nodes.max(initial=0) + 1
    for d in range(dim):
        for corner in range(2**dim):
            if digit[corner, d]:
                continue
            # the cell whose corner on its lower side is the corner of another on its upper side
            across = corner + 2**d
            holds = np.full(count, -1, dtype=np.int32)
            holds[nodes[:, corner]] = np.arange(cells)
            above = holds[nodes[:, across]]
            known = above >= 0
            neighbour[known, d, 1] = above[known]
            neighbour[above[known], d, 0] = np.flatnonzero(known)
    return neighbour


def patches(neighbour: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """The nodes of the patch (cells, 4^dim) of each cell and the cells beside it; -1 for none."""
    cells, dim = neighbour.shape[:2]
    digit = digits(2, dim)
    patch = np.full((cells, 4**dim), -1, dtype=np.int32)
    base = 4 ** np.arange(dim)
    steps = digits(3, dim) - 1  # -1, 0, 1 along each direction
    # over tied sides nodes have copies: of those that a cell has itself it takes its own
    for step in steps[np.argsort(-np.abs(steps).sum(axis=1), kind="stable")]:
        cell = np.arange(cells)
        for d in range(dim):
            if step[d]:
                cell = np.where(cell >= 0, neighbour[cell, d, (step[d] + 1) // 2], -1)
        there = cell >= 0
        for corner in range(2**dim):
            place = 1 + step + digit[corner]
            patch[there, place @ base] = nodes[cell[there], corner]
    return patch
