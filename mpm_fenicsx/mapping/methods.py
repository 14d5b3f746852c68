"""How points and grid talk: deposit × integrate × recover."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from ..common.checks import an_object, check_flags, whole
from .projection import AT_POINTS, DOUBLE_MAPPED, Integration
from .velocities import trapezoidal


class AccelerationCorrection(Enum):
    """What the mismatch of forces at the end of a step changes the acceleration by.

    ``OFF``: nothing, the paper's step; ``LUMPED``: M̄⁻¹ of it, M̄ the lumped mass; ``IMPLICIT``:
    what it changes in the step's own equations, (M + β Δt² K)⁻¹ of it.
    """

    OFF = "off"
    LUMPED = "lumped"
    IMPLICIT = "implicit"


@dataclass(frozen=True)
class Mapping:
    """A material point method, with all that is about the way between points and grid.

    ``support``: points deposit with shape functions averaged over their support domains (GIMP;
    within each cell the local S*_ip of DM-G), else with linear ones; ``integrate``: stiffness is
    summed at the points or double-mapped to the Gauss points (eq. 7); ``composite``: strain is
    recovered from the composite patch (CMPM), else with the gradients of the deposit; ``mass``:
    where mass is summed, in the paper as stiffness is, which loses momentum where cells are partly
    full; ``linear``: in the internal force stress is linear over a support domain, else constant.

    ``stress``: the internal force is summed at the points, or is that of their stress double-mapped
    to the grid (see ``mapped_stress``; studies/stress_on_the_grid.py compares them).

    Options, to be changed by ``dataclasses.replace(DM_GC, sweeps=2)``:

    ``sweeps``: Jacobi sweeps from the lumped towards the consistent mass in the deposit of
    velocities (see ``Deposit``), 0 for division by the lumped mass alone, as in the paper;
    ``transfer``: how points take velocities from the grid, ``trapezoidal`` or ``flip``;
    ``correction``: what the mismatch of (7) and the points' own force changes the acceleration by,
    or None to choose by the Courant number (see ``AccelerationCorrection`` and ``runs.options``);
    ``b_bar``: volume changes by the mean over the material in each cell, on the grid and at the
    points (B-bar, at finite strain F-bar; see ``material_means``), which cures locking where ν
    comes near ½ or flow ties the volume; double mappings only, and None is where a law says that
    it needs it (``keeps_volume``);
    ``hold_cut_cells``: light nodes of cut cells in which anything acts go with those beside them
    (see ``ties``), unless a term ``GhostPenalty`` holds them.

    Raises ``ValueError`` for linear stress without support domains or double-mapped, B-bar without
    double mapping, and what is no option.
    """

    name: str
    support: bool
    integrate: Integration
    composite: bool
    mass: Integration = AT_POINTS
    linear: bool = False
    stress: Integration = AT_POINTS
    sweeps: int = 1
    transfer: Callable = trapezoidal
    correction: AccelerationCorrection | None = None
    b_bar: bool | None = None
    hold_cut_cells: bool = True

    def __post_init__(self) -> None:
        for name in ("integrate", "mass", "stress"):
            an_object(
                name,
                getattr(self, name),
                Integration,
                "mpm_fenicsx.AT_POINTS or mpm_fenicsx.DOUBLE_MAPPED",
            )
        if self.linear and not self.support:
            raise ValueError(
                f"linear stress needs support domains, and mapping {self.name} has none"
            )
        if self.linear and self.stress is DOUBLE_MAPPED:
            raise ValueError(
                f"stress=DOUBLE_MAPPED takes the internal force from the grid, and mapping "
                f"{self.name} has it linear over support domains: take DM_GC, or leave stress at "
                "AT_POINTS"
            )
        object.__setattr__(self, "sweeps", whole("sweeps", self.sweeps, least=0))
        if not callable(self.transfer) or isinstance(self.transfer, type):
            raise ValueError(
                f"transfer must be a function such as trapezoidal or flip, got {self.transfer!r}"
            )
        if self.correction is not None:
            an_object(
                "correction",
                self.correction,
                AccelerationCorrection,
                "AccelerationCorrection.IMPLICIT, LUMPED or OFF",
            )
        check_flags(hold_cut_cells=self.hold_cut_cells)
        if self.b_bar is not None:
            check_flags(b_bar=self.b_bar)
        if self.b_bar and self.integrate is not DOUBLE_MAPPED:
            raise ValueError(
                f"b_bar needs integrals at Gauss points, and mapping {self.name} takes them at the "
                "points"
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
