"""A parameter that follows the plastic strain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..common.checks import array
from ..common.compiled import jit


@dataclass(frozen=True)
class Curve:
    """A value that is piecewise linear in the plastic strain κ, and constant beyond both ends.

    ``plastic_strain`` κ, from zero or more upwards; ``value`` in the unit of what it stands for.
    Raises ``ValueError`` naming what is out of range.
    """

    plastic_strain: Sequence[float]
    value: Sequence[float]

    def __post_init__(self) -> None:
        strain, value = (array(name, getattr(self, name)) for name in ("plastic_strain", "value"))
        if strain.ndim != 1 or not len(strain) or strain.shape != value.shape:
            raise ValueError(
                "plastic_strain and value must be two lists of the same length, got shapes "
                f"{strain.shape} and {value.shape}"
            )
        if not np.isfinite(strain).all() or strain[0] < 0.0 or not (np.diff(strain) > 0.0).all():
            raise ValueError(
                f"plastic_strain must increase from zero or more, got {self.plastic_strain}"
            )
        if not np.isfinite(value).all():
            raise ValueError(f"value must be finite, got {self.value}")
        object.__setattr__(self, "plastic_strain", tuple(strain.tolist()))
        object.__setattr__(self, "value", tuple(value.tolist()))

    @property
    def softens_from(self) -> float:
        """κ beyond which the value only falls: where it is largest for the last time."""
        value = np.array(self.value)
        return self.plastic_strain[len(value) - 1 - int(np.argmax(value[::-1]))]

    @property
    def slopes(self) -> np.ndarray:
        """Change per unit κ of each piece (pieces,)."""
        return np.diff(self.value) / np.diff(self.plastic_strain)

    def __call__(self, plastic_strain: np.ndarray) -> np.ndarray:
        """Values at κ, an array of any shape."""
        return np.interp(plastic_strain, self.plastic_strain, self.value)


def stacked(curves: Sequence[Curve]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Several curves for compiled loops: κ and values (curves, points of the longest), the last
    point repeated, and κ (curves,) from which they soften."""
    most = max(len(curve.value) for curve in curves)

    def rows(name: str) -> np.ndarray:
        every = [getattr(curve, name) for curve in curves]
        return np.array([[*row, *[row[-1]] * (most - len(row))] for row in every])

    return (
        rows("plastic_strain"),
        rows("value"),
        np.array([curve.softens_from for curve in curves]),
    )


@jit
def value_at(curves, which, kappa, scale):
    """Return the value of one of ``stacked`` curves at κ and its slope; what of κ lies in the
    softening part counts ``scale`` times."""
    strain, value, softens_from = curves
    last = strain.shape[1] - 1
    stretch = 1.0
    if kappa > softens_from[which]:
        kappa = softens_from[which] + scale * (kappa - softens_from[which])
        stretch = scale
    if kappa < strain[which, 0]:
        return value[which, 0], 0.0
    for k in range(last):
        left, right = strain[which, k], strain[which, k + 1]
        if left <= kappa < right:
            slope = (value[which, k + 1] - value[which, k]) / (right - left)
            return value[which, k] + slope * (kappa - left), slope * stretch
    return value[which, last], 0.0


@jit
def piece_of(curves, which, kappa, scale):
    """Return the slope just beyond κ of one of ``stacked`` curves, and from where to where in κ it
    is the slope; what of κ lies in the softening part counts ``scale`` times."""
    strain, value, softens_from = curves
    last, start = strain.shape[1] - 1, softens_from[which]
    softens = kappa >= start
    at = start + scale * (kappa - start) if softens else kappa
    slope, low, high = 0.0, strain[which, last], math.inf
    if at < strain[which, 0]:
        low, high = -math.inf, strain[which, 0]
    else:
        for k in range(last):
            left, right = strain[which, k], strain[which, k + 1]
            if left <= at < right:
                slope, low, high = (
                    (value[which, k + 1] - value[which, k]) / (right - left),
                    left,
                    right,
                )
                break
    if softens:
        return slope * scale, start + (low - start) / scale, start + (high - start) / scale
    return slope, low, high
