"""Surfaces along lines, polygons, circles and level sets: places, normals and areas of their
points.

Each function returns ``x`` (n, dim), m, outward unit ``normal`` (n, dim), ``area`` (n,), m² (m per
metre in plane strain), and how many points in a row are the Gauss points of one face.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mpi4py import MPI

import numpy as np

from ..common.checks import array, finite, in_short, positive, whole
from ..common.compiled import digits
from ..common.ranks import together
from .cuts import Cuts, boxes_of, corners

Shape = tuple[np.ndarray, np.ndarray, np.ndarray, int]

GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3.0)
FLAT = 1e-9
"""Of a polygon: so far from its plane a corner may lie."""
NEAR = 1e-12
"""Of the square of a polygon's extent: three corners that span less lie on a line."""
SLIVER = 1e-9
"""Of a box's sides: faces smaller than that are left out."""
ZERO = 1e-12
"""Of the largest value of a level set's function: what is less is zero, where round-off may be."""
PER_CELL = {2: 16, 3: 8}
"""Boxes of a cell in which a level set is flat, unless it is said how many."""
ALONG = 0.9
"""Of their area: faces in one box of which less adds up are sheets of their own."""


def line(a: Sequence[float], b: Sequence[float], spacing: float) -> Shape:
    """From a to b in 2D; the outward normal points to the right of the way from a to b."""
    a, b = (_place(name, value) for name, value in (("a", a), ("b", b)))
    spacing, length = positive("spacing", spacing), float(np.linalg.norm(b - a))
    if length == 0.0:
        raise ValueError(f"a and b must be two places, got {tuple(a.tolist())} twice")
    faces = _faces_on(length, spacing)
    s = (np.arange(faces)[:, None] + 0.5 + 0.5 * GAUSS).ravel() / faces
    normal = np.array([b[1] - a[1], a[0] - b[0]]) / length
    x = a + s[:, None] * (b - a)
    return x, np.tile(normal, (len(x), 1)), np.full(len(x), length / len(x)), 2


def polygon(corners: Sequence[Sequence[float]], spacing: float, closed: bool = True) -> Shape:
    """In 2D from corner to corner, the outward normals to the right: a body whose corners go
    round against the clock, or a hole whose corners go round with it.  In 3D a convex one in a
    plane, outward the side from which the corners go round against the clock."""
    found = array("corners", corners)
    if found.ndim != 2 or found.shape[1] not in (2, 3) or not np.isfinite(found).all():
        raise ValueError(
            f"corners must be finite numbers (n, 2) or (n, 3), got {in_short(corners)}"
        )
    dim = found.shape[1]
    least = 3 if closed or dim == 3 else 2
    if len(found) < least:
        raise ValueError(f"corners must be at least {least}, got {len(found)}")
    ends = np.roll(found, -1, axis=0) if closed or dim == 3 else found[1:]
    starts = found[: len(ends)]
    short = np.flatnonzero((starts == ends).all(axis=1))
    if len(short):
        raise ValueError(
            f"corners must differ from one to the next, got {tuple(starts[short[0]].tolist())} "
            "twice; a closed polygon returns to its first corner by itself"
        )
    if dim == 3:
        return _in_a_plane(found, positive("spacing", spacing))
    _refuse_crossings(starts, ends, closed)
    sides = [line(a, b, spacing) for a, b in zip(starts, ends, strict=True)]
    return *(np.concatenate([side[k] for side in sides]) for k in range(3)), 2


def circle(centre: Sequence[float], radius: float, spacing: float, hole: bool = False) -> Shape:
    """A circle in 2D; outward normals point away from its centre or, of a ``hole``, to it."""
    centre, radius = _place("centre", centre), positive("radius", radius)
    faces = max(3, _faces_on(2.0 * np.pi * radius, positive("spacing", spacing)))
    angle = 2.0 * np.pi * (np.arange(faces)[:, None] + 0.5 + 0.5 * GAUSS).ravel() / faces
    away = np.column_stack((np.cos(angle), np.sin(angle)))
    area = np.full(len(angle), 2.0 * np.pi * radius / len(angle))
    return centre + radius * away, -away if hole else away, area, 2


