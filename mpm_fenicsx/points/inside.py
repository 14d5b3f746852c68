"""Whether a place lies inside a body: among its material points, or in a mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common.compiled import digits
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from .material_points import MaterialPoints

ROOM = 2.0
"""Half support domains from a point to a place that is still inside: the corners of domains of a
body that has been turned and sheared, which leave gaps between them, and half a domain beyond the
outermost."""
STREWN = 2.0
"""Distances between neighbours from the nearest point to a place that is still inside, where points
are strewn wider than their domains: of random places, 2 of 10,000 lie farther off."""
NEAR = 16
"""So many points tell how wide they are strewn."""
EDGE = 1e-6
"""Of a cell: a place that far outside is on its edge."""


def among(bodies: Sequence[MaterialPoints], at: np.ndarray) -> bool:
    """Whether ``at`` (dim,), m, lies among this rank's material points of one of the bodies."""
    return any(_among(body, at) for body in bodies if len(body))


def _among(body: MaterialPoints, at: np.ndarray) -> bool:
    centre = body.x if body.seat is None else body.seat
    if (np.abs(at - centre) <= (1.0 + EDGE) * ROOM * body.half).all(axis=1).any():
        return True
    if len(body) < 2:
        return False
    from scipy.spatial import cKDTree

    tree = cKDTree(body.x)
    distance, rows = tree.query(at, min(NEAR, len(body)))
    apart = tree.query(body.x[rows], 2)[0][:, 1]
    strewn = np.median(apart / (2.0 * body.half[rows].max(axis=1))) > 1.0 + EDGE
    return bool(strewn and distance[0] <= STREWN * apart.max())


def in_mesh(grid: Grid, at: np.ndarray) -> bool:
    """Whether ``at`` (dim,), m, lies in one of this rank's cells, of any shape, or on its edge."""
    x = grid.mesh.geometry.x[dolfinx_versions.cell_vertices(grid.mesh)][
        : grid.owned_cells, :, : grid.dim
    ]
    low, high = x.min(axis=1), x.max(axis=1)
    slack = EDGE * (high - low)
    x = x[((at >= low - slack) & (at <= high + slack)).all(axis=1)]
    corner = digits(2, grid.dim)
    ξ = np.full((len(x), grid.dim), 0.5)
    for _ in range(20):  # Newton's method for x(ξ) = at, the cells' bilinear maps
        one = np.where(corner, ξ[:, None], 1.0 - ξ[:, None])
        slope = np.stack(
            [
                (2 * corner[:, d] - 1) * np.delete(one, d, axis=2).prod(axis=2)
                for d in range(grid.dim)
            ],
            axis=-1,
        )
        miss = at - np.einsum("ck,cki->ci", one.prod(axis=2), x)
        ξ = ξ + np.linalg.solve(np.einsum("cki,ckj->cij", x, slope), miss[..., None])[..., 0]
    return bool((np.abs(ξ - 0.5) <= 0.5 + EDGE).all(axis=1).any())
