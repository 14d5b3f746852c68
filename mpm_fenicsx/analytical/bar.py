"""A bar that moves as told: a manufactured solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Bar:
    """A bar that moves as told, and the body force that makes it do so (manufactured solution; ν =
    0).

        x = X + u + V t,    u = A S(2πX/L) sin(πct/L),    b = ∂²u/∂t² − c² (dP/dF / E) ∂²u/∂X²

    with S the sine, so that ends at X = 0 and L rest, or, where ``free``, the cosine, so that they
    bear no stress. It starts undeformed.  Parameters: ``length`` L (m), ``young`` E (Pa),
    ``density`` ρ (kg/m³) at rest, c² = E/ρ, ``amplitude`` A (m), ``drift`` V (m/s), ``free``;
    ``hencky``: τ = E ln F for finite strain, else P = E (F − 1), what every law comes to at small
    A.
    """

    length: float
    young: float
    density: float
    amplitude: float
    drift: float = 0.0
    free: bool = False
    hencky: bool = False

    @property
    def speed(self) -> float:
        """Wave speed c (m/s)."""
        return (self.young / self.density) ** 0.5

    @property
    def period(self) -> float:
        """Period of the motion 2L/c (s)."""
        return 2 * self.length / self.speed

    def _wave(self, X: np.ndarray, t: float, time: int, place: int) -> np.ndarray:
        """Derivative of u, so many times in time and in place: each is a quarter of a period on."""
        ω, k = np.pi * self.speed / self.length, 2 * np.pi / self.length
        return (
            self.amplitude
            * ω**time
            * np.sin(ω * t + time * np.pi / 2)
            * k**place
            * np.sin(k * X + (place + self.free) * np.pi / 2)
        )

    def displacement(self, X: np.ndarray, t: float) -> np.ndarray:
        """u (m), the drift left out."""
        return self._wave(X, t, 0, 0)

    def velocity(self, X: np.ndarray, t: float) -> np.ndarray:
        """∂u/∂t (m/s), the drift left out."""
        return self._wave(X, t, 1, 0)

    def stretch(self, X: np.ndarray, t: float) -> np.ndarray:
        """F (-)."""
        return 1.0 + self._wave(X, t, 0, 1)

    def stress(self, X: np.ndarray, t: float) -> np.ndarray:
        """Cauchy's stress along the bar (Pa)."""
        F = self.stretch(X, t)
        return self.young * (np.log(F) / F if self.hencky else self._wave(X, t, 0, 1))

    def body_force(self, X: np.ndarray, t: float) -> np.ndarray:
        """b (m/s²), force per mass."""
        F = self.stretch(X, t)
        slope = (1.0 - np.log(F)) / F**2 if self.hencky else 1.0
        return self._wave(X, t, 2, 0) - self.speed**2 * slope * self._wave(X, t, 0, 2)

    def particle(self, x: np.ndarray, t: float) -> np.ndarray:
        """X of what is at x at time t, by Newton's method; beyond the ends the motion goes on."""
        X = at_rest = np.asarray(x, float) - self.drift * t
        for _ in range(50):
            change = (at_rest - X - self.displacement(X, t)) / self.stretch(X, t)
            X = X + change
            if np.abs(change).max(initial=0.0) <= 1e-14 * self.length:
                break
        return X