def level_set(
    grid, function: Callable[[np.ndarray], np.ndarray], per_cell: int | None = None
) -> Shape:
    """Where a function of x (dim, n), m, to (n,) is zero, in this rank's own cells; outward is
    where it is positive.

    Cells are divided in ``per_cell`` = k^dim boxes, these in simplices; what is zero in a simplex
    is flat: in 2D a segment with two Gauss points; in 3D the triangles of a box are four points.
    """
    dim, lattice = grid.dim, grid.lattice
    per_cell = PER_CELL[dim] if per_cell is None else whole("per_cell", per_cell)
    k = round(per_cell ** (1 / dim))
    if k**dim != per_cell:
        kind = "square" if dim == 2 else "cube"
        raise ValueError(f"per_cell must be a {kind} of a whole number, got {per_cell}")
    own = slice(0, grid.owned_cells)
    lower, size = lattice.lower[own], (lattice.upper - lattice.lower)[own]
    with together(grid.comm, Exception):
        largest = 0.0 if not len(lower) else _largest(function, lower, size)
    zero = ZERO * grid.comm.allreduce(largest, op=MPI.MAX)

    def inside(x: np.ndarray) -> np.ndarray:
        return _values(function, x) < -zero

    with together(grid.comm, Exception):
        within = boxes_of(corners(lower, size, k, inside), dim)
        at, number = np.nonzero(within.any(axis=2) & ~within.all(axis=2))
        box = size[at] / k
        cuts = Cuts(lower[at] + digits(k, dim)[number] * box, box, within[at, number], inside)
        of, vertices, normal = cuts.faces()
    area = np.sqrt((normal**2).sum(axis=1))
    large = area > SLIVER * box[of].min(axis=1, initial=np.inf) ** (dim - 1)
    if not grid.comm.allreduce(int(large.sum())):
        raise ValueError(
            f"function has no zero on {grid!r}: it must be negative inside the body and positive "
            "outside"
        )
    of, vertices, normal, area = (a[large] for a in (of, vertices, normal, area))
    if dim == 2:
        middle, way = vertices.mean(axis=1), 0.5 * (vertices[:, 1] - vertices[:, 0])
        x = (middle[:, None] + GAUSS[:, None] * way[:, None]).reshape(-1, 2)
        return x, np.repeat(normal / area[:, None], 2, axis=0), np.repeat(area / 2.0, 2), 2
    x, normal, area = _joined(of, vertices, normal, area)
    return np.clip(x, grid.lower_corner, grid.upper_corner), normal, area, 1


