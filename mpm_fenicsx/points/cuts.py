"""What a body's edge leaves of boxes, and the edge itself: exact where it is straight.

Boxes with corners inside and corners outside the body are split into simplices, along one diagonal,
so that neighbours match.  Where an edge of a simplex leaves the body is found by halving it, and
between these places the body's edge is flat.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from math import factorial

import numpy as np

from ..common.compiled import digits

Inside = Callable[[np.ndarray], np.ndarray]

HALVINGS = 44
"""Of an edge that leaves the body: round-off."""
FINE = {2: 4, 3: 2}
"""Boxes along each side of a support domain that is cut: what the edge does within a box is not
seen but where it leaves its edges."""
LEAST = 1e-6
"""Of a support domain: a point that stands for less is left out, and one that lacks less is
whole."""
NEAR = 0.02
"""Of a box: an edge that far from where it should be is bent there."""
AGAIN, TIMES = 2, {2: 6, 3: 2}
"""Boxes along each side of one in which the edge is bent, and how often boxes are divided so."""
AT_ONCE = 1_000_000
"""Places that a function is asked for in one call."""

# Vertices of a simplex, those inside the body first, then the places where edges from these to the
# others leave it: ends (inside, outside) of such an edge.
_EDGES = {
    (dim, k): [(i, j) for i in range(k) for j in range(k, dim + 1)]
    for dim in (2, 3)
    for k in range(1, dim + 1)
}
# What is inside, as simplices of these; a wedge is three.
_INSIDE = {
    (2, 1): [(0, 3, 4)],
    (2, 2): [(0, 1, 4), (0, 4, 3)],
    (3, 1): [(0, 4, 5, 6)],
    (3, 2): [(0, 4, 5, 7), (0, 4, 6, 7), (0, 1, 6, 7)],
    (3, 3): [(0, 1, 2, 6), (0, 1, 5, 6), (0, 4, 5, 6)],
}
# The edge: segments in 2D, triangles in 3D.
_FACES = {
    (2, 1): [(3, 4)],
    (2, 2): [(3, 4)],
    (3, 1): [(4, 5, 6)],
    (3, 2): [(4, 5, 7), (4, 6, 7)],
    (3, 3): [(4, 5, 6)],
}


def corners(lower: np.ndarray, size: np.ndarray, parts: int, inside: Inside) -> np.ndarray:
    """Whether the corners of ``parts``^dim boxes in each cell lie inside: bool (cells, parts + 1,
    ...), the last axis that of x."""
    dim = lower.shape[1]
    place = digits(parts + 1, dim) / parts
    found = np.empty((len(lower), len(place)), dtype=bool)
    many = max(1, AT_ONCE // len(place))
    for first in range(0, len(lower), many):
        rows = slice(first, first + many)
        x = lower[rows, None] + place * size[rows, None]
        found[rows] = inside(x.reshape(-1, dim).T).reshape(x.shape[:2])
    return found.reshape(-1, *[parts + 1] * dim)


def boxes_of(within: np.ndarray, dim: int) -> np.ndarray:
    """The corners of each box (cells, boxes, 2^dim), boxes and corners with x fastest, of what
    ``corners`` says."""
    parts = within.shape[1] - 1
    boxes = len(within), parts**dim
    ends = [
        within[(slice(None), *(slice(s, s + parts) for s in corner[::-1]))].reshape(boxes)
        for corner in digits(2, dim)
    ]
    return np.stack(ends, axis=2)


class Cuts:
    """Boxes (n,) that the edge of a body runs through.

    ``lower``, ``size`` (n, dim), m; ``within`` (n, 2^dim): which of their corners, x fastest, lie
    ``inside``, a function of x (dim, m) to bool (m,).
    """

    def __init__(self, lower: np.ndarray, size: np.ndarray, within: np.ndarray, inside: Inside):
        self.boxes, self.dim = len(lower), lower.shape[1]
        self._inside, self._size = inside, size
        self._parts: list[tuple[np.ndarray, np.ndarray]] = []
        self._faces: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        place, dim = digits(2, self.dim), self.dim
        for order in permutations(range(dim)):
            way = np.cumsum([0, *(2**d for d in order)])  # from the lowest corner to the highest
            there = within[:, way]
            first = np.argsort(~there, axis=1, kind="stable")
            vertices = lower[:, None] + place[way][first] * size[:, None]
            count = there.sum(axis=1)
            whole = np.flatnonzero(count == dim + 1)
            self._parts.append((whole, vertices[whole]))
            for k in range(1, dim + 1):
                rows = np.flatnonzero(count == k)
                if len(rows):
                    self._cut(rows, vertices[rows], k, inside)

    def _cut(self, box: np.ndarray, vertices: np.ndarray, k: int, inside: Inside) -> None:
        """Simplices (n, dim + 1, dim) with their first k vertices inside."""
        dim = self.dim
        a, b = (vertices[:, [edge[end] for edge in _EDGES[dim, k]]] for end in (0, 1))
        leaves = _last_inside(a.reshape(-1, dim), b.reshape(-1, dim), inside).reshape(a.shape)
        known = np.concatenate((vertices, leaves), axis=1)
        for simplex in _INSIDE[dim, k]:
            self._parts.append((box, known[:, simplex]))
        out = vertices[:, k:].mean(axis=1) - vertices[:, :k].mean(axis=1)
        for face in _FACES[dim, k]:
            self._faces.append((box, known[:, face], out))

    def volumes(self) -> tuple[np.ndarray, np.ndarray]:
        """Volume (n,) of what lies inside in each box, and its first moment (n, dim)."""
        volume, moment = np.zeros(self.boxes), np.zeros((self.boxes, self.dim))
        for box, vertices in self._parts:
            sides = vertices[:, 1:] - vertices[:, :1]
            part = np.abs(np.linalg.det(sides)) / factorial(self.dim)
            volume += np.bincount(box, part, self.boxes)
            for d, first in enumerate((part[:, None] * vertices.mean(axis=1)).T):
                moment[:, d] += np.bincount(box, first, self.boxes)
        return volume, moment

    def faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The edge: boxes (m,) that its faces lie in, their vertices (m, dim, dim), and area times
        outward normal (m, dim)."""
        found = [part for part in self._faces if len(part[0])]
        if not found:
            return np.zeros(0, int), np.zeros((0, self.dim, self.dim)), np.zeros((0, self.dim))
        box, vertices, out = (np.concatenate(part) for part in zip(*found, strict=True))
        if self.dim == 2:
            along = vertices[:, 1] - vertices[:, 0]
            normal = np.column_stack((along[:, 1], -along[:, 0]))
        else:
            sides = vertices[:, 1:] - vertices[:, :1]
            normal = 0.5 * np.cross(sides[:, 0], sides[:, 1])
        back = (normal * out).sum(axis=1) < 0.0
        normal[back] *= -1.0
        return box, vertices, normal

    def bent(self) -> np.ndarray:
        """Boxes (m,) in which the edge is none of the flat faces, as at a corner: beside the middle
        of one the body begins or ends elsewhere."""
        of, vertices, normal = self.faces()
        area = np.sqrt((normal**2).sum(axis=1))
        there = area > 0.0
        of, middle = of[there], vertices[there].mean(axis=1)
        aside = NEAR * self._size[of] * normal[there] / area[there, None]
        wrong = self._inside((middle + aside).T) | ~self._inside((middle - aside).T)
        return np.unique(of[wrong])


