"""Stress and tangent of finite strain at Gauss points: how they become work and stiffness."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import ufl

from ..common import tensors
from ..dynamics.motion import Motion
from ..grid import weak_forms
from ..grid.cell_means import CellMeans
from ..grid.gauss_points import GaussField, GaussPoints, measure
from ..materials import hencky_strain
from ..materials.kinematics import FINITE_STRAIN, SHEAR
from .cell_work import CellWork

Law = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class GradientForms:
    """As coefficients of forms, ``work`` and ``stiffness``: P against ∇w."""

    def __init__(self, motion: Motion, gauss: GaussPoints, symmetric: bool):
        grid = motion.grid
        size = grid.dim**2
        self._gauss = gauss
        self._layout = grid.axes, SHEAR[grid.dim], tensors.in_plane(grid.dim)
        self.stress = GaussField(grid, size)
        self.tangent = GaussField(grid, len(tensors.entries(size, symmetric)[0]))
        dx, trial = measure(motion.region.dx), ufl.TrialFunction(grid.space)
        self.work = weak_forms.nominal_work(self.stress.function, motion.w) * dx
        self.stiffness = weak_forms.nominal_stiffness(self.tangent.function, trial, motion.w) * dx

    def begin(self, gradient: np.ndarray, volumetric: np.ndarray | None) -> None:
        """Volumes change as the gradient says."""

    def rows(
        self, law: Law, state, scale: np.ndarray, deformation, pairs
    ) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of ``stress`` and ``tangent`` of pairs of a deformation and a state.

        ``law`` maps Hencky's strain to τ and ∂τ/∂ε; ``state`` is ``FINITE_STRAIN``'s, ``scale``
        (states,) s of each, P = s τ F⁻ᵀ; ``deformation``: f - 1 of the step and F of what P works
        in, at Gauss points; ``pairs`` (at, of): which rows of these.
        """
        gradient, F = deformation
        strain, *eigen = FINITE_STRAIN.trial(state, gradient, *pairs)
        out = tuple(
            np.empty((len(pairs[0]), field.rows.shape[1])) for field in (self.stress, self.tangent)
        )
        hencky_strain.nominal(self._layout, F, scale, pairs, law(strain), tuple(eigen), *out)
        return out

    def push(self, F: np.ndarray) -> None:
        """Numbers work on ∇w as they are."""

    def finish(self, F: np.ndarray, before: np.ndarray) -> None:
        """Stress is that beyond ``before`` (points, numbers), and that of the points of all
        ranks."""
        self.stress.rows -= before
        self.stress.gather()
        self.tangent.gather()

    def stress_rows(self, stress: np.ndarray) -> np.ndarray:
        """Numbers of ``stress`` of Cauchy's (m, components), Pa, at F = 1."""
        dim = len(self._layout[0])
        return tensors.matrix(stress, dim).reshape(len(stress), dim * dim)

    def add_linear(self, u: np.ndarray) -> None:
        """Add to the stress what displacements u (nodes, dim) change of it, at the start."""
        gradient = self._gauss.gradient(u)
        self.stress.rows += product(
            self.tangent.rows, gradient.reshape(len(gradient), gradient.shape[1] ** 2)
        )

    def add_force(self, u: np.ndarray, nodal: np.ndarray) -> None:
        """Nothing: forms say it."""

    def add_stiffness(self, A, fixed: np.ndarray) -> None:
        """Nothing: forms say it."""


