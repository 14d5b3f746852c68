"""Faces that surface points stand for, cut where grid lines cross them.

The Gauss points of a face carry a load; between them it is f(s) = Σ_g ℓ_g(s) f_g, the polynomial
through them.  A face within a cell needs no more: ∫ f N_i dA = Σ_g A_g f_g N_i(x_g).  Where a grid
line crosses it N_i has a kink, and the integral is taken piece by piece, each with Gauss points q
of its own,

    ∫ f N_i dA = Σ_q Σ_g W_qg A_g f_g N_i(x_q),   Σ_q W_qg = 1:

exact for faces along the grid, also against N_i N_j.  With the face's own points a load misses the
nodes beside a line by a part of it that does not vanish with the fill of the cells, and moves the
light ones among them.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from ..common.compiled import digits, jit
from ..grid.grid import Grid
from ..points.surface_points import SurfacePoints
from .shape_functions import Stencil
from .tied_sides import TiedSides

SQRT3 = np.sqrt(3.0)
# of a cell: so far over the grid's edge a face may reach, as it is drawn from its Gauss points
OVER = 0.01
# of half a face: no piece is shorter; of a cell: a face that extends no further crosses no line
SLIVER = 1e-9


class Faces:
    """Where the loads of surface points act: ``stencil``, that of the points, or of pieces where
    lines cut faces.  ``sides``: tied sides, over which faces go on, if any."""

    def __init__(self, grid: Grid, points: SurfacePoints, sides: TiedSides | None = None):
        self.grid, self.points, self._sides = grid, points, sides
        sign = self._signs = 2.0 * digits(2, grid.dim - 1) - 1.0
        # times a face's points: from its centre to its sides, axis by axis
        self._toward = SQRT3 * sign.T / len(sign)
        self._hair = 1e-9 * grid.smallest  # the same on all ranks, so that they agree on the cell
        # whole points; pieces: face, W
        self._cut: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def within(self, x: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Places a hair inside the body: a point on a cell's edge belongs to the cell with the
        material."""
        return self.brought_in(x - self._hair * normal)

    def brought_in(self, x: np.ndarray) -> np.ndarray:
        """Places beyond tied sides where they come in on the other."""
        return x if self._sides is None else self._sides.inside(x)

    def place(self, own: Stencil) -> str | None:
        """Cut the faces where they are now, ``own`` being the points' stencil; returns what is
        wrong, if anything."""
        self.stencil, self._cut = own, None
        k = self.points.per_face
        if k == 1 or not len(self.points):
            return None
        x, cell = self.points.x.reshape(-1, k, self.grid.dim), own.cell[::k].copy()
        normal = self.points.normal[::k]
        centre, lat = x.sum(axis=1) / k, self.grid.lattice
        lat = lat if self._sides is None else self._sides.lattice
        axes = np.tensordot(self._toward, x, (1, 1))
        self.grid.walk(self.within(centre, normal), cell)
        ends = np.empty((len(x), len(axes), 2 * self.grid.dim))
        if not _ends(centre, axes, cell, lat.lower, lat.upper, lat.neighbour, ends):
            return None
        crossed = (ends < 1.0).reshape(len(x), -1).any(axis=1)
        place, face, weight = _pieces(np.flatnonzero(crossed), centre, axes, ends, self._signs)
        whole = np.flatnonzero(np.repeat(~crossed, k))
        place = self.brought_in(place)
        where, edge = cell[face], np.clip(place, self.grid.lower_corner, self.grid.upper_corner)
        over = np.abs(place - edge).max(axis=1, initial=0.0) <= OVER * self.grid.smallest
        place[over] = edge[over]
        self.grid.walk(self.within(place, normal[face]), where)
        lost = np.flatnonzero(where < 0)
        if len(lost):
            return f"a face of the surface reaches out of the grid at x={place[lost[0]]}"
        self._cut = whole, face, weight
        self.stencil = Stencil(self.grid, len(whole) + len(face), support=False)
        self.stencil.place(
            np.concatenate((self.brought_in(self.points.x[whole]), place)),
            None,
            np.concatenate((own.cell[whole], where)),
        )
        return None

    def spread(self, values: np.ndarray) -> np.ndarray:
        """What the stencil's points bear of the points' area-weighted values (n, f)."""
        if self._cut is None:
            return values
        whole, face, weight = self._cut
        by_face = values.reshape(-1, self.points.per_face, values.shape[1])
        return np.concatenate((values[whole], np.einsum("qg,qgf->qf", weight, by_face[face])))

    @property
    def weights(self) -> csr_matrix:
        """What a load of 1 on each point gives to the nodes (points, nodes)."""
        nodes, values = self.stencil.nodes, self.stencil.values
        row = np.repeat(np.arange(len(nodes)), nodes.shape[1])
        at = csr_matrix((values.ravel(), (row, nodes.ravel())), shape=(len(nodes), self.grid.nodes))
        if self._cut is None:
            return at
        whole, face, weight = self._cut
        k, bears = self.points.per_face, np.arange(len(whole), len(nodes))
        column = np.concatenate((whole, (k * face[:, None] + np.arange(k)).ravel()))
        share = np.concatenate((np.ones(len(whole)), weight.ravel()))
        row = np.concatenate((np.arange(len(whole)), np.repeat(bears, k)))
        return csr_matrix((share, (column, row)), shape=(len(self.points), len(nodes))) @ at


