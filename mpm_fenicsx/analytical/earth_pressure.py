"""Rankine's earth pressure on a smooth vertical wall, under level ground (Rankine, Phil. Trans. R.
Soc. 147, 1857; cohesion after Bell, 1915)."""

from __future__ import annotations

import math

from .compression import passive_coefficient


def active_pressure(depth, weight: float, cohesion: float, friction_angle: float):
    """Pressure (Pa) at ``depth`` (m) where the wall gives way: K_a γ z - 2 c √K_a, of the weight γ
    (N/m³); K_a = 1/K_p."""
    K = 1.0 / passive_coefficient(friction_angle)
    return K * weight * depth - 2.0 * cohesion * math.sqrt(K)


def passive_pressure(depth, weight: float, cohesion: float, friction_angle: float):
    """Pressure (Pa) at ``depth`` (m) where the wall is pushed in: K_p γ z + 2 c √K_p."""
    K = passive_coefficient(friction_angle)
    return K * weight * depth + 2.0 * cohesion * math.sqrt(K)


def active_force(height: float, weight: float, cohesion: float, friction_angle: float) -> float:
    """Force (N/m) on a wall of ``height`` H (m), the soil sticking to it where it pulls:
    K_a γ H²/2 - 2 c H √K_a."""
    return height * active_pressure(0.5 * height, weight, cohesion, friction_angle)


def passive_force(height: float, weight: float, cohesion: float, friction_angle: float) -> float:
    """Force (N/m) on a wall of ``height`` H (m): K_p γ H²/2 + 2 c H √K_p."""
    return height * passive_pressure(0.5 * height, weight, cohesion, friction_angle)
