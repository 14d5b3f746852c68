"""Stress at rest of layered ground, as a function of place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..common import tensors
from ..common.checks import asked, chosen, finite, in_short, numbers, positive

GRAVITY = 9.81
"""m/s²."""
LINES = 200
"""Places along a vertical that are asked which layer they are in."""
HALVINGS = 44
"""Of the way between two of them in different layers: round-off."""
NONE = -1


@dataclass(frozen=True)
class GeostaticStress:
    """σ_v = -∫ ρ g dy from a place up to the surface, and σ_h = K₀ σ_v in the other directions.

    ``layers``: the ground's material, or pairs (material, where), ``where`` mapping x (dim, n), m,
    to bool (n,); ``surface`` (m): its height, or a function of x to heights (n,); ``K0`` (-): one
    number, one for each layer, or a function of x to (n,); ``gravity`` (m/s²): g along -y, or
    (dim,) numbers, down one axis.  K₀ is of total stress, in ``Undrained`` ground, too, whose water
    ``initial_stress`` knows of.  Called with x (dim, n) it gives stress rows (n, components), Pa.

    Exact for layers of any shape that are thicker than 1/200 of the depth below the surface.  In
    level ground of level layers forces balance; below a slope they do not, and a run has to settle.
    Raises ``ValueError`` for what is none of these, and for a place, or one above it, that is in no
    layer or in several, or lies above the surface.
    """

    layers: object
    surface: float | Callable[[np.ndarray], np.ndarray]
    K0: float | Sequence[float] | Callable[[np.ndarray], np.ndarray]
    gravity: float | Sequence[float] = GRAVITY

    def __post_init__(self) -> None:
        layers = self.layers
        single = hasattr(layers, "density")
        pairs = [(layers, None)] if single else layers
        if not single and not (
            isinstance(pairs, list | tuple)
            and pairs
            and all(isinstance(p, list | tuple) and len(p) == 2 and callable(p[1]) for p in pairs)
            and all(hasattr(p[0], "density") for p in pairs)
        ):
            raise ValueError(
                "layers must be a material, or pairs (material, where) with where mapping x "
                f"(dim, n) to bool (n,), got {in_short(layers)}"
            )
        object.__setattr__(self, "layers", tuple(tuple(pair) for pair in pairs))
        object.__setattr__(self, "gravity", downwards(self.gravity))
        object.__setattr__(self, "K0", checked_K0(self.K0, len(self.layers), "layer"))
        if not callable(self.surface):
            object.__setattr__(self, "surface", finite("surface", self.surface))

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa, at places x (dim, n), m."""
        x = np.asarray(x, float)
        top, layer = height_of(self.surface, x), self._layer(x)
        g, up = self.gravity
        if up >= len(x):
            raise ValueError(f"gravity acts along axis {up}, and x has {len(x)} coordinates")
        above = x[up] - top
        if above.max(initial=0.0) > 1e-9 * max(1.0, np.abs(top).max(initial=0.0)):
            n = int(above.argmax())
            raise ValueError(f"surface at {top[n]} m lies below the place {x[:, n]}")
        vertical = -g * self._mass_above(x, top, layer)
        return rows_of(vertical, values_of(self.K0, x, layer), len(x), up)

    def _layer(self, x: np.ndarray) -> np.ndarray:
        """Numbers (n,) of the layers that places x (dim, n) lie in."""
        if self.layers[0][1] is None:
            return np.zeros(x.shape[1], int)
        held = np.array([chosen("where of layers", where, x) for _, where in self.layers])
        bad = np.flatnonzero(held.sum(axis=0) != 1)
        if len(bad):
            which = np.flatnonzero(held[:, bad[0]]).tolist()
            raise ValueError(
                f"layers: the place {x[:, bad[0]]} lies in "
                + (f"the layers {which}: each place is in one" if which else "no layer")
            )
        return held.argmax(axis=0)

    def _mass_above(self, x: np.ndarray, top: np.ndarray, layer: np.ndarray) -> np.ndarray:
        """Mass per area (n,), kg/m², of what is above places up to the surface."""
        density = np.array([material.density for material, _ in self.layers])
        depth = top - x[self.gravity[1]]
        if len(density) == 1:
            return density[0] * depth
        low, before, mass = np.zeros_like(depth), layer, np.zeros_like(depth)
        for k in range(LINES):
            at = np.full_like(depth, (k + 0.5) / LINES)
            now = self._layer(self._raised(x, at * depth))
            change = np.flatnonzero(now != before)
            at[change] = self._interface(x, depth, low, at, before, change)
            mass += density[before] * (at - low) * depth
            low, before = at, now
        return mass + density[before] * (1.0 - low) * depth

    def _interface(self, x, depth, low, high, before, rows) -> np.ndarray:
        """Where, in parts of the depth, verticals ``rows`` leave the layer ``before`` between
        ``low`` and ``high``."""
        a, b = low[rows], high[rows]
        for _ in range(HALVINGS if len(rows) else 0):
            middle = 0.5 * (a + b)
            inside = self._layer(self._raised(x[:, rows], middle * depth[rows])) == before[rows]
            a, b = np.where(inside, middle, a), np.where(inside, b, middle)
        return 0.5 * (a + b)

    def _raised(self, x: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Places x (dim, n) so much higher."""
        found = x.copy()
        found[self.gravity[1]] += by
        return found


def downwards(gravity) -> tuple[float, int]:
    """g (m/s²), and the axis against which it acts, of a number or of (dim,) numbers."""
    if np.ndim(gravity) == 0 or isinstance(gravity, str):
        return positive("gravity", gravity), 1
    vector = numbers(gravity)
    axes = [] if vector is None or vector.ndim != 1 else np.flatnonzero(vector)
    if len(axes) != 1 or not (np.isfinite(vector).all() and vector[axes[0]] < 0.0):
        raise ValueError(
            "gravity must be a positive number (m/s²), or a vector down one axis, such as (0, "
            f"-9.81), got {in_short(gravity)}"
        )
    return float(-vector[axes[0]]), int(axes[0])


def checked_K0(K0, layers: int, of: str):
    """K0 as a function, or as numbers, one for each of so many layers or bodies."""
    if callable(K0):
        return K0
    values = np.ravel(numbers(K0) if numbers(K0) is not None else np.nan)
    if len(values) not in (1, layers) or not np.isfinite(values).all() or (values < 0.0).any():
        raise ValueError(
            f"K0 must be a number that is not negative, one for each {of} ({layers}), or a "
            f"function of x, got {in_short(K0)}"
        )
    return tuple(np.broadcast_to(values, layers).tolist())


def values_of(K0, x: np.ndarray, layer: np.ndarray) -> np.ndarray:
    """K0 (n,) at places x (dim, n) of layers (n,)."""
    return _numbers_at("K0", K0, x) if callable(K0) else np.array(K0)[layer]


def height_of(surface, x: np.ndarray) -> np.ndarray:
    """Height (n,), m, of the surface above places x (dim, n)."""
    if not callable(surface):
        return np.full(x.shape[1], finite("surface", surface))
    return _numbers_at("surface", surface, x)


def stress_at(function: Callable, x: np.ndarray) -> np.ndarray:
    """Stress rows (n, components), Pa, that a function of places x (dim, n) gives.

    Raises ``ValueError`` where it gives anything else.
    """
    if not callable(function):
        raise ValueError(
            "stress must be a function of x (dim, n), m, such as GeostaticStress, got "
            f"{in_short(function)}"
        )
    given = asked("stress", function, x)
    rows, shape = numbers(given), (x.shape[1], tensors.components(len(x)))
    if rows is None or rows.shape != shape or not np.isfinite(rows).all():
        gave = in_short(given) if rows is None or rows.shape == shape else f"shape {rows.shape}"
        raise ValueError(
            f"stress must map x {x.shape} to {shape} finite numbers, rows of xx, yy, zz, xy"
            f"{', yz, xz' if len(x) == 3 else ''}, gave {gave}"
        )
    return rows


def _numbers_at(name: str, function: Callable, x: np.ndarray) -> np.ndarray:
    found = numbers(asked(name, function, x))
    if found is None or found.shape != (x.shape[1],) or not np.isfinite(found).all():
        raise ValueError(
            f"{name} must map (dim, n) to (n,) finite numbers, gave {in_short(found)} for "
            f"n={x.shape[1]}"
        )
    return found


def rows_of(vertical: np.ndarray, K0: np.ndarray, dim: int, up: int) -> np.ndarray:
    """Stress rows (n, components), Pa, of vertical stress (n,) along the axis ``up``."""
    rows = np.zeros((len(vertical), tensors.components(dim)))
    rows[:, :3] = (K0 * vertical)[:, None]
    rows[:, up] = vertical
    return rows
