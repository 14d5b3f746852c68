"""Time stepping as plain arithmetic: the increment u of a step gives velocity and acceleration at its end.

    velocity = c₀ u + c₁ v + c₂ a,    acceleration = d₀ u + d₁ v + d₂ a

with v, a at the start of the step.  The factors serve NumPy arrays and, as constants, UFL expressions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from .checks import finite, positive, whole

Factors = tuple[float, float, float]


@dataclass(frozen=True)
class Newmark:
    """Newmark's implicit step (Do et al. 2023, eqs. 4-6); by default the trapezoidal rule.

    Parameters: ``dt`` (s); ``beta`` and ``gamma`` (-).
    Raises ``ValueError`` for dt <= 0, or for parameters that are not unconditionally stable.
    """

    dt: float
    beta: float = 0.25
    gamma: float = 0.5

    dynamic = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "dt", positive("dt", self.dt))
        object.__setattr__(self, "beta", positive("beta", self.beta))
        object.__setattr__(self, "gamma", finite("gamma", self.gamma))
        if self.gamma < 0.5 or 2 * self.beta < self.gamma:
            raise ValueError(f"Newmark is unconditionally stable for 2 beta >= gamma >= 1/2 only, "
                             f"got beta={self.beta}, gamma={self.gamma}")

    def part(self, share: float) -> Newmark:
        """The same rule with a part of the step."""
        return replace(self, dt=share * self.dt)

    @property
    def velocity(self) -> Factors:
        """Factors of u, v, a in the velocity at the end of the step."""
        β, γ, dt = self.beta, self.gamma, self.dt
        return γ / (β * dt), 1 - γ / β, dt * (1 - γ / (2 * β))

    @property
    def acceleration(self) -> Factors:
        """Factors of u, v, a in the acceleration at the end of the step."""
        β, dt = self.beta, self.dt
        return 1 / (β * dt**2), -1 / (β * dt), 1 - 1 / (2 * β)


@dataclass(frozen=True)
class QuasiStatic:
    """Equilibrium without inertia: time runs from 0 to 1 in ``steps`` equal steps, loads are functions of it.

    Raises ``ValueError`` for fewer than one step.
    """

    steps: int

    dynamic = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "steps", whole("steps", self.steps))

    def part(self, share: float) -> QuasiStatic:
        """The same: nothing in it depends on the length of a step."""
        return self

    @property
    def dt(self) -> float:
        """Step of the load parameter (-)."""
        return 1.0 / self.steps
