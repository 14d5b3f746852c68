"""Forces that only push: S λ + g >= 0, λ >= 0, one of the two zero in every row."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..common.errors import SolverError

# Γ: rows at their bound wait until what is wrong with them outweighs the free rows
PROPORTION = 1.0


def complementary(
    compliance: Callable[[np.ndarray], np.ndarray],
    gap: np.ndarray,
    λ: np.ndarray,
    tolerance: float,
    most: int = 500,
) -> np.ndarray:
    """λ (m,) with S λ + ``gap`` >= 0, λ >= 0 and λ · (S λ + gap) = 0, from a guess λ.

    ``compliance``: λ -> S λ, symmetric and positive semi-definite: rows may say the same thing
    twice.  ``tolerance``: norm of what is left, in the unit of ``gap``.  Conjugate gradients on the
    rows that push, which change where a row runs into its bound or leaves it (MPRGP: Dostál &
    Schöberl, Comput. Optim. Appl. 30, 23-43, 2005); the step over the bound, 1/‖S‖, goes by the
    largest p·Sp/p·p met.
    Raises ``SolverError`` after ``most`` products with S.
    """
    λ = np.maximum(λ, 0.0)
    r, largest = (compliance(λ) + gap if λ.any() else gap.copy()), 0.0
    p = np.where(λ > 0.0, r, 0.0)
    for _ in range(most):
        free, bound = np.where(λ > 0.0, r, 0.0), np.where(λ > 0.0, 0.0, np.minimum(r, 0.0))
        if np.linalg.norm(free + bound) <= tolerance:
            return λ
        reduced = np.minimum(λ * largest, free) if largest > 0.0 else free
        leave = not bound @ bound <= PROPORTION**2 * (reduced @ free)
        d = bound if leave else p
        Sd = compliance(d)
        curvature = d @ Sd
        largest = max(largest, curvature / (d @ d))
        most_step = (λ[d > 0.0] / d[d > 0.0]).min(initial=np.inf)
        step = (
            (r @ d) / curvature if curvature > 0.0 else np.inf
        )  # rows that say the same, of unlike gaps
        if min(step, most_step) == np.inf:
            raise SolverError("contact: no force opens the gaps")
        if step <= most_step:
            λ, r = np.maximum(λ - step * d, 0.0), r - step * Sd
            free = np.where(λ > 0.0, r, 0.0)
            p = free if leave else free - (free @ Sd) / curvature * d
            continue
        λ, r = np.maximum(λ - most_step * d, 0.0), r - most_step * Sd
        λ = np.maximum(λ - np.where(λ > 0.0, r, 0.0) / largest, 0.0)
        r = compliance(λ) + gap
        p = np.where(λ > 0.0, r, 0.0)
    raise SolverError(
        f"contact: forces not found, {np.linalg.norm(free + bound):.3g} m left after {most} "
        f"products; allowed {tolerance:.3g}"
    )
