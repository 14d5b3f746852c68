"""Site response of soil that yields, by linear soil of the same modulus and damping at the strain
that it comes to (Seed & Idriss 1969; Schnabel, Lysmer & Seed 1972)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .site_response import Layer, LayeredGround


@dataclass(frozen=True)
class EquivalentLinear:
    """What ``equivalent_linear`` comes to.

    ``ground``: linear layers, whose ``transfer`` and ``motion_at`` are the response; ``strain``:
    effective shear strain (layers,), ``strain_ratio`` times the largest one at mid-height;
    ``reduction`` G/G_max (layers,) and ``damping`` ratio of the curves (layers,), of 1, at that
    strain; ``iterations`` they took.
    """

    ground: LayeredGround
    strain: np.ndarray
    reduction: np.ndarray
    damping: np.ndarray
    iterations: int


def equivalent_linear(
    ground: LayeredGround,
    curves: Sequence[object],
    acceleration: np.ndarray,
    dt: float,
    kind: str = "outcrop",
    strain_ratio: float = 0.65,
    tolerance: float = 1e-4,
    most: int = 50,
) -> EquivalentLinear:
    """Linear ground that stands for layers whose modulus and damping follow the shear strain.

    ``ground``: layers at small strain; what they damp there is added to what the curves do.
    ``curves``: for each layer an object with functions ``reduction`` (G/G_max) and
    ``damping_ratio`` (of 1) of shear strains (n,), as a ``Backbone`` of a hysteretic soil is, or
    None for a layer that stays linear.  ``acceleration`` (n,), m/s², every ``dt`` (s), of ``kind``
    as in ``LayeredGround``.  Thick layers want to be ``split``: each has one strain.

    From small strain on the strains of the linear ground give its next moduli and damping, until
    these change by less than ``tolerance`` of themselves, damping by as much of 1 %.
    Raises ``ValueError`` for curves that are not one a layer, and ``RuntimeError`` where ``most``
    iterations are not enough.
    """
    curves = list(curves)
    if len(curves) != len(ground.layers):
        raise ValueError(
            f"curves must be one for each of the {len(ground.layers)} layers, or None for it, got "
            f"{len(curves)}"
        )
    for curve in curves:
        lacks = [name for name in ("reduction", "damping_ratio") if not hasattr(curve, name)]
        if curve is not None and lacks:
            raise ValueError(f"curves must have functions of strain {' and '.join(lacks)}: {curve}")
    if not 0.0 < strain_ratio <= 1.0:
        raise ValueError(f"strain_ratio must lie above 0 and be at most 1, got {strain_ratio}")
    bottoms = np.cumsum([layer.thickness for layer in ground.layers])
    middles = bottoms - [0.5 * layer.thickness for layer in ground.layers]
    now = ground
    reduction, damping = np.ones(len(curves)), np.zeros(len(curves))
    for iteration in range(1, most + 1):
        strain = np.array([np.abs(now.strain_at(z, acceleration, dt, kind)).max() for z in middles])
        strain *= strain_ratio
        next_reduction, next_damping = _of_curves(curves, strain)
        change = max(
            np.abs(next_reduction / reduction - 1).max(),
            (np.abs(next_damping - damping) / np.maximum(next_damping, 0.01)).max(),
        )
        reduction, damping = next_reduction, next_damping
        layers = zip(ground.layers, reduction, damping, strict=True)
        now = LayeredGround(tuple(_softened(*one) for one in layers), ground.base)
        if change < tolerance:
            return EquivalentLinear(now, strain, reduction, damping, iteration)
    raise RuntimeError(
        f"moduli and damping still change by {change:.1e} of themselves after {most} iterations, "
        f"more than the tolerance {tolerance:.1e}: the largest effective strain is "
        f"{strain.max():.1e}; split thick layers, or take a larger tolerance"
    )


def _of_curves(curves: list, strain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """G/G_max and damping ratio (layers,) at the strain of each layer."""
    values = []
    for curve, γ in zip(curves, strain, strict=True):
        pair = (1.0, 0.0)
        if curve is not None:
            at = np.array([γ])
            pair = tuple(float(np.ravel(f(at))[0]) for f in (curve.reduction, curve.damping_ratio))
        if not (0.0 < pair[0] <= 1.0 + 1e-9 and 0.0 <= pair[1] < 1.0):
            raise ValueError(
                f"curves must give a reduction above 0 and at most 1, and a damping ratio from 0 "
                f"to below 1, gave {pair[0]} and {pair[1]} at the strain {γ:.3e}"
            )
        values.append(pair)
    reduction, damping = np.array(values).T
    return reduction, damping


def _softened(layer: Layer, reduction: float, damping: float) -> Layer:
    """The layer with its modulus so much lower and so much more damping."""
    own = layer.damping
    both = (lambda f: own(f) + damping) if callable(own) else own + damping
    return replace(layer, speed=layer.speed * np.sqrt(reduction), damping=both)
