"""Constitutive laws: parameters in a frozen dataclass, ``update`` for a batch of points."""

from .elastic import LinearElastic

__all__ = ["LinearElastic"]
