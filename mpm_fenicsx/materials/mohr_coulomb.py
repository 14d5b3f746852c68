"""Mohr and Coulomb's law with a tension cut-off, and its consistent tangent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..common.compiled import jit
from .bracketed_root import TRIES, next_guess
from .curve import Curve, piece_of
from .elastic import LinearElastic
from .elastic_trial import elastic_stiffness, trial_stress
from .frictional import (
    Frictional,
    angles_stay,
    effective_strain,
    parameters_at,
    strengths_at,
)
from .principal_stress import (
    compose,
    compose_tangent,
    decompose,
    largest_and_smallest,
    spectrum,
)
from .shear_planes import (
    ELASTIC,
    EXCESS,
    SETS,
    STRESS,
    beyond,
    change_of_return,
    change_with_bound,
    lay_out,
    planes_change,
    planes_of,
    planes_with,
    principal_tangent,
    return_room,
    return_to_planes,
    returning,
    solve_set,
    strengthen,
)


@jit
def _planes(strengths, p):
    """Return the planes of a point from its row of strengths."""
    row = strengths[p if len(strengths) > 1 else 0]
    return row[0], row[1], row[2], row[3], row[4] > 0.0


@jit
def _strengths(history, soil, options, out):
    """Write the planes (rows, 5) of points in their states."""
    friction, dilation, angles = math.nan, math.nan, (0.0, 1.0, 0.0)
    steady = angles_stay(soil[0])
    for p in range(len(out)):
        kappa = effective_strain(history[p, 0], history[p], options[2]) if len(history) else 0.0
        c, φ, ψ, tension = strengths_at(kappa, p, soil, steady)
        if φ != friction or ψ != dilation:
            friction, dilation, angles = φ, ψ, (math.sin(φ), math.cos(φ), math.sin(ψ))
        out[p, 0], out[p, 1], out[p, 2], out[p, 3], cuts = planes_with(c, angles, tension)
        out[p, 4] = 1.0 if cuts else 0.0


@jit
def _flow(x, s, λ, μ):
    """Return Δκ and the plastic work of the return from x to s, principal stresses."""
    mean = (x[0] - s[0] + x[1] - s[1] + x[2] - s[2]) / 3.0
    opening = mean / (3.0 * λ + 2.0 * μ)
    work, square = 0.0, 0.0
    for i in range(3):
        e = (x[i] - s[i] - mean) / (2.0 * μ)
        work += s[i] * (e + opening)
        square += e * e
    return math.sqrt(2.0 / 3.0 * square), work


@jit
def _perfect(strain, stress, history, options, strengths, outputs, want):
    λ, μ, _ = options
    out, out_history, tangent = outputs
    room, returned, D = spectrum(), return_room(), np.empty((3, 3))
    for p in range(len(strain)):
        planes = _planes(strengths, p)
        if p == 0 or len(strengths) > 1:
            lay_out(planes, returned)
        trial_stress(strain[p], stress[p], λ, μ, out[p])
        decompose(out[p], room)
        which = return_to_planes(room[0], planes, (λ, μ), returned)
        if which == ELASTIC:
            if want:
                elastic_stiffness(λ, μ, tangent[p])
            continue
        kappa, work = _flow(room[0], returned[STRESS], λ, μ)
        out_history[p, 0] += kappa
        out_history[p, 1] += work
        compose(returned[STRESS], room, out[p])
        if want:
            principal_tangent(which, (λ, μ), returned, D)
            compose_tangent(returned[STRESS], D, μ, room, tangent[p])


@jit
def _along(x, s, μ, Δκ, other):
    """Return ⅔ e·other/Δκ, e the deviator of the plastic strain of the return from x to s: the
    change of Δκ where plastic strain changes by ``other`` (3)."""
    if not Δκ > 0.0:
        return 0.0
    mean = (x[0] - s[0] + x[1] - s[1] + x[2] - s[2]) / 3.0
    found = 0.0
    for i in range(3):
        found += (x[i] - s[i] - mean) / (2.0 * μ) * other[i]
    return found / (1.5 * Δκ)


@jit
def _harden(x, state, p, soil, options, returned, moved):
    """Return to the planes of κ + Δκ, Δκ being that of the return; write into ``moved`` the change
    of the returned stress with κ, and return the set of planes, Δκ and the change of the return's
    Δκ with κ."""
    λ, μ, weight = options
    through = 1.0 if len(state) < 3 else 1.0 - weight
    low, high, Δκ, slope, which = 0.0, math.inf, 0.0, 0.0, ELASTIC
    floor = 1e-16 * (abs(x[0]) + abs(x[2])) / μ
    for _ in range(TRIES):
        kappa = effective_strain(state[0] + Δκ, state, weight)
        (c, φ, ψ, tension), change = parameters_at(kappa, p, soil)
        planes = planes_of(c, φ, ψ, tension)
        lay_out(planes, returned)
        which = return_to_planes(x, planes, (λ, μ), returned)
        found, _ = _flow(x, returned[STRESS], λ, μ)
        change_of_return(which, planes_change(c, φ, ψ, change, planes), (λ, μ), returned, moved)
        for i in range(3):
            moved[i] *= through
        slope = -_along(x, returned[STRESS], μ, found, moved) / (2.0 * μ)
        if abs(found - Δκ) <= 1e-14 * Δκ + floor:
            break
        Δκ, low, high = next_guess(Δκ, found - Δκ, slope - 1.0, low, high)
    return which, Δκ, slope


@jit
def _harden_on_piece(x, state, p, soil, options, planes, returned, moved):
    """Return as ``_harden`` does where the angles stay and the cohesion is linear up to κ + Δκ;
    ``planes`` are those of κ.  Δκ is negative where it is not, or other planes come into play.

    The returned stress is linear in κ then, s + moved Δκ, and Δκ² = ⅔ |e - m Δκ|², e and m the
    deviators of the plastic strains of the two: a quadratic equation.
    """
    λ, μ, weight = options
    curves, factor, limit, scale = soil
    through = 1.0 if len(state) < 3 else 1.0 - weight
    kappa = effective_strain(state[0], state, weight)
    slope, low, high = piece_of(curves, 0, kappa, scale[p if len(scale) > 1 else 0])
    sine, bound = planes[0], planes[1]
    cosine = math.sqrt((1.0 - sine) * (1.0 + sine))
    rate = 2.0 * cosine * factor[p if len(factor) > 1 else 0, 0] * slope * through
    lay_out(planes, returned)
    which = return_to_planes(x, planes, (λ, μ), returned)
    if which < 0 and (planes[4] or rate > 0.0):
        return which, -1.0, 0.0
    if which < 0:  # the tip, which draws back and then is all the more the answer
        moved[0] = moved[1] = moved[2] = 0.5 * rate / sine
    else:
        change_with_bound(which, rate, returned, moved)
    s = returned[STRESS]
    mean = (x[0] - s[0] + x[1] - s[1] + x[2] - s[2]) / 3.0
    middle = (moved[0] + moved[1] + moved[2]) / 3.0
    A, B, C = 0.0, 0.0, 0.0
    for i in range(3):
        e, m = x[i] - s[i] - mean, moved[i] - middle
        A, B, C = A + e * e, B - e * m, C + m * m
    times = 1.0 / (6.0 * μ * μ)
    A, B, gap = A * times, B * times, 1.0 - C * times
    if not gap > 0.0:
        return which, -1.0, 0.0
    root = math.sqrt(B * B + gap * A)
    Δκ = (B + root) / gap if B > 0.0 else A / (root - B)
    if not (Δκ > 0.0 and low <= kappa + through * Δκ <= high):
        return which, -1.0, 0.0
    now, most = bound + rate * Δκ, limit[p if len(limit) > 1 else 0]
    cuts = sine <= 0.0 or 2.0 * most * sine < now
    planes = sine, now, most if cuts else now / sine / 2.0, planes[3], planes[4]
    if cuts != planes[4]:
        return which, -1.0, 0.0
    if which < 0:
        s[0] = s[1] = s[2] = planes[2]
    elif not strengthen(which, x, rate * Δκ, planes, returned):
        return which, -1.0, 0.0
    return which, Δκ, (B + (1.0 - gap) * Δκ) / Δκ


@jit
def _add_hardening(x, s, μ, Δκ, slope, moved, D):
    """Add to D (3, 3) what the stress changes because κ does."""
    if not Δκ > 0.0:
        return
    mean = (x[0] - s[0] + x[1] - s[1] + x[2] - s[2]) / 3.0
    times = 1.0 / (3.0 * μ * Δκ * (1.0 - slope))
    first, second, third = x[0] - s[0] - mean, x[1] - s[1] - mean, x[2] - s[2] - mean
    e = first * times, second * times, third * times
    for j in range(3):
        along = e[j] - (e[0] * D[0, j] + e[1] * D[1, j] + e[2] * D[2, j]) / (2.0 * μ)
        for i in range(3):
            D[i, j] += moved[i] * along


@jit
def _hardening(strain, stress, history, options, strengths, soil, outputs, want):
    λ, μ, _ = options
    out, out_history, tangent = outputs
    room, returned, D, moved = spectrum(), return_room(), np.empty((3, 3)), np.empty(3)
    steady = angles_stay(soil[0])
    for p in range(len(strain)):
        trial_stress(strain[p], stress[p], λ, μ, out[p])
        decompose(out[p], room)
        x, s, planes = room[0], returned[STRESS], _planes(strengths, p)
        if not beyond(x[0], x[2], planes) > 0.0:
            if want:
                elastic_stiffness(λ, μ, tangent[p])
            continue
        which, Δκ, slope = ELASTIC, -1.0, 0.0
        if steady:
            which, Δκ, slope = _harden_on_piece(
                x, history[p], p, soil, options, planes, returned, moved
            )
        if Δκ < 0.0:
            which, Δκ, slope = _harden(x, history[p], p, soil, options, returned, moved)
        _, work = _flow(x, s, λ, μ)
        out_history[p, 0] += Δκ
        out_history[p, 1] += work
        compose(s, room, out[p])
        if want:
            principal_tangent(which, (λ, μ), returned, D)
            _add_hardening(x, s, μ, Δκ, slope, moved, D)
            compose_tangent(s, D, μ, room, tangent[p])


@jit
def _surely_elastic(row, planes):
    """Whether bounds of the principal stresses, by the mean and the deviator, tell that a row (6,)
    is inside."""
    mean = (row[0] + row[1] + row[2]) / 3.0
    square = row[3] ** 2 + row[4] ** 2 + row[5] ** 2
    for i in range(3):
        square += 0.5 * (row[i] - mean) ** 2
    radius = math.sqrt(square)
    third = radius / math.sqrt(3.0)
    inside = 2.0 * radius + planes[0] * (2.0 * mean + third) < planes[1]
    return inside and not (planes[4] and mean + 2.0 * third >= planes[2])


@jit
def _yields(strain, stress, at, of, lame, strengths, rows):
    """Write which of the pairs (strain row ``at``, state row ``of``) yield; return their number."""
    trial, room, found = np.empty(strain.shape[1]), spectrum(), 0
    for m in range(len(at)):
        p = of[m]
        planes = _planes(strengths, p)
        trial_stress(strain[at[m]], stress[p], lame[0], lame[1], trial)
        if len(trial) == 6 and _surely_elastic(trial, planes):
            continue
        high, low = largest_and_smallest(trial, room)
        if beyond(high, low, planes) > 0.0:
            rows[found] = m
            found += 1
    return found


@jit
def _excess(stress, strengths, out):
    """Write by how much stress rows are beyond the planes (n,)."""
    room = spectrum()
    for p in range(len(stress)):
        high, low = largest_and_smallest(stress[p], room)
        out[p] = beyond(high, low, _planes(strengths, p))


class OnShearPlanes(Frictional):
    """A law that returns to the planes of ``shear_planes``."""

    columns = 5
    loops: ClassVar = {
        "strengths": _strengths,
        "perfect": _perfect,
        "hardening": _hardening,
        "yields": _yields,
        "excess": _excess,
    }

    def _steepest(self, friction: float, dilation: float) -> float:
        """Fall of the cohesion per unit κ (Pa) at which a point on a plane, an edge or a corner
        snaps back: where Δκ of the return grows as fast as κ."""
        limit, room, moved = np.inf, return_room(), np.empty(3)
        lay_out((math.sin(friction), 1.0, 0.0, math.sin(dilation), True), room)
        for which, members in enumerate(SETS):
            if members[0] != 0 or (3 in members and self.tensile_strength is None):
                continue
            if not solve_set(which, self.lame, room):
                continue
            returning(which, room)
            room[:, EXCESS] = 0.0
            room[STRESS] = 0.0
            change = 0.0, 2.0 * math.cos(friction), 0.0, 0.0
            change_of_return(which, change, self.lame, room, moved)
            e = (moved - moved.mean()) / (2.0 * self.lame[1])
            limit = min(limit, 1.0 / math.sqrt(2.0 / 3.0 * float(e @ e)))
        return limit


@dataclass(frozen=True)
class MohrCoulomb(OnShearPlanes):
    """Elastic soil that yields where σ_1 - σ_3 + (σ_1 + σ_3) sin φ = 2 c cos φ, tension positive,
    σ_1 >= σ_2 >= σ_3, or σ_1 = T.

    Parameters: ``elastic``; ``cohesion`` c (Pa); ``friction_angle`` φ and ``dilation_angle`` ψ
    (degrees, 0 <= ψ <= φ < 90), the latter that of the plane of flow; each a number, or a ``Curve``
    of the plastic strain κ.  ``tensile_strength`` T (Pa): the largest tensile stress, with flow
    along its normal; None, or more than the apex c cot φ, is the apex.  ``length`` (m), the cell
    size at which curves were found: a point of size d follows what falls in them d/length times as
    fast, so that a band one cell wide takes the same energy per area on every grid; ``size`` is
    then required.  ``averaging``: an ``OverNonlocal``, whose κ̄ then takes the place of κ, by its
    weight.  c, φ, ψ and T may be given point by point; a given value scales a curve by its first
    value.

    The return is of closed form (``shear_planes``); with curves Δκ is the root of one equation
    around it, Δκ = √(⅔ eᵖ:eᵖ), eᵖ(κ + Δκ) the deviator of the step's plastic strain. The
    tangent is its exact derivative.  Cohesion that falls so fast that a point snaps back is
    refused; where the friction angle falls, that depends on pressure, and the root found is one
    where it does not.

    Raises ``ValueError`` naming the parameter that is out of range.
    """

    elastic: LinearElastic
    cohesion: float | Curve
    friction_angle: float | Curve
    dilation_angle: float | Curve = 0.0
    tensile_strength: float | None = None
    length: float | None = None
    averaging: object | None = None
