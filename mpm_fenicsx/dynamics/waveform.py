"""The motion of a wave, as functions of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..common.checks import finite, positive


@dataclass(frozen=True)
class Waveform:
    """Displacement (m), velocity (m/s) and acceleration (m/s²), functions of an array of times (s).

    The motion of an ``IncidentWave``, which takes all three, or of
    ``analytical.plane_waves.PlaneWaves``, of which what is None cannot be asked for.
    """

    displacement: Callable[[np.ndarray], np.ndarray] | None = None
    velocity: Callable[[np.ndarray], np.ndarray] | None = None
    acceleration: Callable[[np.ndarray], np.ndarray] | None = None

    @classmethod
    def ricker(cls, frequency: float, peak: float = 1.0, middle: float | None = None) -> Waveform:
        """Ricker's pulse of velocity, which ends where it began.

        ``frequency`` (Hz): at which its spectrum is largest; ``peak`` (m/s), the largest velocity;
        ``middle`` (s), when that is there: after one and a half periods by default, before which
        the displacement was 1e-8 of its largest.
        Raises ``ValueError`` for a frequency <= 0, or a peak or a middle that is not finite.
        """
        rate, peak = (np.pi * positive("frequency", frequency)) ** 2, finite("peak", peak)
        middle = 1.5 / frequency if middle is None else finite("middle", middle)

        def bell(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            s = np.asarray(t, float) - middle
            return s, peak * np.exp(-rate * s**2)

        def displacement(t: np.ndarray) -> np.ndarray:
            s, b = bell(t)
            return s * b

        def velocity(t: np.ndarray) -> np.ndarray:
            s, b = bell(t)
            return (1.0 - 2.0 * rate * s**2) * b

        def acceleration(t: np.ndarray) -> np.ndarray:
            s, b = bell(t)
            return (-6.0 * rate * s + 4.0 * rate**2 * s**3) * b

        return cls(displacement, velocity, acceleration)
