"""A length of softening: strength by a plastic strain that is averaged over the ground around."""

from __future__ import annotations

from dataclasses import dataclass

from ..common.checks import finite, positive

AVERAGED = "plastic_strain"
AVERAGE = "nonlocal_strain"
"""Names of the state variables κ and κ̄."""


@dataclass(frozen=True)
class OverNonlocal:
    """Strength by m κ̄ + (1 - m) κ, κ̄ the plastic strain κ averaged over a length l.

    ``length`` l (m), at least two cells; ``weight`` m > 1 (-).  The run solves, after each step,

        κ̄ - l² ∇²κ̄ = κ

    in the ground of a material, without flux over its surface.  A band that softens is then as
    wide as l makes it, on every grid.  κ̄ stays as it is within a step.
    At m = 1 κ has no part of its own, and bands still shrink to a cell: such a weight is refused.

    Raises ``ValueError`` naming what is out of range.
    See ``analytical.shear_band`` for the band's width and how it softens.
    """

    length: float
    weight: float = 2.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", positive("length", self.length))
        weight = finite("weight", self.weight)
        if not weight > 1.0:
            raise ValueError(
                "weight must be above 1: up to there a band still shrinks to a single cell, got "
                f"{weight}"
            )
        object.__setattr__(self, "weight", weight)
