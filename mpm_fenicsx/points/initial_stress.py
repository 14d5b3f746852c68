"""Material points of layered ground take the stress at rest: the weight of points above them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..common.ranks import together
from .geostatic_stress import GRAVITY, checked_K0, downwards, height_of, rows_of, values_of
from .material_points import MaterialPoints

SAME = 0.1
"""Of half a support domain: so near are the points of one column."""
GAP = 0.5
"""Of half a support domain: so much may lie open between two points of a column."""
STAIR = 4.0
"""Half support domains from the highest point of a column to the surface of a slope."""


def initial_stress(
    bodies: MaterialPoints | Sequence[MaterialPoints],
    surface: float | Callable[[np.ndarray], np.ndarray],
    K0: float | Sequence[float] | Callable[[np.ndarray], np.ndarray],
    gravity: float | Sequence[float] = GRAVITY,
) -> None:
    """Give points the stress of ground at rest, σ_v = -∫ ρ g dy up to the surface, σ_h = K₀ σ_v,
    and state variables that go with it.

    ``bodies``: all that there is above and below one another; ``surface`` (m): its height, or a
    function of x (dim, n) to (n,); ``K0`` (-): one number, one for each body, or a function of x;
    ``gravity`` (m/s²): g along -y, or (dim,) numbers, down one axis.  Of ``Undrained`` soil K₀ is
    that of effective stresses, with the pore pressure that its points start with.

    Densities are summed along the columns of points, so that forces of the points balance to
    round-off in level ground, wherever interfaces lie; where they slope they are stairs of points,
    and the stress of the columns is that of the true interface within half a point's weight.
    Points must be as ``fill`` has made them, not cut: give others ``GeostaticStress``.  Collective.
    Raises ``ValueError``, naming the place, for points that are not in columns, a gap in a column,
    a surface that is not that of the points, and a stress that a law cannot bear.
    """
    bodies = [bodies] if isinstance(bodies, MaterialPoints) else list(bodies)
    if not bodies or not all(isinstance(body, MaterialPoints) for body in bodies):
        raise ValueError(f"bodies must be material points, one body or several, got {bodies!r}")
    K0, gravity = checked_K0(K0, len(bodies), "body"), downwards(gravity)
    if gravity[1] >= bodies[0].dim:
        raise ValueError(f"gravity acts along axis {gravity[1]}, and points have {bodies[0].dim}")
    grid = next((body._grid() for body in bodies if body._grid and body._grid()), None)
    boxes = _boxes(bodies)
    if grid is None or grid.comm.size == 1:
        _give(bodies, boxes, surface, K0, gravity)
        return
    every = zip(*grid.comm.allgather(boxes), strict=True)
    boxes = tuple(np.concatenate(part) for part in every)
    with together(grid.comm):
        _give(bodies, boxes, surface, K0, gravity)


def _boxes(bodies) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres and halves of all support domains (n, dim), m, and densities (n,)."""
    centre = [body.x if body.seat is None else body.seat for body in bodies]
    density = [np.full(len(body), body.material.density) for body in bodies]
    return tuple(np.concatenate(part) for part in (centre, [body.half for body in bodies], density))


def _give(bodies, boxes, surface, K0, gravity: tuple[float, int]) -> None:
    """Stress and state variables of this rank's points."""
    (centre, half, density), (g, up) = boxes, gravity
    mass, lines = _mass_above(centre, half, density, height_of(surface, centre.T), up)
    found = []
    for n, body in enumerate(bodies):
        place = body.x if body.seat is None else body.seat
        row = lines.rows(place)
        # a point that jitter has moved weighs what is above it where it is
        above = mass[row] + density[row] * (place - body.x)[:, up]
        at = np.full(len(body), n)
        u = _pore_pressure(body)
        stress = rows_of(-g * above + u, values_of(K0, body.x.T, at), body.dim, up)
        stress[:, :3] -= u[:, None]
        history = body.history
        if body.material.history:
            history = body.material.initial_history(stress, body.parameters)
        found.append((stress, history))
    for body, (stress, history) in zip(bodies, found, strict=True):
        body.bear(stress, history)


