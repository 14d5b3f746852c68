"""Motion that is prescribed to nodes: displacement with its velocity and acceleration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .time_stepping import Newmark, QuasiStatic

Step = tuple[float, tuple[float, float], tuple[float, float]]
"""What a step is told: the increment (m), and velocity (m/s) and acceleration (m/s²) before and
after it."""


class Prescribed:
    """A motion that is given."""

    description = ""

    def step(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> Step:
        """Increment, and velocity and acceleration before and after it."""
        raise NotImplementedError

    def carry(self) -> None:
        """The step is made."""

    def state(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        return {}


class Displacement(Prescribed):
    """A displacement u(t) alone; where there is inertia, velocity and acceleration follow by
    differences over the step,

        v(t) = (u(t + Δt) - u(t - Δt)) / 2Δt,    a(t) = (u(t + Δt) - 2 u(t) + u(t - Δt)) / Δt²,

    of second order, and one-sided of the same order in the first step, for no motion is known
    before t = 0.
    """

    description = "velocity and acceleration by differences of the displacement"

    def __init__(self, displacement: Callable[[float], float]):
        self._u = displacement

    def step(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> Step:
        """Increment, and velocity and acceleration before and after it."""
        increment = self._u(end) - self._u(start)
        if not stepping.dynamic:
            return increment, (0.0, 0.0), (0.0, 0.0)
        return increment, self._rates(start, stepping.dt), self._rates(end, stepping.dt)

    def _rates(self, t: float, dt: float) -> tuple[float, float]:
        u = self._u
        if t - dt < 0.0:
            u0, u1, u2, u3 = (u(t + k * dt) for k in range(4))
            return (-3.0 * u0 + 4.0 * u1 - u2) / (2.0 * dt), (
                2.0 * u0 - 5.0 * u1 + 4.0 * u2 - u3
            ) / dt**2
        before, now, after = u(t - dt), u(t), u(t + dt)
        return (after - before) / (2.0 * dt), (after - 2.0 * now + before) / dt**2


class WholeMotion(Prescribed):
    """Displacement, velocity and acceleration as given."""

    description = "displacement, velocity and acceleration as given"

    def __init__(self, displacement: Callable, velocity: Callable, acceleration: Callable):
        self._u, self._v, self._a = displacement, velocity, acceleration

    def step(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> Step:
        """Increment, and velocity and acceleration before and after it."""
        return (
            self._u(end) - self._u(start),
            (self._v(start), self._a(start)),
            (self._v(end), self._a(end)),
        )


class AccelerationRecord(Prescribed):
    """An acceleration a(t), integrated by the trapezoidal rule, Newmark's, from rest:

        Δu = Δt v + ¼ Δt² (a + a₁),    v₁ = v + ½ Δt (a + a₁).

    It is that of every stepping: with the γ > ½ of generalised α a record would gain (γ - ½) Δt
    (a(t) - a(0)) in velocity. ``velocity`` (1,), m/s, is that reached; a restart needs it.
    """

    description = "acceleration as given, integrated by the trapezoidal rule"

    def __init__(self, acceleration: Callable[[float], float]):
        self._a = acceleration
        self.velocity = np.zeros(1)

    def step(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> Step:
        """Increment, and velocity and acceleration before and after it."""
        v, a, a_end, dt = float(self.velocity[0]), self._a(start), self._a(end), end - start
        self._end = v + 0.5 * dt * (a + a_end)
        return dt * v + 0.25 * dt**2 * (a + a_end), (v, a), (self._end, a_end)

    def carry(self) -> None:
        """The step is made."""
        self.velocity[0] = self._end

    def state(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        return {"velocity": self.velocity}
