"""Absorbing boundaries that can hardly be meant: looked at when a run is built."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ..common.ranks import warn
from ..grid.grid import Grid, GridSurface
from ..points.material_points import MaterialPoints
from ..points.surface_points import SurfacePoints
from .absorbing import ViscousBoundary

AHEAD = 0.9
"""Of half a support domain, from the place where the next point would be: what lies nearer is in
front (Gauss points of a face lie 0.58 beside its point in 2D, 0.82 in 3D)."""


def warn_of_doubtful(grid: Grid, terms: Sequence, bodies: Sequence[MaterialPoints] = ()) -> None:
    """Warn of two absorbing boundaries on one surface, whose dashpots add up, and of surfaces with
    material in front.  Collective."""
    absorbing = [term for term in terms if isinstance(term, ViscousBoundary)]
    for one, other in combinations(absorbing, 2):
        if _alike(one.on, other.on):
            warn(
                grid.comm,
                f"{type(one).__name__} and {type(other).__name__} act on the same surface, and "
                "their dashpots add up: name one of them",
                3,
            )
    for term in absorbing:
        inner, of = _inner(term.on, bodies) if isinstance(term.on, SurfacePoints) else (0, 0)
        inner, of = grid.comm.allreduce(inner), grid.comm.allreduce(of)
        if 2 * inner > of:
            warn(
                grid.comm,
                f"{type(term).__name__} acts on a surface inside the soil: in front of {inner} of "
                f"its {of} points there is material; its dashpots hold that to the ground at rest",
                3,
            )


def _alike(one, other) -> bool:
    """Whether two surfaces share facets, or are the same surface points."""
    if isinstance(one, GridSurface) and isinstance(other, GridSurface):
        return bool(set(one.tags) & set(other.tags))
    return one is other


def _inner(surface: SurfacePoints, bodies: Sequence[MaterialPoints]) -> tuple[int, int]:
    """How many of this rank's surface points have material in front of them, and of how many."""
    bodies = [body for body in bodies if len(body)]
    if not bodies or not len(surface):
        return 0, len(surface)
    from scipy.spatial import cKDTree

    x, half = (np.concatenate([getattr(body, name) for body in bodies]) for name in ("x", "half"))
    tree = cKDTree(x)
    beside = half[tree.query(surface.x)[1]]
    away = (np.abs(surface.normal) * beside).sum(axis=1)
    distance, row = tree.query(surface.x + away[:, None] * surface.normal)
    return int((distance < AHEAD * half[row].min(axis=1)).sum()), len(surface)
