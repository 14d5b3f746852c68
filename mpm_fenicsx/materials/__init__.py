"""Constitutive laws: parameters in a frozen dataclass, ``respond`` and ``tangent`` for a batch of points."""

from .elastic import LinearElastic
from .von_mises import VonMises

__all__ = ["LinearElastic", "VonMises"]
