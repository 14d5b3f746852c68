"""Units of acceleration, and words about a peak that none of them explains."""

from __future__ import annotations

GRAVITY = 9.80665  # m/s², the standard g
LARGEST = 10.0 * GRAVITY  # m/s²; the ground has been seen to reach half of that
UNITS = {
    "g": GRAVITY,
    "m/s2": 1.0,
    "m/s²": 1.0,
    "cm/s2": 0.01,
    "cm/s²": 0.01,
    "gal": 0.01,
}
"""m/s² in one of each."""


def doubt(peak: float, unit: str) -> str:
    """A sentence on a ``peak`` above 10 g, a number in this ``unit``, with those it may be in."""
    likely = [name for name in ("m/s2", "cm/s2") if peak * UNITS[name] <= LARGEST]
    instead = " or ".join(f"{name!r} ({peak * UNITS[name] / GRAVITY:.3g} g)" for name in likely)
    return (
        f"a peak acceleration of {peak:.4g} in {unit!r} is {peak * UNITS[unit] / GRAVITY:.3g} g, "
        "more than the ground has ever done; "
        + (f"the unit is likely to be {instead}" if likely else "look at the unit and the column")
    )
