"""Soil whose pore water cannot flow: effective stress by a law, pore pressure by change of
volume."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..common.checks import finite, in_short, positive
from .law_checks import has
from .material import NOTHING, Given, Law


@dataclass(frozen=True)
class Undrained(Law):
    """A law of effective stress σ' with pore water that stays where it is: σ = σ' − u 1.

    Parameters: ``law`` of small strain, whose ``density`` is that of the saturated soil;
    ``bulk_modulus`` (Pa), that of the pore water divided by the porosity, for grains do not
    compress: 2.2e9/0.4 = 5.5e9 Pa without air; ``pore_pressure`` u (Pa) at the start, compression
    positive, which may be given point by point, as by ``hydrostatic``.

    Stress rows of points are *total* stresses, in the initial state as in the run.  The law is
    asked with σ' = σ + u 1, and

        u' = u − bulk_modulus Δε_v     (Δε_v tension positive).

    The state variables are those of the law, and "pore_pressure" u (Pa) as the last.  The water
    stores u²/2 bulk_modulus per volume.  Points whose total stress is zero have none yet: the law
    starts without effective stress.  Flow of water through the soil would need a second field, and
    is not computed.

    Raises ``ValueError`` for a law of finite strain, and naming what is out of range.
    """

    law: Law
    bulk_modulus: float
    pore_pressure: float = 0.0

    keeps_volume = True

    def __post_init__(self) -> None:
        has("law", self.law, ("density", "lame", "kinematics", "tangent", "history", "parameters"))
        if self.law.kinematics.finite:
            raise ValueError(
                "law must be one of small strain, got "
                f"{in_short(self.law)}: undrained soil at finite strain is not available, take "
                "LinearElastic in place of Hencky"
            )
        if "pore_pressure" in self.law.history:
            raise ValueError(f"law must be drained, got {in_short(self.law)}: it has pore water")
        object.__setattr__(self, "bulk_modulus", positive("bulk_modulus", self.bulk_modulus))
        object.__setattr__(self, "pore_pressure", finite("pore_pressure", self.pore_pressure))

    @property
    def density(self) -> float:
        """ρ (kg/m³) of the law, water included."""
        return self.law.density

    @property
    def lame(self) -> tuple[float, float]:
        """λ and μ (Pa), those of the law and the water's stiffness."""
        λ, μ = self.law.lame
        return λ + self.bulk_modulus, μ

    @property
    def history(self) -> tuple[str, ...]:
        """Those of the law, and the pore pressure."""
        return (*self.law.history, "pore_pressure")

    @property
    def parameters(self) -> tuple[str, ...]:
        """Those of the law, and the pore pressure at the start."""
        return (*self.law.parameters, "pore_pressure")

    @property
    def length(self) -> float | None:
        """That of the law (m)."""
        return self.law.length

    @property
    def symmetric(self) -> bool:
        """Whether the law's tangent is."""
        return self.law.symmetric

    @property
    def check_pressure(self) -> float:
        """That of the law (Pa)."""
        return getattr(self.law, "check_pressure", 0.0)

    @property
    def averaging(self):
        """That of the law, if it softens over a length."""
        return getattr(self.law, "averaging", None)

    def effective(self, stress: np.ndarray, history: np.ndarray) -> np.ndarray:
        """Effective stress rows (n, components), Pa, of total ones."""
        return _shifted(stress, history[:, -1])

    def starting_pore_pressure(self, points: int, given: Given = NOTHING) -> np.ndarray:
        """u (points,), Pa, at the start."""
        return np.broadcast_to(given.get("pore_pressure", self.pore_pressure), (points,))

    def initial_history(self, stress: np.ndarray, given: Given = NOTHING) -> np.ndarray:
        """State variables (n, k) of points that start with the total ``stress`` (n, components),
        Pa."""
        stress = np.asarray(stress, float)
        u = self.starting_pore_pressure(len(stress), given)
        effective = _shifted(stress, np.where(stress.any(axis=1), u, 0.0))
        own = self.law.initial_history(effective, self._of_law(given))
        return np.column_stack((own, u))

    def moduli(self, stress, history, given: Given = NOTHING) -> tuple:
        """λ and μ (Pa) of the law in this state, and the water's stiffness."""
        λ, μ = self.law.moduli(
            self.effective(stress, history), history[:, :-1], self._of_law(given)
        )
        return λ + self.bulk_modulus, μ

    def respond(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray]:
        """Total stress (n, components), Pa, and history (n, k) after the strain increments
        ``strain`` (n, components)."""
        effective = self.effective(stress, history)
        new, own = self.law.respond(strain, effective, history[:, :-1], self._of_law(given))
        return self._with_water(strain, history, new, own)

    def tangent(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``respond`` and the tangent ∂σ/∂ε (n, components, components), Pa."""
        effective = self.effective(stress, history)
        new, own, D = self.law.tangent(strain, effective, history[:, :-1], self._of_law(given))
        D = np.array(D)
        D[:, :3, :3] += self.bulk_modulus
        return *self._with_water(strain, history, new, own), D

    def yields(self, strain, stress, history, at, of, given: Given = NOTHING) -> np.ndarray:
        """Which pairs leave the law's reference: the water never does."""
        effective = self.effective(stress, history)
        return self.law.yields(strain, effective, history[:, :-1], at, of, self._of_law(given))

    def energy(self, stress: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
        """Stored by the soil and by the water (n,), J/m³."""
        if history is None:
            raise ValueError("history is needed for the pore pressure, got None")
        soil = self.law.energy(self.effective(stress, history), history[:, :-1])
        return soil + history[:, -1] ** 2 / (2.0 * self.bulk_modulus)

    def plastic_work(self, history: np.ndarray, given: Given = NOTHING) -> np.ndarray:
        """That of the law (n,), J/m³."""
        return self.law.plastic_work(history[:, :-1], self._of_law(given))

    def _of_law(self, given: Given) -> Given:
        """What is given point by point, less the pore pressure."""
        if "pore_pressure" not in given:
            return given
        return {name: value for name, value in given.items() if name != "pore_pressure"}

    def _with_water(self, strain, history, effective, own) -> tuple[np.ndarray, np.ndarray]:
        """Total stress rows and the whole history, after the step."""
        u = history[:, -1] - self.bulk_modulus * strain[:, :3].sum(axis=1)
        return _shifted(effective, -u), np.column_stack((own, u))


def _shifted(stress: np.ndarray, u: np.ndarray) -> np.ndarray:
    """σ + u 1."""
    new = np.array(stress, float)
    new[:, :3] += u[:, None]
    return new


def hydrostatic(
    water_table: float, unit_weight: float = 9810.0
) -> Callable[[np.ndarray], np.ndarray]:
    """Pore pressure (Pa) of water at rest, as a function of x (dim, n), m.

    ``water_table``: its height (m) along the last axis; above it the pressure is zero.
    ``unit_weight`` of water (N/m³).  For ``MaterialPoints.fill(..., parameters={"pore_pressure":
    hydrostatic(4.0)})``.
    """
    level, weight = finite("water_table", water_table), positive("unit_weight", unit_weight)

    def pore_pressure(x: np.ndarray) -> np.ndarray:
        """u (n,), Pa, at x (dim, n), m."""
        return weight * np.maximum(0.0, level - np.asarray(x, float)[-1])

    return pore_pressure
