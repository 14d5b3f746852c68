"""Rows that go from rank to rank: all that one carries is a row of bytes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpi4py import MPI

import numpy as np


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


def exchanged(comm: MPI.Comm, rows: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Rows of bytes (n, width) that come where each rank sends ``count`` (ranks,) of its own to
    each other, sorted by these; those of the first rank come first.  Collective."""
    count = np.asarray(count, np.int32)
    back = np.empty_like(count)
    comm.Alltoall(count, back)
    came = np.empty((back.sum(), rows.shape[1]), np.uint8)
    row = MPI.BYTE.Create_contiguous(rows.shape[1]).Commit()
    start, end = (np.concatenate(([0], np.cumsum(n)[:-1])) for n in (count, back))
    comm.Alltoallv([rows, (count, start), row], [came, (back, end), row])
    row.Free()
    return came


def delivered(
    comm: MPI.Comm, arrays: Mapping[str, np.ndarray], to: np.ndarray
) -> dict[str, np.ndarray]:
    """Rows of ``arrays`` (n, …), the same names and kinds on all ranks, that come where each rank
    sends its own to ranks ``to`` (n,).  Collective."""
    order = np.argsort(to, kind="stable")
    count = np.bincount(to, minlength=comm.size)
    values = list(arrays.values())
    came = exchanged(comm, packed(values, order), count)
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
