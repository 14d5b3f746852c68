"""Return to the planes of Mohr and Coulomb and of a tension cut-off, in principal stresses.

Tension is positive and s_1 >= s_2 >= s_3.  Six planes n·s <= bound bound the stress, each with its
flow m:

    0, 1, 2  (1 + sin φ) s_i - (1 - sin φ) s_j <= 2 c cos φ,  (i, j) = (1, 3), (1, 2), (2, 3)
    3, 4, 5  s_i <= T,  i = 1, 2, 3

Flow on the first three is along the plane of the dilation angle ψ in place of φ, on the others
along their normal.  For a set of active planes with normals N (k, 3) and flows M (k, 3),

    s = x - R f(x),  R = D Mᵀ A⁻¹,  A = N D Mᵀ,  multipliers A⁻¹ f(x) >= 0,

x the trial stress and D the elastic stiffness.  The first of ``SETS`` that is admissible is the
answer; where none is, stress is at the tip, min(T, c cot φ) in all directions (Clausen, Damkilde
and Andersen, Comput. Struct. 85, 2007; de Souza Neto, Perić and Owen, 2008, section 8.2).
Plastic strain is C : (x - s), whatever the multipliers.
"""

from __future__ import annotations

import math

import numpy as np

from ..common.compiled import jit

SETS = ((0,), (3,), (0, 2), (0, 1), (0, 3), (3, 4), (3, 4, 5), (0, 1, 3), (0, 2, 3), (0, 3, 4))
"""Sets of planes that can be active together between sorted stresses: sides, edges, corners."""
SIZE = np.array([len(planes) for planes in SETS])
PLANES = np.array([[*planes, *[-1] * (3 - len(planes))] for planes in SETS])
FIRST, SECOND = np.array([0, 0, 1, 0, 1, 2]), np.array([2, 1, 2, 0, 1, 2])
ELASTIC, TIP = -1, -2
EXCESS, FLOW, INVERSE, RETURN, STRESS = 5, 6, 9, 12, 15
"""Column of the excess, and rows, in ``return_room``."""
ON_PLANE = 1e-13
"""Of the stresses: a point at rest on a plane is elastic, whatever the rounding."""
ADMISSIBLE = 1e-12
"""Of the stresses: so far beyond another plane is still on it."""


@jit
def planes_of(cohesion, friction, dilation, tension):
    """Return sin φ, 2 c cos φ, T (at most the apex), sin ψ and whether T cuts the apex off; angles
    in radians."""
    angles = math.sin(friction), math.cos(friction), math.sin(dilation)
    return planes_with(cohesion, angles, tension)


@jit
def planes_with(cohesion, angles, tension):
    """Return what ``planes_of`` does, of sin φ, cos φ and sin ψ."""
    sine, cosine, flow = angles
    cuts = sine <= 0.0 or tension * sine < cohesion * cosine
    highest = tension if cuts else cohesion * cosine / sine
    return sine, 2.0 * cohesion * cosine, highest, flow, cuts


@jit
def planes_change(cohesion, friction, dilation, change, planes):
    """Return the derivatives of the first four of ``planes_of`` where c, φ and ψ change by
    ``change`` (3)."""
    sine, cosine = math.sin(friction), math.cos(friction)
    dc, dφ, dψ = change
    highest = 0.0
    if not planes[4]:
        highest = dc * cosine / sine - cohesion * dφ / (sine * sine)
    return cosine * dφ, 2.0 * (dc * cosine - cohesion * sine * dφ), highest, math.cos(dilation) * dψ


@jit
def beyond(high, low, planes):
    """Return by how much the largest and smallest principal stress are beyond the planes (Pa),
    less what rounding may bring."""
    shear = (1.0 + planes[0]) * high - (1.0 - planes[0]) * low - planes[1]
    slack = ON_PLANE * (planes[1] + abs(high) + abs(low))
    if planes[4]:
        shear = max(shear, high - planes[2])
    return shear - slack


@jit
def return_room():
    """Room for one return, one array so that loops hand on little: rows 0 to 5 are the planes, with
    n_i, n_j, m_i, m_j, the bound and the excess f of the trial stress; then D Mᵀ, A⁻¹ and R, three
    rows each, and the row of the stress."""
    return np.zeros((16, 6))


