"""Drucker and Prager's law, matched to Mohr and Coulomb's, and its consistent tangent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..common.checks import an_object
from ..common.compiled import jit
from .bracketed_root import TRIES, next_guess
from .cone import (
    CUT_OFF,
    ELASTIC,
    MatchedTo,
    beyond_cone,
    change_of_cone_return,
    cone_change,
    cone_of,
    derivative,
    return_to_cone,
)
from .curve import Curve
from .elastic import LinearElastic
from .elastic_trial import elastic_stiffness, trial_stress
from .frictional import Frictional, effective_strain, parameters_at

SQRT3 = math.sqrt(3.0)


@jit
def _cone(strengths, p):
    """Return the cone of a point from its row of strengths."""
    row = strengths[p if len(strengths) > 1 else 0]
    return row[0], row[1], row[2], row[3]


@jit
def _strengths(history, soil, options, out):
    """Write the cones (rows, 4) of points in their states."""
    for p in range(len(out)):
        kappa = effective_strain(history[p, 0], history[p], options[2]) if len(history) else 0.0
        (c, φ, ψ, tension), _ = parameters_at(kappa, p, soil)
        out[p, 0], out[p, 1], out[p, 2], out[p, 3] = cone_of(c, φ, ψ, tension, options[3])


@jit
def _invariants(row):
    """Return the mean stress and √J₂ of a row."""
    mean = (row[0] + row[1] + row[2]) / 3.0
    square = 0.0
    for i in range(len(row)):
        square += 0.5 * (row[i] - mean) ** 2 if i < 3 else row[i] ** 2
    return mean, math.sqrt(square)


@jit
def _bring_back(p, j, p_new, j_new, row):
    """Overwrite a trial row with that of the new invariants, along its own deviator."""
    ratio = j_new / j if j > 0.0 else 0.0
    for i in range(len(row)):
        row[i] = p_new + ratio * (row[i] - p) if i < 3 else ratio * row[i]


@jit
def _tangent(row, p, j, ratio, J, bulk, μ, out):
    """Write the tangent from the trial row, j'/j and the derivatives J of p' and j' by p and j."""
    n = len(row)
    shear = μ * (J[3] - ratio)
    for i in range(n):
        u = (row[i] - p if i < 3 else row[i]) / j if j > 0.0 else 0.0
        for k in range(n):
            v = (row[k] - p if k < 3 else row[k]) / j if j > 0.0 else 0.0
            value = shear * u * v
            if i < 3:
                value += μ * J[1] * v
            if k < 3:
                value += bulk * J[2] * u
            if i < 3 and k < 3:
                value += bulk * J[0] - 2.0 / 3.0 * μ * ratio
            out[i, k] = value
        out[i, i] += 2.0 * μ * ratio if i < 3 else μ * ratio


@jit
def _finish(row, trial, returned, J, moduli, history, tangent, want):
    """Write stress, plastic work and, where wanted, the tangent of a point that flows."""
    p, j = trial
    p_new, j_new, which = returned
    bulk, μ = moduli
    history[1] += p_new * (p - p_new) / bulk + j_new * (j - j_new) / μ
    if want:
        ratio = j_new / j if j > 0.0 else (1.0 if which == CUT_OFF else 0.0)
        _tangent(row, p, j, ratio, J, bulk, μ, tangent)
    _bring_back(p, j, p_new, j_new, row)


@jit
def _perfect(strain, stress, history, options, strengths, outputs, want):
    λ, μ, _, _ = options
    bulk = λ + 2.0 / 3.0 * μ
    out, out_history, tangent = outputs
    for m in range(len(strain)):
        trial_stress(strain[m], stress[m], λ, μ, out[m])
        p, j = _invariants(out[m])
        cone, into = _cone(strengths, m), tangent[m if want else 0]
        returned = return_to_cone(p, j, cone, bulk, μ)
        if returned[2] == ELASTIC:
            if want:
                elastic_stiffness(λ, μ, into)
            continue
        out_history[m, 0] += (j - returned[1]) / (SQRT3 * μ)
        J = derivative(returned[2], cone, bulk, μ)
        _finish(out[m], (p, j), returned, J, (bulk, μ), out_history[m], into, want)


@jit
def _harden(p, j, state, m, soil, options, bulk):
    """Return to the cone of κ + Δκ, Δκ being that of the return: p', j' and their set, Δκ, and the
    derivatives of p' and j' by p and j."""
    _, μ, weight, matched = options
    through = 1.0 if len(state) < 3 else 1.0 - weight
    low, high, Δκ = 0.0, math.inf, 0.0
    p_new, j_new, which, J = p, j, ELASTIC, (1.0, 0.0, 0.0, 1.0)
    floor = 1e-16 * (j + abs(p)) / μ
    for _ in range(TRIES):
        kappa = effective_strain(state[0] + Δκ, state, weight)
        (c, φ, ψ, tension), change = parameters_at(kappa, m, soil)
        cone = cone_of(c, φ, ψ, tension, matched)
        p_new, j_new, which = return_to_cone(p, j, cone, bulk, μ)
        found = (j - j_new) / (SQRT3 * μ)
        moved = cone_change(c, φ, ψ, tension, change, matched)
        dp, dj = change_of_cone_return(which, p, j, cone, moved, bulk, μ)
        slope = -through * dj / (SQRT3 * μ)
        a, b, c_, d = derivative(which, cone, bulk, μ)
        share = through / (SQRT3 * μ * (1.0 - slope))
        J = (
            a - dp * share * c_,
            b + dp * share * (1.0 - d),
            c_ - dj * share * c_,
            d + dj * share * (1.0 - d),
        )
        if abs(found - Δκ) <= 1e-14 * Δκ + floor:
            break
        Δκ, low, high = next_guess(Δκ, found - Δκ, slope - 1.0, low, high)
    return (p_new, j_new, which), Δκ, J


