"""The band in which a long layer fails in shear whose strength follows an over-nonlocal plastic
strain.

Strength c falls by h per unit of s = m κ̄ - (m - 1) κ, m > 1, where κ̄ - l² κ̄'' = κ.  Shear stress
is the same all over the layer, and so is s where it flows.  There

    κ̄'' + (κ̄ - s)/λ² = 0,  λ = l √(m - 1):    κ̄ = s (1 + √((m - 1)/m) cos(x/λ)),
                                                κ = s (1 + √(m/(m - 1)) cos(x/λ)),

x from the middle; outside κ̄ falls as exp(-x/l).  κ̄ and its slope are the same on both sides of the
edge, and κ is zero there: the soil beyond it has just not flowed.  So cos(a/λ) = -√((m - 1)/m) and
sin(a/λ) = 1/√m, that is a = λ (π - atan(1/√(m - 1))).  Since ∫κ dx = ∫κ̄ dx,

    ∫ κ dx = 2 (a + l) s:

the layer softens as if all of a band 2 (a + l) wide had flowed alike, by the local law.  It holds
until c is at its residual in the middle, in layers several l longer than the band.
"""

from __future__ import annotations

import math

import numpy as np


def half_width(length: float, weight: float = 2.0) -> float:
    """a (m) of the length l (m) and the weight m."""
    λ = length * math.sqrt(weight - 1.0)
    return λ * (math.pi - math.atan(1.0 / math.sqrt(weight - 1.0)))


def width(length: float, weight: float = 2.0) -> float:
    """2 a (m), the part of the layer that flows: 4.712 l at m = 2."""
    return 2.0 * half_width(length, weight)


def softening_width(length: float, weight: float = 2.0) -> float:
    """2 (a + l) (m), the width of a band of even κ that softens alike: 6.712 l at m = 2."""
    return 2.0 * (half_width(length, weight) + length)


def plastic_strain(x: np.ndarray, s: float, length: float, weight: float = 2.0) -> np.ndarray:
    """κ (n,) at x (n,), m, from the middle, where the strength has fallen by h ``s``."""
    λ = length * math.sqrt(weight - 1.0)
    shape = 1.0 + math.sqrt(weight / (weight - 1.0)) * np.cos(np.asarray(x) / λ)
    return np.where(np.abs(x) < half_width(length, weight), s * shape, 0.0)


def nonlocal_strain(x: np.ndarray, s: float, length: float, weight: float = 2.0) -> np.ndarray:
    """κ̄ (n,) at x (n,), m, from the middle, where the strength has fallen by h ``s``."""
    λ, a, x = length * math.sqrt(weight - 1.0), half_width(length, weight), np.abs(x)
    inside = s * (1.0 + math.sqrt((weight - 1.0) / weight) * np.cos(np.minimum(x, a) / λ))
    return np.where(x < a, inside, s / weight * np.exp(-(np.maximum(x, a) - a) / length))


def softening_slope(
    height: float, shear_modulus: float, softening: float, length: float, weight: float = 2.0
) -> float:
    """dτ/du (Pa/m), u the displacement of the top of a layer of von Mises soil against its base.

    ``height`` (m), ``shear_modulus`` G and ``softening`` h (Pa).  In simple shear κ = γᵖ/√3 and τ =
    c, hence u = τ H/G + √3 ∫κ dx and 1/slope = H/G - 2√3 (a + l)/h.  Positive: the layer snaps
    back.
    """
    band = math.sqrt(3.0) * softening_width(length, weight)
    return 1.0 / (height / shear_modulus - band / softening)
