"""Bearing capacity of weightless soil under a strip, q = c N_c + p N_q, p the pressure beside it
(Prandtl, Nachr. Ges. Wiss. Göttingen, 1920; Reissner, Proc. 1st Int. Congr. Appl. Mech., 1924);
exact where flow is associated."""

from __future__ import annotations

import math

from .compression import passive_coefficient


def surcharge_factor(friction_angle: float) -> float:
    """N_q = K_p e^{π tan φ} of φ (degrees)."""
    slope = math.tan(math.radians(friction_angle))
    return passive_coefficient(friction_angle) * math.exp(math.pi * slope)


def cohesion_factor(friction_angle: float) -> float:
    """N_c = (N_q - 1) cot φ of φ (degrees), 2 + π without friction."""
    slope = math.tan(math.radians(friction_angle))
    if slope == 0.0:
        return 2.0 + math.pi
    sine = math.sin(math.radians(friction_angle))
    # N_q - 1 without loss of digits where φ is small
    return math.expm1(math.pi * slope + math.log1p(sine) - math.log1p(-sine)) / slope


def bearing_capacity(cohesion: float, friction_angle: float, surcharge: float = 0.0) -> float:
    """Pressure (Pa) that the strip bears, of c (Pa), φ (degrees) and p (Pa)."""
    return cohesion * cohesion_factor(friction_angle) + surcharge * surcharge_factor(friction_angle)
