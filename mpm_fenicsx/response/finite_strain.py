"""Finite strain within a step, the step's start being the reference: P : ∇w in place of σ : ε(w).

With f = I + ∇u and J, σ before the step, a point works with P = τ(f) f⁻ᵀ/J against ∇w, per its
volume before the step, and P = σ at u = 0.  What the points bear at the start is summed at the
points; here the rest is added, P - σ, and the tangent ∂P/∂f, geometric stiffness included.  The
forms carry none of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
import ufl
from petsc4py import PETSc

from ..common import tensors
from ..common.ranks import together
from ..dynamics.motion import Motion
from ..grid import weak_forms
from ..grid.cell_means import CellMeans
from ..grid.gauss_points import GaussField, GaussPoints
from ..mapping.double_mapping import add, pairs_of
from ..mapping.projection import AT_POINTS, DOUBLE_MAPPED, Integration, Projection
from ..mapping.shape_functions import Stencil
from ..materials import hencky_strain
from ..materials.kinematics import FINITE_STRAIN, SHEAR, deformation, volume_ratio
from ..materials.material import Given, given_at
from ..points.material_points import MaterialPoints
from .gradient_fields import GradientForms, GradientMeans, Law, product
from .response import Response

CHUNK = 4096  # pairs of a point and a Gauss point at a time: their tangents stay in the cache


class FiniteStrain(Response):
    """The whole response of bodies of finite strain.

    Between the solves of a step it is exact; for the first it is linear in u.
    """

    def _law(self, material, history: np.ndarray, given: Given) -> Law:
        """Hencky's strain (m, components) to τ, Pa, and ∂τ/∂ε."""

        def tangent(strain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            τ, _, D = material.tangent(strain, np.zeros_like(strain), history, given)
            return τ, D

        return tangent


def states_of(body: MaterialPoints):
    """Those of ``FINITE_STRAIN``, factors of P, history and parameters of the points of a body,
    before the step."""
    J = volume_ratio(body)
    return (
        FINITE_STRAIN.state(body.material, J[:, None] * body.stress),
        1.0 / J,
        body.remembered,
        body.parameters,
    )


class FiniteStrainAtGaussPoints(FiniteStrain):
    """The same as fields at the Gauss points: of the gradient there, or with volume changes cell by
    cell where there are ``means``."""

    def __init__(
        self,
        motion: Motion,
        gauss: GaussPoints,
        materials: Sequence,
        means: CellMeans | None = None,
    ):
        super().__init__(motion, materials)
        kind = GradientForms if means is None else partial(GradientMeans, means)
        self.gauss, self.means = gauss, means
        self.fields, self.summed = kind(motion, gauss, self.symmetric), means is not None
        self.stress, self.tangent = self.fields.stress, self.fields.tangent
        self.work, self.stiffness = self.fields.work, self.fields.stiffness

    def clear(self) -> None:
        """The response linear about the start of the step, at the motion's u."""
        u = self.motion.nodal(self.motion.u)
        self._respond(np.zeros_like(u))
        if u.any():
            self.fields.add_linear(u)

    def evaluate(self) -> bool:
        """Refresh everything for the motion's u."""
        self._respond(self.motion.nodal(self.motion.u))
        return True

    def add_force(self, internal: np.ndarray) -> None:
        """Add what is no form to the internal force (dofs,), N."""
        u = self.motion.nodal(self.motion.u)
        self.fields.add_force(u, internal.reshape(u.shape))

    def add_stiffness(self, A: PETSc.Mat, fixed: np.ndarray) -> None:
        """Add the derivative of that to the matrix."""
        self.fields.add_stiffness(A, fixed)


class FiniteStrainPoints(FiniteStrainAtGaussPoints):
    """The response of material points, double-mapped: each is asked at every Gauss point that it
    reaches."""

    def __init__(
        self,
        motion: Motion,
        gauss: GaussPoints,
        bodies: Sequence[tuple[MaterialPoints, Stencil]],
        means: CellMeans | None = None,
    ):
        super().__init__(motion, gauss, [body.material for body, _ in bodies], means)
        self._bodies = bodies
        self._before = np.zeros_like(self.stress.rows)
        self._pressure = None if means is None else GaussField(motion.grid, 1)

    def place(self) -> None:
        """Find the pairs, and the states before the step."""
        self._pairs = [pairs_of(self.gauss, body, stencil) for body, stencil in self._bodies]
        self._states = [states_of(body) for body, _ in self._bodies]
        fields = self.fields
        self._before[:] = 0.0
        for (body, _), (point, where, weight) in zip(self._bodies, self._pairs, strict=True):
            add(where, weight, fields.stress_rows(body.stress)[point], self._before)
        if self.means is not None:
            pressure = self._pressure.rows[:, 0]
            pressure[:] = self._before[:, -1]
            self._pressure.gather()
            fields.beside = [(-fields.in_cells(pressure), self.means.slopes)]

    def _respond(self, u: np.ndarray) -> None:
        self.stress.rows[:] = self.tangent.rows[:] = 0.0
        gradient, fields = self.gauss.gradient(u), self.fields
        f = deformation(gradient)
        if self.means is not None:
            fields.begin(gradient, self.means.log_stretch(u))
            fields.slopes = self.means.pushed(u)
        with together(self.motion.grid.comm, Exception):
            for (body, _), pairs, states in zip(
                self._bodies, self._pairs, self._states, strict=True
            ):
                state, scale, history, given = states
                for point, where, weight in _chunks(*pairs):
                    law = self._law(body.material, history[point], given_at(given, point))
                    stress, tangent = fields.rows(law, state, scale, (gradient, f), (where, point))
                    add(where, weight, stress, self.stress.rows)
                    add(where, weight, tangent, self.tangent.rows)
        fields.finish(f, self._before)


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
        grid, size = motion.grid, motion.grid.dim**2
        self._numbers = size, len(tensors.entries(size, self.symmetric)[0])
        self._layout = grid.axes, SHEAR[grid.dim], self._plane
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
            self._deposit(
                body, stencil, -product(tangent, recover(u).reshape(len(body), body.dim**2))
            )
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
                stress, tangent = self._response(body.material, states, gradient, rows)
            self._deposit(
                body, stencil, stress - tensors.matrix(body.stress, body.dim).reshape(stress.shape)
            )
            self._tangent.add(stencil, body.volume[:, None] * tangent)
            tangents.append(tangent)
        self._tangent.finish()
        return tangents

    def _response(self, material, states, gradient: np.ndarray, rows: np.ndarray):
        """P (n, dim²) and ∂P/∂F (n, entries) of points with the gradients of the step."""
        state, scale, history, given = states
        strain, *eigen = FINITE_STRAIN.trial(state, gradient, rows, rows)
        law = self._law(material, history, given)(strain)
        stress, tangent = (np.empty((len(rows), n)) for n in self._numbers)
        hencky_strain.nominal(
            self._layout,
            deformation(gradient),
            scale,
            (rows, rows),
            law,
            tuple(eigen),
            stress,
            tangent,
        )
        return stress, tangent

    def _deposit(self, body: MaterialPoints, stencil: Stencil, stress: np.ndarray) -> None:
        force = body.volume[:, None] * stress
        stencil.deposit_divergence(force.reshape(len(body), body.dim, body.dim), self._force)


def finite_strain_of(
    motion: Motion,
    bodies: Sequence[MaterialPoints],
    stencils: Sequence[Stencil],
    integration: Integration,
    recover: Callable[[int, np.ndarray], np.ndarray],
    means: CellMeans | None = None,
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
        return FiniteStrainPoints(motion, GaussPoints(motion.grid), chosen, means)
    return FiniteStrainSums(motion, chosen, [lambda u, n=n: recover(n, u) for n in finite])