@jit
def lay_out(planes, room):
    """Write the coefficients of the six planes, which returns with this room then go by."""
    sine, bound, tension, flow, _ = planes
    for plane in range(3):
        room[plane, 0], room[plane, 1] = 1.0 + sine, sine - 1.0
        room[plane, 2], room[plane, 3] = 1.0 + flow, flow - 1.0
        room[plane, 4] = bound
        room[3 + plane, 0] = room[3 + plane, 2] = 1.0
        room[3 + plane, 4] = tension


@jit
def _invert(room, k):
    """Overwrite A (k, k), in ``room``, with its inverse; False where it has none."""
    n, o, m = INVERSE, INVERSE + 1, INVERSE + 2
    if k == 1:
        room[n, 0] = 1.0 / room[n, 0]
        return True
    if k == 2:
        a, b, c, d = room[n, 0], room[n, 1], room[o, 0], room[o, 1]
        det = a * d - b * c
        room[n, 0], room[n, 1], room[o, 0], room[o, 1] = d / det, -b / det, -c / det, a / det
        return abs(det) > 1e-13 * (abs(a * d) + abs(b * c))
    a, b, c = room[n, 0], room[n, 1], room[n, 2]
    d, e, f = room[o, 0], room[o, 1], room[o, 2]
    g, h, i = room[m, 0], room[m, 1], room[m, 2]
    p, q, r = e * i - f * h, f * g - d * i, d * h - e * g
    det = a * p + b * q + c * r
    room[n, 0], room[n, 1], room[n, 2] = p / det, (c * h - b * i) / det, (b * f - c * e) / det
    room[o, 0], room[o, 1], room[o, 2] = q / det, (a * i - c * g) / det, (c * d - a * f) / det
    room[m, 0], room[m, 1], room[m, 2] = r / det, (b * g - a * h) / det, (a * e - b * d) / det
    return abs(det) > 1e-13 * (abs(a * p) + abs(b * q) + abs(c * r))


@jit
def solve_set(which, lame, room):
    """Write D Mᵀ and A⁻¹ of a set of planes; False where A is singular."""
    λ, μ = lame
    k = SIZE[which]
    for b in range(k):
        plane = PLANES[which, b]
        first, second = room[plane, 2], room[plane, 3]
        room[FLOW + b, 0] = room[FLOW + b, 1] = room[FLOW + b, 2] = λ * (first + second)
        room[FLOW + b, FIRST[plane]] += 2.0 * μ * first
        room[FLOW + b, SECOND[plane]] += 2.0 * μ * second
    for a in range(k):
        plane = PLANES[which, a]
        i, j = FIRST[plane], SECOND[plane]
        for b in range(k):
            room[INVERSE + a, b] = (
                room[plane, 0] * room[FLOW + b, i] + room[plane, 1] * room[FLOW + b, j]
            )
    return _invert(room, k)


@jit
def returning(which, room):
    """Write R of the set that is solved."""
    k = SIZE[which]
    for i in range(3):
        for a in range(k):
            room[RETURN + i, a] = 0.0
            for b in range(k):
                room[RETURN + i, a] += room[FLOW + b, i] * room[INVERSE + b, a]


@jit
def _admissible(s, t, u, planes, slack):
    """Whether three principal stresses, in any order, are within the planes and the cut-off."""
    high, low = max(s, t, u), min(s, t, u)
    inside = (1.0 + planes[0]) * high - (1.0 - planes[0]) * low <= planes[1] + slack
    return inside and not (planes[4] and high > planes[2] + slack)


@jit
def _try(which, x, planes, lame, scale, room):
    """Whether a set of planes is the answer; its stress is then in ``room``."""
    if SIZE[which] == 1 and not room[PLANES[which, 0], EXCESS] > 0.0:
        return False
    if not solve_set(which, lame, room) or not _pushes(which, scale, room):
        return False
    returning(which, room)
    return _brings_back(which, x, planes, scale, room)


@jit
def _pushes(which, scale, room):
    """Whether no multiplier of the set that is solved is negative."""
    k = SIZE[which]
    for a in range(k):
        multiplier, size = 0.0, 0.0
        for b in range(k):
            multiplier += room[INVERSE + a, b] * room[PLANES[which, b], EXCESS]
            size = max(size, abs(room[INVERSE + a, b]))
        if not multiplier >= -ADMISSIBLE * size * scale:
            return False
    return True


@jit
def _brings_back(which, x, planes, scale, room):
    """Write the stress after the return by a set; whether it is within all planes."""
    for i in range(3):
        room[STRESS, i] = x[i]
        for a in range(SIZE[which]):
            room[STRESS, i] -= room[RETURN + i, a] * room[PLANES[which, a], EXCESS]
    return _admissible(
        room[STRESS, 0], room[STRESS, 1], room[STRESS, 2], planes, ADMISSIBLE * scale
    )


