"""Time stepping as plain arithmetic: the increment u of a step gives velocity and acceleration at
its end.

    velocity = c₀ u + c₁ v + c₂ a,    acceleration = d₀ u + d₁ v + d₂ a

with v, a at the start of the step.  The factors serve NumPy arrays and, as constants, UFL
expressions.  ``balanced`` are those of the velocity and acceleration that the balance of forces is
written with, and ``start`` is what forces at the start of the step weigh in it, those at its end
weighing 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ..common.checks import finite, positive, whole

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
            raise ValueError(
                "Newmark is unconditionally stable for 2 beta >= gamma >= 1/2 only, got "
                f"beta={self.beta}, gamma={self.gamma}"
            )

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
        """Factors of u, v, a in the velocity and the acceleration of the balance: those at the end
        of the step."""
        return self.velocity, self.acceleration

    @property
    def inertia(self) -> float:
        """What the acceleration at the end of the step weighs in the balance, its forces weighing
        1."""
        return self.balanced[1][0] / self.acceleration[0]


@dataclass(frozen=True)
class GeneralizedAlpha(Newmark):
    """Newmark's step with forces balanced inside it, which damps what is fast (Chung & Hulbert, J.
    Appl. Mech. 60, 371-375, 1993).

        M [(1 - α_m) a₁ + α_m a₀] + (1 - α_f) F(u₁, v₁) + α_f F(u₀, v₀) = (1 - α_f) P(t₁) + α_f
        P(t₀) γ = ½ + s,  β = ¼ (1 + s)²,  s = α_f - α_m = (1 - ρ)/(1 + ρ),  w = α_f/(1 - α_f)

    of second order.  ``spectral_radius`` ρ, 0 to 1: what is left of a vibration much faster than
    ``dt`` (s) after a step; 1 keeps all.  ``start`` w, 0 to ρ: weight of the forces at the start of
    the step, those at its end weighing 1. With 0 (Wood, Bossak & Zienkiewicz, Int. J. Numer.
    Methods Eng. 15, 1562-1566, 1980) only inertia changes, and ρ = 1 is Newmark's trapezoidal rule
    whatever the start: the choice for material points, whose forces are not quite in balance at the
    start of a step.  ρ (Chung & Hulbert) damps slow vibrations the least: the choice for finite
    elements that start with the acceleration of their loads.  Divided by 1 - α_f the balance reads

        M [(1 + s + w s) a₁ + (w - s - w s) a₀] + F(u₁, v₁) + w F(u₀, v₀) = P(t₁) + w P(t₀)

    so that what u adds to forces keeps its factor 1, in every law.
    Raises ``ValueError`` for dt <= 0, ρ outside [0, 1] or w outside [0, ρ].
    """

    beta: float = field(init=False, repr=False)
    gamma: float = field(init=False, repr=False)
    spectral_radius: float = 0.8
    start: float = 0.0

    def __post_init__(self) -> None:
        ρ, w = finite("spectral_radius", self.spectral_radius), finite("start", self.start)
        if not 0.0 <= ρ <= 1.0:
            raise ValueError(f"spectral_radius must lie in [0, 1], got {ρ}")
        if not 0.0 <= w <= ρ:
            raise ValueError(f"start must lie in [0, {ρ}], 0 to spectral_radius, got {w}")
        s = self._shift
        for name, value in (
            ("spectral_radius", ρ),
            ("start", w),
            ("beta", 0.25 * (1 + s) ** 2),
            ("gamma", 0.5 + s),
        ):
            object.__setattr__(self, name, value)
        super().__post_init__()

    @property
    def _shift(self) -> float:
        return (1 - self.spectral_radius) / (1 + self.spectral_radius)

    @property
    def balanced(self) -> tuple[Factors, Factors]:
        """Factors of u, v, a in v₁ + w v and in (1 + s + w s) a₁ + (w - s - w s) a."""
        w, s, (c0, c1, c2) = self.start, self._shift, self.velocity
        d0, d1, d2 = ((1 + s + w * s) * d for d in self.acceleration)
        return (c0, c1 + w, c2), (d0, d1, d2 + w - s - w * s)


@dataclass(frozen=True)
class QuasiStatic:
    """Equilibrium without inertia: time runs from 0 to 1 in ``steps`` equal steps, loads are
    functions of it.

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
