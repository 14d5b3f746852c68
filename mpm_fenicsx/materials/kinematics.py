"""How a body's points strain: small increments that add up, or multiplicative in Hencky's strain.

The material says which, by its attribute ``kinematics``.
"""

from __future__ import annotations

import numpy as np

from ..common import tensors
from . import hencky_strain

SHEAR = {dim: np.array(pairs) for dim, pairs in tensors.SHEAR.items()}


class SmallStrain:
    """Strain increments ε(∇u) add up; the forms carry the elastic response."""

    finite = False

    def reference(self, material) -> tuple[float, float]:
        """λ and μ (Pa) of the elastic response that the forms of finite elements carry."""
        return material.lame

    def moduli(self, body) -> tuple:
        """The same of material points, as they are now: two numbers or two (n,)."""
        return body.material.moduli(body.stress, body.remembered, body.parameters)

    def respond(self, body, gradient: np.ndarray, volumetric: np.ndarray | None = None) -> None:
        """Give the points stress and history after the displacement gradients (n, dim, dim);
        ``volumetric`` (n,) strain in place of the gradients' own."""
        strain = tensors.strain(gradient)
        if volumetric is not None:
            strain = tensors.dilate(strain, volumetric)
        body.bear(*body.material.respond(strain, body.stress, body.remembered, body.parameters))

    def change(self, before: np.ndarray, after: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """What the step has changed of stress, Pa, per volume before it; rows (n, components), as
        before and after."""
        return after - before

    def energy(self, body) -> float:
        """Strain energy (J)."""
        return float(body.volume @ body.material.energy(body.stress, body.remembered))

    def plastic_work(self, body) -> float:
        """Plastic work (J)."""
        return float(body.volume @ body.material.plastic_work(body.remembered, body.parameters))


class FiniteStrain:
    """F = Fᵉ Fᵖ with Hencky's strain ε = ½ ln Fᵉ Fᵉᵀ and a law τ(ε) between it and Kirchhoff's
    stress τ = J σ.

    For isotropic laws the return map of small strain is then the exact one of the exponential map,
    in Hencky's strain (Simo, Comput. Methods Appl. Mech. Engrg. 99, 1992).  Nothing more has to be
    kept: ε = C⁻¹ : J σ, and J is volume over volume at rest, mass/density.  Stress given to points
    at the start is that of the body at J = 1. The forms carry none of the response: see
    ``finite_strain``.
    """

    finite = True

    def reference(self, material) -> tuple[float, float]:
        """None of the response is linear."""
        return 0.0, 0.0

    def moduli(self, body) -> tuple[float, float]:
        """None of the response is linear."""
        return 0.0, 0.0

    def respond(self, body, gradient: np.ndarray, volumetric: np.ndarray | None = None) -> None:
        """Give the points stress and history after the displacement gradients (n, dim, dim);
        ``volumetric`` (n,) strain, logarithmic, in place of the gradients' own."""
        J, rows = volume_ratio(body), np.arange(len(body), dtype=np.int32)
        strain, *_ = self.trial(
            self.state(body.material, J[:, None] * body.stress), gradient, rows, rows
        )
        stretch = tensors.stretch(gradient)
        if volumetric is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                strain[:, :3] += ((volumetric - np.log(stretch)) / 3.0)[:, None]
            stretch = np.exp(volumetric)
        at_rest = np.zeros_like(strain)
        stress, history = body.material.respond(strain, at_rest, body.remembered, body.parameters)
        # ``deform`` names a point that turns inside out
        with np.errstate(divide="ignore", invalid="ignore"):
            body.bear(stress / (J * stretch)[:, None], history)

    def state(self, material, kirchhoff: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Elastic left Cauchy-Green tensors less 1, (n, dim, dim), of τ (n, components), Pa, and
        ε_zz (n,)."""
        strain, dim = material.strain(kirchhoff), 2 if kirchhoff.shape[1] == 4 else 3
        E = np.empty((len(strain), dim, dim))
        hencky_strain.exponential(strain, SHEAR[dim], E)
        return E, np.ascontiguousarray(strain[:, 2])

    def trial(
        self, state, gradient: np.ndarray, at: np.ndarray, of: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Hencky's strain rows (m, components), were the step elastic, and eigenvalues (m, dim) and
        eigenvectors (m, dim, dim) of b, for pairs of a gradient f - 1, row ``at`` (m,), and a
        state, row ``of`` (m,)."""
        m, dim = len(at), gradient.shape[1]
        out = np.empty((m, tensors.components(dim))), np.empty((m, dim)), np.empty((m, dim, dim))
        hencky_strain.trial(gradient, state, (at, of), SHEAR[dim], out)
        return out

    def change(self, before: np.ndarray, after: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """The same of the first Piola-Kirchhoff stress (n, dim, dim), σ J f⁻ᵀ after the step, f the
        step's own deformation."""
        dim = gradient.shape[1]
        return tensors.matrix(after, dim) @ tensors.cofactor(gradient) - tensors.matrix(before, dim)

    def energy(self, body) -> float:
        """Strain energy (J): that of τ per volume at rest."""
        J = volume_ratio(body)
        return float(
            (body.volume / J) @ body.material.energy(J[:, None] * body.stress, body.remembered)
        )

    def plastic_work(self, body) -> float:
        """Plastic work (J), per volume at rest."""
        work = body.material.plastic_work(body.remembered, body.parameters)
        return float(body.mass @ work) / body.material.density


def volume_ratio(body) -> np.ndarray:
    """J (n,): volume over volume at rest."""
    return body.volume * (body.material.density / body.mass)


def deformation(gradient: np.ndarray) -> np.ndarray:
    """I + ∇u (n, dim, dim)."""
    return gradient + np.eye(gradient.shape[1])


SMALL_STRAIN = SmallStrain()
FINITE_STRAIN = FiniteStrain()
