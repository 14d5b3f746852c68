"""Pairs of a point and a Gauss point: the weights of the double mapping, eq. (7)."""

from __future__ import annotations

import numpy as np

from ..common.compiled import digits, jit
from ..grid.gauss_points import PLACE, GaussPoints
from ..points.material_points import MaterialPoints
from .projection import DOUBLE_MAPPED
from .shape_functions import Stencil


@jit
def _count(side):
    """Cells that each point's support domain touches, all together."""
    total = 0
    for p in range(len(side)):
        cells = 1
        for d in range(side.shape[1]):
            cells *= 2 if side[p, d] != 0 else 1
        total += cells
    return total


@jit
def _pair(cut, points, cells, dual, gauss_points, out):
    """Pairs of a point and a Gauss point that it reaches, with w_gp |c|-weighted; returns their
    number.

    ``cut`` (side, span, share); ``points`` (cell, volume); ``cells`` (neighbour, volume, corners);
    ``dual`` as in ``Projection``; ``gauss_points`` (place, digit), ``place`` (2,) their reference
    coordinates along a direction; written are ``out`` (point, Gauss point, weight).
    """
    side, span, share = cut
    cell, volume = points
    neighbour, cell_volume, corners = cells
    place, digit = gauss_points
    point, gauss, weight = out
    n, dim = side.shape
    line = np.empty((dim, 2, 2))
    m = 0
    for p in range(n):
        crossed = 0
        for d in range(dim):
            crossed += side[p, d] != 0
            for s in range(2):
                mean = 0.5 * (span[p, d, s, 0] + span[p, d, s, 1])
                low = dual[0, 0] + dual[0, 1] * mean
                high = dual[1, 0] + dual[1, 1] * mean
                for b in range(2):
                    line[d, s, b] = share[p, d, s] * ((1 - place[b]) * low + place[b] * high)
        for k in range(len(corners) if crossed else 1):
            c = cell[p]
            for d in range(dim):
                if corners[k, d]:
                    c = neighbour[c, d, (side[p, d] + 1) // 2] if side[p, d] != 0 and c >= 0 else -1
            if c < 0:
                continue
            for q in range(digit.shape[1]):
                w = volume[p] / cell_volume[c]
                for d in range(dim):
                    w *= line[d, corners[k, d], digit[c, q, d]]
                if w > 0.0:
                    point[m], gauss[m], weight[m] = p, c * digit.shape[1] + q, w
                    m += 1
    return m


@jit
def add(gauss, weight, values, out):
    """out_g += w q for the pairs' values (m, f)."""
    for m in range(len(gauss)):
        for f in range(values.shape[1]):
            out[gauss[m], f] += weight[m] * values[m, f]


def pairs_of(
    gauss: GaussPoints, body: MaterialPoints, at: Stencil
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (m,), Gauss points that they reach (m,) and w_gp (m,), for the points where they are
    now."""
    lat = at.lattice
    most = _count(at.side) * gauss.digit.shape[1]
    point, where, weight = np.empty(most, np.int32), np.empty(most, np.int32), np.empty(most)
    found = _pair(
        at.cut,
        (at.cell, body.volume),
        (lat.neighbour, lat.volume, digits(2, gauss.grid.dim)),
        DOUBLE_MAPPED.dual,
        (PLACE, gauss.digit),
        (point, where, weight),
    )
    return point[:found], where[:found], weight[:found]
