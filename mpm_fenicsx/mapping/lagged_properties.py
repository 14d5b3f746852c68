"""Fields that stay as they are in a cell while what the points give to it has hardly changed."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from ..common.compiled import digits, jit, once
from .projection import Integration, Projection


class Kept:
    """``fields`` of a projection that follow it cell by cell, where they would be off by more than
    a part ``limit``.

    At the points where the forms integrate, fresh values lie between 1 - limit and 1 + limit of the
    kept ones.  So does every matrix that is an integral of them with a positive semidefinite
    integrand, in the sense of x·Ax: what is kept is the exact step of a body whose density and
    moduli are off by at most that, which does not add up over steps.
    """

    def __init__(self, projection: Projection, limit: float):
        self._fresh, self._limit = projection, limit
        self.fields = [fem.Function(f.function_space) for f in projection.fields]
        self._sample = at_quadrature(projection.integration, projection.grid.dim)
        self._least = np.zeros((projection.grid.cells, len(self.fields)))

    def refresh(self) -> None:
        """Take over what has changed."""
        fresh, kept = (
            tuple(f.x.array for f in fields) for fields in (self._fresh.fields, self.fields)
        )
        _take_over(
            once(len(fresh)),
            self._fresh.dofs,
            self._sample,
            np.abs(self._sample).sum(axis=1).max(),
            self._limit,
            fresh,
            kept,
            self._least,
        )

    def state(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        return {
            **{f"field {k}": f.x.array for k, f in enumerate(self.fields)},
            "least": self._least,
        }


def at_quadrature(integration: Integration, dim: int) -> np.ndarray:
    """Values (points, nodes) of the shape functions of a discontinuous space where its integrals
    are taken."""
    place = 0.5 * (1.0 + np.polynomial.legendre.leggauss((integration.quadrature + 1) // 2)[0])
    line = np.power.outer(place, np.arange(integration.degree + 1)) @ integration.nodal.T
    q, k = (digits(n, dim) for n in line.shape)
    return np.prod([line[q[:, d, None], k[:, d]] for d in range(dim)], axis=0)


@jit
def _take_over(columns, dofs, sample, bound, limit, fresh, kept, least):
    """kept = fresh in cells where that changes a value at a sample by more than ``limit`` times the
    least there.

    ``bound``: how many times the largest change of a dof one at a sample can be; ``least`` (cells,
    columns) of |kept| over the samples, zero where they change sign.
    """
    for c in range(len(dofs)):
        same = True
        for f in range(len(columns)):
            most = 0.0
            for k in range(dofs.shape[1]):
                most = max(most, abs(fresh[f][dofs[c, k]] - kept[f][dofs[c, k]]))
            if not bound * most <= limit * least[c, f]:
                same = False
        if same:
            continue
        for f in range(len(columns)):
            for k in range(dofs.shape[1]):
                kept[f][dofs[c, k]] = fresh[f][dofs[c, k]]
            low, high = np.inf, -np.inf
            for q in range(len(sample)):
                value = 0.0
                for k in range(dofs.shape[1]):
                    value += sample[q, k] * kept[f][dofs[c, k]]
                low, high = min(low, value), max(high, value)
            least[c, f] = max(low, -high, 0.0)
