"""What laws with cohesion and friction have in common: their parameters, which may follow the
plastic strain and differ from point to point, and what is refused of them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from ..common.checks import finite, positive
from ..common.compiled import jit
from .curve import Curve, stacked, value_at
from .elastic import LinearElastic, OnElastic
from .material import NOTHING, Given, checked_rows

NAMES = ("cohesion", "friction_angle", "dilation_angle")
RADIANS = 0.9
"""Degrees: angles of friction below are likely radians (0.9 are 52°)."""
OUTSIDE = 1e-6
"""Of the stress: so far beyond the yield surface may a stress given at the start be."""


@jit
def parameters_at(kappa, p, soil):
    """Return c, φ, ψ and T of point p at κ (Pa, radians), and how the first three change with
    κ."""
    curves, factor, tension, scale = soil
    stretch = scale[p if len(scale) > 1 else 0]
    times = factor[p if len(factor) > 1 else 0]
    c, dc = value_at(curves, 0, kappa, stretch)
    φ, dφ = value_at(curves, 1, kappa, stretch)
    ψ, dψ = value_at(curves, 2, kappa, stretch)
    change = times[0] * dc, times[1] * dφ, times[2] * dψ
    limit = tension[p if len(tension) > 1 else 0]
    return (times[0] * c, times[1] * φ, times[2] * ψ, limit), change


@jit
def angles_stay(curves):
    """Whether neither angle follows κ."""
    value = curves[1]
    for which in (1, 2):
        for k in range(value.shape[1]):
            if value[which, k] != value[which, 0]:
                return False
    return True


@jit
def strengths_at(kappa, p, soil, steady):
    """Return what ``parameters_at`` does but for the changes; ``steady``: the angles stay."""
    if not steady:
        return parameters_at(kappa, p, soil)[0]
    curves, factor, tension, scale = soil
    times = factor[p if len(factor) > 1 else 0]
    c, _ = value_at(curves, 0, kappa, scale[p if len(scale) > 1 else 0])
    value, limit = curves[1], tension[p if len(tension) > 1 else 0]
    return times[0] * c, times[1] * value[1, 0], times[2] * value[2, 0], limit


@jit
def effective_strain(kappa, state, weight):
    """Return the κ that strengths go by: of a state (columns,) with a non-local strain κ̄,
    ``weight`` κ̄ + (1 - ``weight``) κ, else κ itself."""
    if len(state) < 3:
        return kappa
    return weight * state[2] + (1.0 - weight) * kappa


class Frictional(OnElastic):
    """A law with the fields ``elastic``, ``cohesion``, ``friction_angle``, ``dilation_angle``,
    ``tensile_strength``, ``length`` and ``averaging``.

    State variables are κ = ∫ √(⅔ deᵖ:deᵖ), eᵖ the deviator of plastic strain, and plastic work
    (J/m³), σ_after : Δεᵖ summed; with ``averaging`` also κ̄, which the run refreshes.  Heirs have
    compiled loops and ``_steepest``.
    """

    elastic: LinearElastic
    cohesion: float | Curve
    friction_angle: float | Curve
    dilation_angle: float | Curve
    tensile_strength: float | None
    length: float | None
    averaging: object | None

    parameters = (*NAMES, "tensile_strength")
    keeps_volume = True

    columns: ClassVar[int]
    """Numbers in a row of strengths."""
    loops: ClassVar[dict[str, Callable]]
    """"strengths", "perfect", "hardening", "yields" and "excess"."""

    def __post_init__(self) -> None:
        if not isinstance(self.elastic, LinearElastic):
            raise ValueError(f"elastic must be a LinearElastic, got {self.elastic!r}")
        if self.tensile_strength is not None:
            tension = finite("tensile_strength", self.tensile_strength)
            if tension < 0.0:
                raise ValueError(f"tensile_strength must not be negative, got {tension}")
            object.__setattr__(self, "tensile_strength", tension)
        self._check_lengths()
        values = [getattr(self, name) for name in NAMES]
        follows = [isinstance(value, Curve) for value in values]
        object.__setattr__(self, "perfect", not any(follows))
        for name, value, follow in zip(NAMES, values, follows, strict=True):
            if name in self.parameters and not follow:
                object.__setattr__(self, name, finite(name, value))
        # a number is that many times a curve of ones
        own = [1.0 if f else float(v) for v, f in zip(values, follows, strict=True)]
        curves = [v if f else Curve((0.0,), (1.0,)) for v, f in zip(values, follows, strict=True)]
        object.__setattr__(self, "_factor", np.array([own]))
        object.__setattr__(self, "_curves", curves)
        self._check_ranges(self._factor)
        self._warn_of_radians()
        self._warn_of_a_late_rise()
        strain, value, softens_from = stacked(curves)
        value[1:] = np.radians(value[1:])
        object.__setattr__(self, "_stacked", (strain, value, softens_from))
        self._check_snap_back(self._factor, np.ones(1))

    @property
    def history(self) -> tuple[str, ...]:
        """Names of the state variables."""
        names = ("plastic_strain", "plastic_work")
        return names if self.averaging is None else (*names, "nonlocal_strain")

    @property
    def symmetric(self) -> bool:
        """The tangent is, where flow is associated and nothing follows κ."""
        return self.perfect and self.friction_angle == self.dilation_angle

    # -- checks ------------------------------------------------------------------------------------

    def _check_lengths(self) -> None:
        if self.length is not None:
            object.__setattr__(self, "length", positive("length", self.length))
        if self.averaging is None:
            return
        if self.length is not None:
            raise ValueError(
                f"length must be None with averaging, which brings a length of its own, got "
                f"{self.length}"
            )
        if not all(hasattr(self.averaging, name) for name in ("length", "weight")):
            raise ValueError(f"averaging must be an OverNonlocal(length), got {self.averaging!r}")
        for name in ("length", "weight"):
            positive(f"{name} of averaging", getattr(self.averaging, name))

    def _check_ranges(self, factor: np.ndarray) -> None:
        """Refuse values out of range, of curves times factors (n, 3)."""
        _, φ, ψ = self._curves
        lowest, highest = (
            factor * [f(curve.value) for curve in self._curves] for f in (min, max)
        )  # factors are positive
        for k, name in enumerate(NAMES):
            _refuse_rows(lowest[:, k] < 0.0, f"{name} must not be negative", lowest[:, k])
        _refuse_rows(
            highest[:, 1] >= 90.0, "friction_angle must be below 90 degrees", highest[:, 1]
        )
        friction, dilation = factor[:, 1:2] * φ(self._knots), factor[:, 2:3] * ψ(self._knots)
        over = dilation - friction
        row, k = np.unravel_index(np.argmax(over), over.shape)
        if over[row, k] > 1e-12 * friction[row, k]:
            raise ValueError(
                f"dilation_angle must not exceed friction_angle = {friction[row, k]}, for flow "
                f"would give energy, got {dilation[row, k]}{_at(row, len(factor))}"
            )
        none = (lowest[:, 0] == 0.0) & (lowest[:, 1] == 0.0)
        _refuse_rows(none, "cohesion must be positive where friction_angle is zero", lowest[:, 0])

    def _warn_of_radians(self) -> None:
        """Warn of a friction angle that would be a common one in radians."""
        largest = float(self._factor[0, 1] * max(self._curves[1].value))
        if 0.0 < largest < RADIANS:
            warnings.warn(
                f"friction_angle is in degrees, and {largest:g} is hardly any friction: an angle "
                f"in radians is np.degrees({largest:g}) = {np.degrees(largest):.3g}",
                UserWarning,
                stacklevel=4,
            )

    def _warn_of_a_late_rise(self) -> None:
        """Warn of strength that rises, but not from κ = 0 on: a curve is constant before its first
        point, and soil under loads flows there without anything that holds it."""
        for name in NAMES[:2]:
            curve = getattr(self, name)
            if not isinstance(curve, Curve) or len(curve.value) < 2:
                continue
            first = curve.plastic_strain[0]
            if first > 0.0 and curve.value[1] > curve.value[0]:
                warnings.warn(
                    f"{name} rises only from plastic_strain = {first:g} on and is constant before, "
                    "where soil under loads flows freely, and statics find no equilibrium: begin "
                    "the curve at plastic_strain 0 if the soil hardens from first yield on",
                    UserWarning,
                    stacklevel=4,
                )

    def _check_snap_back(self, factor: np.ndarray, scale: np.ndarray) -> None:
        """Refuse cohesion that falls so fast with κ that a point snaps back; ``factor`` (n, 3) of
        the curves, ``scale`` (n,) of the softening part."""
        slopes = self._curves[0].slopes
        if not len(slopes) or not slopes.min() < 0.0:
            return
        back = 1.0 if self.averaging is None else 1.0 - self.averaging.weight
        if back <= 0.0:
            return  # at a given κ̄ the cohesion rises with κ
        least = factor[:, 1:].min(axis=0)
        angles = [
            np.radians(f * c(self._knots)) for f, c in zip(least, self._curves[1:], strict=True)
        ]
        limit = min(map(self._steepest, *angles)) / back
        steepest = -slopes.min() * factor[:, 0] * scale
        row = int(np.argmax(steepest))
        if steepest[row] < limit:
            return
        if self.length is not None and scale[row] != 1.0:
            largest = limit * self.length / (-slopes.min() * factor[row, 0])
            raise ValueError(
                f"size must stay below {largest}, where a point snaps back, got "
                f"{scale[row] * self.length}"
            )
        raise ValueError(
            f"cohesion must not fall by {limit} Pa or more per unit of plastic strain, where a "
            f"point snaps back, got {steepest[row]}{_at(row, len(steepest))}"
        )

    @property
    def _knots(self) -> np.ndarray:
        """κ at which the angles may have their extremes."""
        return np.union1d(*(curve.plastic_strain for curve in self._curves[1:]))

    def _steepest(self, friction: float, dilation: float) -> float:
        """Fall of the cohesion per unit κ (Pa) at which a point snaps back at φ and ψ, radians."""
        raise NotImplementedError

    # -- parameters --------------------------------------------------------------------------------

    def _scale(self, given: Given) -> np.ndarray:
        """Factors (n,) or (1,) of κ in the softening part of curves: size/length."""
        if self.length is None:
            return np.ones(1)
        if "size" not in given:
            raise ValueError(f"size is required, because length = {self.length} is given, got None")
        size = np.atleast_1d(np.asarray(given["size"], float))
        bad = np.flatnonzero(~(size > 0.0))
        if len(bad):
            raise ValueError(f"size must be positive, got {size[bad[0]]}{_at(bad[0], len(size))}")
        return size / self.length

    def _soil(self, n: int, given: Given):
        """What ``parameters_at`` reads: curves, factors (n, 3) or (1, 3), T and scale, (n,) or
        (1,).

        A value that is given for a point takes the place of a number, and of the first value of a
        curve, which it scales.
        """
        limit = np.inf if self.tensile_strength is None else self.tensile_strength
        factor, tension = self._factor, np.array([limit])
        if not n:
            return self._stacked, factor, tension, np.ones(1)
        scale = self._scale(given)
        own = [name for name in NAMES if name in given]
        if own:
            factor = np.repeat(factor, n, axis=0)
            for name in own:
                k = NAMES.index(name)
                first = self._curves[k].value[0]
                if first == 0.0:
                    raise ValueError(
                        f"{name} must not begin at 0 where points are given their own, which scale "
                        f"the curve, got {self._curves[k]}"
                    )
                factor[:, k] = _column(name, given[name], n) / first
            self._check_ranges(factor)
            if self.symmetric and not np.array_equal(factor[:, 1], factor[:, 2]):
                row = int(np.argmax(factor[:, 1] != factor[:, 2]))
                raise ValueError(
                    "dilation_angle must be given as friction_angle is where the law has one "
                    "number for both, and a symmetric tangent: give the law another "
                    f"dilation_angle, got {factor[row, 2]} and {factor[row, 1]}{_at(row, n)}"
                )
        if "tensile_strength" in given:
            tension = _column("tensile_strength", given["tensile_strength"], n)
            _refuse_rows(~(tension >= 0.0), "tensile_strength must not be negative", tension)
        if scale.shape not in ((1,), (n,)):
            raise ValueError(f"size must be a number or have shape ({n},), got shape {scale.shape}")
        if own or self.length is not None:
            self._check_snap_back(factor, scale)
        return self._stacked, factor, tension, scale

    @property
    def _weight(self) -> float:
        return 0.0 if self.averaging is None else float(self.averaging.weight)

    def _strengths(self, history: np.ndarray, soil) -> np.ndarray:
        """Strengths as the law's loops read them, (n, columns), or (1, columns) where all points
        share them."""
        rows = len(history)
        if self.perfect:
            rows = max(len(array) for array in soil[1:])
        out = np.empty((rows, self.columns))
        self.loops["strengths"](history, soil, self._options, out)
        return out

    @property
    def _options(self):
        """What else the loops are given: λ, μ and the weight of κ̄, and what heirs add."""
        return (*self.lame, self._weight)

    # -- the law -----------------------------------------------------------------------------------

    def initial_history(self, stress: np.ndarray, given: Given = NOTHING) -> np.ndarray:
        """Zeros (n, k).  Raises ``ValueError`` for a stress outside the yield surface."""
        stress = np.ascontiguousarray(stress, float)
        history = np.zeros((len(stress), len(self.history)))
        excess = np.empty(len(stress))
        strengths = self._strengths(history, self._soil(len(stress), given))
        self.loops["excess"](stress, strengths, excess)
        over = excess - OUTSIDE * np.abs(stress).max(axis=1, initial=0.0)
        if len(over) and not over.max() <= 0.0:
            row = int(np.argmax(over))
            raise ValueError(
                f"stress must lie inside the yield surface, and is beyond it by {excess[row]:.6g} "
                f"Pa at point {row}: {stress[row]}"
            )
        return history

    def respond(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray]:
        """Stress (n, components), Pa, and state variables (n, k) after the strain increments
        ``strain`` (n, components)."""
        return self._update(strain, stress, history, given, False)[:2]

    def tangent(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``respond`` and the consistent tangent ∂σ/∂ε (n, components, components), Pa, in one
        pass."""
        return self._update(strain, stress, history, given, True)

    def yields(self, strain, stress, history, at, of, given: Given = NOTHING) -> np.ndarray:
        """Which of the pairs of a strain increment, row ``at`` (m,), and a state, row ``of`` (m,),
        yield: (k,) rows."""
        strain, stress, history = (
            np.ascontiguousarray(a, float) for a in (strain, stress, history)
        )
        strengths = self._strengths(history, self._soil(len(stress), given))
        rows = np.empty(len(at), np.int32)
        found = self.loops["yields"](strain, stress, at, of, self.lame, strengths, rows)
        return rows[:found]

    def _update(self, strain, stress, history, given: Given, want: bool):
        """Stress, history and, where wanted, the tangent."""
        strain, stress, history = checked_rows(strain, stress, history, len(self.history))
        n = len(strain)
        soil = self._soil(n, given)
        strengths = self._strengths(history, soil)
        count = strain.shape[1]
        tangent = np.empty((n if want else 1, count, count))
        outputs = np.empty_like(stress), history.copy(), tangent
        if self.perfect:
            self.loops["perfect"](strain, stress, history, self._options, strengths, outputs, want)
        else:
            self.loops["hardening"](
                strain, stress, history, self._options, strengths, soil, outputs, want
            )
        return outputs


def _column(name: str, value, n: int) -> np.ndarray:
    column = np.asarray(value, float)
    if column.shape != (n,):
        raise ValueError(f"{name} must have shape ({n},), got shape {column.shape}")
    return column


def _at(row: int, rows: int) -> str:
    return f" at point {row}" if rows > 1 else ""


def _refuse_rows(bad: np.ndarray, what: str, value: np.ndarray) -> None:
    rows = np.flatnonzero(bad)
    if len(rows):
        raise ValueError(f"{what}, got {value[rows[0]]}{_at(rows[0], len(value))}")
