"""Linear isotropic elasticity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.checks import between, positive
from .material import NOTHING, Given, Law, hooke, stiffness


@dataclass(frozen=True)
class LinearElastic(Law):
    """Linear isotropic elastic soil.

    Parameters: ``young`` E (Pa), ``poisson`` ν (-1 < ν < 0.5), ``density`` ρ (kg/m³).
    Raises ``ValueError`` naming the parameter that is out of range.
    """

    young: float
    poisson: float
    density: float

    linear = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "young", positive("young", self.young))
        object.__setattr__(self, "poisson", between("poisson", self.poisson, -1.0, 0.5))
        object.__setattr__(self, "density", positive("density", self.density))

    @property
    def lame(self) -> tuple[float, float]:
        """Lamé's λ and μ (Pa)."""
        E, ν = self.young, self.poisson
        return E * ν / ((1 + ν) * (1 - 2 * ν)), E / (2 * (1 + ν))

    def update(self, strain: np.ndarray, stress: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa, after the strain increments ``strain`` (n,
        components)."""
        return hooke(self.lame, strain, stress)

    def strain(self, stress: np.ndarray) -> np.ndarray:
        """Elastic strain C⁻¹ : σ, rows (n, components), of stress rows, Pa."""
        E, ν = self.young, self.poisson
        row = stress * (2 * (1 + ν) / E)
        row[:, :3] = ((1 + ν) * stress[:, :3] - ν * stress[:, :3].sum(axis=1, keepdims=True)) / E
        return row

    def energy(self, stress: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
        """Elastic energy per volume ½ σ : C⁻¹ : σ (n,), J/m³, of stress rows (n, components)."""
        E, ν = self.young, self.poisson
        normal = (stress[:, :3] ** 2).sum(axis=1)
        trace = stress[:, :3].sum(axis=1)
        shear = (stress[:, 3:] ** 2).sum(axis=1)
        return ((1 + ν) * (normal + 2 * shear) - ν * trace**2) / (2 * E)

    def respond(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray]:
        """``update``, and the empty history (n, 0)."""
        return self.update(strain, stress), history

    def tangent(
        self, strain, stress, history, given: Given = NOTHING
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``respond`` and the stiffness ∂σ/∂ε (n, components, components), Pa."""
        C = stiffness(self.lame, 2 if strain.shape[1] == 4 else 3)
        return self.update(strain, stress), history, np.repeat(C[None], len(strain), axis=0)

    def yields(self, strain, stress, history, at, of, given: Given = NOTHING) -> np.ndarray:
        """None of the pairs."""
        return np.zeros(0, np.int32)

    def strength(self, history, given: Given = NOTHING) -> np.ndarray:
        """Yield value of q (n,), Pa: out of reach."""
        return np.full(len(history), np.inf)

    def dissipation(self, before, after, given: Given = NOTHING) -> np.ndarray:
        """Plastic work per volume (n,), J/m³, between two histories: none."""
        return np.zeros(len(after))

    def plastic_work(self, history, given: Given = NOTHING) -> np.ndarray:
        """None (n,)."""
        return np.zeros(len(history))


class OnElastic(Law):
    """A law whose reference is the soil ``elastic``, at whose kinematics it is: of finite strain
    where that is a ``Hencky``."""

    elastic: LinearElastic

    @property
    def density(self) -> float:
        """ρ (kg/m³)."""
        return self.elastic.density

    @property
    def lame(self) -> tuple[float, float]:
        """Lamé's λ and μ (Pa)."""
        return self.elastic.lame

    @property
    def kinematics(self):
        """That of ``elastic``."""
        return self.elastic.kinematics

    def strain(self, stress: np.ndarray) -> np.ndarray:
        """Elastic strain (n, components) of stress rows (n, components), Pa."""
        return self.elastic.strain(stress)

    def energy(self, stress: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
        """Elastic energy per volume (n,), J/m³."""
        return self.elastic.energy(stress)