class GradientMeans(CellWork):
    """As sums over cells, in which volume changes by that of the cell's mean gradient (F-bar).

    With J of the gradient f at a Gauss point and J̄ of its cell, stress is that of (J̄/J)^⅓ f, and
    works on ∇w f⁻¹ with its deviator and on the cell's div w with its mean: the derivative of one
    energy, where there is one (after de Souza Neto, Perić, Dutko and Owen, Int. J. Solids
    Structures 33, 1996, whose force is not).
    """

    work = stiffness = 0

    def __init__(self, means: CellMeans, motion: Motion, gauss: GaussPoints, symmetric: bool):
        dim = motion.grid.dim
        pairs = tuple(((i, j),) for i in range(dim) for j in range(dim))
        super().__init__(gauss, means, pairs, symmetric)
        self._layout = motion.grid.axes, SHEAR[dim], tensors.in_plane(dim)
        self._points, self.turns = gauss.digit.shape[1], True
        self._shift = np.zeros(len(gauss))

    def begin(self, gradient: np.ndarray, volumetric: np.ndarray) -> None:
        """Volumes change by ``volumetric`` (cells,), logarithmic, where the gradient (points, dim,
        dim) of the step says otherwise."""
        with np.errstate(divide="ignore", invalid="ignore"):
            own = np.log(tensors.stretch(gradient))
        self._shift = (np.repeat(volumetric, self._points) - own) / 3.0

    def rows(
        self, law: Law, state, scale: np.ndarray, deformation, pairs
    ) -> tuple[np.ndarray, np.ndarray]:
        """As of ``GradientForms``; against ∇w F⁻¹ until ``push``."""
        gradient, _ = deformation
        strain, *eigen = FINITE_STRAIN.trial(state, gradient, *pairs)
        strain[:, :3] += self._shift[pairs[0], None]
        out = tuple(
            np.empty((len(pairs[0]), field.rows.shape[1])) for field in (self.stress, self.tangent)
        )
        hencky_strain.by_means(
            self._layout, scale, pairs, law(strain), tuple(eigen), self._entries, *out
        )
        return out

    def push(self, F: np.ndarray) -> None:
        """Numbers, against ∇w F⁻¹ so far, work on ∇w."""
        hencky_strain.push(
            self._layout[0],
            F,
            self.stress.rows,
            self.tangent.rows,
            (*self._entries, self.symmetric),
        )

    def finish(self, F: np.ndarray, before: np.ndarray) -> None:
        """Stress is that beyond ``before`` (points, numbers), and that of the points of all
        ranks."""
        self.push(F)
        # the last works on div w as it is before the step: in ``beside``
        self.stress.rows[:, :-1] -= before[:, :-1]
        self.stress.gather()
        self.tangent.gather()

    def stress_rows(self, stress: np.ndarray) -> np.ndarray:
        """Numbers of ``stress`` of Cauchy's (m, components), Pa, at F = 1."""
        dim, p = len(self._layout[0]), tensors.mean(stress)
        deviator = tensors.matrix(stress, dim)
        for i in range(dim):
            deviator[:, i, i] -= p
        return np.column_stack((deviator.reshape(len(stress), dim * dim), p))

    def in_cells(self, values: np.ndarray) -> np.ndarray:
        """Integrals (cells,) of values at Gauss points (points,)."""
        return (self._cell_volume * values.reshape(self._cell_volume.shape)).sum(axis=1)

    def add_linear(self, u: np.ndarray) -> None:
        """Add to the stress what displacements u (nodes, dim) change of it, at the start."""
        gradient = self.gauss.gradient(u)
        θ = np.repeat(self.means.divergence(u), self._points)
        strain = np.column_stack((gradient.reshape(len(gradient), gradient.shape[1] ** 2), θ))
        self.stress.rows += product(self.tangent.rows, strain)
        turned = np.einsum("ckb,cba->cka", self.means.slopes, self.means.gradient(u))
        self.slopes = self.means.slopes - turned


def product(tangent: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """A times strain (n, size), A given by its entries (n, …), of a symmetric one the upper
    triangle."""
    size = strain.shape[1]
    symmetric = tangent.shape[1] < size**2
    i, j = tensors.entries(size, symmetric)
    full = np.empty((len(tangent), size, size))
    full[:, i, j] = tangent
    if symmetric:
        full[:, j, i] = tangent
    return np.einsum("nij,nj->ni", full, strain)