@jit
def return_to_planes(x, planes, lame, room):
    """Write into ``room`` the principal stresses after the return from x (3,), sorted;
    return the number of the set of planes, ``ELASTIC`` or ``TIP``.  ``lay_out`` comes before."""
    if not beyond(x[0], x[2], planes) > 0.0:
        for i in range(3):
            room[STRESS, i] = x[i]
        return ELASTIC
    scale = planes[1] + abs(x[0]) + abs(x[2])
    for plane in range(6 if planes[4] else 3):
        room[plane, EXCESS] = room[plane, 0] * x[FIRST[plane]] - room[plane, 4]
        room[plane, EXCESS] += room[plane, 1] * x[SECOND[plane]]
    for which in range(len(SIZE)):
        if PLANES[which, SIZE[which] - 1] > 2 and not planes[4]:
            continue
        if _try(which, x, planes, lame, scale, room):
            return which
    for i in range(3):
        room[STRESS, i] = planes[2]
    return TIP


@jit
def strengthen(which, x, bound, planes, room):
    """Whether the set that ``return_to_planes`` gave is still the answer where 2 c cos φ is
    ``bound`` more, in ``planes`` too; its stress is then in ``room``."""
    scale = planes[1] + abs(x[0]) + abs(x[2])
    for plane in range(3):
        room[plane, EXCESS] -= bound
    if SIZE[which] == 1 and not room[PLANES[which, 0], EXCESS] > 0.0:
        return False
    return _pushes(which, scale, room) and _brings_back(which, x, planes, scale, room)


@jit
def principal_tangent(which, lame, room, out):
    """Write ∂s/∂ε (3, 3) between principal values, of the set that ``return_to_planes`` gave."""
    λ, μ = lame
    for i in range(3):
        for j in range(3):
            out[i, j] = 0.0 if which == TIP else λ
        if which != TIP:
            out[i, i] += 2.0 * μ
    if which < 0:
        return
    for a in range(SIZE[which]):
        plane = PLANES[which, a]
        first, second = room[plane, 0], room[plane, 1]
        spread = λ * (first + second)
        for i in range(3):
            r = room[RETURN + i, a]
            out[i, 0] -= r * spread
            out[i, 1] -= r * spread
            out[i, 2] -= r * spread
            out[i, FIRST[plane]] -= r * 2.0 * μ * first
            out[i, SECOND[plane]] -= r * 2.0 * μ * second


@jit
def change_of_return(which, change, lame, room, out):
    """Write the derivative (3,) of the returned stress, the trial stress being held, where
    sin φ, 2 c cos φ, T and sin ψ change by ``change``.

    With N s = bound, s = x - D Mᵀ l:  ds = -D dMᵀ l + R (dbound - dN s + N D dMᵀ l).
    """
    sine, bound, tension, flow = change
    for i in range(3):
        out[i] = tension if which == TIP else 0.0
    if which < 0:
        return
    λ, μ = lame
    k = SIZE[which]
    volume = 0.0
    for a in range(k):
        plane = PLANES[which, a]
        if plane > 2:
            continue
        multiplier = 0.0
        for b in range(k):
            multiplier += room[INVERSE + a, b] * room[PLANES[which, b], EXCESS]
        volume += 2.0 * flow * multiplier
        out[FIRST[plane]] -= 2.0 * μ * flow * multiplier
        out[SECOND[plane]] -= 2.0 * μ * flow * multiplier
    for i in range(3):
        out[i] -= λ * volume
    moved = out[0], out[1], out[2]
    for a in range(k):
        plane = PLANES[which, a]
        rest = tension
        if plane < 3:
            rest = bound - sine * (room[STRESS, FIRST[plane]] + room[STRESS, SECOND[plane]])
        rest -= room[plane, 0] * moved[FIRST[plane]] + room[plane, 1] * moved[SECOND[plane]]
        for i in range(3):
            out[i] += room[RETURN + i, a] * rest


@jit
def change_with_bound(which, bound, room, out):
    """Write the same where 2 c cos φ alone changes, by ``bound``."""
    for i in range(3):
        out[i] = 0.0
        for a in range(SIZE[which]):
            if PLANES[which, a] < 3:
                out[i] += bound * room[RETURN + i, a]
