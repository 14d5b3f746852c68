"""What ranks agree on: messages, failures, and who keeps what."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import TypeVar

from mpi4py import MPI

import numpy as np

from .errors import SolverError

T = TypeVar("T")

PASSED_ON = 0.5
"""s; what a rank has printed is lost where the launcher is given no time to pass it on."""


def end_together() -> None:
    """Where several ranks run, an error that ends one ends all, once it is printed.  ``python -m
    mpi4py`` means to do so, but after PETSc has closed, which waits for the others for ever."""
    if MPI.COMM_WORLD.size == 1:
        return
    show = sys.excepthook

    def hook(kind, error, traceback) -> None:
        show(kind, error, traceback)
        sys.stderr.flush()
        time.sleep(PASSED_ON)
        if not MPI.Is_finalized():
            MPI.COMM_WORLD.Abort(1)

    sys.excepthook = hook


def anywhere(comm: MPI.Comm, message: T | None) -> T | None:
    """The first message that a rank has, on every rank: all stop together, or none does."""
    if comm.size == 1:
        return message
    return next((m for m in comm.allgather(message) if m is not None), None)


def of_all(comm: MPI.Comm, value: T, op: MPI.Op = MPI.SUM) -> T:
    """The sum of the ranks' values, or what else ``op`` says; at once where there is one rank, as
    many a step asks for costs more than some of its loops.  Collective."""
    return value if comm.size == 1 else comm.allreduce(value, op=op)


def warn(comm: MPI.Comm, message: str, stacklevel: int = 2) -> None:
    """A ``UserWarning`` of what all ranks have found, shown by the first alone; where warnings are
    errors, all raise it."""
    with nullcontext() if comm.rank == 0 else warnings.catch_warnings(record=True):
        warnings.warn(message, UserWarning, stacklevel=stacklevel + 1)


@contextmanager
def together(comm: MPI.Comm, kind: type[Exception] = ValueError) -> Iterator[None]:
    """Make an error of one rank, of this kind, a ``ValueError`` of every rank, or a ``SolverError``
    if it is one; on one rank it stays what it is.  Nothing inside may be collective."""
    message = cause = None
    try:
        yield
    except kind as error:
        if comm.size == 1:
            raise
        cause, name = error, type(error).__name__
        plain = isinstance(error, ValueError | SolverError)
        message = type(error) is SolverError, str(error) if plain else f"{name}: {error}"
    message = anywhere(comm, message)
    if message is not None:
        raise (SolverError if message[0] else ValueError)(message[1]) from cause


def keepers(comm: MPI.Comm, things: np.ndarray, own: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Which rank is to keep each of this rank's things (n,), so that one does of all ranks that
    have it.

    ``things`` (n, k): numbers that say what it is, the same wherever it is; ``own`` (n,): it lies
    in this rank's cells; ``known`` (n,): in its cells or ghosts.  It is the rank whose own it is
    or, where none such has it, the first that knows its cell or, where none does, the first that
    has it.  Collective.
    """
    nobody, mine = 3 * comm.size, np.flatnonzero(~own)
    keeper = np.full(len(own), comm.rank)
    asked = comm.allgather(
        things[mine]
    )  # few: what lies in ghost cells, or everything where all ranks have all
    if not sum(map(len, asked)):
        return keeper
    _, which = np.unique(np.concatenate((things, *asked)), axis=0, return_inverse=True)
    which = which.ravel()
    best = np.full(len(which), nobody)
    np.minimum.at(
        best,
        which[: len(things)],
        comm.rank + comm.size * np.where(own, 0, np.where(known, 1, 2)),
    )
    answer = best[which[len(things) :]]
    comm.Allreduce(MPI.IN_PLACE, answer, op=MPI.MIN)
    start = sum(map(len, asked[: comm.rank]))
    answer = answer[start : start + len(mine)]
    keeper[mine] = answer % comm.size
    return keeper


def bounds(comm: MPI.Comm, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates (dim,), m, of places (n, dim) on all ranks.  Collective."""
    low = [comm.allreduce(a, op=MPI.MIN) for a in x.min(axis=0, initial=np.inf)]
    high = [comm.allreduce(a, op=MPI.MAX) for a in x.max(axis=0, initial=-np.inf)]
    return np.array(low), np.array(high)
