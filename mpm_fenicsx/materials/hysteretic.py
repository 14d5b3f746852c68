"""Soil that is hysteretic from small strain on: elastic and perfectly plastic elements in parallel,
which obey Masing's rules."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..common import tensors
from ..common.checks import an_object, increasing, whole
from ..common.compiled import jit, once
from .backbone import Backbone
from .elastic import LinearElastic, OnElastic
from .law_checks import has
from .material import NOTHING, Given, checked_rows

SLACK = 1.0 + 1e-13  # of q²: an element at rest at its limit is elastic, whatever the rounding
DEVIATOR = "xx", "yy", "xy", "yz", "xz"  # zz follows
FIRST = 2  # of the columns of history that are stresses of elements
CONCAVE = 1e-2  # of the stress: by no more does a straight line replace a dent of the backbone
STRAIGHT = 1e-12  # of the stiffness: what counts as elastic still


@jit
def _trial(columns, increment, history, k, stiffness, out):
    """Write the deviator of element k, were it elastic; return its q²."""
    at, n = FIRST + 5 * k, len(columns)
    for i in range(2):
        out[i] = history[at + i]
    out[2] = -out[0] - out[1]
    for i in range(3, n):
        out[i] = history[at + i - 1]
    q2 = 0.0
    for i in range(n):
        out[i] += stiffness[k] * increment[i]
        q2 += (1.5 if i < 3 else 3.0) * out[i] ** 2
    return q2


@jit
def _deviator(columns, strain, out):
    """Write the deviator of an increment, shear strains halved; return its change of volume."""
    volume = strain[0] + strain[1] + strain[2]
    for i in range(len(columns)):
        out[i] = strain[i] - volume / 3.0 if i < 3 else 0.5 * strain[i]
    return volume


@jit
def _work(columns, stress, increment):
    """σ : Δe of a stress row and a deviator."""
    total = 0.0
    for i in range(len(columns)):
        total += (1.0 if i < 3 else 2.0) * stress[i] * increment[i]
    return total


@jit
def respond_point(columns, strain, stress, history, soil, work_space, out_stress, out_history):
    """Write stress and state variables of one point after an increment of strain.

    ``columns``: as many entries as a row (``once``); ``soil``: K (Pa), 2G and limits of q of the
    elements (N,), Pa; ``work_space`` (2, components).
    """
    bulk, stiffness, limit = soil
    increment, trial = work_space
    volume, n = _deviator(columns, strain, increment), len(columns)
    for i in range(n):
        out_stress[i] = stress[i] + bulk * volume if i < 3 else stress[i]
    plastic, begun = 0.0, _work(columns, stress, increment)
    for k in range(len(stiffness)):
        at, q2 = FIRST + 5 * k, _trial(columns, increment, history, k, stiffness, trial)
        ratio = 1.0
        if q2 > SLACK * limit[k] ** 2:
            ratio = limit[k] / math.sqrt(q2)
            plastic += ratio * (1.0 - ratio) * q2 / (1.5 * stiffness[k])
        for i in range(n):
            if i == 2:
                old = -history[at] - history[at + 1]
            else:
                old = history[at + (i if i < 2 else i - 1)]
            begun -= (1.0 if i < 3 else 2.0) * old * increment[i]
            out_stress[i] += ratio * trial[i] - old
        for i in range(5):
            out_history[at + i] = 0.0
        for i in range(2):
            out_history[at + i] = ratio * trial[i]
        for i in range(3, n):
            out_history[at + i - 1] = ratio * trial[i]
    out_history[0] = history[0] + plastic
    out_history[1] = history[1] + begun


@jit
def tangent_point(columns, history, soil, work_space, out):
    """Write ∂σ/∂ε of the increment that ``respond_point`` has left in ``work_space``."""
    bulk, stiffness, limit = soil
    increment, trial = work_space
    n, shear = len(columns), 0.0
    for i in range(n):
        for j in range(i, n):
            out[i, j] = 0.0
    for k in range(len(stiffness)):
        q2, ratio = _trial(columns, increment, history, k, stiffness, trial), 1.0
        if q2 > SLACK * limit[k] ** 2:
            ratio = limit[k] / math.sqrt(q2)
            loss = 1.5 * stiffness[k] * ratio / q2
            for i in range(n):
                for j in range(i, n):
                    out[i, j] -= loss * trial[i] * trial[j]
        shear += stiffness[k] * ratio
    for i in range(n):
        for j in range(i, 3):
            out[i, j] += bulk - shear / 3.0
        out[i, i] += shear if i < 3 else 0.5 * shear
        for j in range(i):
            out[i, j] = out[j, i]


@jit
def _respond(columns, strain, stress, history, soil, out_stress, out_history):
    work_space = np.empty((2, strain.shape[1]))
    for p in range(len(strain)):
        respond_point(
            columns,
            strain[p],
            stress[p],
            history[p],
            soil,
            work_space,
            out_stress[p],
            out_history[p],
        )


@jit
def _tangent(columns, strain, stress, history, soil, out_stress, out_history, out):
    work_space = np.empty((2, strain.shape[1]))
    for p in range(len(strain)):
        respond_point(
            columns,
            strain[p],
            stress[p],
            history[p],
            soil,
            work_space,
            out_stress[p],
            out_history[p],
        )
        tangent_point(columns, history[p], soil, work_space, out[p])


@jit
def _yields(columns, strain, history, at, of, soil, rows):
    """Write in which of the pairs an element flows; return their number."""
    _, stiffness, limit = soil
    increment, trial = np.empty(strain.shape[1]), np.empty(strain.shape[1])
    found = 0
    for m in range(len(at)):
        state = history[of[m]]
        _deviator(columns, strain[at[m]], increment)
        for k in range(len(stiffness)):
            q2 = _trial(columns, increment, state, k, stiffness, trial)
            if q2 > SLACK * limit[k] ** 2:
                rows[found] = m
                found += 1
                break
    return found


@dataclass(frozen=True)
class Hysteretic(OnElastic):
    """Soil with a ``backbone`` in shear that obeys Masing's rules, in any direction of shear.

    Parameters: ``elastic``, whose G is that of the smallest strains; ``backbone``, such as
    ``Hyperbolic(1e-3)`` or ``ReductionCurve(strain, ratio)``; ``elements`` N ≥ 2; ``range``, the
    first and the last of the strains at which the backbone is met, by default the backbone's own.

    N von Mises elements bear the deviatoric stress in parallel (Iwan 1967), each elastic and
    perfectly plastic, s = Σ s_k, q_k ≤ √3 G_k b_k.  In simple shear that is the backbone as a chain
    of straight lines that meets it at N strains γ_i in geometric progression: breaks are at γ_2, …
    γ_N, and where the first chord, made longer, meets τ = G γ, so that ΣG_k = G. Beyond the last
    strain the stress stays.  Unloading and reloading are the backbone, twice as large; a closed
    cycle of strain is a closed loop; ``damping_ratio`` and ``reduction`` are those of the elements.

    Dents of a measured backbone, up to 1 % of its stress, are bridged by straight lines.  The
    change of volume is elastic, and strength does not depend on pressure.  Elements start without
    stress, whatever the points' initial stress: that is where strain is counted from.  State
    variables: ``plastic_work`` (J/m³); the work of the deviatoric initial stress (J/m³), which is
    none but where there is one; five stresses of each element (Pa).  Stored energy is p²/2K + Σ
    s_k:s_k/4G_k and that work.

    Raises ``ValueError`` naming what is out of range, and where a backbone is dented more.
    """

    elastic: LinearElastic
    backbone: Backbone
    elements: int = 15
    range: tuple[float, float] | None = None

    keeps_volume = True

    def __post_init__(self) -> None:
        such = "a LinearElastic, such as LinearElastic(80e6, 0.3, 1900.0)"
        an_object("elastic", self.elastic, LinearElastic, such)
        if self.elastic.kinematics.finite:
            raise ValueError(
                f"elastic must be one of small strain, got {self.elastic!r}: stresses of elements "
                "do not turn with the soil, take LinearElastic"
            )
        has("backbone", self.backbone, ("reduction", "range"))
        object.__setattr__(self, "elements", whole("elements", self.elements, least=2))
        if self.range is not None:
            low, *_, high = (float(x) for x in increasing("range", self.range))
            if len(self.range) != 2 or low <= 0.0:
                raise ValueError(f"range must be two strains above 0, got {self.range}")
            object.__setattr__(self, "range", (low, high))
        _ = self.chain

    @cached_property
    def history(self) -> tuple[str, ...]:
        """Plastic work, the work of the initial stress, and the stresses of the elements."""
        names = (f"element_{k}_{c}" for k in range(1, len(self.chain[0]) + 1) for c in DEVIATOR)
        return ("plastic_work", "initial_stress_work", *names)

    @cached_property
    def chain(self) -> tuple[np.ndarray, np.ndarray]:
        """Strains b_k at which elements begin to flow, and their shear moduli G_k (Pa), (N,)
        each."""
        γ = np.geomspace(*(self.range or self.backbone.range), self.elements)
        ratio = np.asarray(self.backbone.reduction(γ), float)
        if ratio.shape != γ.shape or not ((ratio > 0.0) & (ratio <= 1.0 + STRAIGHT)).all():
            raise ValueError(f"reduction of backbone must be above 0 and at most 1, got {ratio}")
        strain, stress = _concave(γ, γ * np.minimum(ratio, 1.0))
        straight = int((stress > strain * (1.0 - STRAIGHT)).sum())
        if straight:  # the last point of the elastic line is where it ends
            strain, stress = strain[straight - 1 :], stress[straight - 1 :]
        slopes = np.diff(stress) / np.diff(strain)
        breaks = strain.copy()
        if not straight and len(slopes):
            breaks[0] = (stress[0] - slopes[0] * strain[0]) / (1.0 - slopes[0])
        moduli = -np.diff(np.concatenate(([1.0], slopes, [0.0]))) * self.lame[1]
        bearing = moduli > 0.0  # but for one at the end of a backbone that gets flat
        return breaks[bearing], moduli[bearing]

    @property
    def nodes(self) -> np.ndarray:
        """Strains (N,) at which the elements bear the backbone's stress, but for dents."""
        return np.geomspace(*(self.range or self.backbone.range), self.elements)

    def shear_stress(self, strain) -> np.ndarray:
        """τ (n,), Pa, of the elements in a first loading to shear strains γ (n,)."""
        breaks, moduli = self.chain
        γ = np.asarray(strain, float)[..., None]
        return (moduli * np.sign(γ) * np.minimum(np.abs(γ), breaks)).sum(axis=-1)

    def reduction(self, strain) -> np.ndarray:
        """G_secant/G (n,) of the elements at strains γ (n,)."""
        breaks, moduli = self.chain
        γ = np.maximum(np.abs(np.asarray(strain, float)), np.finfo(float).tiny)[..., None]
        return (moduli * np.minimum(1.0, breaks / γ)).sum(axis=-1) / self.lame[1]

    def damping_ratio(self, strain) -> np.ndarray:
        """ξ (n,), of 1, of the elements in cycles between −γ and γ (n,): (2/π) (2 ∫τ dγ/τγ − 1)."""
        breaks, moduli = self.chain
        γ = np.maximum(np.abs(np.asarray(strain, float)), 1e-100)[..., None]
        area = moduli * np.where(γ < breaks, 0.5 * γ**2, breaks * (γ - 0.5 * breaks))
        whole_area = self.shear_stress(γ[..., 0]) * γ[..., 0]
        ratio = 2.0 / np.pi * (2.0 * area.sum(axis=-1) / whole_area - 1.0)
        return np.maximum(ratio, 0.0)  # while elastic: zero, but for round-off

    def respond(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray]:
        """Stress (n, components), Pa, and history (n, 2 + 5N) after the strain increments
        ``strain`` (n, components)."""
        inputs, outputs = self._prepare(strain, stress, history)
        _respond(*inputs, *outputs)
        return outputs

    def tangent(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``respond`` and the consistent tangent ∂σ/∂ε (n, components, components), Pa."""
        inputs, outputs = self._prepare(strain, stress, history)
        out = np.empty((*outputs[0].shape, outputs[0].shape[1]))
        _tangent(*inputs, *outputs, out)
        return *outputs, out

    def yields(self, strain, stress, history, at, of, given: Given = NOTHING) -> np.ndarray:
        """In which of the pairs of a strain increment, row ``at`` (m,), and a state, row ``of``
        (m,), an element flows: (k,) rows."""
        strain, history = (np.ascontiguousarray(a, float) for a in (strain, history))
        rows = np.empty(len(at), np.int32)
        found = _yields(once(strain.shape[1]), strain, history, at, of, self._numbers, rows)
        return rows[:found]

    def energy(self, stress: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
        """p²/2K, what the elements store, and the work of the initial stress (n,), J/m³."""
        if history is None:
            raise ValueError("history is needed for the stresses of elements, got None")
        bulk, stiffness, _ = self._numbers
        s = history[:, FIRST:].reshape(len(history), -1, 5)
        squares = (s[..., :2] ** 2).sum(axis=-1) + (s[..., 0] + s[..., 1]) ** 2
        squares = squares + 2.0 * (s[..., 2:] ** 2).sum(axis=-1)
        shear = (squares / (2.0 * stiffness)).sum(axis=1)
        return tensors.mean(stress) ** 2 / (2.0 * bulk) + shear + history[:, 1]

    @cached_property
    def _numbers(self) -> tuple[float, np.ndarray, np.ndarray]:
        """What the compiled loops know: K, 2G and limits of q of the elements, Pa."""
        (λ, μ), (breaks, moduli) = self.lame, self.chain
        return λ + 2.0 * μ / 3.0, 2.0 * moduli, math.sqrt(3.0) * moduli * breaks

    def _prepare(self, strain, stress, history):
        """Arrays of the kernels, refused unless their shapes agree: compiled loops do not look."""
        strain, stress, history = checked_rows(
            strain, stress, history, FIRST + 5 * len(self.chain[0])
        )
        inputs = once(strain.shape[1]), strain, stress, history, self._numbers
        return inputs, (np.empty_like(stress), np.empty_like(history))


def _concave(strain: np.ndarray, stress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points that bound the backbone from above, seen from the origin; refused where others
    lie more than ``CONCAVE`` below."""
    x, y = np.append(0.0, strain), np.append(0.0, stress)
    kept = [0]
    for k in np.arange(1, len(x)):
        while len(kept) > 1 and _slope(x, y, kept[-2], kept[-1]) <= _slope(x, y, kept[-1], k):
            kept.pop()
        kept.append(k)
    on_line = np.interp(strain, x[kept], y[kept])
    dent = 1.0 - stress / on_line
    if (np.diff(y[kept]) < 0.0).any() or dent.max() > CONCAVE:
        k = int(dent.argmax())
        raise ValueError(
            "backbone must rise and get flatter with strain, for elements cannot stiffen, got "
            f"stress that is {100 * dent[k]:.2g} % too low at the strain {strain[k]:.4g}: smooth "
            "it, or take fewer elements or a smaller range"
        )
    return x[kept[1:]], y[kept[1:]]


def _slope(x: np.ndarray, y: np.ndarray, a: int, b: int) -> float:
    return (y[b] - y[a]) / (x[b] - x[a])
