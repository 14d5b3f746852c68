"""Kinds of cells: boxes of one size, whose corners the mesh numbers alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUND_OFF = 4 * np.finfo(float).eps
"""Of the largest coordinate: sizes that differ by less are one, their mean."""


@dataclass(frozen=True)
class Kinds:
    """``of`` each cell (cells,) the kind that it is of, and ``corners`` (kinds, 2^dim, 3), m, of
    one cell a kind, the lowest at the origin, in the order of the mesh."""

    of: np.ndarray
    corners: np.ndarray


def kinds_of(corners: np.ndarray) -> Kinds | None:
    """The kinds of cells with ``corners`` (cells, 2^dim, dim), m; None where one is no box to
    round-off."""
    cells, count, dim = corners.shape
    tolerance = ROUND_OFF * np.abs(corners).max(initial=0.0)
    lower, upper = corners.min(axis=1), corners.max(axis=1)
    size = upper - lower
    above = corners - lower[:, None] > 0.5 * size[:, None]
    off = np.abs(corners - np.where(above, upper[:, None], lower[:, None]))
    if off.max(initial=0.0) > tolerance:
        return None
    order = above.reshape(cells, count * dim) @ 2 ** np.arange(count * dim)
    groups, means = zip(*(_grouped(size[:, d], tolerance) for d in range(dim)), strict=True)
    size, labels = np.stack(means, axis=1), np.stack([order, *groups], axis=1)
    _, first, of = np.unique(labels, axis=0, return_index=True, return_inverse=True)
    found = np.zeros((len(first), count, 3))
    found[:, :, :dim] = above[first] * size[first, None]
    return Kinds(of.reshape(-1).astype(np.int32), found)


def _grouped(size: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """A number (n,) for each size, the same for those within ``tolerance`` of the least of them,
    and the means of these (n,)."""
    sizes, of = np.unique(size, return_inverse=True)
    group, number, first = np.empty(len(sizes), dtype=np.int64), 0, 0
    while first < len(sizes):
        end = np.searchsorted(sizes, sizes[first] + tolerance, side="right")
        group[first:end], number, first = number, number + 1, end
    found = group[of.reshape(-1)]
    return found, (np.bincount(found, size) / np.bincount(found))[found]
