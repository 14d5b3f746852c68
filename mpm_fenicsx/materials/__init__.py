"""Constitutive laws: parameters in a frozen dataclass, ``respond`` and ``tangent`` for a batch of
points."""

from .backbone import Hyperbolic, ReductionCurve
from .curve import Curve
from .drucker_prager import DruckerPrager, MatchedTo
from .elastic import LinearElastic, OnElastic
from .hencky import Hencky
from .hysteretic import Hysteretic
from .modified_cam_clay import ModifiedCamClay
from .mohr_coulomb import MohrCoulomb
from .over_nonlocal import OverNonlocal
from .tresca import Tresca
from .umat import Umat
from .undrained import Undrained, hydrostatic
from .von_mises import VonMises

__all__ = [
    "Curve",
    "DruckerPrager",
    "Hencky",
    "Hyperbolic",
    "Hysteretic",
    "LinearElastic",
    "MatchedTo",
    "ModifiedCamClay",
    "MohrCoulomb",
    "OnElastic",
    "OverNonlocal",
    "ReductionCurve",
    "Tresca",
    "Umat",
    "Undrained",
    "VonMises",
    "hydrostatic",
]
