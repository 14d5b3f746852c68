"""Boundaries that absorb waves: dashpots, and dashpots with springs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from ufl import inner

from ..common.checks import positive
from ..grid import weak_forms
from ..materials.law_checks import has
from .contribution import Contribution
from .loads import Surface
from .scene import Scene


@dataclass(frozen=True)
class ViscousBoundary:
    """Absorbing dashpots (Lysmer & Kuhlemeyer; Do et al. 2023, eqs. 9, 13, 14).

    σ_n = -ρ c_p v_n, σ_s = -ρ c_s v_s with the elastic constants and density of ``material``.
    """

    on: Surface
    material: object

    @property
    def impedance(self) -> np.ndarray:
        """ρ c_p and ρ c_s (2,), Pa s/m."""
        soil = self.material
        return soil.density * np.array([soil.p_speed, soil.s_speed])

    @property
    def stiffness(self) -> np.ndarray:
        """Of springs, along the normal and across (2,), Pa/m."""
        return np.zeros(2)

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work ∫ Z v·w, and the energy absorbed."""
        if not scene.motion.stepping.dynamic:
            raise ValueError(f"{type(self).__name__} needs velocities: step with Newmark")
        patch, motion, soil = scene.patch(self.on), scene.motion, self.material
        has(f"material of {type(self).__name__}", soil, ("density", "p_speed", "s_speed"))
        Z = patch.tensor(*self.impedance)
        work = weak_forms.dashpot(Z, scene.velocity, motion.w) * patch.measure

        def energy() -> dict[str, object]:
            return {"absorbed": inner(Z * motion.u, motion.u) / motion.dt * patch.measure}

        return Contribution(work, energy=energy)


@dataclass(frozen=True)
class ViscoelasticBoundary(ViscousBoundary):
    """Dashpots with springs beside them (Deeks & Randolph; Do et al. 2023, eqs. 10, 15, 16).

    k_n = 2 G / r_b, k_s = G / (2 r_b), ``radius`` r_b (m) the distance to the source; the springs
    act on the displacement accumulated since the start.
    Raises ``ValueError`` for radius <= 0.
    """

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive("radius", self.radius))

    @property
    def stiffness(self) -> np.ndarray:
        """Of springs, along the normal and across (2,), Pa/m."""
        return self.material.lame[1] / self.radius * np.array([2.0, 0.5])

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work ∫ (Z v + k u)·w, and the energy absorbed and stored."""
        viscous = super().bind(scene)
        has(f"material of {type(self).__name__}", self.material, ("lame",))
        patch, motion = scene.patch(self.on), scene.motion
        k, stored = patch.tensor(*self.stiffness), patch.stored(*self.stiffness)
        spring = weak_forms.spring(k, motion.u, motion.known(stored), motion.w)

        def energy() -> dict[str, object]:
            in_springs = inner(0.5 * k * motion.u + stored, motion.u) * patch.measure
            return {**viscous.energy(), "stored": in_springs}

        return Contribution(viscous.work + spring * patch.measure, energy=energy)


def in_words(impedance: np.ndarray) -> str:
    """Impedances (2,), of P and of S waves, for a message."""
    return " and ".join(f"{z:.5g}" for z in impedance) + " Pa s/m"
