"""Finite strain within a step, the step's start being the reference: P : ∇w in place of σ : ε(w).

With f = I + ∇u and J, σ before the step, a point works with P = τ(f) f⁻ᵀ/J against ∇w, per its
volume before the step, and P = σ at u = 0.  What the points bear at the start is summed at the
points; here the rest is added, P - σ, and the tangent ∂P/∂f, geometric stiffness included.  The
forms carry none of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import ufl

from ..common import tensors
from ..common.ranks import together
from ..dynamics.motion import Motion
from ..grid import weak_forms
from ..grid.gauss_points import GaussField, GaussPoints, measure
from ..mapping.double_mapping import add, pairs_of
from ..mapping.projection import AT_POINTS, DOUBLE_MAPPED, Integration, Projection
from ..mapping.shape_functions import Stencil
from ..materials import hencky_strain
from ..materials.kinematics import FINITE_STRAIN, SHEAR, deformation, volume_ratio
from ..materials.material import given_at
from ..points.material_points import MaterialPoints
from .response import Response

CHUNK = 4096  # pairs of a point and a Gauss point at a time: their tangents stay in the cache


class FiniteStrain(Response):
    """The whole response of bodies of finite strain.

    Between the solves of a step it is exact; for the first it is linear in u.
    """

    def __init__(self, motion: Motion, materials: Sequence):
        super().__init__(motion, materials)
        size, axes = motion.grid.dim**2, motion.grid.axes
        self._numbers = size, len(tensors.entries(size, self.symmetric)[0])
        self._layout = axes, SHEAR[motion.grid.dim], self._plane

    def _response(
        self, material, states, gradient: np.ndarray, F: np.ndarray, at: np.ndarray, of: np.ndarray
    ):
        """P (m, dim²) and ∂P/∂F (m, entries) of pairs: deformation ``at`` and state ``of``.

        ``states``: those of ``FINITE_STRAIN``, factors of P, history and parameters; ``gradient``:
        f - 1 of the step; ``F`` the deformation of the configuration that P works in.
        """
        state, scale, history, given = states
        strain, *eigen = FINITE_STRAIN.trial(state, gradient, at, of)
        at_rest = np.zeros_like(strain)
        τ, _, D = material.tangent(strain, at_rest, history[of], given_at(given, of))
        stress, tangent = (np.empty((len(at), n)) for n in self._numbers)
        hencky_strain.nominal(
            self._layout, F, scale, (at, of), (τ, D), tuple(eigen), stress, tangent
        )
        return stress, tangent


def states_of(body: MaterialPoints):
    """What ``FiniteStrain._response`` wants to know of the points of a body, before the step."""
    J = volume_ratio(body)
    return (
        FINITE_STRAIN.state(body.material, J[:, None] * body.stress),
        1.0 / J,
        body.remembered,
        body.parameters,
    )


def product(tangent: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """A : ∇u (n, dim²), A given by its entries (n, …), of a symmetric one the upper triangle."""
    size = gradient.shape[1] ** 2
    symmetric = tangent.shape[1] < size**2
    i, j = tensors.entries(size, symmetric)
    full = np.empty((len(tangent), size, size))
    full[:, i, j] = tangent
    if symmetric:
        full[:, j, i] = tangent
    return np.einsum("nij,nj->ni", full, gradient.reshape(-1, size))


class FiniteStrainAtGaussPoints(FiniteStrain):
    """The same as fields at the Gauss points."""

    def __init__(self, motion: Motion, gauss: GaussPoints, materials: Sequence):
        super().__init__(motion, materials)
        self.gauss, grid = gauss, motion.grid
        self.stress, self.tangent = (GaussField(grid, n) for n in self._numbers)
        dx, trial = measure(motion.region.dx), ufl.TrialFunction(grid.space)
        self.work = weak_forms.nominal_work(self.stress.function, motion.w) * dx
        self.stiffness = weak_forms.nominal_stiffness(self.tangent.function, trial, motion.w) * dx

    def clear(self) -> None:
        """The response linear about the start of the step, at the motion's u."""
        u = self.motion.nodal(self.motion.u)
        self._respond(np.zeros_like(u))
        if u.any():
            self.stress.rows += product(self.tangent.rows, self.gauss.gradient(u))

    def evaluate(self) -> bool:
        """Refresh everything for the motion's u."""
        self._respond(self.motion.nodal(self.motion.u))
        return True


class FiniteStrainPoints(FiniteStrainAtGaussPoints):
    """The response of material points, double-mapped: each is asked at every Gauss point that it
    reaches."""

    def __init__(
        self, motion: Motion, gauss: GaussPoints, bodies: Sequence[tuple[MaterialPoints, Stencil]]
    ):
        super().__init__(motion, gauss, [body.material for body, _ in bodies])
        self._bodies = bodies

    def place(self) -> None:
        """Find the pairs, and the states before the step."""
        self._pairs = [pairs_of(self.gauss, body, stencil) for body, stencil in self._bodies]
        self._states = [states_of(body) for body, _ in self._bodies]

    def _respond(self, u: np.ndarray) -> None:
        self.stress.rows[:] = self.tangent.rows[:] = 0.0
        gradient = self.gauss.gradient(u)
        f = deformation(gradient)
        with together(self.motion.grid.comm, Exception):
            for (body, _), pairs, states in zip(
                self._bodies, self._pairs, self._states, strict=True
            ):
                before = tensors.matrix(body.stress, body.dim).reshape(len(body), body.dim**2)
                for point, where, weight in _chunks(*pairs):
                    stress, tangent = self._response(
                        body.material, states, gradient, f, where, point
                    )
                    add(where, weight, stress - before[point], self.stress.rows)
                    add(where, weight, tangent, self.tangent.rows)
        self.stress.gather()
        self.tangent.gather()


