"""Waves in a loaded column, by d'Alembert."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Column:
    """One-dimensional waves in a loaded column, by d'Alembert.

    The down-going particle velocity p leaves the top, the up-going one q leaves the base:

        p(t) = f(t)/Z + q(t − L/c),    fixed base: q(t) = −p(t − L/c)
        dashpot and spring: q = −k u_b/(2Z) with du_b/dt = p(t − L/c) + q    (k = 0: no echo)

    Parameters: ``height`` L (m), ``speed`` c (m/s), ``density`` (kg/m³), ``load`` f(t) pressure on
    the top (Pa; a function of an array of times), ``end`` the last time asked for (s), ``fixed``
    base or else a dashpot with the material's impedance and a spring of stiffness ``spring`` k
    (Pa/m). The march resolves L/c by ``resolution`` intervals, second order.
    """

    height: float
    speed: float
    density: float
    load: Callable[[np.ndarray], np.ndarray]
    end: float
    fixed: bool = True
    spring: float = 0.0
    resolution: int = 4000

    def __post_init__(self) -> None:
        Z, n = self.density * self.speed, self.resolution
        step = self.height / self.speed / n
        times = step * np.arange(int(np.ceil(self.end / step)) + n + 2)
        down = np.asarray(self.load(times), float) / Z
        up = np.zeros_like(times)
        k = self.spring / (2 * Z)
        u_base = arrived = 0.0
        for first in range(
            n, len(times), n
        ):  # by blocks of one travel time, each known from the last
            block = slice(first, min(first + n, len(times)))
            arriving = down[first - n : block.stop - n]
            if self.fixed:
                up[block] = -arriving
            elif k:
                for i, p in zip(range(block.start, block.stop), arriving, strict=True):
                    # trapezoidal rule for du_b/dt = p − k u_b
                    u_base = ((1 - k * step / 2) * u_base + step / 2 * (arrived + p)) / (
                        1 + k * step / 2
                    )
                    arrived = p
                    up[i] = -k * u_base
            echo = down[block.start + n : block.stop + n]
            echo += up[block][: len(echo)]
        object.__setattr__(self, "_times", times)
        object.__setattr__(self, "_down", down)
        object.__setattr__(self, "_up", up)

    def _wave(self, wave: np.ndarray, t: np.ndarray) -> np.ndarray:
        return np.interp(t, self._times, wave, left=0.0)

    def velocity(self, depth: float, t: np.ndarray) -> np.ndarray:
        """Downward particle velocity (m/s) at ``depth`` below the top (m), times ``t`` (s)."""
        below = self.height - depth
        return self._wave(self._down, t - depth / self.speed) + self._wave(
            self._up, t - below / self.speed
        )

    def pressure(self, depth: float, t: np.ndarray) -> np.ndarray:
        """Vertical pressure (Pa, compression positive) at ``depth`` (m), times ``t`` (s)."""
        below = self.height - depth
        difference = self._wave(self._down, t - depth / self.speed) - self._wave(
            self._up, t - below / self.speed
        )
        return self.density * self.speed * difference

    def displacement(self, depth: float, t: np.ndarray) -> np.ndarray:
        """Downward displacement (m) at ``depth`` (m), times ``t`` (s)."""
        v = self.velocity(depth, self._times)
        steps = np.diff(self._times) * (v[1:] + v[:-1]) / 2
        return np.interp(t, self._times, np.concatenate(([0.0], np.cumsum(steps))))
