"""Modified Cam-Clay: clay whose stiffness follows the pressure and whose strength follows its
history, with an implicit return map and its tangent."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..common import tensors
from ..common.checks import between, finite, positive
from ..common.compiled import jit, once
from .material import NOTHING, Given, Law, checked_rows

SLACK = 1e-12  # of the yield function over p p_c: a point at rest on the surface is elastic
CLOSE = 1e-9  # of a correction, relative to its unknown: the next one would be its square
NOTHING_LEFT = 1e-14  # of the logarithm of the yield function, and of strains over κ/v
TRIES = 30
LARGEST = 230.0  # exponent of pressures: squares of e^230 are numbers still
SERIES = 1e-5  # below it (e^x - 1)/x goes by its series


@jit
def _power(exponent):
    """e^x, of a strain that is not absurd."""
    return math.exp(min(max(exponent, -LARGEST), LARGEST))


@jit
def _shear_modulus(x, pressure, clay):
    """G of the increment and its derivative by x = ln(p'/p): constant, or by a constant ν that of
    the mean of K over the increment."""
    swelling, ratio, constant = clay[0], clay[3], clay[4]
    if constant > 0.0:
        return constant, 0.0
    factor = ratio * pressure / swelling
    if abs(x) < SERIES:
        return factor * (1.0 + 0.5 * x + x * x / 6.0), factor * (0.5 + x / 3.0)
    power = _power(x)
    return factor * math.expm1(min(max(x, -LARGEST), LARGEST)) / x, factor * (
        x * power - power + 1.0
    ) / x**2


@jit
def _deviators(columns, strain, stress, shape, start):
    """Write the deviators of the increment and of the stress, shear strains halved; return the
    compression of the increment and the pressure."""
    e = -(strain[0] + strain[1] + strain[2])
    p = -(stress[0] + stress[1] + stress[2]) / 3.0
    for i in range(len(columns)):
        shape[i] = strain[i] + e / 3.0 if i < 3 else 0.5 * strain[i]
        start[i] = stress[i] + p if i < 3 else stress[i]
    return e, p


@jit
def _squares(columns, shape, start):
    """3/2 of the products s:s, s:d and d:d of the two deviators."""
    a, b, c = 0.0, 0.0, 0.0
    for i in range(len(columns)):
        weight = 1.5 if i < 3 else 3.0
        a += weight * start[i] * start[i]
        b += weight * start[i] * shape[i]
        c += weight * shape[i] * shape[i]
    return a, b, c


@jit
def _state(y, flow, trial, clay):
    """What follows from plastic compression y and multiplier Δφ (1/Pa).

    p, p_c, G and dG/dx, B = 1 + 6 G Δφ/M² and q² after the increment.
    """
    e, before, hardened, (a, b, c) = trial
    swelling, hardening, slope = clay[0], clay[1], clay[2]
    x = (e - y) / swelling
    p = before * _power(x)
    p_c = hardened * _power(y / hardening)
    G, change = _shear_modulus(x, before, clay)
    B = 1.0 + 6.0 * G * flow / slope**2
    q2 = (a + 4.0 * G * b + 4.0 * G * G * c) / B**2
    return p, p_c, G, change, B, q2


@jit
def _jacobian(flow, state, trial, clay):
    """Derivatives of the two residuals by y and Δφ, and of the second by the compression e.

    r₁ = y − Δφ (2p − p_c),  r₂ = q²/M² + p (p − p_c).
    """
    _, b, c = trial[3]
    swelling, hardening, m2 = clay[0], clay[1], clay[2] ** 2
    p, p_c, G, change, B, q2 = state
    K, C, away = p / swelling, p_c / hardening, 2.0 * p - p_c
    by_shear = (4.0 * b + 8.0 * G * c) / B**2 - 12.0 * q2 * flow / (m2 * B)
    by_strain = by_shear * change / (swelling * m2) + K * away
    return (
        1.0 + flow * (2.0 * K + C),
        -away,
        -by_strain - p * C,
        -12.0 * G * q2 / (m2 * m2 * B),
        by_strain,
    )


@jit
def _newton(trial, clay):
    """y, Δφ and whether they were found, from no flow, with the logarithm of r₂, which is linear
    where nothing shears."""
    y, flow, m2 = 0.0, 0.0, clay[2] ** 2
    for _ in range(TRIES):
        state = _state(y, flow, trial, clay)
        p, p_c, _, _, _, q2 = state
        J11, J12, J21, J22, _ = _jacobian(flow, state, trial, clay)
        r1 = y - flow * (2.0 * p - p_c)
        surface = p * p + q2 / m2
        # ln(surface/(p p_c)) has the derivatives of r₂ over surface, and those of its own p p_c
        extra = surface / (p * p_c) - 1.0
        J21 = (J21 + extra * p * p_c * (1.0 / clay[0] - 1.0 / clay[1])) / surface
        J22 /= surface
        r2 = math.log(surface / (p * p_c))
        det = J11 * J22 - J12 * J21
        dy, dflow = (J12 * r2 - J22 * r1) / det, (J21 * r1 - J11 * r2) / det
        if not (math.isfinite(dy) and math.isfinite(dflow)) or flow + dflow < 0.0:
            return 0.0, 0.0, False
        y, flow = y + dy, flow + dflow
        if abs(dflow) <= CLOSE * flow and abs(dy) <= CLOSE * abs(y):
            return y, flow, True
        left = abs(J21 * dy) + abs(J22 * dflow) + (abs(J11 * dy) + abs(J12 * dflow)) / clay[0]
        if left <= NOTHING_LEFT:
            return y, flow, True
    return 0.0, 0.0, False


@jit
def _compression(flow, trial, clay):
    """y of a given Δφ: the root of r₁, which grows with y, held in brackets."""
    swelling, hardening = clay[0], clay[1]
    e, before, hardened = trial[0], trial[1], trial[2]
    # where 2p = p_c no volume changes: the root lies between there and no flow
    ratio = math.log(2.0 * before / hardened) + e / swelling
    far = ratio / (1.0 / swelling + 1.0 / hardening)
    low, high = min(0.0, far), max(0.0, far)
    y = 0.0
    for _ in range(200):
        p = before * _power((e - y) / swelling)
        p_c = hardened * _power(y / hardening)
        r = y - flow * (2.0 * p - p_c)
        if r > 0.0:
            high = y
        else:
            low = y
        new = y - r / (1.0 + flow * (2.0 * p / swelling + p_c / hardening))
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - y) <= 1e-16 * abs(new) or not low < new < high:
            return new
        y = new
    return y


@jit
def _bisect(trial, clay):
    """y and Δφ by halving the bracket of ln Δφ: for q → 0 the stress lies inside the surface, so
    there is a root."""
    m2 = clay[2] ** 2
    low, high = -LARGEST, LARGEST
    for _ in range(200):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        flow = math.exp(middle)
        y = _compression(flow, trial, clay)
        p, p_c, _, _, _, q2 = _state(y, flow, trial, clay)
        if q2 / m2 + p * (p - p_c) > 0.0:
            low = middle
        else:
            high = middle
    flow = math.exp(0.5 * (low + high))
    return _compression(flow, trial, clay), flow


@jit
def respond_point(columns, strain, stress, history, clay, work_space, out_stress, out_history):
    """Write stress and state variables of one point after an increment of strain.

    ``columns``: as many entries as a row (``once``); ``clay``: κ/v, (λ − κ)/v, M, G/K or 0, G (Pa)
    or 0; ``work_space`` (2, components).  Returns what ``tangent_point`` needs.
    """
    shape, start = work_space
    e, p0 = _deviators(columns, strain, stress, shape, start)
    trial = (e, p0, history[0], _squares(columns, shape, start))
    y, flow = 0.0, 0.0
    state = _state(y, flow, trial, clay)
    p, p_c, _, _, _, q2 = state
    if q2 / clay[2] ** 2 + p * (p - p_c) > SLACK * p * p_c:
        y, flow, solved = _newton(trial, clay)
        if not solved:
            y, flow = _bisect(trial, clay)
        state = _state(y, flow, trial, clay)
    p, p_c, G, _, B, q2 = state
    for i in range(len(columns)):
        out_stress[i] = (start[i] + 2.0 * G * shape[i]) / B - (p if i < 3 else 0.0)
    q = math.sqrt(q2)
    sheared = 2.0 * q * flow / clay[2] ** 2
    out_history[0] = p_c
    out_history[1] = history[1] + sheared
    out_history[2] = history[2] + p * y + q * sheared
    return trial, flow, state


@jit
def tangent_point(columns, found, clay, work_space, out_stress, out):
    """Write ∂σ/∂ε by the derivative of the two residuals at their root."""
    trial, flow, state = found
    p, _, G, change, B, _ = state
    swelling, m2, n = clay[0], clay[2] ** 2, len(columns)
    y_e, y_s, flow_e, flow_s = 0.0, 0.0, 0.0, 0.0
    if flow > 0.0:
        J11, J12, J21, J22, by_strain = _jacobian(flow, state, trial, clay)
        det = J11 * J22 - J12 * J21
        first, sheared = -2.0 * flow * p / swelling, 6.0 * G / (B * m2)
        y_e, flow_e = (J12 * by_strain - J22 * first) / det, (J21 * first - J11 * by_strain) / det
        y_s, flow_s = J12 * sheared / det, -J11 * sheared / det
    K, stiffening = p / swelling, change / swelling
    for j in range(n):
        s = out_stress[j] + (p if j < 3 else 0.0)
        volume = -1.0 if j < 3 else 0.0
        elastic = (1.0 - y_e) * volume - y_s * s
        flowing = flow_e * volume + flow_s * s
        for i in range(n):
            s = out_stress[i] + (p if i < 3 else 0.0)
            by_shear = (2.0 * work_space[0, i] - 6.0 * flow / m2 * s) / B
            value = by_shear * stiffening * elastic - 6.0 * G / (m2 * B) * s * flowing
            if i < 3:
                value -= K * elastic
                if j < 3:
                    value -= 2.0 * G / (3.0 * B)
            if i == j:
                value += (2.0 if i < 3 else 1.0) * G / B
            out[i, j] = value


@jit
def _respond(columns, strain, stress, history, clay, out_stress, out_history):
    work_space = np.empty((2, strain.shape[1]))
    for p in range(len(strain)):
        respond_point(
            columns,
            strain[p],
            stress[p],
            history[p],
            clay,
            work_space,
            out_stress[p],
            out_history[p],
        )


@jit
def _tangent(columns, strain, stress, history, clay, out_stress, out_history, out):
    work_space = np.empty((2, strain.shape[1]))
    for p in range(len(strain)):
        found = respond_point(
            columns,
            strain[p],
            stress[p],
            history[p],
            clay,
            work_space,
            out_stress[p],
            out_history[p],
        )
        tangent_point(columns, found, clay, work_space, out_stress[p], out[p])


@dataclass(frozen=True)
class ModifiedCamClay(Law):
    """Modified Cam-Clay (Roscoe & Burland 1968), for effective stress at small strain.

    Parameters: ``compression_index`` λ and ``swelling_index`` κ, slopes in the plane of specific
    volume and ln p (natural logarithm), 0 < κ < λ; ``critical_state_ratio`` M, q/p at the critical
    state; ``specific_volume`` v = 1 + void ratio at the start, to which strains refer; ``density``
    ρ (kg/m³); exactly one of ``poisson`` ν and ``shear_modulus`` G (Pa);
    ``overconsolidation_ratio`` R ≥ 1, which may be given point by point; ``reference_pressure``
    (Pa), at which ``lame`` and with it the impedance of dashpots are taken.

    With p and compression counted positive, and strain increments Δε_v = Δε_vᵉ + Δε_vᵖ,

        yield      f = q²/M² + p (p − p_c) = 0,  flow by ∂f/∂σ
        pressure   p' = p exp(v Δε_vᵉ/κ)
        hardening  p_c' = p_c exp(v Δε_vᵖ/(λ − κ))
        shear      s' = s + 2 G Δeᵉ

    which are integrated exactly but for flow, by backward Euler in two unknowns.  With ``poisson``,
    G = 3K(1 − 2ν)/2(1 + ν) of the mean of K over the increment: such elasticity has no stored
    energy (Zytynski et al. 1978), ``energy`` is then that of the present moduli, and the balance of
    energy does not close exactly.  With ``shear_modulus`` it has, κ p/v + q²/6G, which comes back
    whole in a cycle of loading; the balance then closes to the first order of the step, where the
    clay flows.

    Stress must be given: the law has no stiffness without pressure.  The surface at the start is
    the one through the initial stress, R times as large: p_c = R (p + q²/M²p); points without any
    stress take theirs when they are first asked.  State variables: ``preconsolidation`` p_c (Pa),
    ``plastic_strain`` ∫ √(⅔ deᵖ:deᵖ), ``plastic_work`` (J/m³).  The tangent is that of the implicit
    rule and is not symmetric: p_c is taken after the step.

    Raises ``ValueError`` naming the parameter that is out of range, and a stress without
    compression.  See Borja and Lee, Comput. Methods Appl. Mech. Engrg. 78 (1990).
    """

    compression_index: float
    swelling_index: float
    critical_state_ratio: float
    specific_volume: float
    density: float
    poisson: float | None = None
    shear_modulus: float | None = None
    overconsolidation_ratio: float = 1.0
    reference_pressure: float = 100e3

    history = ("preconsolidation", "plastic_strain", "plastic_work")
    parameters = ("overconsolidation_ratio",)
    keeps_volume = True
    symmetric = False

    def __post_init__(self) -> None:
        for name in (
            "compression_index",
            "swelling_index",
            "critical_state_ratio",
            "density",
            "reference_pressure",
        ):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        if not self.swelling_index < self.compression_index:
            raise ValueError(
                f"swelling_index must be less than compression_index = {self.compression_index}, "
                f"got {self.swelling_index}"
            )
        for name, least in (("specific_volume", 1.0), ("overconsolidation_ratio", 1.0)):
            number = finite(name, getattr(self, name))
            if number < least:
                raise ValueError(f"{name} must be at least {least}, got {number}")
            object.__setattr__(self, name, number)
        if (self.poisson is None) == (self.shear_modulus is None):
            raise ValueError(
                "poisson or shear_modulus must be given, one and not both, got poisson = "
                f"{self.poisson} and shear_modulus = {self.shear_modulus}"
            )
        if self.poisson is not None:
            object.__setattr__(self, "poisson", between("poisson", self.poisson, -1.0, 0.5))
        else:
            object.__setattr__(self, "shear_modulus", positive("shear_modulus", self.shear_modulus))

    @property
    def check_pressure(self) -> float:
        """The pressure (Pa) under which the law is looked at: ``reference_pressure``."""
        return self.reference_pressure

    @property
    def lame(self) -> tuple[float, float]:
        """λ and μ (Pa) at ``reference_pressure``."""
        λ, μ = self._lame(np.array([self.reference_pressure]))
        return float(λ[0]), float(np.ravel(μ)[0])

    def moduli(self, stress, history, given: Given = NOTHING) -> tuple[np.ndarray, np.ndarray]:
        """λ and μ (n,), Pa, under the present pressure."""
        return self._lame(self._pressure(stress))

    def initial_history(self, stress: np.ndarray, given: Given = NOTHING) -> np.ndarray:
        """State variables (n, 3) of points that start with ``stress`` (n, components), Pa.

        Points whose stress is zero have none yet: their p_c is 0 until they are first asked.
        Raises ``ValueError`` for other stresses without compression.
        """
        stress = np.asarray(stress, float)
        history = np.zeros((len(stress), 3))
        some = np.flatnonzero(stress.any(axis=1))
        history[some, 0] = self._first_size(stress[some], self._ratio(len(stress), given)[some])
        return history

    def respond(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray]:
        """Stress (n, components), Pa, and history (n, 3) after the strain increments ``strain`` (n,
        components)."""
        inputs, outputs = self._prepare(strain, stress, history, given)
        _respond(*inputs, *outputs)
        return outputs

    def tangent(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``respond`` and the consistent tangent ∂σ/∂ε (n, components, components), Pa."""
        inputs, outputs = self._prepare(strain, stress, history, given)
        out = np.empty((*outputs[0].shape, outputs[0].shape[1]))
        _tangent(*inputs, *outputs, out)
        return *outputs, out

    def energy(self, stress: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
        """κ p/v + q²/6G (n,), J/m³, with G under the present pressure."""
        p, q = np.maximum(-tensors.mean(stress), 0.0), tensors.von_mises(stress)
        G = self._lame(np.maximum(p, np.finfo(float).tiny))[1]
        return p * self.swelling_index / self.specific_volume + q**2 / (6.0 * G)

    def _lame(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        K = pressure * self.specific_volume / self.swelling_index
        G = self._shear_ratio * K if self.shear_modulus is None else self.shear_modulus
        return K - 2.0 * G / 3.0, G * np.ones_like(K)

    @property
    def _shear_ratio(self) -> float:
        """G/K of a constant ν, or 0."""
        if self.poisson is None:
            return 0.0
        return 1.5 * (1.0 - 2.0 * self.poisson) / (1.0 + self.poisson)

    @property
    def _numbers(self) -> tuple[float, ...]:
        """What the compiled loops know of the clay."""
        λ, κ, v = self.compression_index, self.swelling_index, self.specific_volume
        shear = 0.0 if self.shear_modulus is None else self.shear_modulus
        return κ / v, (λ - κ) / v, self.critical_state_ratio, self._shear_ratio, shear

    def _pressure(self, stress: np.ndarray) -> np.ndarray:
        """p (n,), Pa, compression positive, or ``ValueError`` where it is not."""
        p = -tensors.mean(np.asarray(stress, float))
        bad = np.flatnonzero(~((p > 0.0) & (p < np.inf)))
        if len(bad):
            raise ValueError(
                f"stress must have a mean in compression (less than 0 Pa) for {type(self).__name__}"
                f", which has no stiffness without it, got a mean of {-p[bad[0]]} Pa: give an "
                "initial stress"
            )
        return p

    def _first_size(self, stress: np.ndarray, ratio: np.ndarray) -> np.ndarray:
        """p_c (n,), Pa, of the surface through the stress, ``ratio`` times as large."""
        p, q = self._pressure(stress), tensors.von_mises(stress)
        return ratio * (p + (q / self.critical_state_ratio) ** 2 / p)

    def _ratio(self, n: int, given: Given) -> np.ndarray:
        """R (n,), refused below 1."""
        name = "overconsolidation_ratio"
        ratio = np.broadcast_to(np.asarray(given.get(name, self.overconsolidation_ratio)), (n,))
        bad = np.flatnonzero(~((ratio >= 1.0) & (ratio < np.inf)))
        if len(bad):
            raise ValueError(f"{name} must be at least 1 at every point, got {ratio[bad[0]]}")
        return ratio

    def _prepare(self, strain, stress, history, given: Given):
        """Arrays of the kernels, refused unless their shapes agree: compiled loops do not look."""
        strain, stress, history = checked_rows(strain, stress, history, 3)
        self._pressure(stress)
        new = np.flatnonzero(history[:, 0] == 0.0)
        if len(new):
            history = history.copy()
            history[new, 0] = self._first_size(stress[new], self._ratio(len(strain), given)[new])
        inputs = once(strain.shape[1]), strain, stress, history, self._numbers
        return inputs, (np.empty_like(stress), np.empty_like(history))
