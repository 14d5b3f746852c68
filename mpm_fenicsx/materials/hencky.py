"""Hencky's hyperelasticity: linear between logarithmic strain and Kirchhoff stress, at any rotation
and stretch."""

from __future__ import annotations

from dataclasses import dataclass

from .elastic import LinearElastic
from .kinematics import FINITE_STRAIN


@dataclass(frozen=True)
class Hencky(LinearElastic):
    """Elastic soil of finite strain, τ = λ tr(ε) I + 2μ ε with ε = ½ ln F Fᵀ and τ = J σ.

    Parameters as of ``LinearElastic``; ``density`` is that at rest.  Waves keep real speeds for
    principal stretches from 0.21 to e^(1/3) = 1.40 (Bruhns, Xiao and Meyers, Proc. R. Soc. Lond. A
    457, 2001). As ``elastic`` of a ``VonMises`` it makes that law multiplicative, with the same
    return map in Hencky's strain.
    """

    kinematics = FINITE_STRAIN
    linear = False
