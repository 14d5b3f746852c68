"""Rows of arrays that lie on other ranks: sent to whom they belong, looked up by their number."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np


def slice_of(comm: MPI.Comm, count: int) -> tuple[int, int]:
    """First and end of this rank's of ``count`` rows, where all ranks take as many."""
    return count * comm.rank // comm.size, count * (comm.rank + 1) // comm.size


def send(comm: MPI.Comm, rows: np.ndarray, to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n, k) to ranks ``to`` (n,); returns those that come (m, k), in the order of the ranks
    that they come from, and how many come from each (ranks,).  Collective."""
    count = np.bincount(to, minlength=comm.size).astype(np.int32)
    back = np.empty_like(count)
    comm.Alltoall(count, back)
    rows = np.ascontiguousarray(rows[np.argsort(to, kind="stable")])
    came = np.empty((back.sum(dtype=np.int64), rows.shape[1]), rows.dtype)
    row = MPI.BYTE.Create_contiguous(rows.dtype.itemsize * rows.shape[1]).Commit()
    start, end = (np.concatenate(([0], np.cumsum(n)[:-1])) for n in (count, back))
    comm.Alltoallv([rows, (count, start), row], [came, (back, end), row])
    row.Free()
    return came, back


def look_up(comm: MPI.Comm, rows: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Rows of these numbers (n,), where each rank has a slice (m, k) of all rows, one rank's after
    the other's.  Collective."""
    if comm.size == 1:
        return rows[number]
    first = np.array([0, *np.cumsum(comm.allgather(len(rows)))])
    asked, which = np.unique(number, return_inverse=True)
    holder = np.searchsorted(first, asked, side="right") - 1
    questions, count = send(comm, asked[:, None], holder)
    answers = rows[questions[:, 0] - first[comm.rank]]
    found, _ = send(comm, answers, np.repeat(np.arange(comm.size), count))
    return found[which.ravel()]


def scatter(comm: MPI.Comm, rows: np.ndarray) -> np.ndarray:
    """This rank's slice of the rows (n, k) that rank 0 has.  Collective."""
    kind, count, width = comm.bcast((rows.dtype.str, *rows.shape))
    if comm.rank:
        rows = np.empty((0, width), kind)
    ends = count * np.arange(1, comm.size + 1) // comm.size
    to = np.searchsorted(ends, np.arange(len(rows)), side="right")
    return send(comm, rows, to)[0]
