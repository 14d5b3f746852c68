"""A long cylindrical cavity in unbounded Mohr-Coulomb soil, whose pressure rises or falls; pressure
and outward motion are positive, strains small.

Around the cavity, r < R, soil flows.  There σ_θ = k σ_r + y and dεᵖ_r + β dεᵖ_θ = 0, with K_p, Y
and K_ψ of ``compression``,

    expansion    k = 1/K_p,  y = -Y/K_p,  β = 1/K_ψ        (σ_r the largest pressure)
    contraction  k = K_p,    y = Y,       β = K_ψ          (σ_θ the largest pressure)

Equilibrium, dσ_r/dr = ((k - 1) σ_r + y)/r, gives σ_r = A r^{k-1} - y/(k - 1), and outside
σ_r + σ_θ = 2 p_0 at the pressure p_y = (2 p_0 - y)/(1 + k) of first yield, whence R.  With h =
εᵉ_r + β εᵉ_θ of the elastic strains since the start, plane strain,

    u' + β u/r = -h,   u(R) = (p_y - p_0) R/2G,

which is solved in closed form.  The axial stress stays between the other two, or else the answer
is refused.  After Yu, Cavity Expansion Methods in Geomechanics (2000), chapter 4, at small strain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .compression import passive_coefficient, unconfined_strength


@dataclass(frozen=True)
class CylindricalCavity:
    """A cavity of ``radius`` (m) at whose wall the pressure p_0 has become ``pressure`` (Pa).

    ``at_rest`` p_0 (Pa), the isotropic pressure of the start; ``cohesion`` (Pa), ``friction_angle``
    and ``dilation_angle`` (degrees); ``young`` (Pa), ``poisson``.
    Raises ``ValueError`` for soil that the pressure at rest makes flow already, for a cavity that
    collapses, and where the axial stress becomes the largest or the smallest.
    """

    at_rest: float
    pressure: float
    cohesion: float
    friction_angle: float
    dilation_angle: float
    young: float
    poisson: float
    radius: float = 1.0

    def __post_init__(self) -> None:
        K = passive_coefficient(self.friction_angle)
        Y = unconfined_strength(self.cohesion, self.friction_angle)
        if not (K - 1.0) * self.at_rest + Y > 0.0:
            raise ValueError(f"at_rest must be a pressure that this soil bears, got {self.at_rest}")
        if not (K - 1.0) * self.pressure + Y > 0.0:
            raise ValueError(f"pressure must hold the cavity open, got {self.pressure}")
        if self.plastic_radius > self.radius:
            for r in (self.radius, self.plastic_radius):
                radial, hoop, axial = self.stress(r)
                slack = 1e-9 * (abs(radial) + abs(hoop))
                if not min(radial, hoop) - slack <= axial <= max(radial, hoop) + slack:
                    raise ValueError(
                        f"pressure = {self.pressure} makes the axial stress {axial} leave the "
                        f"range between {radial} and {hoop} Pa, where this answer ends"
                    )

    @property
    def _sign(self) -> float:
        return 1.0 if self.pressure > self.at_rest else -1.0

    @property
    def _k(self) -> float:
        return passive_coefficient(self.friction_angle) ** -self._sign

    @property
    def _y(self) -> float:
        Y = unconfined_strength(self.cohesion, self.friction_angle)
        return -Y * self._k if self._sign > 0.0 else Y

    @property
    def _shear_modulus(self) -> float:
        return 0.5 * self.young / (1.0 + self.poisson)

    @property
    def yield_pressure(self) -> float:
        """p_y (Pa) at which the wall first yields."""
        return (2.0 * self.at_rest - self._y) / (1.0 + self._k)

    @property
    def plastic_radius(self) -> float:
        """R (m); the cavity's own where nothing flows."""
        p, p_y, k, y = self.pressure, self.yield_pressure, self._k, self._y
        if self._sign * (p - p_y) <= 0.0:
            return self.radius
        if k == 1.0:
            return self.radius * math.exp((p_y - p) / y)
        ratio = ((k - 1.0) * p_y + y) / ((k - 1.0) * p + y)
        return self.radius * ratio ** (1.0 / (k - 1.0))

    def stress(self, r):
        """Pressures σ_r, σ_θ and σ_z (Pa) at r (m), numbers or arrays."""
        r, R, p_0 = np.asarray(r, float), self.plastic_radius, self.at_rest
        k, y, p = self._k, self._y, self.pressure
        edge = self.yield_pressure if R > self.radius else p
        outer = (edge - p_0) * (R / np.maximum(r, R)) ** 2
        x = np.minimum(r, R) / self.radius
        if k == 1.0:
            inner = p + y * np.log(x)
        else:
            inner = (p + y / (k - 1.0)) * x ** (k - 1.0) - y / (k - 1.0)
        flows = r < R
        radial = np.where(flows, inner, p_0 + outer)
        hoop = np.where(flows, k * inner + y, p_0 - outer)
        axial = p_0 + self.poisson * (radial + hoop - 2.0 * p_0)
        return radial, hoop, axial

    def displacement(self, r):
        """Outward displacement u (m) at r (m), a number or an array."""
        r, R = np.asarray(r, float), self.plastic_radius
        edge = self.yield_pressure if R > self.radius else self.pressure
        at_edge = 0.5 * (edge - self.at_rest) * R / self._shear_modulus
        outer = at_edge * R / np.maximum(r, R)
        if R == self.radius:
            return outer
        β = passive_coefficient(self.dilation_angle) ** -self._sign
        x = np.minimum(r, R)
        inner = self._particular(x, β) + (at_edge - self._particular(R, β)) * (R / x) ** β
        return np.where(r < R, inner, outer)

    def _particular(self, r, β: float):
        """A solution of u' + β u/r = -h."""
        ν, k, y = self.poisson, self._k, self._y
        radial, hoop = (1.0 - ν) - β * ν, β * (1.0 - ν) - ν  # of h in Δσ_r and Δσ_θ, times 1/2G
        x = r / self.radius
        if k == 1.0:
            # Δσ_r = a + y ln x, Δσ_θ = a + y + y ln x
            a = self.pressure - self.at_rest
            constant, slope = (radial + hoop) * a + hoop * y, (radial + hoop) * y
            found = constant / (1.0 + β) + slope * (np.log(x) / (1.0 + β) - (1.0 + β) ** -2)
        else:
            # Δσ_r = A x^{k-1} - b, Δσ_θ = k A x^{k-1} - b
            A, b = self.pressure + y / (k - 1.0), self.at_rest + y / (k - 1.0)
            found = A * (radial + k * hoop) * x ** (k - 1.0) / (k + β)
            found = found - b * (radial + hoop) / (1.0 + β)
        return -0.5 * r * found / self._shear_modulus
