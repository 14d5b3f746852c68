"""Where a mean volume change is not what it is taken for: told when a run is built."""

from __future__ import annotations

from collections.abc import Sequence

from ..common.ranks import warn


def warn_of_laws(comm, materials: Sequence, stacklevel: int = 3) -> None:
    """Warn of laws whose flow may change volume: B-bar replaces the strain, and is the cure for
    laws that keep it."""
    for material in materials:
        if not (material.linear or material.kinematics.finite or material.keeps_volume):
            warn(
                comm,
                f"b_bar with {type(material).__name__}: where flow changes volume, the mean of a "
                "cell takes that for all of its points; it is a cure for flow that keeps the "
                "volume, as of VonMises",
                stacklevel,
            )


def warn_of_points(comm, materials: Sequence, partly_filled: int, dynamic: bool) -> None:
    """The same, and warn of softening, and of partly filled cells in dynamics."""
    warn_of_laws(comm, materials, stacklevel=4)
    for material in materials:
        if getattr(material, "softening", 0.0) > 0.0:  # a parameter of its own, which few laws have
            warn(
                comm,
                f"b_bar with softening = {material.softening:.6g}: where a side of the body lies "
                "on a grid line, Newton's iteration may stall at residuals of 1e-6 to 4e-6; allow "
                "Newton(tolerance=1e-5), or go without b_bar",
                3,
            )
    if dynamic and partly_filled:
        warn(
            comm,
            f"b_bar in dynamics with {partly_filled} partly filled cells: motion grows there even "
            "at rest; lay the sides of the body on grid lines, or go without b_bar",
            3,
        )
