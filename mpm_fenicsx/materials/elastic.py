"""Linear isotropic elasticity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.checks import between, positive
from .kinematics import SMALL_STRAIN


@dataclass(frozen=True)
class LinearElastic:
    """Linear isotropic elastic soil.

    Parameters: ``young`` E (Pa), ``poisson`` ν (-1 < ν < 0.5), ``density`` ρ (kg/m³).
    Raises ``ValueError`` naming the parameter that is out of range.
    """

    young: float
    poisson: float
    density: float

    history = ()
    length = None
    kinematics = SMALL_STRAIN

    def __post_init__(self) -> None:
        object.__setattr__(self, "young", positive("young", self.young))
        object.__setattr__(self, "poisson", between("poisson", self.poisson, -1.0, 0.5))
        object.__setattr__(self, "density", positive("density", self.density))

    @property
    def lame(self) -> tuple[float, float]:
        """Lamé's λ and μ (Pa)."""
        E, ν = self.young, self.poisson
        return E * ν / ((1 + ν) * (1 - 2 * ν)), E / (2 * (1 + ν))

    @property
    def p_speed(self) -> float:
        """Speed of compression waves c_p (m/s)."""
        λ, μ = self.lame
        return float(np.sqrt((λ + 2 * μ) / self.density))

    @property
    def s_speed(self) -> float:
        """Speed of shear waves c_s (m/s)."""
        return float(np.sqrt(self.lame[1] / self.density))

    def update(self, strain: np.ndarray, stress: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa, after the strain increments ``strain`` (n,
        components)."""
        λ, μ = self.lame
        new = stress.copy()
        mean = λ * (strain[:, 0] + strain[:, 1] + strain[:, 2])
        for k in range(stress.shape[1]):  # by columns: NumPy is slow along short rows
            new[:, k] += 2 * μ * strain[:, k] + mean if k < 3 else μ * strain[:, k]
        return new

    def strain(self, stress: np.ndarray) -> np.ndarray:
        """Elastic strain C⁻¹ : σ, rows (n, components), of stress rows, Pa."""
        E, ν = self.young, self.poisson
        row = stress * (2 * (1 + ν) / E)
        row[:, :3] = ((1 + ν) * stress[:, :3] - ν * stress[:, :3].sum(axis=1, keepdims=True)) / E
        return row

    def energy(self, stress: np.ndarray) -> np.ndarray:
        """Elastic energy per volume ½ σ : C⁻¹ : σ (n,), J/m³, of stress rows (n, components)."""
        E, ν = self.young, self.poisson
        normal = (stress[:, :3] ** 2).sum(axis=1)
        trace = stress[:, :3].sum(axis=1)
        shear = (stress[:, 3:] ** 2).sum(axis=1)
        return ((1 + ν) * (normal + 2 * shear) - ν * trace**2) / (2 * E)

    def respond(self, strain, stress, history, size=None) -> tuple[np.ndarray, np.ndarray]:
        """``update``, and the empty history (n, 0)."""
        return self.update(strain, stress), history

    def tangent(
        self, strain, stress, history, size=None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``respond`` and the stiffness ∂σ/∂ε (n, components, components), Pa."""
        n, count = strain.shape
        unit = np.eye(count)
        stiffness = self.update(unit, np.zeros_like(unit))
        return self.update(strain, stress), history, np.repeat(stiffness[None], n, axis=0)

    def strength(self, history, size=None) -> np.ndarray:
        """Yield value of q (n,), Pa: out of reach."""
        return np.full(len(history), np.inf)

    def dissipation(self, before, after, size=None) -> np.ndarray:
        """Plastic work per volume (n,), J/m³: none."""
        return np.zeros(len(after))