def _chunks(*arrays: np.ndarray) -> Iterator[tuple[np.ndarray, ...]]:
    for start in range(0, len(arrays[0]), CHUNK):
        yield tuple(a[start : start + CHUNK] for a in arrays)


class FiniteStrainSums(FiniteStrain):
    """The response of material points where integrals are taken at the points, with the gradients
    they recover.

    What is linear in u is a form, with the tangent at the start of the step, projected; what goes
    beyond is summed at the points.  With linear shape functions both are point sums, and the matrix
    is the derivative.  With support domains the form has the mean over the domain of ∇N ∇N, the
    points ∇S ∇S, so that the difference is left to the next step.  ``recover`` maps nodal u to a
    body's displacement gradients (n, dim, dim).
    """

    def __init__(
        self,
        motion: Motion,
        bodies: Sequence[tuple[MaterialPoints, Stencil]],
        recover: Sequence[Callable[[np.ndarray], np.ndarray]],
    ):
        super().__init__(motion, [body.material for body, _ in bodies])
        grid = motion.grid
        self._bodies, self._recover = bodies, recover
        self._force = np.zeros((grid.nodes, grid.dim))
        self._start, self._tangent = (
            Projection(grid, AT_POINTS, self._numbers[1]) for _ in range(2)
        )
        dx = motion.region.dx(metadata={"quadrature_degree": AT_POINTS.quadrature})
        trial = ufl.TrialFunction(grid.space)
        self.work = (
            weak_forms.nominal_stiffness(ufl.as_vector(self._start.fields), motion.u, motion.w) * dx
        )
        self.stiffness = (
            weak_forms.nominal_stiffness(ufl.as_vector(self._tangent.fields), trial, motion.w) * dx
        )

    def place(self) -> None:
        """Find the states before the step."""
        self._states = [states_of(body) for body, _ in self._bodies]

    def clear(self) -> None:
        """The response linear about the start of the step."""
        self._linear = self._respond(np.zeros_like(self.motion.nodal(self.motion.u)))
        for start, now in zip(self._start.fields, self._tangent.fields, strict=True):
            start.x.array[:] = now.x.array
        self._force[:] = 0.0

    def evaluate(self) -> bool:
        """Refresh everything for the motion's u."""
        u = self.motion.nodal(self.motion.u)
        self._respond(u)
        for (body, stencil), recover, tangent in zip(
            self._bodies, self._recover, self._linear, strict=True
        ):
            self._deposit(body, stencil, -product(tangent, recover(u)))
        return True

    def add_force(self, internal: np.ndarray) -> None:
        """Add Σ_p V_p (P_p - σ_p - A_p : ∇u) ∇S_ip."""
        internal += self._force.ravel()

    def _respond(self, u: np.ndarray) -> list[np.ndarray]:
        self._force[:] = 0.0
        self._tangent.clear()
        tangents = []
        for (body, stencil), recover, states in zip(
            self._bodies, self._recover, self._states, strict=True
        ):
            gradient, rows = recover(u), np.arange(len(body), dtype=np.int32)
            with together(self.motion.grid.comm, Exception):
                stress, tangent = self._response(
                    body.material, states, gradient, deformation(gradient), rows, rows
                )
            self._deposit(
                body, stencil, stress - tensors.matrix(body.stress, body.dim).reshape(stress.shape)
            )
            self._tangent.add(stencil, body.volume[:, None] * tangent)
            tangents.append(tangent)
        self._tangent.finish()
        return tangents

    def _deposit(self, body: MaterialPoints, stencil: Stencil, stress: np.ndarray) -> None:
        force = body.volume[:, None] * stress
        stencil.deposit_divergence(force.reshape(len(body), body.dim, body.dim), self._force)


def finite_strain_of(
    motion: Motion,
    bodies: Sequence[MaterialPoints],
    stencils: Sequence[Stencil],
    integration: Integration,
    recover: Callable[[int, np.ndarray], np.ndarray],
) -> FiniteStrain | None:
    """The response of those bodies that are of finite strain, None where there are none.

    Raises ``ValueError`` where others yield at small strain.
    """
    finite = [n for n, body in enumerate(bodies) if body.material.kinematics.finite]
    if not finite:
        return None
    for n, body in enumerate(bodies):
        if n not in finite and not body.material.linear:
            raise ValueError(
                "points: a body that yields at small strain cannot share a run with one of finite "
                f"strain, got {body.material!r}"
            )
    chosen = [(bodies[n], stencils[n]) for n in finite]
    if integration is DOUBLE_MAPPED:
        return FiniteStrainPoints(motion, GaussPoints(motion.grid), chosen)
    return FiniteStrainSums(motion, chosen, [lambda u, n=n: recover(n, u) for n in finite])
