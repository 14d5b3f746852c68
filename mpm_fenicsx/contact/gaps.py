"""The gaps between all surfaces that may touch, in one row, and the forces across them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ..terms.boundary_patches import PointPatch
from .surface_pair import Touching


class Gaps:
    """Every pair of surfaces; rows (m,) are those of the pairs, one pair after the other.

    What concerns bodies is a list with an entry for each: nodal fields (nodes, dim).
    """

    def __init__(self, patches: Sequence[PointPatch]):
        self.grid = patches[0].grid
        self.pairs = [
            (a, b, Touching(patches[a], patches[b]))
            for a, b in combinations(range(len(patches)), 2)
        ]
        self.bodies = len(patches)

    def find(self) -> None:
        """What lies before what, with the surfaces where they are."""
        for _, _, pair in self.pairs:
            pair.find()

    def weigh(self, bare: Sequence[np.ndarray]) -> None:
        """Weights on the nodes; those marked in ``bare`` (nodes,) of a body get none."""
        for a, b, pair in self.pairs:
            pair.weigh(bare[a], bare[b])

    @property
    def start(self) -> np.ndarray:
        """Gaps (m,), m, at the start of the step."""
        return np.concatenate([pair.gap for _, _, pair in self.pairs])

    @property
    def λ(self) -> np.ndarray:
        """Forces (m,), N."""
        return np.concatenate([pair.λ for _, _, pair in self.pairs])

    def keep(self, λ: np.ndarray) -> None:
        """Remember forces (m,), N."""
        for _, _, pair, rows in self._parts():
            pair.keep(λ[rows])

    def opening(self, fields: Sequence[np.ndarray]) -> np.ndarray:
        """What displacements open gaps by (m,), or the rate at which velocities do."""
        return np.concatenate([pair.opening(fields[a], fields[b]) for a, b, pair in self.pairs])

    def forces(self, λ: np.ndarray) -> list[np.ndarray]:
        """Nodal forces, N, of λ (m,)."""
        found = [np.zeros((self.grid.nodes, self.grid.dim)) for _ in range(self.bodies)]
        for a, b, pair, rows in self._parts():
            for body, force in zip((a, b), pair.forces(λ[rows]), strict=True):
                found[body] += force
        return found

    def resultants(self, λ: np.ndarray) -> np.ndarray:
        """Force (bodies, dim), N, of λ (m,) on each body."""
        found = np.zeros((self.bodies, self.grid.dim))
        for a, b, pair, rows in self._parts():
            push = pair.resultant(λ[rows])
            found[a] += push
            found[b] -= push
        return found

    def state(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        return {f"{a}-{b}": pair.force for a, b, pair in self.pairs}

    def _parts(self):
        start = 0
        for a, b, pair in self.pairs:
            yield a, b, pair, slice(start, start + len(pair.gap))
            start += len(pair.gap)
