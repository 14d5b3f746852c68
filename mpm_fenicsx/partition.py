"""Which rank owns which cell: coordinate bisection, with every vertex neighbour as a ghost."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI

import numpy as np

from . import fenicsx


def distribute(comm: MPI.Comm, x: np.ndarray, cells: np.ndarray):
    """Mesh of x and cells (as given on rank 0), cut by coordinate bisection, all vertex neighbours ghosted."""
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
        destinations = [np.concatenate(([o], np.flatnonzero(w))) for o, w in zip(owner, wanted, strict=True)]
        return np.concatenate(([0], np.cumsum([len(d) for d in destinations]))), np.concatenate(destinations)

    return fenicsx.create_mesh(comm, x, cells, owners)


def anywhere(comm: MPI.Comm, message: str | None) -> str | None:
    """The first message that a rank has, on every rank: all stop together, or none does."""
    if comm.size == 1:
        return message
    return next((m for m in comm.allgather(message) if m is not None), None)


@contextmanager
def together(comm: MPI.Comm) -> Iterator[None]:
    """Make a ``ValueError`` of one rank one of every rank.  Nothing inside may be collective."""
    message = cause = None
    try:
        yield
    except ValueError as error:
        message, cause = str(error), error
    message = anywhere(comm, message)
    if message:
        raise ValueError(message) from cause


def keepers(comm: MPI.Comm, things: np.ndarray, own: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Which rank is to keep each of this rank's things (n,), so that one does of all ranks that have it.

    ``things`` (n, k): numbers that say what it is, the same wherever it is; ``own`` (n,): it lies in this rank's cells;
    ``known`` (n,): in its cells or ghosts.  It is the rank whose own it is or, where none such has it, the first that
    knows its cell; -1 if none does.  Collective.
    """
    nobody, mine = 2 * comm.size, np.flatnonzero(~own)
    keeper = np.where(own, comm.rank, -1)
    asked = comm.allgather(things[mine])  # few: what lies in ghost cells, or everything where all ranks have all
    if not sum(map(len, asked)):
        return keeper
    _, which = np.unique(np.concatenate((things, *asked)), axis=0, return_inverse=True)
    which = which.ravel()
    best = np.full(len(which), nobody)
    np.minimum.at(best, which[: len(things)], np.where(own, comm.rank, np.where(known, comm.size + comm.rank, nobody)))
    answer = best[which[len(things) :]]
    comm.Allreduce(MPI.IN_PLACE, answer, op=MPI.MIN)
    start = sum(map(len, asked[: comm.rank]))
    answer = answer[start : start + len(mine)]
    keeper[mine] = np.where(answer < nobody, answer % comm.size, -1)
    return keeper


def _bisect(centre: np.ndarray, cells: np.ndarray, first: int, ranks: int, owner: np.ndarray) -> None:
    """Give ``cells`` to ``ranks`` ranks from ``first`` on, cutting the longest direction again and again."""
    if ranks == 1:
        owner[cells] = first
        return
    longest = np.argmax(np.ptp(centre[cells], axis=0)) if len(cells) else 0
    order = cells[np.argsort(centre[cells, longest], kind="stable")]
    half = ranks // 2
    cut = len(order) * half // ranks
    _bisect(centre, order[:cut], first, half, owner)
    _bisect(centre, order[cut:], first + half, ranks - half, owner)