def _pore_pressure(body: MaterialPoints) -> np.ndarray:
    """u (n,), Pa, that points start with: zero where the law knows of no water."""
    starts = getattr(body.material, "starting_pore_pressure", None)
    return np.zeros(len(body)) if starts is None else starts(len(body), body.parameters)


class _Lines:
    """Columns of points: which (n,) each of all boxes is in, and how to find a box again."""

    def __init__(self, centre: np.ndarray, half: np.ndarray, up: int):
        across = np.delete(np.arange(centre.shape[1]), up)
        self._ticks = [_ticks(centre[:, d], half[:, d]) for d in range(centre.shape[1])]
        keys = self._keys(centre)
        _, self.column = np.unique(keys[:, across], axis=0, return_inverse=True)
        self.column = self.column.ravel()
        self._known = {key: n for n, key in enumerate(map(tuple, keys.tolist()))}
        if len(self._known) < len(centre):
            raise ValueError(
                "bodies: points lie upon one another; they must be those of different bodies, as "
                "fill has made them, each on one rank"
            )

    def _keys(self, x: np.ndarray) -> np.ndarray:
        return np.column_stack(
            [np.searchsorted(tick, x[:, d]) for d, tick in enumerate(self._ticks)]
        )

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Numbers (m,) of the boxes with centres x (m, dim)."""
        return np.array([self._known[key] for key in map(tuple, self._keys(x).tolist())], np.int64)


def _ticks(x: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Limits between the coordinates that points share."""
    order = np.sort(x)
    step = np.diff(order)
    apart = step > SAME * half.min()
    return 0.5 * (order[:-1] + order[1:])[apart]


def _mass_above(centre, half, density, top, up: int) -> tuple[np.ndarray, _Lines]:
    """Mass per area (n,), kg/m², from each box's centre to the surface, column by column."""
    lines = _Lines(centre, half, up)
    order = np.lexsort((-centre[:, up], lines.column))  # from the top of each column down
    column, y, h, ρ = lines.column[order], centre[order, up], half[order, up], density[order]
    first = np.r_[True, column[1:] != column[:-1]]
    _check(centre[order], half[order], first, top[order], up)
    upper = np.where(first, top[order], np.r_[0.0, 0.5 * ((y + h)[1:] + (y - h)[:-1])])
    follows = np.r_[~first[1:], False]
    lower = np.where(follows, np.r_[upper[1:], 0.0], y - h)
    box = np.cumsum(ρ * (upper - lower))
    start = np.maximum.accumulate(np.where(first, np.arange(len(y)), 0))
    whole = box - ρ * (upper - lower)  # of all boxes before, other columns' too
    mass = np.empty(len(y))
    mass[order] = whole - whole[start] + ρ * (upper - y)
    return mass, lines


def _check(centre, half, first, top, up: int) -> None:
    """Refuse columns with gaps or overlaps, points beside their column, and another surface;
    rows from the top of each column down."""
    cure = "points must be as fill makes them, not cut or moved: give others a GeostaticStress"
    for d in set(range(centre.shape[1])) - {up}:
        beside = np.flatnonzero(~first[1:] & (np.abs(np.diff(centre[:, d])) > SAME * half[1:, d]))
        if len(beside):
            raise ValueError(
                f"bodies: the point at {centre[beside[0] + 1]} is in no column; {cure}"
            )
    y, h = centre[:, up], half[:, up]
    gap = np.r_[0.0, (y - h)[:-1] - (y + h)[1:]]
    wrong = np.flatnonzero(~first & (np.abs(gap) > GAP * h))
    if len(wrong):
        n = wrong[0]
        what = "are open" if gap[n] > 0 else "overlap"
        raise ValueError(
            f"bodies: {abs(gap[n]):.3g} m {what} above the point at {centre[n]}: give "
            f"all bodies that lie above one another; {cure}"
        )
    off = np.where(first, (top - y) / h, 1.0)
    wrong = np.flatnonzero(~((off > -1e-9) & (off < STAIR)))
    if len(wrong):
        n = wrong[0]
        raise ValueError(
            f"surface at {top[n]} m is not that of the points, the highest of which is at "
            f"{centre[n]} there"
        )
