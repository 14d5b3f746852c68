"""A vibration that is damped, in time and in the steps of the trapezoidal rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DampedVibration:
    """q̈ + 2 ξ ω q̇ + ω² q = 0 from rest with a velocity: one mode of a damped body.

    ``angular_frequency`` ω (rad/s) without damping; ``ratio`` ξ (-) of critical damping, below 1;
    ``velocity`` (m/s) at the start, where q = 0.
    """

    angular_frequency: float
    ratio: float
    velocity: float = 1.0

    @property
    def _exponent(self) -> complex:
        ω, ξ = self.angular_frequency, self.ratio
        return ω * complex(-ξ, np.sqrt(1.0 - ξ * ξ))

    def state(self, time) -> tuple[np.ndarray, np.ndarray]:
        """q (m) and q̇ (m/s) at times (n,), s: q = v₀ e^(-ξωt) sin(ω' t)/ω', ω' = ω √(1 - ξ²)."""
        return self._of(np.exp(self._exponent * np.asarray(time, float)))

    def stepped(self, dt: float, steps) -> tuple[np.ndarray, np.ndarray]:
        """q (m) and q̇ (m/s) after so many steps (n,) of the trapezoidal rule: e^(λ dt) is then
        (1 + λ dt/2)/(1 - λ dt/2), λ the exponent of the vibration."""
        half = 0.5 * self._exponent * dt
        return self._of(((1.0 + half) / (1.0 - half)) ** np.asarray(steps))

    def _of(self, power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q = Im(power) v₀/Im λ, and its rate, λ the exponent."""
        λ = self._exponent
        return tuple(self.velocity / λ.imag * (factor * power).imag for factor in (1.0, λ))

    def energy(self, time) -> np.ndarray:
        """Kinetic and elastic energy over that at the start (n,), -."""
        return self._left(*self.state(time))

    def energy_stepped(self, dt: float, steps) -> np.ndarray:
        """The same after steps of the trapezoidal rule."""
        return self._left(*self.stepped(dt, steps))

    def _left(self, q: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return (rate**2 + (self.angular_frequency * q) ** 2) / self.velocity**2


def bar_frequency(mode: int, length: float, speed: float, cell: float = 0.0) -> float:
    """Angular frequency (rad/s) of a vibration of a bar with both ends held, sin(kx), k = mode π
    over ``length`` (m), waves of ``speed`` (m/s); in linear elements of a consistent mass where
    these have a size ``cell`` (m): ω² = 6 (c/h)² (1 - cos kh)/(2 + cos kh)."""
    k = mode * np.pi / length
    if not cell:
        return float(k * speed)
    cosine = np.cos(k * cell)
    return float(speed / cell * np.sqrt(6.0 * (1.0 - cosine) / (2.0 + cosine)))
