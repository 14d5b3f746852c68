"""Constitutive laws: parameters in a frozen dataclass, ``respond`` and ``tangent`` for a batch of
points."""

from .elastic import LinearElastic, OnElastic
from .hencky import Hencky
from .von_mises import VonMises

__all__ = ["Hencky", "LinearElastic", "OnElastic", "VonMises"]
