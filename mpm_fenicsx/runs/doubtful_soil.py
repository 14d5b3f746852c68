"""Soil that a run can hardly mean: cells that lock, stress that a law does not bear."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common.ranks import anywhere, warn
from ..materials.kinematics import volume_ratio
from ..points.material_points import MaterialPoints

NEARLY = 0.49
"""Poisson's ratio of elastic soil from which cells lock so that it shows."""
BEYOND = 1e-6
"""Of the largest stress: by so much may a law change one that is given, without any strain."""


def warn_of_locking(comm, materials: Sequence, method: str, able: bool = True) -> None:
    """Warn of soil that makes cells lock, in a run of a ``method`` that was not told whether to
    take B-bar, and does not.  Collective."""
    for law in materials:
        name = type(law).__name__
        if law.keeps_volume and not able:
            warn(
                comm,
                f"{name}: it keeps the volume or ties it to shear, and {method} integrates at the "
                "points, where cells lock: they bear a multiple of what the soil does, less on "
                "finer grids. Take DM_GC, which goes with B-bar for it; b_bar=False says nothing",
                4,
            )
            return
        λ, μ = law.lame
        ratio = λ / (2.0 * (λ + μ))
        if ratio > NEARLY and not law.keeps_volume:
            cure = "b_bar=True" if able else "DM_GC with b_bar=True"
            warn(
                comm,
                f"{name}: with ν = {ratio:.4g} cells lock, and settlements are too small: take "
                f"{cure}, or say b_bar=False",
                4,
            )
            return


def warn_of_stress(comm, bodies: Sequence[MaterialPoints]) -> None:
    """Warn of points that bear, before the first step, what their law does not: it falls away at
    once.  Collective."""
    message = None
    for body in bodies:
        law = body.material
        if law.linear or not len(body) or not body.stress.any():
            continue
        state = body.remembered, body.parameters
        stress, none = body.stress, np.zeros_like(body.stress)
        if law.kinematics.finite:
            stress = volume_ratio(body)[:, None] * stress
            found, _ = law.respond(law.strain(stress), none, *state)
        else:
            found, _ = law.respond(none, stress, *state)
        off = np.abs(found - stress).max(axis=1, initial=0.0)
        row = int(np.argmax(off))
        if off[row] > BEYOND * np.abs(stress).max():
            message = (
                f"points bear stress at the start that {type(law).__name__} does not: at "
                f"x={body.x[row]} {np.round(stress[row], 1)} Pa, of which it leaves "
                f"{np.round(found[row], 1)}; the rest falls away in the first step, with its energy"
            )
    message = anywhere(comm, message)
    if message:
        warn(comm, message, 3)
