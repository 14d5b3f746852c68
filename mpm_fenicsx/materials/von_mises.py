"""Von Mises plasticity with linear softening of the cohesion, and its consistent tangent.

``respond_point`` and ``tangent_point`` take one row each and are meant for calls from other
compiled loops.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..common.checks import an_object, finite, positive
from ..common.compiled import jit
from .elastic import LinearElastic, OnElastic
from .material import NOTHING, Given, checked_rows
from .over_nonlocal import AVERAGE, OverNonlocal

SQRT3 = math.sqrt(3.0)
SLACK = 1.0 + 1e-13  # of q²: a point at rest on the yield surface is elastic, whatever the rounding


@jit
def _trial(strain, stress, lame, out):
    """Write the elastic trial stress; return its mean and q²."""
    λ, μ = lame
    volumetric = λ * (strain[0] + strain[1] + strain[2])
    for i in range(3):
        out[i] = stress[i] + 2.0 * μ * strain[i] + volumetric
    mean = (out[0] + out[1] + out[2]) / 3.0
    q2 = 1.5 * ((out[0] - mean) ** 2 + (out[1] - mean) ** 2 + (out[2] - mean) ** 2)
    for i in range(3, len(strain)):
        out[i] = stress[i] + μ * strain[i]
        q2 += 3.0 * out[i] ** 2
    return mean, q2


@jit
def _flow(q2, kappa, μ, strength):
    """Return κ, the ratio r = q/q_trial and b = -∂q/∂q_trial after plastic flow; (κ, 1, -1)
    without."""
    peak, residual, h = strength
    c = max(residual, peak - h * kappa)
    if not q2 > SLACK * 3.0 * c * c:
        return kappa, 1.0, -1.0
    q = math.sqrt(q2)
    soft = (q - SQRT3 * (peak - h * kappa)) / (3.0 * μ - SQRT3 * h)
    flat = (q - SQRT3 * residual) / (3.0 * μ)
    b = 0.0
    if soft < flat:
        b = SQRT3 * h / (3.0 * μ - SQRT3 * h)
    kappa += max(0.0, min(soft, flat))
    return kappa, SQRT3 * max(residual, peak - h * kappa) / q, b


@jit
def _scale(mean, ratio, out):
    """Bring the trial stress back along its deviator."""
    for i in range(3):
        out[i] = mean + ratio * (out[i] - mean)
    for i in range(3, len(out)):
        out[i] *= ratio


@jit
def respond_point(strain, stress, kappa, lame, strength, out_stress):
    """Write the stress after the increment ``strain`` (4 or 6 numbers) and return κ.

    ``lame`` (λ, μ); ``strength`` (peak, residual, softening h of this point), 3μ - √3 h > 0; all
    Pa.  ``out_stress`` may be ``stress`` itself.
    """
    mean, q2 = _trial(strain, stress, lame, out_stress)
    kappa, ratio, _ = _flow(q2, kappa, lame[1], strength)
    if ratio != 1.0:
        _scale(mean, ratio, out_stress)
    return kappa


@jit
def tangent_point(strain, stress, kappa, lame, strength, out_stress, out_tangent):
    """``respond_point`` that also writes ∂σ/∂ε, for engineering shear strains, into
    ``out_tangent``."""
    λ, μ = lame
    mean, q2 = _trial(strain, stress, lame, out_stress)
    kappa, ratio, b = _flow(q2, kappa, μ, strength)
    n = len(strain)
    off = λ + 2.0 / 3.0 * μ * (1.0 - ratio)
    for i in range(n):
        for j in range(n):
            out_tangent[i, j] = off if i < 3 and j < 3 else 0.0
        out_tangent[i, i] += 2.0 * μ * ratio if i < 3 else μ * ratio
    if ratio != 1.0:
        loss = 3.0 * μ * (ratio + b) / q2
        for i in range(n):
            s = out_stress[i] - mean if i < 3 else out_stress[i]
            for j in range(n):
                out_tangent[i, j] -= loss * s * (out_stress[j] - mean if j < 3 else out_stress[j])
        _scale(mean, ratio, out_stress)
    return kappa


@jit
def _of_point(strength, p):
    """Peak, residual and softening of point p, of columns (n,) or (1,)."""
    peak, residual, softening = strength
    return (
        peak[p if len(peak) > 1 else 0],
        residual[p if len(residual) > 1 else 0],
        softening[p if len(softening) > 1 else 0],
    )


@jit
def _respond(strain, stress, history, lame, strength, out_stress, out_history):
    for p in range(len(strain)):
        out_history[p, 0] = respond_point(
            strain[p], stress[p], history[p, 0], lame, _of_point(strength, p), out_stress[p]
        )


@jit
def _tangent(strain, stress, history, lame, strength, out_stress, out_history, out):
    for p in range(len(strain)):
        out_history[p, 0] = tangent_point(
            strain[p], stress[p], history[p, 0], lame, _of_point(strength, p), out_stress[p], out[p]
        )


@jit
def _yields(strain, stress, history, at, of, lame, strength, rows):
    """Write which of the pairs (strain row ``at``, state row ``of``) yield; return their number.

    q is a norm: a pair is within the surface where q of the state and q of the increment add up to
    less than the strength, which spares it the sum of their rows.
    """
    none, trial = np.zeros(strain.shape[1]), np.empty(strain.shape[1])
    grows, room = np.empty(len(strain)), np.empty(len(stress))
    for e in range(len(strain)):
        grows[e] = np.sqrt(_trial(strain[e], none, lame, trial)[1])
    for p in range(len(stress)):
        peak, residual, h = _of_point(strength, p)
        limit = SQRT3 * max(residual, peak - h * history[p, 0])
        room[p] = limit - np.sqrt(_trial(none, stress[p], lame, trial)[1])
    found = 0
    for m in range(len(at)):
        p = of[m]
        if grows[at[m]] < room[p]:
            continue
        q2 = _trial(strain[at[m]], stress[p], lame, trial)[1]
        peak, residual, h = _of_point(strength, p)
        c = max(residual, peak - h * history[p, 0])
        if q2 > SLACK * 3.0 * c * c:
            rows[found] = m
            found += 1
    return found


@dataclass(frozen=True)
class VonMises(OnElastic):
    """Elastic soil that yields at q = √3 c(κ), with c = max(residual, peak - h κ).

    Parameters: ``elastic``; ``peak`` and ``residual`` cohesion (Pa); ``softening`` h (Pa per unit
    κ); ``length`` (m), the cell size at which ``softening`` was found.  With it a point of size d
    softens with h d / length, so that a band one cell wide takes the same energy per area on every
    grid; ``size`` is then required, and has to stay the same through a point's life.  Without it
    ``size`` is ignored.  ``averaging``, in place of ``length``: strengths go by the plastic strain
    averaged over a length of its own, c = max(residual, peak - h (m κ̄ + (1 - m) κ)), in which the
    run refreshes κ̄ between steps; where κ runs ahead of κ̄, c rises, beyond the peak too.
    ``peak`` and ``residual`` may be given point by point.

    The history is κ = ∫ √(⅔ dεᵖ:dεᵖ), with ``averaging`` also plastic work (J/m³) and κ̄.  Flow is
    dεᵖ = dγ ∂q/∂σ = dγ 3s/2q, and s:s = ⅔ q², hence dκ = dγ and σ:dεᵖ = q dκ; in simple shear κ =
    γᵖ/√3.  Backward Euler keeps the mean stress and the direction of s:

        q + 3μ Δκ = q_trial,  q = √3 c(κ + Δκ)
        softening  Δκ = (q_trial - √3 (peak - h κ)) / (3μ - √3 h)
        residual   Δκ = (q_trial - √3 residual) / 3μ

    c being the larger of two lines, Δκ is the smaller of the two roots.  It is the only one while
    3μ Δκ grows faster than √3 c falls, 3μ > √3 h; beyond, q would have to fall while the strain
    runs back: snap-back.  At a given κ̄ the same equations hold with peak - h m κ̄ and h (1 - m) in
    place of peak and h, and there is none.  With r = q/q_trial, and b = √3 h/(3μ - √3 h) while
    softening or 0 at residual, the tangent is

        K 1⊗1 + 2μ r I_dev - 3μ (r + b) s⊗s / q²   (s/q as in the trial).

    Raises ``ValueError`` naming the parameter that is out of range.  See Simo and Hughes,
    Computational Inelasticity (1998), section 3.3.
    """

    elastic: LinearElastic
    peak: float
    residual: float
    softening: float
    length: float | None = None
    averaging: OverNonlocal | None = None

    parameters = ("peak", "residual")
    keeps_volume = True

    def __post_init__(self) -> None:
        if not isinstance(self.elastic, LinearElastic):
            raise ValueError(f"elastic must be a LinearElastic, got {self.elastic!r}")
        object.__setattr__(self, "peak", positive("peak", self.peak))
        for name in ("residual", "softening"):
            number = finite(name, getattr(self, name))
            if number < 0.0:
                raise ValueError(f"{name} must not be negative, got {number}")
            object.__setattr__(self, name, number)
        if self.residual > self.peak:
            raise ValueError(f"residual must not exceed peak = {self.peak}, got {self.residual}")
        if self.length is not None:
            object.__setattr__(self, "length", positive("length", self.length))
        if self.averaging is not None:
            an_object("averaging", self.averaging, OverNonlocal, "an OverNonlocal(length)")
            if self.length is not None:
                raise ValueError(
                    "length must be None with averaging, which brings a length of its own, got "
                    f"{self.length}"
                )
        elif not 3.0 * self.lame[1] - SQRT3 * self.softening > 0.0:
            limit = f"√3 G = {SQRT3 * self.lame[1]}"
            raise ValueError(
                f"softening must stay below {limit}, where a point snaps back, got {self.softening}"
            )

    @property
    def history(self) -> tuple[str, ...]:
        """Names of the state variables."""
        if self.averaging is None:
            return ("plastic_strain",)
        return ("plastic_strain", "plastic_work", AVERAGE)

    @property
    def young(self) -> float:
        """E (Pa)."""
        return self.elastic.young

    @property
    def poisson(self) -> float:
        """ν (-)."""
        return self.elastic.poisson

    def modulus(self, given: Given = NOTHING) -> np.ndarray:
        """Softening modulus (n,) or (1,), Pa, of points of ``size`` (m).

        Raises ``ValueError`` where ``size`` is missing, not positive, or so large that a point
        snaps back.
        """
        if self.length is None:
            return np.array([self.softening])
        if "size" not in given:
            raise ValueError(f"size is required, because length = {self.length} is given, got None")
        size = np.atleast_1d(np.asarray(given["size"], float))
        for d in (size.min(initial=self.length), size.max(initial=self.length)):
            positive("size", d)
            if not 3.0 * self.lame[1] - SQRT3 * self.softening * d / self.length > 0.0:
                limit = SQRT3 * self.lame[1] * self.length / self.softening
                raise ValueError(f"size must stay below {limit}, where a point snaps back, got {d}")
        return self.softening * size / self.length

    def respond(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray]:
        """Stress (n, components), Pa, and history (n, k) after the strain increments ``strain`` (n,
        components)."""
        inputs, outputs = self._prepare(strain, stress, history, given)
        _respond(*inputs, *outputs)
        self._add_work(inputs, outputs[1])
        return outputs

    def tangent(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``respond`` and the consistent tangent ∂σ/∂ε (n, components, components), Pa, in one
        pass."""
        inputs, outputs = self._prepare(strain, stress, history, given)
        out = np.empty((*outputs[0].shape, outputs[0].shape[1]))
        _tangent(*inputs, *outputs, out)
        self._add_work(inputs, outputs[1])
        return *outputs, out

    def yields(self, strain, stress, history, at, of, given: Given = NOTHING) -> np.ndarray:
        """Which of the pairs of a strain increment, row ``at`` (m,), and a state, row ``of`` (m,),
        yield: (k,) rows."""
        strain, stress, history = (
            np.ascontiguousarray(a, float) for a in (strain, stress, history)
        )
        rows = np.empty(len(at), np.int32)
        found = _yields(
            strain, stress, history, at, of, self.lame, self._strengths(history, given), rows
        )
        return rows[:found]

    def strength(self, history, given: Given = NOTHING) -> np.ndarray:
        """Yield value of q (n,), Pa."""
        return _strength(self._strengths(history, given), history[:, 0])

    def dissipation(self, before, after, given: Given = NOTHING) -> np.ndarray:
        """Plastic work per volume (n,), J/m³, between two histories: backward Euler, σ_after : Δεᵖ
        = q_after Δκ."""
        if self.averaging is not None:
            return after[:, 1] - before[:, 1]
        return self.strength(after, given) * (after[:, 0] - before[:, 0])

    def plastic_work(self, history, given: Given = NOTHING) -> np.ndarray:
        """Plastic work per volume (n,), J/m³, since κ = 0: ∫ q dκ, with ``averaging`` the sum of
        ``dissipation``, for κ̄ is no function of κ."""
        if self.averaging is not None:
            return history[:, 1]
        κ = history[:, 0]
        peak, residual, h = self._strengths(history, given)
        soft = np.where(h * κ < peak - residual, κ, (peak - residual) / np.maximum(h, 1e-300))
        return SQRT3 * (peak * soft - 0.5 * h * soft**2 + residual * (κ - soft))

    def _strengths(
        self, history: np.ndarray, given: Given
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Peak, residual and softening, Pa, (n,) where they differ from point to point, else (1,):
        those of c as a function of κ, at the κ̄ of the ``history`` (n, k)."""
        n = len(history)
        peak, residual = (
            np.atleast_1d(np.asarray(given.get(name, getattr(self, name)), float))
            for name in self.parameters
        )
        modulus = self.modulus(given)
        for name, column in (("peak", peak), ("residual", residual), ("size", modulus)):
            if column.shape not in ((1,), (n,)):
                raise ValueError(
                    f"{name} must be a number or have shape ({n},), got shape {column.shape}"
                )
        if "peak" in given or "residual" in given:
            bad = np.flatnonzero(~((peak > 0.0) & (residual >= 0.0) & (residual <= peak)))
            if len(bad):
                values = np.broadcast_arrays(peak, residual)
                raise ValueError(
                    "peak must be positive, and residual from 0 to peak, at every point, got "
                    f"{values[0][bad[0]]} and {values[1][bad[0]]}"
                )
        if self.averaging is None:
            return peak, residual, modulus
        weight = self.averaging.weight
        return peak - modulus * weight * history[:, 2], residual, modulus * (1.0 - weight)

    def _add_work(self, inputs: tuple, after: np.ndarray) -> None:
        """Plastic work of the increments, where it is a state variable."""
        if self.averaging is None:
            return
        before, strength = inputs[2], inputs[4]
        after[:, 1] += _strength(strength, after[:, 0]) * (after[:, 0] - before[:, 0])

    def _prepare(self, strain, stress, history, given: Given):
        """Arrays of the kernels, refused unless their shapes agree: compiled loops do not look."""
        strain, stress, history = checked_rows(strain, stress, history, len(self.history))
        inputs = strain, stress, history, self.lame, self._strengths(history, given)
        return inputs, (np.empty_like(stress), history.copy())


def _strength(strengths: tuple, kappa: np.ndarray) -> np.ndarray:
    """Yield value of q (n,), Pa, at κ (n,)."""
    peak, residual, h = strengths
    return SQRT3 * np.maximum(residual, peak - h * kappa)
