"""Tresca's law: Mohr and Coulomb's without friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .curve import Curve
from .elastic import LinearElastic
from .mohr_coulomb import OnShearPlanes


@dataclass(frozen=True)
class Tresca(OnShearPlanes):
    """Elastic soil that yields where σ_1 - σ_3 = 2 c, and keeps its volume; undrained clay.

    Parameters as of ``MohrCoulomb``, at φ = ψ = 0: ``elastic``; ``cohesion`` c (Pa), the undrained
    strength, a number or a ``Curve`` of κ; ``tensile_strength`` (Pa), None for none; ``length`` (m)
    and ``averaging``.  c and the tensile strength may be given point by point.
    Raises ``ValueError`` naming the parameter that is out of range.
    """

    elastic: LinearElastic
    cohesion: float | Curve
    tensile_strength: float | None = None
    length: float | None = None
    averaging: object | None = None

    friction_angle: ClassVar[float] = 0.0
    dilation_angle: ClassVar[float] = 0.0
    parameters: ClassVar = ("cohesion", "tensile_strength")
