"""Closed-form answers that demos, studies and tests share."""

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

    Parameters: ``height`` L (m), ``speed`` c (m/s), ``density`` (kg/m³), ``load`` f(t) pressure on the top
    (Pa; a function of an array of times), ``end`` the last time asked for (s), ``fixed`` base or else a
    dashpot with the material's impedance and a spring of stiffness ``spring`` k (Pa/m).
    The march resolves L/c by ``resolution`` intervals, second order.
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
        for first in range(n, len(times), n):  # by blocks of one travel time, each known from the last
            block = slice(first, min(first + n, len(times)))
            arriving = down[first - n : block.stop - n]
            if self.fixed:
                up[block] = -arriving
            elif k:
                for i, p in zip(range(block.start, block.stop), arriving, strict=True):
                    # trapezoidal rule for du_b/dt = p − k u_b
                    u_base = ((1 - k * step / 2) * u_base + step / 2 * (arrived + p)) / (1 + k * step / 2)
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
        return self._wave(self._down, t - depth / self.speed) + self._wave(self._up, t - below / self.speed)

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


@dataclass(frozen=True)
class Bar:
    """A bar that moves as told, and the body force that makes it do so (manufactured solution; ν = 0).

        x = X + u + V t,    u = A S(2πX/L) sin(πct/L),    b = ∂²u/∂t² − c² (dP/dF / E) ∂²u/∂X²

    with S the sine, so that ends at X = 0 and L rest, or, where ``free``, the cosine, so that they bear no stress.
    It starts undeformed.  Parameters: ``length`` L (m), ``young`` E (Pa), ``density`` ρ (kg/m³) at rest, c² = E/ρ,
    ``amplitude`` A (m), ``drift`` V (m/s), ``free``; ``hencky``: τ = E ln F for finite strain, else P = E (F − 1),
    what every law comes to at small A.
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
        return self.amplitude * ω**time * np.sin(ω * t + time * np.pi / 2) * k**place * np.sin(
            k * X + (place + self.free) * np.pi / 2)

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


def thick_cylinder(r: np.ndarray, inner: float, outer: float, pressure: float, young: float,
                   poisson: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radial and hoop stress (Pa) and radial displacement (m) at radius ``r`` (m) of a cylinder in plane strain under
    ``pressure`` (Pa) inside (Lamé 1852): σ_r,θ = A ∓ B/r², A = p r_i²/(r_o² − r_i²), B = A r_o².
    """
    A = pressure * inner**2 / (outer**2 - inner**2)
    B = A * outer**2 / r**2
    return A - B, A + B, (1 + poisson) / young * ((1 - 2 * poisson) * A + B) * r


def rayleigh_speed(poisson: float) -> float:
    """Speed of surface waves over that of shear waves: (2 − ξ)² = 4 √(1 − ξ) √(1 − κξ), ξ = c²/c_s², κ = c_s²/c_p²."""
    κ = (1 - 2 * poisson) / (2 - 2 * poisson)
    roots = np.roots([1.0, -8.0, 24 - 16 * κ, 16 * (κ - 1)])
    ξ = roots[(abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)].real
    return float(np.sqrt(ξ.min()))


def dashpot_echo(angle: float, poisson: float, wave: str) -> float:
    """Part of a plane wave's energy that viscous dashpots (Lysmer & Kuhlemeyer 1969) send back.

    ``angle`` (rad) from the normal; ``wave`` P or S, in the plane.  u = d f(t − s·x) puts the traction
    −(λ d·s n + μ (s·n d + d·n s)) f' on the boundary, where it should be −Z d f'; what comes back mends that.
    """
    fast, slow = np.sqrt((2 - 2 * poisson) / (1 - 2 * poisson)), 1.0  # of waves, ρ = μ = 1
    λ, Z = fast**2 - 2, np.diag([slow, fast])  # the boundary lies above: n = (0, 1)
    along = np.sin(angle) / (fast if wave == "P" else slow)

    def slowness(speed: float, way: int) -> np.ndarray:
        return np.array([along, way * np.sqrt(1 / speed**2 - along**2 + 0j)])

    def out_of_balance(s: np.ndarray, d: np.ndarray) -> np.ndarray:
        n = np.array([0.0, 1.0])
        return Z @ d - (λ * (d @ s) * n + s[1] * d + d[1] * s)

    s_in = slowness(fast if wave == "P" else slow, 1)
    p, s = slowness(fast, -1), slowness(slow, -1)
    p[1] = p[1].real - 1j * abs(p[1].imag)  # beyond the critical angle it dies away from the boundary
    d_p, d_s = fast * p, slow * np.array([-s[1], s[0]])
    d_in = fast * s_in if wave == "P" else slow * np.array([-s_in[1], s_in[0]])
    back = np.linalg.solve(np.stack((out_of_balance(p, d_p), out_of_balance(s, d_s)), axis=1),
                           -out_of_balance(s_in, d_in))
    flux = abs(back) ** 2 * -np.array([fast**2 * p[1].real, slow**2 * s[1].real])
    return float(flux.sum() / ((fast if wave == "P" else slow) ** 2 * s_in[1].real))


def relative_error(computed: np.ndarray, exact: np.ndarray) -> float:
    """L2 norm of the difference over the L2 norm of ``exact``, both sampled at the same even times."""
    return float(np.linalg.norm(np.asarray(computed) - exact) / np.linalg.norm(exact))
