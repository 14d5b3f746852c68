"""Where one surface may touch another: gaps, and what a force across them gives to the nodes."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from ..mapping.shape_functions import Stencil
from ..terms.boundary_patches import PointPatch

FACING = -0.5  # cosine between outward normals: no flatter than 60° away from face to face
# of a face's half width: no further aside from the nearest of its points lies what is opposite the
# face
ON = 0.6
DEPTH = 0.5  # of a cell: points deeper below a face have not come through it
NEAREST = 8  # points of the other surface among which the face opposite is looked for


class Touching:
    """Points of one surface before the faces of another.

    Point f at x_f is held before the plane through the nearest point of the other surface with a
    normal against its own, at y_f straight below: g_f = (x_f − y_f)·n_f, n_f the outward normal
    there.  The pressure between them is linear from line to line of the grid, Σ_i T_i p_i: rows
    (m,) are those hats T_i across the surface,

        gap_i = Σ_f T_i(x_f) A_f g_f / Σ_f T_i(x_f) A_f,
        force at f: n_f Σ_i λ_i T_i(x_f) A_f / Σ_f T_i(x_f) A_f

    so that there are as many as there are nodes along the surface: with a row a point, forces are
    not unique.  What acts at x_f acts back at y_f, on one line.
    """

    def __init__(self, points: PointPatch, faces: PointPatch):
        self.points, self.faces, self.grid = points, faces, points.grid
        self.force = np.zeros(len(points.points))  # N, on every point, along the normal

    def find(self) -> None:
        """Which points have a face before them; ``gap`` (rows,), m, and a first guess of ``λ``
        (rows,), N."""
        own, other, lattice = self.points.points, self.faces.points, self.grid.lattice
        k = min(NEAREST, len(other))
        at = cKDTree(other.x).query(own.x, k)[1].reshape(len(own), k)
        away, n = own.x[:, None] - other.x[at], other.normal[at]
        gap = np.einsum("fkd,fkd->fk", away, n)
        aside = np.linalg.norm(away - gap[..., None] * n, axis=2)
        dim = self.grid.dim
        width = ON * np.sqrt(dim - 1.0) * other.area[at] ** (1.0 / (dim - 1))
        h = (lattice.upper - lattice.lower)[self.faces.stencil.cell].min(axis=1)[at]
        fits = (
            (np.einsum("fd,fkd->fk", own.normal, n) < FACING)
            & (aside <= width)
            & (gap > -DEPTH * h)
        )
        near = self.near = np.flatnonzero(fits.any(axis=1))
        pick = near, np.argmax(fits[near], axis=1)
        self.normal, gap, at = n[pick], gap[pick], at[pick]
        self._opposite(own.x[near] - gap[:, None] * self.normal, self.faces.stencil.cell[at])
        self._share()
        self.gap = self._mean @ gap
        self.λ = self._hats @ self.force[near]  # that of the last step, or near it

    def _opposite(self, y: np.ndarray, cell: np.ndarray) -> None:
        """Weights at y (near, dim), beside points of the faces in ``cell`` (near,)."""
        found = cell.copy()
        self.grid.walk(self.faces.faces.within(y, self.normal), found)
        self._below = Stencil(self.grid, len(y), support=False)
        self._below.place(y, None, np.where(found < 0, cell, found))

    def _share(self) -> None:
        """The hats T, one for each node on the lower side, along the normal, of the points'
        cells."""
        own, dim = self.points.stencil, self.grid.dim
        line, nodes = own.line[self.near], own.nodes[self.near]
        along, each = np.abs(self.normal).argmax(axis=1), np.arange(len(self.near))
        names, weights = [], []
        for corner in product((0, 1), repeat=dim - 1):
            digit = np.array([np.insert(corner, d, 0) for d in range(dim)])[along]
            names.append(
                along * self.grid.nodes + nodes[each, digit @ 2 ** np.arange(dim)].astype(np.int64)
            )
            weights.append(
                np.prod(
                    [np.where(along == d, 1.0, line[each, d, digit[:, d]]) for d in range(dim)],
                    axis=0,
                )
            )
        names, weights = np.array(names), np.array(weights)
        weights[weights < 1e-9] = 0.0  # points on a line of the grid
        used, name = np.unique(names[weights > 0.0], return_inverse=True)
        point = np.nonzero(weights > 0.0)[1]
        self._hats = csr_matrix(
            (weights[weights > 0.0], (name, point)), shape=(len(used), len(self.near))
        )
        areas = self._hats.multiply(self.points.points.area[self.near]).tocsr()
        self._mean = areas.multiply(1.0 / areas.sum(axis=1)).tocsr() if len(used) else areas

    def weigh(self, bare: np.ndarray, bare_other: np.ndarray) -> None:
        """Weights of points and faces on the nodes; those that are ``bare`` (nodes,), which no
        matter moves, get none.

        What they would have had goes to the others of the cell: a force is never lost.
        """
        own, below = self.points.stencil, self._below
        along = [self._mean.multiply(self.normal[:, d]).tocsr() for d in range(self.grid.dim)]
        at = _weights(own.nodes[self.near], own.values[self.near], bare)
        opposite = _weights(below.nodes, below.values, bare_other)
        self._own = [mean @ at for mean in along]
        self._other = [mean @ opposite for mean in along]

    def forces(self, λ: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodal forces (nodes, dim), N, of λ (rows,) on the body of the points and on that of the
        faces."""
        return np.stack([at.T @ λ for at in self._own], 1), -np.stack(
            [at.T @ λ for at in self._other], 1
        )

    def opening(self, u: np.ndarray, u_other: np.ndarray) -> np.ndarray:
        """What nodal displacements (nodes, dim) of the two bodies add to the gaps (rows,), m."""
        return sum(
            own @ u[:, d] - other @ u_other[:, d]
            for d, (own, other) in enumerate(zip(self._own, self._other, strict=True))
        )

    def keep(self, λ: np.ndarray) -> None:
        """Remember what rows (rows,), N, give to the points."""
        self.λ, self.force[:] = λ, 0.0
        self.force[self.near] = self._mean.T @ λ

    def resultant(self, λ: np.ndarray) -> np.ndarray:
        """Force (dim,), N, of λ (rows,) on the body of the points."""
        return (self._mean.T @ λ) @ self.normal


def _weights(nodes: np.ndarray, values: np.ndarray, bare: np.ndarray) -> csr_matrix:
    """Rows that add up to one over nodes that are not bare (m, nodes)."""
    values = np.where(bare[nodes], 0.0, values)
    total = values.sum(axis=1, keepdims=True)
    values = values / np.where(total > 0.0, total, 1.0)
    row = np.repeat(np.arange(len(nodes)), nodes.shape[1])
    return csr_matrix(
        (values.ravel(), (row, nodes.ravel().astype(np.int64))), shape=(len(nodes), len(bare))
    )