def _joined(
    of: np.ndarray, vertices: np.ndarray, normal: np.ndarray, area: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (n, 3, 3) in boxes ``of`` (n,) as four points a box, where they are one sheet:
    with its area, its centre and the second moments of its area in its plane."""
    _, of = np.unique(of, return_inverse=True)
    (whole,) = _summed(of, area)
    (along,) = _summed(of, normal)
    sheet = np.sqrt((along**2).sum(axis=1)) > ALONG * whole
    own = np.flatnonzero(~sheet[of])  # several sheets: each triangle is on its own
    of = np.where(sheet[of], of, -1)
    of[own] = len(whole) + np.arange(len(own))
    _, of = np.unique(of, return_inverse=True)
    whole, along, first = _summed(of, area, normal, area[:, None] * vertices.mean(axis=1))
    centre = first / whole[:, None]
    arm = vertices - centre[of][:, None]
    arm = np.concatenate((arm, arm.sum(axis=1, keepdims=True)), axis=1)
    (second,) = _summed(of, area[:, None, None] / 12.0 * np.einsum("nki,nkj->nij", arm, arm))
    size, axis = np.linalg.eigh(second / whole[:, None, None])
    reach = np.sqrt(np.maximum(size, 0.0))[:, None, 1:] * axis[:, :, 1:]  # of the two largest
    sign = 2.0 * digits(2, 2) - 1.0
    x = centre[:, None] + np.einsum("ka,nia->nki", sign, reach)
    normal = along / np.sqrt((along**2).sum(axis=1))[:, None]
    return x.reshape(-1, 3), np.repeat(normal, 4, axis=0), np.repeat(whole / 4.0, 4)


def _summed(of: np.ndarray, *values: np.ndarray) -> list[np.ndarray]:
    """Sums of values (n, …) over the rows of each number in ``of`` (n,)."""
    found = []
    for value in values:
        total = np.zeros((of.max(initial=-1) + 1, *value.shape[1:]))
        np.add.at(total, of, value)
        found.append(total)
    return found


def _place(name: str, value: Sequence[float]) -> np.ndarray:
    found = array(name, value)
    if found.shape != (2,):
        raise ValueError(f"{name} must be a place (x, y) in 2D, got {in_short(value)}")
    for coordinate in found:
        finite(name, coordinate)
    return found


def _faces_on(length: float, spacing: float) -> int:
    """Faces of one length, none longer than ``spacing``."""
    return max(1, int(np.ceil(length / spacing - 1e-9)))


def _refuse_crossings(starts: np.ndarray, ends: np.ndarray, closed: bool) -> None:
    """Raise ``ValueError`` where sides from starts to ends (n, 2) cross or touch, but at the corner
    that one and the next have in common."""
    a, b, c, d = starts[:, None], ends[:, None], starts[None], ends[None]
    near = NEAR * np.ptp(np.concatenate((starts, ends)), axis=0).max() ** 2
    s = [_cross(b - a, c - a), _cross(b - a, d - a), _cross(d - c, a - c), _cross(d - c, b - c)]
    s = [np.where(np.abs(side) <= near, 0.0, side) for side in s]
    meet = (s[0] * s[1] <= 0.0) & (s[2] * s[3] <= 0.0)
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    meet &= ((low[:, None] <= high[None]) & (low[None] <= high[:, None])).all(axis=2)
    n = len(starts)
    one, other = np.nonzero(np.triu(meet, 1))
    for i, j in zip(one.tolist(), other.tolist(), strict=True):
        beside = j == i + 1 or (closed and i == 0 and j == n - 1)
        if beside:
            first, second = (i, j) if j == i + 1 else (j, i)
            before, after = ends[first] - starts[first], ends[second] - starts[second]
            if abs(_cross(before, after)) > near or before @ after > 0.0:
                continue
        raise ValueError(
            f"corners: the side from {tuple(starts[i].tolist())} to {tuple(ends[i].tolist())} and "
            f"that from {tuple(starts[j].tolist())} to {tuple(ends[j].tolist())} cross or touch; "
            "give one polygon for each body or hole"
        )


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _in_a_plane(found: np.ndarray, spacing: float) -> Shape:
    """A convex polygon in 3D: a parallelogram in faces of four Gauss points, others in triangles
    whose points stand for themselves."""
    middle = found.mean(axis=0)
    arms, following = found - middle, np.roll(found, -1, axis=0) - middle
    spun = np.cross(arms, following)
    normal = spun.sum(axis=0)
    twice = float(np.linalg.norm(normal))
    size = np.abs(arms).max()
    if twice <= FLAT * size**2:
        raise ValueError(f"corners must not lie on a line, got {in_short(found.tolist())}")
    normal /= twice
    if np.abs(arms @ normal).max() > FLAT * size:
        raise ValueError(
            f"corners must lie in a plane, got {np.abs(arms @ normal).max():.3g} m out of it; take "
            "several polygons, or level_set"
        )
    turn = np.cross(following - arms, np.roll(following, -1, axis=0) - following) @ normal
    if (spun @ normal).min() <= 0.0 or turn.min() < -FLAT * size**2:
        raise ValueError(
            "corners of a polygon in 3D must go round it once and have no bay, got "
            f"{in_short(found.tolist())}; take several polygons, or level_set"
        )
    if len(found) == 4 and np.abs(found[0] - found[1] + found[2] - found[3]).max() <= FLAT * size:
        one, other = found[1] - found[0], found[3] - found[0]
        n, m = (_faces_on(np.linalg.norm(side), spacing) for side in (one, other))
        s = (np.arange(n)[:, None, None, None] + 0.5 + 0.5 * GAUSS) / n  # n, 1, 1, 2
        t = (np.arange(m)[None, :, None, None] + 0.5 + 0.5 * GAUSS[:, None]) / m  # 1, m, 2, 1
        s, t = (np.broadcast_to(v, (n, m, 2, 2)).reshape(-1, 1) for v in (s, t))
        x = found[0] + s * one + t * other
        return x, np.tile(normal, (len(x), 1)), np.full(len(x), twice / 2.0 / len(x)), 4
    x, area = [], []
    for a, b, weight in zip(arms, following, spun @ normal, strict=True):
        k = _faces_on(max(np.linalg.norm(v) for v in (a, b, b - a)), spacing)
        i, j = (v.ravel() for v in np.meshgrid(np.arange(k), np.arange(k), indexing="ij"))
        up, down = i + j < k, i + j < k - 1
        at = np.concatenate(
            (np.column_stack((i, j))[up] + 1 / 3, np.column_stack((i, j))[down] + 2 / 3)
        )
        x.append(middle + at @ np.stack((a, b)) / k)
        area.append(np.full(len(at), 0.5 * weight / len(at)))
    x, area = np.concatenate(x), np.concatenate(area)
    return x, np.tile(normal, (len(x), 1)), area, 1


def _values(function: Callable, x: np.ndarray) -> np.ndarray:
    """Finite values (n,) of a function of places x (dim, n), or ``ValueError`` naming it."""
    found = np.asarray(function(x), float) if callable(function) else None
    if found is None or found.shape != (x.shape[1],) or not np.isfinite(found).all():
        what = in_short(function) if found is None else f"{found.shape}"
        if found is not None and found.shape == (x.shape[1],):
            bad = np.flatnonzero(~np.isfinite(found))[0]
            what = f"{found[bad]} at x={x[:, bad]}"
        raise ValueError(
            f"function must map x (dim, n) to finite numbers (n,), negative inside, got {what}"
        )
    return found


def _largest(function: Callable, lower: np.ndarray, size: np.ndarray) -> float:
    """The largest value at the corners of cells, regardless of sign."""
    x = lower[:, None] + digits(2, lower.shape[1]) * size[:, None]
    return float(np.abs(_values(function, x.reshape(-1, lower.shape[1]).T)).max())
