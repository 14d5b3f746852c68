"""Time stepping as plain arithmetic: the increment u of a step gives velocity and acceleration at its end.

    velocity = c₀ u + c₁ v + c₂ a,    acceleration = d₀ u + d₁ v + d₂ a

with v, a at the start of the step.  The factors serve NumPy arrays and, as constants, UFL expressions.  ``balanced``
are those of the velocity and acceleration that the balance of forces is written with, and ``start`` is what forces at
the start of the step weigh in it, those at its end weighing 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

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
    start = 0.0

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

    @property
    def balanced(self) -> tuple[Factors, Factors]:
        """Factors of u, v, a in the velocity and the acceleration of the balance: those at the end of the step."""
        return self.velocity, self.acceleration


@dataclass(frozen=True)
class GeneralizedAlpha(Newmark):
    """Newmark's step with forces balanced inside it, which damps high frequencies (Chung & Hulbert, J. Appl. Mech. 60,
    371-375, 1993).

        M [(1 - α_m) a₁ + α_m a₀] + (1 - α_f) F(u₁, v₁) + α_f F(u₀, v₀) = (1 - α_f) P(t₁) + α_f P(t₀)
        α_m = (2ρ - 1)/(ρ + 1),  α_f = ρ/(ρ + 1),  γ = ½ - α_m + α_f,  β = ¼ (1 - α_m + α_f)²

    ``spectral_radius`` ρ of a step, 0 to 1, is what is left of a vibration much faster than ``dt`` (s) after it; slow
    ones are damped the least that second order allows.  ρ = 1 is the trapezoidal rule, where forces balance at the
    start.  Divided by 1 - α_f = 1/(1 + ρ) the balance reads

        M [(2 - ρ) a₁ + (2ρ - 1) a₀] + F(u₁, v₁) + ρ F(u₀, v₀) = P(t₁) + ρ P(t₀)

    so that what u adds to forces keeps its factor 1, in every law.  A start out of balance (points at rest, without
    their acceleration, under a load that is there at t = 0) leaves a trace (1 - 2ρ)ⁿ/(2 - ρ)ⁿ in the acceleration.
    Raises ``ValueError`` for dt <= 0 or ρ outside [0, 1].
    """

    beta: float = field(init=False, repr=False)
    gamma: float = field(init=False, repr=False)
    spectral_radius: float = 0.8

    def __post_init__(self) -> None:
        ρ = finite("spectral_radius", self.spectral_radius)
        if not 0.0 <= ρ <= 1.0:
            raise ValueError(f"spectral_radius must lie in [0, 1], got {ρ}")
        shift = (1 - ρ) / (1 + ρ)  # α_f - α_m
        for name, value in (("spectral_radius", ρ), ("beta", 0.25 * (1 + shift) ** 2), ("gamma", 0.5 + shift)):
            object.__setattr__(self, name, value)
        super().__post_init__()

    @property
    def start(self) -> float:
        """Weight of the start's forces, ρ."""
        return self.spectral_radius

    @property
    def balanced(self) -> tuple[Factors, Factors]:
        """Factors of u, v, a in v₁ + ρ v and (2 - ρ) a₁ + (2ρ - 1) a."""
        ρ, (c0, c1, c2) = self.spectral_radius, self.velocity
        d0, d1, d2 = ((2 - ρ) * d for d in self.acceleration)
        return (c0, c1 + ρ, c2), (d0, d1, d2 + 2 * ρ - 1)


@dataclass(frozen=True)
class QuasiStatic:
    """Equilibrium without inertia: time runs from 0 to 1 in ``steps`` equal steps, loads are functions of it.

    Raises ``ValueError`` for fewer than one step.
    """

    steps: int

    dynamic = False
    start = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "steps", whole("steps", self.steps))

    def part(self, share: float) -> QuasiStatic:
        """The same: nothing in it depends on the length of a step."""
        return self

    @property
    def dt(self) -> float:
        """Step of the load parameter (-)."""
        return 1.0 / self.steps
