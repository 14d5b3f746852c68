"""How points and grid talk: deposit × integrate × recover."""

from __future__ import annotations

from dataclasses import dataclass

from ..common.checks import an_object
from .projection import AT_POINTS, DOUBLE_MAPPED, Integration


@dataclass(frozen=True)
class Mapping:
    """A material point method.

    ``support``: points deposit with shape functions averaged over their support domains (GIMP;
    within each cell the local S*_ip of DM-G), else with linear ones; ``integrate``: stiffness is
    summed at the points or double-mapped to the Gauss points (eq. 7); ``composite``: strain is
    recovered from the composite patch (CMPM), else with the gradients of the deposit; ``mass``:
    where mass is summed, in the paper as stiffness is, which loses momentum where cells are partly
    full; ``linear``: in the internal force stress is linear over a support domain, else constant.
    Raises ``ValueError`` for linear stress without support domains.
    """

    name: str
    support: bool
    integrate: Integration
    composite: bool
    mass: Integration = AT_POINTS
    linear: bool = False

    def __post_init__(self) -> None:
        for name in ("integrate", "mass"):
            an_object(
                name,
                getattr(self, name),
                Integration,
                "AT_POINTS or DOUBLE_MAPPED of mpm_fenicsx.projection",
            )
        if self.linear and not self.support:
            raise ValueError(
                f"linear stress needs support domains, and mapping {self.name} has none"
            )

    def __str__(self) -> str:
        return self.name


MPM = Mapping("MPM", False, AT_POINTS, False)
GIMP = Mapping("GIMP", True, AT_POINTS, False)
CMPM = Mapping("CMPM", False, AT_POINTS, True)
DM = Mapping("DM", False, DOUBLE_MAPPED, False)
DM_G = Mapping("DM-G", True, DOUBLE_MAPPED, False)
DM_C = Mapping("DM-C", False, DOUBLE_MAPPED, True)
DM_GC = Mapping("DM-GC", True, DOUBLE_MAPPED, True)
DM_GCL = Mapping("DM-GCL", True, DOUBLE_MAPPED, True, linear=True)
"""DM-GC with linear stress: second order where points cross cells, too, for a tenth more of time a
step."""

MAPPINGS = (MPM, GIMP, CMPM, DM, DM_G, DM_C, DM_GC)
