"""What bodies in contact have left of their velocity against one another.

Newmark's step stops a gap that closes at rate −v by ending it at rate +v: nodes at the contact
would bounce at every step, with forces three times too large and then none.  Of the velocity and of
the acceleration that points carry on, what does so is taken out, 0 <= impulse of the step ⟂ rate of
the gap >= 0 (Moreau's inelastic impact, of the nodes at the contact; Hughes, Taylor, Sackman,
Curnier & Kanoknukulchai, Comput. Methods Appl. Mech. Eng. 8, 249-276, 1976, correct both).  It is
done with the points' own nodal mass, so that momentum stays and their kinetic energy cannot grow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .complementarity import complementary
from .gaps import Gaps

TOLERANCE = 1e-8
"""Of the largest rate: what is left of it."""


def nodal_mass(run) -> np.ndarray:
    """Mass of the run's points at the nodes (nodes, 1), kg."""
    mass = np.zeros((run.grid.nodes, 1))
    for body, stencil in zip(run.bodies, run.stencils, strict=True):
        stencil.deposit(body.mass[:, None], mass)
    return mass


def stop(runs: Sequence, gaps: Gaps, masses: Sequence[np.ndarray], stepping) -> np.ndarray:
    """Stop what bounces, after the runs' points have taken velocity and acceleration from the grid.

    ``masses``: nodal masses (nodes, 1) of the runs, with the stencils as they are.  Returns forces
    (m,), N, whose impulse bodies get, in this step and by what their points carry into later ones.
    """
    on, forces = np.flatnonzero(gaps.λ > 0.0), np.zeros(len(gaps.λ))
    if not len(on):
        return forces
    per = [np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0.0) for mass in masses]
    λ, every = gaps.λ[on], np.zeros(len(gaps.λ))

    def change(impulse: np.ndarray) -> list[np.ndarray]:
        every[on] = impulse
        return [force * share for force, share in zip(gaps.forces(every), per, strict=True)]

    def rate(impulse: np.ndarray) -> np.ndarray:
        return gaps.opening(change(impulse))[on]

    # κ a₁ + (1 + w - κ) a = λ/m in the balance: κ = 1 and w = 0 but in GeneralizedAlpha
    γ, dt, known = stepping.gamma, stepping.dt, 1.0 + stepping.start
    κ = stepping.balanced[1][0] / stepping.acceleration[0]
    forces[on] = λ / known
    later = (
        1.0 - γ + (κ - known) / known
    )  # impulse that an acceleration carried on gives in the end, over m a Δt
    # what λ has given to velocity, half of its impulse, and to acceleration may be taken back, no
    # more: nothing pulls
    for name, acted, weight in (
        ("velocity", γ * dt * λ / κ, 1.0 / dt),
        ("acceleration", λ / κ, later),
    ):
        now = gaps.opening(
            [_nodal(run, name, share) for run, share in zip(runs, per, strict=True)]
        )[on]
        allowed = TOLERANCE * np.linalg.norm(now)
        impulse = complementary(rate, now - rate(acted), acted, allowed) - acted
        for run, field in zip(runs, change(impulse), strict=True):
            for body, stencil in zip(run.bodies, run.stencils, strict=True):
                getattr(body, name)[:] += stencil.at_points(field)
        forces[on] += weight * impulse
    return forces


def _nodal(run, name: str, per: np.ndarray) -> np.ndarray:
    """Means at the nodes (nodes, dim), weighted by mass, of what the points carry."""
    total = np.zeros((run.grid.nodes, run.grid.dim))
    for body, stencil in zip(run.bodies, run.stencils, strict=True):
        stencil.deposit(body.mass[:, None] * getattr(body, name), total)
    return total * per