@jit
def _ends(centre, axes, cell, lower, upper, neighbour, out):
    """Where the lines around the centres' cells cut faces, ``out`` (faces, axes, 2 dim), s in (-1,
    1); 1 for nowhere.

    Returns whether there are any.
    """
    crossed = False
    for f in range(len(cell)):
        c = cell[f]
        for j in range(len(axes)):
            for d in range(centre.shape[1]):
                axis = axes[j, f, d]
                for side in range(2):
                    s = 1.0
                    if (
                        c >= 0
                        and neighbour[c, d, side] >= 0
                        and abs(axis) > SLIVER * (upper[c, d] - lower[c, d])
                    ):
                        s = ((lower[c, d] if side == 0 else upper[c, d]) - centre[f, d]) / axis
                        s = s if abs(s) < 1.0 - SLIVER else 1.0
                    out[f, j, 2 * d + side] = s
                    crossed |= s < 1.0
    return crossed


@jit
def _pieces(faces, centre, axes, ends, signs):
    """Gauss points (m, dim) of the pieces of those ``faces`` (n,) that lines cut, the face of each
    (m,), and its W (m, points of a face).

    ``axes`` (axes, faces, dim) from the centres (faces, dim) to the faces' sides; ``ends`` (faces,
    axes, cuts), sorted here; ``signs`` (points of a face, axes) of the places of these.
    """
    lines, dim = axes.shape[0], centre.shape[1]
    edge = np.ones((len(faces), 2, 2 * dim + 2))  # of pieces along each axis; one that is not there
    edge[:, :, 0] = -1.0
    total = 0
    for r in range(len(faces)):
        points = 1
        for j in range(lines):
            edge[r, j, 1:-1] = np.sort(ends[faces[r], j])
            longer = 0
            for e in range(2 * dim + 1):
                longer += edge[r, j, e + 1] > edge[r, j, e]
            points *= 2 * longer
        total += points
    place, weight = np.empty((total, dim)), np.empty((total, len(signs)))
    face = np.empty(total, np.int64)
    q, s, w = 0, np.zeros(2), np.ones(2)
    for r in range(len(faces)):
        f = faces[r]
        for piece in range((2 * (2 * dim + 1)) ** lines):
            part, there = piece, True
            for j in range(lines):
                e, gauss = part // 2 % (2 * dim + 1), 2 * (part % 2) - 1
                part //= 2 * (2 * dim + 1)
                w[j] = 0.5 * (edge[r, j, e + 1] - edge[r, j, e])
                s[j] = 0.5 * (edge[r, j, e + 1] + edge[r, j, e]) + w[j] * (gauss / SQRT3)
                there = there and w[j] > 0.0
            if not there:
                continue
            face[q] = f
            for d in range(dim):
                place[q, d] = centre[f, d]
                for j in range(lines):
                    place[q, d] += s[j] * axes[j, f, d]
            for g in range(len(signs)):
                weight[q, g] = 1.0
                for j in range(lines):
                    weight[q, g] *= w[j] * 0.5 * (1.0 + SQRT3 * signs[g, j] * s[j])
            q += 1
    return place, face, weight
