"""Which bodies layers may stand beside: rules drawn from eigenvalues.

A cell of length 2c/p sends back what does not travel in it with modulus 1 and a phase that may feed
it.  What is trapped in a body and evanescent in its layer can therefore grow: between two walls
with a layer at one end, in strata beside much softer ones, in bodies that are very long and flat.
Elastic cells behind damp it.  Limits are those inside of which none of some thousands of bodies
grew (``analytical.layer_stability``, tests/test_layer_stability.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

LONGEST = {0: 10.0, 1: 20.0, 2: 40.0, 3: 40.0}
"""By elastic cells: times its least extent, the greatest of a body."""
STIFFER_ABOVE, SOFTER_ABOVE = {2: 1.3, 3: 1.3, 4: 1.5}, {2: 2.5, 3: 2.5, 4: 4.0}
"""By elastic cells: ratios of the speeds of S waves of two strata."""


@dataclass(frozen=True)
class Body:
    """What a layer lies beside.

    ``extent`` (dim,), m; ``one_cell`` (dim,), bool: whether it is one cell wide; ``open`` (dim,),
    bool: whether there is a layer at an end of each direction; ``plane`` (dim,), bool: whether all
    nodes are held across a direction, or along it and not across, or its sides are tied.
    """

    extent: np.ndarray
    one_cell: np.ndarray
    open: np.ndarray
    plane: np.ndarray


@dataclass(frozen=True)
class Stratum:
    """``height`` (m) of its middle, and ``speed`` (m/s) of S waves."""

    height: float
    speed: float


def refusal(absorbing: int, elastic: int, body: Body, strata: Sequence[Stratum]) -> str | None:
    """Why a layer of so many cells would grow beside a body, and what to do; None where it would
    not."""
    if absorbing < 2:
        return f"takes two absorbing cells or more, got absorbing={absorbing}"
    closed = np.flatnonzero(~body.open)
    for d in closed:
        if not (body.one_cell[d] and body.plane[d]):
            return (
                f"needs a layer at one end at least of the direction {'xyz'[d]}: between walls, or "
                "free sides, or tied ones more than a cell apart, what is trapped there grows; "
                "name a side of that direction too, or take ViscousBoundary"
            )
    if len(closed) == len(body.open) - 1 and len(strata) > 1:
        return (
            "grows at the end of a column of several materials: take ViscousBoundary, which is "
            "exact there"
        )
    return _of_shape(elastic, body) or _of_strata(elastic, strata)


def _of_shape(elastic: int, body: Body) -> str | None:
    extent = body.extent[body.open]
    ratio, most = extent.max() / extent.min(), LONGEST.get(elastic, np.inf)
    if ratio <= most:
        return None
    return (
        f"with elastic={elastic} grows beside a body {ratio:.3g} times as long as deep; up to "
        f"{most:.3g} times it does not, and with elastic=4 at any length"
    )


def _of_strata(elastic: int, strata: Sequence[Stratum]) -> str | None:
    if len(strata) < 2:
        return None
    if elastic < 2:
        return f"of several materials takes two elastic cells or more, got elastic={elastic}"
    most = min(elastic, max(STIFFER_ABOVE))
    for one, other in combinations(sorted(strata, key=lambda s: s.height), 2):
        ratio = other.speed / one.speed  # upper over lower
        allowed = (STIFFER_ABOVE if ratio > 1 else SOFTER_ABOVE)[most]
        if max(ratio, 1 / ratio) > allowed:
            how = "faster" if ratio > 1 else "slower"
            return (
                f"grows where S waves are {max(ratio, 1 / ratio):.3g} times {how} in a stratum "
                f"than in one below; up to {allowed} times it does not: end the body in one "
                "stratum, or take ViscousBoundary"
            )
    return None
