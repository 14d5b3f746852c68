"""What loops are compiled with, and what the compiler unrolls."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

_OPTIONS = {"nogil": True, "error_model": "numpy"}


def jit(function: Callable) -> Callable:
    """A compiled loop, kept between processes where there is a folder that can be written."""
    try:
        compiled = numba.njit(cache=True, **_OPTIONS)(function)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        return numba.njit(**_OPTIONS)(function)
    _know_pieces(compiled, function)
    return compiled


def _know_pieces(compiled, function: Callable) -> None:
    """Have a kept loop be as old as the loops of other files that are compiled into it: numba looks
    at its own file alone, and would go on with pieces that have changed since."""
    names, cells = function.__code__.co_names, function.__closure__ or ()
    used = [*map(function.__globals__.get, names), *(cell.cell_contents for cell in cells)]
    pieces = [file for file in map(_kept, used) if file is not None]
    mine = _kept(compiled)
    if pieces and mine is not None:
        mine._source_stamp = (mine._source_stamp, *(file._source_stamp for file in pieces))


def _kept(compiled):
    """The file that a compiled loop is kept in, which knows its age, or None."""
    return getattr(getattr(compiled, "_cache", None), "_cache_file", None)


def compiles(*arrays: np.ndarray) -> bool:
    """Whether arrays are of the numbers that loops are compiled for; complex ones, by which
    derivatives can be told, are left to NumPy."""
    return all(array.dtype == np.float64 for array in arrays)


def inlined(function: Callable) -> Callable:
    """A piece of compiled loops that is written into them where it is called."""
    return numba.njit(inline="always", **_OPTIONS)(function)


def once(count: int) -> tuple[int, ...]:
    """A tuple of ``count`` entries, for a loop whose length the compiler knows."""
    return tuple(range(count))


def digits(base: int, dim: int) -> np.ndarray:
    """Positions of a tensor-product table, first direction fastest (base^dim, dim)."""
    return (
        np.stack(np.meshgrid(*[np.arange(base)] * dim, indexing="ij"), -1)
        .reshape(-1, dim)[:, ::-1]
        .copy()
    )
