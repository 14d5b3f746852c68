"""Rows of arrays that lie on other ranks: sent to whom they belong, looked up by their number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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


def packed(arrays: Sequence[np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Rows of all arrays, side by side as bytes (rows, width)."""
    return np.concatenate(
        [
            np.ascontiguousarray(a[rows]).view(np.uint8).reshape(len(rows), _width(a))
            for a in arrays
        ],
        axis=1,
    )


def unpacked(rows: np.ndarray, like: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The arrays that ``packed`` has put side by side, of the kinds of ``like``."""
    end = np.cumsum([_width(a) for a in like])
    parts = np.split(rows, end[:-1], axis=1)
    return [
        np.ascontiguousarray(part).reshape(-1).view(a.dtype).reshape(len(rows), *a.shape[1:])
        for part, a in zip(parts, like, strict=True)
    ]


def delivered(
    comm: MPI.Comm, arrays: Mapping[str, np.ndarray], to: np.ndarray
) -> dict[str, np.ndarray]:
    """Rows of ``arrays`` (n, …), the same names and kinds on all ranks, that come where each rank
    sends its own to ranks ``to`` (n,).  Collective."""
    values = list(arrays.values())
    came, _ = send(comm, packed(values, np.arange(len(to))), to)
    return dict(zip(arrays, unpacked(came, values), strict=True))


def fetched(
    comm: MPI.Comm, numbers: np.ndarray, arrays: Mapping[str, np.ndarray], asked: np.ndarray
) -> dict[str, np.ndarray]:
    """Rows of ``arrays`` whose ``numbers`` (n,) are ``asked`` for (m,), from the ranks that have
    them.

    Each number has a rank where those that have it and those that ask for it meet.  Collective;
    raises ``KeyError`` naming a number that is nowhere, on the ranks that ask for it.
    """
    kept = delivered(comm, {"number": numbers, **arrays}, numbers % comm.size)
    number = kept.pop("number")
    order = np.argsort(number, kind="stable")
    number = number[order]
    needed, back = np.unique(asked, return_inverse=True)
    question = {"asked": needed, "from": np.full(len(needed), comm.rank)}
    question = delivered(comm, question, needed % comm.size)
    at = np.searchsorted(number, question["asked"])
    known = at < len(number)
    known[known] = number[at[known]] == question["asked"][known]
    answer = {name: value[order[at[known]]] for name, value in kept.items()}
    answer = delivered(
        comm, {"number": question["asked"][known], **answer}, question["from"][known]
    )
    number = answer.pop("number")
    if len(number) < len(needed):
        raise KeyError(int(np.setdiff1d(needed, number)[0]))
    order = np.argsort(number)[back.ravel()]
    return {name: value[order] for name, value in answer.items()}


def _width(a: np.ndarray) -> int:
    """Bytes of a row."""
    return a.dtype.itemsize * int(np.prod(a.shape[1:]))
