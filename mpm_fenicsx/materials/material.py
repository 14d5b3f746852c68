"""What a law is to the package, and a base with what most laws have in common.

Rows are points: n of them, or m pairs of a strain and a state.  Stress and strain rows have 4
numbers in plane strain and 6 in 3D (see ``tensors``), shear strains are engineering strains.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np

from ..common import tensors
from ..common.compiled import compiles, jit
from .kinematics import SMALL_STRAIN

Given = Mapping[str, np.ndarray]
"""Parameters that differ from point to point, (n,) each, by name."""

NOTHING: Given = MappingProxyType({})


class Material(Protocol):
    """A law.  ``Law`` has defaults for all of it but ``density``, ``lame`` and ``tangent``.

    ``density`` ρ (kg/m³), at rest.  ``lame``: λ and μ (Pa) of the elastic reference that forms
    carry, and that dashpots take their impedance from; any positive ones are right, for the law
    adds the rest, and the nearer they are the fewer solves a step takes.
    ``kinematics``: ``SMALL_STRAIN``, or ``FINITE_STRAIN`` for an isotropic law between Hencky's
    strain and Kirchhoff's stress.
    ``linear``: the reference is all there is; then a step is one solve.
    ``symmetric``: so is the tangent; it is carried whole where it is not, and solved accordingly.
    ``history``: names of the state variables; ``parameters``: names of those parameters that may
    be given point by point, ``MaterialPoints.fill(..., parameters={name: function of x})``; where
    they are not, ``given`` lacks them, and the law has a number of its own.
    ``length`` (m): the law depends on the size of a point's cell, which it then gets as
    ``given["size"]`` (m); None where size plays no part.
    ``keeps_volume``: flow keeps the volume, or ties it to shear, or pore water does: elements lock
    under such a law, and a run takes B-bar for it unless it is told not to.
    ``check_pressure`` (Pa): the law is looked at under it, 0 for one that has stiffness without.
    ``averaging``: an ``OverNonlocal`` by which the run averages the state variable "plastic_strain"
    and gives it back as "nonlocal_strain", which the law leaves as it is; None for a local law.
    """

    density: float
    lame: tuple[float, float]
    kinematics: object
    linear: bool
    symmetric: bool
    history: tuple[str, ...]
    parameters: tuple[str, ...]
    length: float | None
    keeps_volume: bool
    check_pressure: float

    def initial_history(self, stress: np.ndarray, given: Given = NOTHING) -> np.ndarray:
        """State variables (n, k) of points that start with ``stress`` (n, components), Pa.

        Raises ``ValueError`` for a stress that the law cannot bear.
        """

    def moduli(self, stress: np.ndarray, history: np.ndarray, given: Given = NOTHING):
        """λ and μ (Pa) of the reference at points in this state: two numbers, or two (n,)."""

    def respond(
        self, strain: np.ndarray, stress: np.ndarray, history: np.ndarray, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray]:
        """Stress (n, components), Pa, and state variables (n, k) after increments ``strain``."""

    def tangent(
        self, strain: np.ndarray, stress: np.ndarray, history: np.ndarray, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``respond``, and ∂σ/∂ε (n, components, components), Pa, rows stress, columns strain."""

    def yields(
        self,
        strain: np.ndarray,
        stress: np.ndarray,
        history: np.ndarray,
        at: np.ndarray,
        of: np.ndarray,
        given: Given = NOTHING,
    ) -> np.ndarray:
        """Which pairs of an increment, row ``at`` (m,), and a state, row ``of`` (m,), do not go the
        way of the reference: (k,) numbers of pairs."""

    def strain(self, stress: np.ndarray) -> np.ndarray:
        """Elastic strain (n, components) of stress rows, Pa; asked at finite strain only."""

    def energy(self, stress: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
        """Stored energy per volume (n,), J/m³."""

    def plastic_work(self, history: np.ndarray, given: Given = NOTHING) -> np.ndarray:
        """Work per volume (n,), J/m³, that flow has taken since the start."""


class Law:
    """What laws have in common: an isotropic elastic reference of ``lame``, and nothing special.

    A law of your own states ``density`` and ``lame``, names its ``history``, and defines
    ``tangent``.  It keeps its plastic work as the state variable "plastic_work", or defines
    ``plastic_work``; it defines ``respond`` and ``yields`` where it can answer them for less, and
    ``energy`` where its moduli follow the state.
    """

    kinematics = SMALL_STRAIN
    linear = False
    symmetric = True
    history: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    length: float | None = None
    keeps_volume = False
    check_pressure = 0.0
    averaging: object | None = None

    @property
    def p_speed(self) -> float:
        """Speed of compression waves c_p (m/s)."""
        λ, μ = self.lame
        return float(np.sqrt((λ + 2 * μ) / self.density))

    @property
    def s_speed(self) -> float:
        """Speed of shear waves c_s (m/s)."""
        return float(np.sqrt(self.lame[1] / self.density))

    def initial_history(self, stress: np.ndarray, given: Given = NOTHING) -> np.ndarray:
        """Zeros (n, k)."""
        return np.zeros((len(stress), len(self.history)))

    def moduli(self, stress, history, given: Given = NOTHING) -> tuple[float, float]:
        """``lame``, whatever the state."""
        return self.lame

    def respond(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray]:
        """The first two of ``tangent``."""
        return self.tangent(strain, stress, history, given)[:2]

    def tangent(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stress and state variables after the increments, and ∂σ/∂ε."""
        raise NotImplementedError(f"{type(self).__name__} needs tangent")

    def yields(self, strain, stress, history, at, of, given: Given = NOTHING) -> np.ndarray:
        """All pairs."""
        return np.arange(len(at), dtype=np.int32)

    def strain(self, stress: np.ndarray) -> np.ndarray:
        """C⁻¹ : σ of the reference (n, components)."""
        return compliance(self.lame, stress)

    def energy(self, stress: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
        """½ σ : C⁻¹ : σ of the reference (n,), J/m³."""
        return 0.5 * (stress * compliance(self.lame, stress)).sum(axis=1)

    def plastic_work(self, history: np.ndarray, given: Given = NOTHING) -> np.ndarray:
        """The state variable of that name (n,), J/m³."""
        if "plastic_work" not in self.history:
            raise ValueError(
                f"material: {type(self).__name__} needs a state variable plastic_work, or a "
                "function plastic_work(history, given) of its own, for the balance of energy"
            )
        return history[:, self.history.index("plastic_work")]


def given_at(given: Given, rows: np.ndarray | slice) -> Given:
    """Parameters of some points."""
    return {name: value[rows] for name, value in given.items()} if given else NOTHING


def checked_rows(strain, stress, history, columns: int) -> tuple[np.ndarray, ...]:
    """Strain and stress rows (n, components), history (n, columns), as compiled loops want them,
    which do not look.  Raises ``ValueError`` for other shapes."""
    strain, stress, history = (np.ascontiguousarray(a, float) for a in (strain, stress, history))
    n = len(strain)
    if strain.ndim != 2 or strain.shape[1] not in (4, 6):
        raise ValueError(f"strain must have shape (n, 4) or (n, 6), got {strain.shape}")
    for name, array, shape in (
        ("stress", stress, strain.shape),
        ("history", history, (n, columns)),
    ):
        if array.shape != shape:
            raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    return strain, stress, history


def hooke(lame: tuple, strain: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """Stress rows (n, components), Pa, after elastic increments ``strain`` (n, components) of λ and
    μ (Pa), two numbers or two (n,)."""
    strain = np.broadcast_to(strain, stress.shape)
    if not compiles(strain, stress):
        λ, μ = (np.asarray(value)[..., None] for value in lame)
        new = stress + μ * strain
        new[:, :3] += μ * strain[:, :3] + λ * strain[:, :3].sum(axis=1, keepdims=True)
        return new
    λ, μ = (np.atleast_1d(np.asarray(value, float)) for value in lame)
    new = np.empty(stress.shape)
    _hooke(λ, μ, strain, stress, new)
    return new


@jit
def _hooke(λ, μ, strain, stress, new):
    """σ + λ tr(Δε) 1 + 2 μ Δε, λ and μ (1,) or (n,)."""
    for p in range(len(new)):
        l, m = λ[p if len(λ) > 1 else 0], μ[p if len(μ) > 1 else 0]
        mean = l * (strain[p, 0] + strain[p, 1] + strain[p, 2])
        for k in range(3):
            new[p, k] = stress[p, k] + (2.0 * m * strain[p, k] + mean)
        for k in range(3, new.shape[1]):
            new[p, k] = stress[p, k] + m * strain[p, k]


def stiffness(lame: tuple, dim: int) -> np.ndarray:
    """∂σ/∂ε (components, components), Pa, of λ and μ; of two (n,), one for each point."""
    λ, μ = (np.asarray(value, float)[..., None, None] for value in lame)
    count = tensors.components(dim)
    volume, shape = np.zeros((count, count)), np.diag([2.0] * 3 + [1.0] * (count - 3))
    volume[:3, :3] = 1.0
    return λ * volume + μ * shape


def compliance(lame: tuple[float, float], stress: np.ndarray) -> np.ndarray:
    """Elastic strain (n, components) of stress rows, Pa."""
    λ, μ = lame
    row = stress / μ
    trace = stress[:, :3].sum(axis=1, keepdims=True)
    row[:, :3] = 0.5 * (stress[:, :3] - λ / (3 * λ + 2 * μ) * trace) / μ
    return row