@jit
def _hardening(strain, stress, history, options, strengths, soil, outputs, want):
    λ, μ = options[0], options[1]
    bulk = λ + 2.0 / 3.0 * μ
    out, out_history, tangent = outputs
    for m in range(len(strain)):
        trial_stress(strain[m], stress[m], λ, μ, out[m])
        p, j = _invariants(out[m])
        into = tangent[m if want else 0]
        if not beyond_cone(p, j, _cone(strengths, m)) > 0.0:
            if want:
                elastic_stiffness(λ, μ, into)
            continue
        returned, Δκ, J = _harden(p, j, history[m], m, soil, options, bulk)
        out_history[m, 0] += Δκ
        _finish(out[m], (p, j), returned, J, (bulk, μ), out_history[m], into, want)


@jit
def _yields(strain, stress, at, of, lame, strengths, rows):
    """Write which of the pairs (strain row ``at``, state row ``of``) yield; return their number."""
    trial, found = np.empty(strain.shape[1]), 0
    for m in range(len(at)):
        trial_stress(strain[at[m]], stress[of[m]], lame[0], lame[1], trial)
        p, j = _invariants(trial)
        if beyond_cone(p, j, _cone(strengths, of[m])) > 0.0:
            rows[found] = m
            found += 1
    return found


@jit
def _excess(stress, strengths, out):
    """Write by how much stress rows are beyond the cone (n,)."""
    for m in range(len(stress)):
        p, j = _invariants(stress[m])
        out[m] = beyond_cone(p, j, _cone(strengths, m))


@dataclass(frozen=True)
class DruckerPrager(Frictional):
    """Elastic soil that yields where √J₂ + η p = k, p the mean stress, tension positive, or p = T.

    Parameters: ``elastic``; ``cohesion`` c (Pa), ``friction_angle`` φ and ``dilation_angle`` ψ
    (degrees, 0 <= ψ <= φ < 90), numbers or each a ``Curve`` of the plastic strain κ;
    ``matched_to``: where the cone is that of Mohr and Coulomb's planes of c, φ and ψ::

        COMPRESSION   η = 6 sin φ/(√3 (3 - sin φ)),  k = c η cot φ,  η̄ as η with ψ
        EXTENSION     the same with 3 + sin
        PLANE_STRAIN  η̄ = sin ψ/√(1 + sin²ψ/3),  η = w sin φ,  k = w c cos φ,
                      1/w = √(1 - η̄²/3) + η̄ sin φ/3

    The last holds where all strain is plastic.  ``tensile_strength`` T (Pa): the largest
    mean stress; None, or more than the apex c cot φ, is the apex.  ``length``, ``averaging``, the
    state variables and values given point by point are as of ``MohrCoulomb``.

    The return is of closed form (``cone``), Δκ = Δ√J₂/(√3 μ); with curves Δκ is the root of one
    equation around it.  Cohesion that falls so fast that a point snaps back is refused.
    Raises ``ValueError`` naming the parameter that is out of range.
    """

    elastic: LinearElastic
    cohesion: float | Curve
    friction_angle: float | Curve
    dilation_angle: float | Curve = 0.0
    matched_to: MatchedTo = MatchedTo.COMPRESSION
    tensile_strength: float | None = None
    length: float | None = None
    averaging: object | None = None

    columns = 4
    loops: ClassVar = {
        "strengths": _strengths,
        "perfect": _perfect,
        "hardening": _hardening,
        "yields": _yields,
        "excess": _excess,
    }

    def __post_init__(self) -> None:
        an_object("matched_to", self.matched_to, MatchedTo, "a MatchedTo, such as COMPRESSION")
        super().__post_init__()

    @property
    def _options(self):
        return (*super()._options, self.matched_to.value)

    def _steepest(self, friction: float, dilation: float) -> float:
        """Fall of the cohesion per unit κ (Pa) at which a point on the cone, or on its edge with
        the limit of p, snaps back."""
        λ, μ = self.lame
        η, k, flow, _ = cone_of(1.0, friction, dilation, np.inf, self.matched_to.value)
        stiff = μ if self.tensile_strength is not None else μ + (λ + 2 * μ / 3) * η * flow
        return SQRT3 * stiff / k
