"""Absorbing boundaries that can hardly be meant: looked at when a run is built."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ..common.ranks import warn
from ..grid.cells import SIDES
from ..grid.grid import GridSurface
from ..points.material_points import MaterialPoints
from ..points.surface_points import SurfacePoints
from .absorbing import ViscousBoundary
from .doubtful_ground import in_front
from .scene import Scene

AHEAD = 0.9
"""Of half a support domain, from the place where the next point would be: what lies nearer is in
front (Gauss points of a face lie 0.58 beside its point in 2D, 0.82 in 3D)."""


def warn_of_doubtful(scene: Scene, terms: Sequence, bodies: Sequence[MaterialPoints] = ()) -> None:
    """Warn of two absorbing boundaries on one surface, whose dashpots add up, of surfaces with
    material in front, and of what acts on sides that are tied.  Collective."""
    grid = scene.grid
    _warn_of_tied(scene)
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
        on_points = isinstance(term.on, SurfacePoints)
        inner, of = _inner(scene, term.on, bodies) if on_points else (0, 0)
        inner, of = grid.comm.allreduce(inner), grid.comm.allreduce(of)
        if 2 * inner > of:
            warn(
                grid.comm,
                f"{type(term).__name__} acts on a surface inside the soil: in front of {inner} of "
                f"its {of} points there is material; its dashpots hold that to the ground at rest",
                3,
            )


def _warn_of_tied(scene: Scene) -> None:
    """Warn of loads, dashpots and springs on tied sides, which are no edge."""
    if scene.sides is None:
        return
    names = [name for name, (d, _) in SIDES.items() if d in scene.sides.directions]
    for patch in scene.patches:
        on = [n for n in names if patch.tags & set(scene.grid.facets(n).tags)]
        if on and patch.acting:
            warn(
                scene.grid.comm,
                f"{' and '.join(patch.acting)} on the side {on[0]}, which is tied: what acts there "
                "acts inside the ground that goes on over it; leave it out",
                4,
            )


def _alike(one, other) -> bool:
    """Whether two surfaces share facets, or are the same surface points."""
    if isinstance(one, GridSurface) and isinstance(other, GridSurface):
        return bool(set(one.tags) & set(other.tags))
    return one is other


def _inner(
    scene: Scene, surface: SurfacePoints, bodies: Sequence[MaterialPoints]
) -> tuple[int, int]:
    """How many of this rank's surface points have material in front of them, and of how many."""
    bodies = [body for body in bodies if len(body)]
    plain = in_front(scene, surface.x, surface.normal)
    if not bodies or not len(surface):
        return int(plain.sum()), len(surface)
    from scipy.spatial import cKDTree

    x, half = (np.concatenate([getattr(body, name) for body in bodies]) for name in ("x", "half"))
    tree = cKDTree(x)
    beside = half[tree.query(surface.x)[1]]
    away = (np.abs(surface.normal) * beside).sum(axis=1)
    distance, row = tree.query(surface.x + away[:, None] * surface.normal)
    return int((plain | (distance < AHEAD * half[row].min(axis=1))).sum()), len(surface)
