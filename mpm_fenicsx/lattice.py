"""Cells of a rectilinear grid as arrays: bounds, neighbours, patches."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .kernels import digits

SIDES = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1), "back": (2, 0), "front": (2, 1)}
"""Direction and end of the sides that every grid and body has."""


@dataclass(frozen=True)
class Lattice:
    """Where the cells of a rectilinear grid lie, for the local and ghost cells of one rank.

    ``lower``, ``upper`` (cells, dim), m; ``nodes`` (cells, 2^dim) in tensor order, x fastest;
    ``neighbour`` (cells, dim, 2) and ``patch`` (cells, 4^dim), -1 where there is none; ``volume`` (cells,).
    """

    lower: np.ndarray
    upper: np.ndarray
    nodes: np.ndarray
    neighbour: np.ndarray
    patch: np.ndarray
    volume: np.ndarray

    @cached_property
    def around(self) -> np.ndarray:
        """The patches one after the other, for the compiled loops: without sign, and 0 where there is no node."""
        return np.maximum(self.patch, 0).astype(np.uint32).ravel()

    def spread(self, values: np.ndarray) -> np.ndarray:
        """The largest of each cell's value (cells,) and those of the cells beside it, corners included.

        In ghost cells only of those that this rank knows.
        """
        out = values.copy()
        for d in range(self.lower.shape[1]):
            before = out.copy()
            for beyond in self.neighbour[:, d].T:
                there = beyond >= 0
                out[there] = np.maximum(out[there], before[beyond[there]])
        return out


def beside(lower: np.ndarray, upper: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours across facets and the nodes of the 4^dim patch of each cell, through shared nodes."""
    cells, dim = lower.shape
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
    patch = np.full((cells, 4**dim), -1, dtype=np.int32)
    base = 4 ** np.arange(dim)
    for step in digits(3, dim) - 1:  # -1, 0, 1 along each direction
        cell = np.arange(cells)
        for d in range(dim):
            if step[d]:
                cell = np.where(cell >= 0, neighbour[cell, d, (step[d] + 1) // 2], -1)
        there = cell >= 0
        for corner in range(2**dim):
            place = 1 + step + digit[corner]
            patch[there, place @ base] = nodes[cell[there], corner]
    return neighbour, patch
