"""Return to the cone of Drucker and Prager, and to a limit of the mean stress, in p and j = √J₂.

Tension is positive.  The cone is j + η p <= k, its flow along j + η̄ p, and p <= T, with flow along
p, cuts it off; T is at most the apex k/η, so that return to the apex is return to the corner of
the two.  From the trial p, j,

    cone     l = (j + η p - k)/(μ + K η η̄),  p' = p - K η̄ l,  j' = j - μ l
    cut-off  p' = T,  j' = min(j, k - η T)

(de Souza Neto, Perić and Owen, Computational Methods for Plasticity, 2008, section 8.3).
"""

from __future__ import annotations

import math
from enum import Enum

from ..common.compiled import jit

ELASTIC, CONE, CORNER, CUT_OFF = -1, 0, 1, 2
SQRT3 = math.sqrt(3.0)
ON_CONE = 1e-13
"""Of the stresses: a point at rest on the cone is elastic, whatever the rounding."""


class MatchedTo(Enum):
    """States in which a cone yields, and dilates, as the planes of Mohr and Coulomb do."""

    COMPRESSION = 0
    """Triaxial compression; the cone outside the planes."""
    EXTENSION = 1
    """Triaxial extension."""
    PLANE_STRAIN = 2
    """Flow in plane strain, elastic strain having come to rest."""


@jit
def cone_of(cohesion, friction, dilation, tension, matched):
    """Return η, k, η̄ and T of c, φ and ψ (Pa, radians)."""
    sine, cosine, flow = math.sin(friction), math.cos(friction), math.sin(dilation)
    if matched == 2:
        root = 1.0 / math.sqrt(1.0 + flow * flow / 3.0)
        η_flow = flow * root
        w = 1.0 / (root + sine * η_flow / 3.0)
    else:
        sign = -1.0 if matched == 0 else 1.0
        w = 2.0 * SQRT3 / (3.0 + sign * sine)
        η_flow = 2.0 * SQRT3 * flow / (3.0 + sign * flow)
    η, k = w * sine, w * cosine * cohesion
    highest = tension if tension * η < k else (k / η if η > 0.0 else math.inf)
    return η, k, η_flow, highest


@jit
def cone_change(cohesion, friction, dilation, tension, change, matched):
    """Return the derivatives of ``cone_of`` where c, φ and ψ change by ``change`` (3)."""
    sine, cosine, flow = math.sin(friction), math.cos(friction), math.sin(dilation)
    dc, dφ, dψ = change
    if matched == 2:
        root = 1.0 / math.sqrt(1.0 + flow * flow / 3.0)
        η_flow = flow * root
        dη_flow = math.cos(dilation) * dψ * root**3
        below = root + sine * η_flow / 3.0
        dbelow = -flow / 3.0 * dη_flow + (cosine * dφ * η_flow + sine * dη_flow) / 3.0
        w, dw = 1.0 / below, -dbelow / (below * below)
    else:
        sign = -1.0 if matched == 0 else 1.0
        w = 2.0 * SQRT3 / (3.0 + sign * sine)
        dw = -sign * w * cosine * dφ / (3.0 + sign * sine)
        dη_flow = 6.0 * SQRT3 * math.cos(dilation) * dψ / (3.0 + sign * flow) ** 2
    η, k = w * sine, w * cosine * cohesion
    dη = dw * sine + w * cosine * dφ
    dk = dw * cosine * cohesion - w * sine * dφ * cohesion + w * cosine * dc
    dhighest = 0.0
    if η > 0.0 and not tension * η < k:
        dhighest = (dk - dη * k / η) / η
    return dη, dk, dη_flow, dhighest


@jit
def beyond_cone(p, j, cone):
    """Return by how much p and j are beyond the cone or the limit of p (Pa), less what rounding may
    bring."""
    η, k, _, highest = cone
    return max(j + η * p - k, p - highest) - ON_CONE * (k + j + abs(p))


@jit
def return_to_cone(p, j, cone, bulk, μ):
    """Return p', j' and ``CONE``, ``CORNER`` or ``CUT_OFF``, ``ELASTIC`` without flow."""
    η, k, flow, highest = cone
    if not beyond_cone(p, j, cone) > 0.0:
        return p, j, ELASTIC
    multiplier = (j + η * p - k) / (μ + bulk * η * flow)
    lower = p - bulk * flow * multiplier
    if multiplier > 0.0 and lower <= highest:
        return lower, j - μ * multiplier, CONE
    limit = max(0.0, k - η * highest)
    if j > limit:
        return highest, limit, CORNER
    return highest, j, CUT_OFF


@jit
def derivative(which, cone, bulk, μ):
    """Return ∂p'/∂p, ∂p'/∂j, ∂j'/∂p and ∂j'/∂j."""
    η, _, flow, _ = cone
    if which == CONE:
        below = μ + bulk * η * flow
        return (
            1.0 - bulk * flow * η / below,
            -bulk * flow / below,
            -μ * η / below,
            1.0 - μ / below,
        )
    if which == ELASTIC:
        return 1.0, 0.0, 0.0, 1.0
    return 0.0, 0.0, 0.0, 1.0 if which == CUT_OFF else 0.0


@jit
def change_of_cone_return(which, p, j, cone, change, bulk, μ):
    """Return the derivatives of p' and j' where η, k, η̄ and T change by ``change``, the trial being
    held."""
    η, k, flow, highest = cone
    dη, dk, dflow, dhighest = change
    if which == CONE:
        below = μ + bulk * η * flow
        multiplier = (j + η * p - k) / below
        moved = (dη * p - dk - multiplier * bulk * (dη * flow + η * dflow)) / below
        return -bulk * (dflow * multiplier + flow * moved), -μ * moved
    if which == CORNER:
        return dhighest, dk - dη * highest - η * dhighest
    if which == CUT_OFF:
        return dhighest, 0.0
    return 0.0, 0.0
