"""Which rank owns which cell: coordinate bisection, with every vertex neighbour as a ghost."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from . import dolfinx_versions


def distribute(comm: MPI.Comm, x: np.ndarray, cells: np.ndarray):
    """Mesh of x and cells (as given on rank 0), cut by coordinate bisection, all vertex neighbours
    ghosted."""
    if comm.rank:
        x, cells = x[:0], cells[:0]

    def owners(ranks: int) -> tuple[np.ndarray, np.ndarray]:
        owner = np.zeros(len(cells), dtype=np.int64)
        if ranks == 1 or not len(cells):
            return np.arange(len(cells) + 1), owner
        _bisect(x[cells].mean(axis=1), np.arange(len(cells)), 0, ranks, owner)
        touches = np.zeros((len(x), ranks), dtype=bool)
        touches[cells.ravel(), np.repeat(owner, cells.shape[1])] = True
        wanted = touches[cells].any(axis=1)
        wanted[np.arange(len(cells)), owner] = False
        destinations = [
            np.concatenate(([o], np.flatnonzero(w))) for o, w in zip(owner, wanted, strict=True)
        ]
        return np.concatenate(([0], np.cumsum([len(d) for d in destinations]))), np.concatenate(
            destinations
        )

    return dolfinx_versions.create_mesh(comm, x, cells, owners)


def _bisect(
    centre: np.ndarray, cells: np.ndarray, first: int, ranks: int, owner: np.ndarray
) -> None:
    """Give ``cells`` to ``ranks`` ranks from ``first`` on, cutting the longest direction again and
    again."""
    if ranks == 1:
        owner[cells] = first
        return
    longest = np.argmax(np.ptp(centre[cells], axis=0)) if len(cells) else 0
    order = cells[np.argsort(centre[cells, longest], kind="stable")]
    half = ranks // 2
    cut = len(order) * half // ranks
    _bisect(centre, order[:cut], first, half, owner)
    _bisect(centre, order[cut:], first + half, ranks - half, owner)
