"""Newton's iteration, and when to stop it."""

from __future__ import annotations

from dataclasses import dataclass

from ..common.checks import positive, whole
from ..common.errors import SolverError

ROUND_OFF = 1e-14
"""Of the residual before the first solve, some fifty times what the sums of a node leave.  It holds
the rigid motion, and with 1e-12 of it a body on the move stopped earlier than the same body at
rest."""


@dataclass(frozen=True)
class Newton:
    """Newton's method with a line search on the norm of the residual.

    ``tolerance``: largest residual (-), relative to internal and external forces without inertia,
    or None for one solve a step whatever is left (linearly implicit); ``iterations``: solves a
    step; ``halvings`` of an increment that does not reduce the residual; ``cuts``: how often a step
    that fails is halved before it is given up.
    """

    tolerance: float | None = 1e-6
    iterations: int = 20
    halvings: int = 6
    cuts: int = 3

    def __post_init__(self) -> None:
        if self.tolerance is not None:
            object.__setattr__(self, "tolerance", positive("tolerance", self.tolerance))
            if self.tolerance >= 1.0:
                raise ValueError(
                    f"tolerance must be below 1, for it is relative to the forces, got "
                    f"{self.tolerance}"
                )
        object.__setattr__(self, "iterations", whole("iterations", self.iterations))
        for name in ("halvings", "cuts"):
            object.__setattr__(self, name, whole(name, getattr(self, name), least=0))

    def iterate(self, equilibrium, internal, first: float = 0.0) -> None:
        """Go on from the first solve, of the residual ``first`` (N), which in free flight is all
        inertia and whose round-off is let be.
        Raises ``SolverError`` with the residuals if it does not converge."""
        u, increment, law = equilibrium.motion.u.x, equilibrium.increment.x, equilibrium.yielding
        if self.tolerance is None or not law.evaluate():
            return  # the step was linear, and is solved
        allowed = max(self.tolerance * equilibrium.scale(internal), ROUND_OFF * first)
        norms = [equilibrium.refresh(internal)]
        while not norms[-1] <= allowed:  # nor if it is not a number
            if len(norms) >= self.iterations:
                found = ", ".join(f"{norm / allowed * self.tolerance:.1e}" for norm in norms)
                raise SolverError(
                    f"Newton does not converge, relative residuals {found}; allowed "
                    f"{self.tolerance:.1e}; {equilibrium.largest()}"
                )
            equilibrium.bend()
            equilibrium.correct()
            law.evaluate()
            norm, share = equilibrium.refresh(internal), 1.0
            while not norm <= (1.0 - 1e-4 * share) * norms[-1] and share > 0.5**self.halvings:
                share *= 0.5
                u.array[:] -= share * increment.array
                law.evaluate()
                norm = equilibrium.refresh(internal)
            norms.append(norm)
