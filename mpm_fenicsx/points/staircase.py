"""Slopes and curves that a surface of points takes for stairs: told from the edges of blocks."""

from __future__ import annotations

import numpy as np

FINE = 1.5
"""Of a face: stairs no higher, or on treads no wider, are those of a slope or a curve."""
LEVELS = 3
"""So many levels that such stairs join are a slope; an edge between two is none."""
NEAR = 0.4
"""Of half a face: treads whose ends are no farther apart meet."""


def levels_of_a_slope(x: np.ndarray, half: np.ndarray, d: int) -> int:
    """How many levels along direction ``d`` fine stairs join, 0 where faces form no slope.

    ``x``, ``half`` (n, dim), m: centres of faces with normals along d, and half their support
    domains.  Faces of one level side by side form a tread; where one tread ends another one begins.
    Blocks have long treads and high stairs, slopes have stairs of one point, or treads of one, or
    both.
    """
    if not len(x):
        return 0
    joined = [_joined(x, half, d, e) for e in range(x.shape[1]) if e != d]
    found = len(np.unique(np.concatenate(joined)))
    return found if found >= LEVELS else 0


def _joined(x: np.ndarray, half: np.ndarray, d: int, e: int) -> np.ndarray:
    """Levels that fine stairs join, going along direction e."""
    level, line = _numbers(x, half, d), np.zeros(len(x), np.int64)
    for i in set(range(x.shape[1])) - {d, e}:
        line = _numbers(x, half, i)
    order = np.lexsort((x[:, e], level, line))
    level, line, height, width = level[order], line[order], x[order, d], half[order, d]
    start, end = (x - half)[order, e], (x + half)[order, e]
    near = NEAR * half[:, e].min()
    first = np.flatnonzero(
        np.r_[True, (np.diff(level) != 0) | (np.diff(line) != 0) | (start[1:] - end[:-1] > near)]
    )
    last = np.r_[first[1:], len(x)] - 1
    apart = 2.0 * np.ptp(np.r_[start, end])  # of the lines, one after the other
    begin, finish = start[first] + apart * line[first], end[last] + apart * line[last]
    sort = np.argsort(begin, kind="stable")
    low, high = (np.searchsorted(begin[sort], finish + side * near) for side in (-1.0, 1.0))
    a = np.repeat(np.arange(len(first)), high - low)
    b = sort[np.arange(len(a)) - np.repeat(np.cumsum(high - low) - high, high - low)]
    narrow, at = last - first + 1 < FINE, first
    rise = np.abs(height[at[a]] - height[at[b]]) / (width[at[a]] + width[at[b]])
    fine = (level[at[a]] != level[at[b]]) & (narrow[a] | narrow[b] | (rise < FINE))
    return np.concatenate((level[at[a[fine]]], level[at[b[fine]]]))


def _numbers(x: np.ndarray, half: np.ndarray, d: int) -> np.ndarray:
    """Whole numbers that are the same for faces as far along direction d."""
    return np.rint((x[:, d] - x[:, d].min()) / half[:, d].min()).astype(np.int64)
