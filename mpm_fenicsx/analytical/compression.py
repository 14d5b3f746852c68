"""Mohr-Coulomb soil that is shortened while the stress at its sides is held: pressure positive."""

from __future__ import annotations

import math


def passive_coefficient(friction_angle: float) -> float:
    """K_p = (1 + sin φ)/(1 - sin φ) of φ (degrees)."""
    sine = math.sin(math.radians(friction_angle))
    return (1.0 + sine) / (1.0 - sine)


def unconfined_strength(cohesion: float, friction_angle: float) -> float:
    """Y = 2 c √K_p (Pa), the pressure at which soil fails that nothing holds sideways."""
    return 2.0 * cohesion * math.sqrt(passive_coefficient(friction_angle))


def deviatoric_strength(pressure: float, cohesion: float, friction_angle: float) -> float:
    """q = σ_1 - σ_3 (Pa) at failure under the pressure σ_3 (Pa) at the sides, in triaxial
    compression and in plane strain: p (K_p - 1) + Y."""
    K = passive_coefficient(friction_angle)
    return pressure * (K - 1.0) + unconfined_strength(cohesion, friction_angle)


def pressure_out_of_plane(pressure: float, q: float, poisson: float) -> float:
    """σ_2 (Pa) in plane strain, where it stays elastic: p + ν q, of isotropic pressure p at the
    start."""
    return pressure + poisson * q


def dilation_rate(dilation_angle: float) -> float:
    """dε_v/dε_1 of flow, -2 sin ψ/(1 - sin ψ); shortening and loss of volume positive."""
    sine = math.sin(math.radians(dilation_angle))
    return -2.0 * sine / (1.0 - sine)
