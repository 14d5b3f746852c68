"""Closed-form answers that demos, studies and tests share."""

from __future__ import annotations

import numpy as np


def thick_cylinder(
    r: np.ndarray, inner: float, outer: float, pressure: float, young: float, poisson: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radial and hoop stress (Pa) and radial displacement (m) at radius ``r`` (m) of a cylinder in
    plane strain under ``pressure`` (Pa) inside (Lamé 1852): σ_r,θ = A ∓ B/r², A = p r_i²/(r_o² −
    r_i²), B = A r_o².
    """
    A = pressure * inner**2 / (outer**2 - inner**2)
    B = A * outer**2 / r**2
    return A - B, A + B, (1 + poisson) / young * ((1 - 2 * poisson) * A + B) * r


def rayleigh_speed(poisson: float) -> float:
    """Speed of surface waves over that of shear waves: (2 − ξ)² = 4 √(1 − ξ) √(1 − κξ), ξ =
    c²/c_s², κ = c_s²/c_p²."""
    κ = (1 - 2 * poisson) / (2 - 2 * poisson)
    roots = np.roots([1.0, -8.0, 24 - 16 * κ, 16 * (κ - 1)])
    ξ = roots[(abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)].real
    return float(np.sqrt(ξ.min()))


def dashpot_echo(angle: float, poisson: float, wave: str) -> float:
    """Part of a plane wave's energy that viscous dashpots (Lysmer & Kuhlemeyer 1969) send back.

    ``angle`` (rad) from the normal; ``wave`` P or S, in the plane.  u = d f(t − s·x) puts the
    traction −(λ d·s n + μ (s·n d + d·n s)) f' on the boundary, where it should be −Z d f'; what
    comes back mends that.
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
    p[1] = p[1].real - 1j * abs(
        p[1].imag
    )  # beyond the critical angle it dies away from the boundary
    d_p, d_s = fast * p, slow * np.array([-s[1], s[0]])
    d_in = fast * s_in if wave == "P" else slow * np.array([-s_in[1], s_in[0]])
    back = np.linalg.solve(
        np.stack((out_of_balance(p, d_p), out_of_balance(s, d_s)), axis=1),
        -out_of_balance(s_in, d_in),
    )
    flux = abs(back) ** 2 * -np.array([fast**2 * p[1].real, slow**2 * s[1].real])
    return float(flux.sum() / ((fast if wave == "P" else slow) ** 2 * s_in[1].real))


def relative_error(computed: np.ndarray, exact: np.ndarray) -> float:
    """L2 norm of the difference over the L2 norm of ``exact``, both sampled at the same even
    times."""
    return float(np.linalg.norm(np.asarray(computed) - exact) / np.linalg.norm(exact))
