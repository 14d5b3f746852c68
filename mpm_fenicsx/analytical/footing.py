"""Settlement of an elastic layer and of a half-space under a flexible rectangular footing."""

from __future__ import annotations

import numpy as np


def layer_compliance(k: np.ndarray, depth: float, young: float, poisson: float) -> np.ndarray:
    """Settlement over pressure (m/Pa) of a layer that sticks to a rigid base, where the pressure on
    its surface goes as cos(k·x) and bears no shear.

    ``k`` (1/m), > 0 or 0; ``depth`` H (m).  With κ = 3 − 4ν and x = kH (Burmister 1956)

        w/p = 2(1 − ν²)/(E k) · (2κ sinh 2x − 4x)/(2κ cosh 2x + 1 + κ² + 4x²)

    which is H over the confined modulus for k = 0, and 2(1 − ν²)/(E k), the half-space's, where
    waves are short beside H.
    """
    ν, κ = poisson, 3.0 - 4.0 * poisson
    k = np.asarray(k, float)
    x = np.maximum(k * depth, 1e-4)  # below, round-off exceeds what is left out
    e = np.exp(-2.0 * x)
    share = (κ * (1.0 - e**2) - 4.0 * x * e) / (κ * (1.0 + e**2) + (1.0 + κ**2 + 4.0 * x**2) * e)
    return 2.0 * (1.0 - ν**2) / young * share * depth / x


def settlement_of_a_box(
    places: np.ndarray,
    half: tuple[float, float],
    width: tuple[float, float],
    depth: float,
    pressure: float,
    young: float,
    poisson: float,
    terms: int = 1000,
) -> np.ndarray:
    """Settlement (n,), m, at ``places`` (n, 2), m, on the surface of a box of elastic soil.

    The box is 0 ≤ x, z ≤ ``width`` between smooth vertical walls and sticks to a rigid base at
    ``depth``; ``pressure`` (Pa) acts on x < ``half[0]``, z < ``half[1]``.  Walls mirror the load,
    so that it is a sum of cosines, Σ p_mn cos(α_m x) cos(β_n z), α_m = mπ/W: each settles by
    ``layer_compliance``, and the sum is exact at small strain.  ``terms`` in each direction: with
    1000 it is good to 5e-6 at the centre of a square.
    """
    wave, settled, _ = _series(half, width, depth, young, poisson, terms)
    x = np.atleast_2d(np.asarray(places, float))
    cosines = [np.cos(np.outer(x[:, d], wave[d])) for d in range(2)]
    return pressure * ((cosines[0] @ settled) * cosines[1]).sum(axis=1)


def mean_settlement_of_a_box(
    half: tuple[float, float],
    width: tuple[float, float],
    depth: float,
    pressure: float,
    young: float,
    poisson: float,
    terms: int = 1000,
) -> float:
    """Mean settlement (m) under the footing of ``settlement_of_a_box``: the work of its load is
    half the load times this."""
    _, settled, mean = _series(half, width, depth, young, poisson, terms)
    return float(pressure * (mean[0] @ settled @ mean[1]))


def _series(
    half: tuple[float, float],
    width: tuple[float, float],
    depth: float,
    young: float,
    poisson: float,
    terms: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wave numbers (2, terms), 1/m, what each pair of cosines settles under a load of 1 Pa (terms,
    terms), m/Pa, and the means of cosines under the footing (2, terms)."""
    m = np.arange(terms)
    a, W = (np.array(lengths)[:, None] for lengths in (half, width))
    wave, mean = m * np.pi / W, np.sinc(m * a / W)
    share = np.where(m > 0, 2.0, 1.0) * a / W * mean
    compliance = layer_compliance(np.hypot(*np.ix_(*wave)), depth, young, poisson)
    return wave, np.outer(*share) * compliance, mean


def corner_of_a_half_space(
    sides: tuple[float, float], pressure: float, young: float, poisson: float
) -> float:
    """Settlement (m) of a half-space at the corner of a rectangle that bears ``pressure`` (Pa)
    (Schleicher 1926): the centre of a footing settles four times as much as a corner of one of its
    quarters.

        w = p (1 − ν²)/(π E) · [a arsinh(b/a) + b arsinh(a/b)]
    """
    a, b = sides
    shape = a * np.arcsinh(b / a) + b * np.arcsinh(a / b)
    return float(pressure * (1.0 - poisson**2) / (np.pi * young) * shape)