def _last_inside(a: np.ndarray, b: np.ndarray, inside: Inside) -> np.ndarray:
    """Where ways from places a inside to places b outside (n, dim) leave the body."""
    a, way = a.T, (b - a).T
    t, step = np.zeros(a.shape[1]), 0.5
    for _ in range(HALVINGS):
        t += step * inside(a + (t + step) * way)
        step *= 0.5
    return (a + (t + step) * way).T


def inside_of_domains(
    x: np.ndarray, half: np.ndarray, k: int, inside: Inside, own: int
) -> tuple[np.ndarray, np.ndarray]:
    """The part of each support domain that lies inside (cells, k^dim), and its centre (cells,
    k^dim, dim), m.

    ``x``, ``half`` (cells, k^dim, dim), m: domains that fill the cells, those of this rank's
    ``own`` first; nothing is inside in the others.
    """
    cells, points, dim = x.shape
    fine = FINE[dim]
    parts, box = k * fine, 2.0 * half[:own, 0] / fine
    lower = (x[:own, 0] - half[:own, 0]).reshape(-1, dim)
    within = boxes_of(corners(lower, parts * box, parts, inside), dim)
    domain = (digits(parts, dim) // fine) @ k ** np.arange(dim)
    volume, moment = np.zeros(own * points), np.zeros((own * points, dim))
    mixed = within.any(axis=2) & ~within.all(axis=2)
    cut = np.zeros(own * points, dtype=bool)
    at, number = np.nonzero(mixed)
    cut[points * at + domain[number]] = True
    at, number = np.nonzero(within.any(axis=2) & cut.reshape(own, points)[:, domain])
    corner = lower[at] + digits(parts, dim)[number] * box[at]
    of = points * at + domain[number]
    inner = _volumes(corner, box[at], within[at, number], inside, TIMES[dim])
    volume += np.bincount(of, inner[0], len(volume))
    for d in range(dim):
        moment[:, d] += np.bincount(of, inner[1][:, d], len(volume))
    full = np.zeros((own, points), dtype=bool)
    full[:, domain] = within.all(axis=2)
    part = np.where(cut, volume / (2.0 * half[:own]).prod(axis=2).ravel(), full.ravel())
    part[part <= LEAST], part[part >= 1.0 - LEAST] = 0.0, 1.0
    found, centre = np.zeros((cells, points)), x.copy()
    found[:own] = part.reshape(own, points)
    rows = np.flatnonzero((part > 0.0) & (part < 1.0))
    centre.reshape(-1, dim)[rows] = moment[rows] / volume[rows, None]
    return found, centre


def _volumes(
    lower: np.ndarray, size: np.ndarray, within: np.ndarray, inside: Inside, times: int
) -> tuple[np.ndarray, np.ndarray]:
    """What ``Cuts.volumes`` says, with boxes in which the edge is bent divided again."""
    cuts, dim = Cuts(lower, size, within, inside), lower.shape[1]
    volume, moment = cuts.volumes()
    bent = cuts.bent() if times else np.zeros(0, int)
    if len(bent):
        part = size[bent] / AGAIN
        there = boxes_of(corners(lower[bent], size[bent], AGAIN, inside), dim)
        at, number = np.nonzero(there.any(axis=2))
        corner = lower[bent][at] + digits(AGAIN, dim)[number] * part[at]
        inner = _volumes(corner, part[at], there[at, number], inside, times - 1)
        volume[bent] = np.bincount(at, inner[0], len(bent))
        for d in range(dim):
            moment[bent, d] = np.bincount(at, inner[1][:, d], len(bent))
    return volume, moment
