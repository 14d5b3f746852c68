"""What loops are compiled with, and what the compiler unrolls."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

_OPTIONS = {"nogil": True, "error_model": "numpy"}


def jit(function: Callable) -> Callable:
    """A compiled loop, kept between processes where there is a folder that can be written."""
    try:
        return numba.njit(cache=True, **_OPTIONS)(function)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        return numba.njit(**_OPTIONS)(function)


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
