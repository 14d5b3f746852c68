"""Stress and tangent of small strain at Gauss points: how they become work and stiffness."""

from __future__ import annotations

import numpy as np
import ufl

from ..common import tensors
from ..dynamics.motion import Motion
from ..grid import weak_forms
from ..grid.cell_means import CellMeans
from ..grid.gauss_points import GaussField, GaussPoints, measure
from .cell_work import CellWork


class StrainForms:
    """As coefficients of forms, ``work`` and ``stiffness``, against strain in the plane."""

    def __init__(self, motion: Motion, gauss: GaussPoints, symmetric: bool):
        grid = motion.grid
        self._gauss, self._plane = gauss, tensors.in_plane(grid.dim)
        self._entries = tensors.entries(len(self._plane), symmetric)
        self.stress = GaussField(grid, len(self._plane))
        self.tangent = GaussField(grid, len(self._entries[0]))
        dx, trial = measure(motion.region.dx), ufl.TrialFunction(grid.space)
        self.work = weak_forms.plastic_work(self.stress.function, motion.w) * dx
        self.stiffness = weak_forms.plastic_stiffness(self.tangent.function, trial, motion.w) * dx

    def strain(self, u: np.ndarray) -> np.ndarray:
        """Strain rows (points, components) of nodal displacements (nodes, dim)."""
        return self._gauss.strain(u)

    def stress_rows(self, stress: np.ndarray) -> np.ndarray:
        """Numbers of ``stress`` of stress rows (m, components)."""
        return stress[:, self._plane]

    def tangent_rows(self, tangent: np.ndarray) -> np.ndarray:
        """Numbers of ``tangent`` of ∂σ/∂ε (m, components, components)."""
        i, j = self._entries
        return tangent[:, self._plane[i], self._plane[j]]

    def add_force(self, u: np.ndarray, nodal: np.ndarray) -> None:
        """Nothing: forms say it."""

    def add_stiffness(self, A, fixed: np.ndarray) -> None:
        """Nothing: forms say it."""


class StrainMeans(CellWork):
    """As sums over cells, in which volume changes by the cell's mean."""

    work = stiffness = 0

    def __init__(self, means: CellMeans, motion: Motion, gauss: GaussPoints, symmetric: bool):
        dim = motion.grid.dim
        normal = (((i, i),) for i in range(dim))
        shear = (((i, j), (j, i)) for i, j in tensors.SHEAR[dim])
        super().__init__(gauss, means, (*normal, *shear), symmetric)
        plane, count = tensors.in_plane(dim), tensors.components(dim)
        # strain rows of strain in the plane, of which the volume's part is left out, and of θ
        self._way = np.zeros((count, len(plane) + 1))
        self._way[plane, range(len(plane))] = 1.0
        self._way[:3, :dim] -= 1.0 / 3.0
        self._way[:3, -1] = 1.0 / 3.0

    def strain(self, u: np.ndarray) -> np.ndarray:
        """Strain rows (points, components) of nodal displacements (nodes, dim)."""
        return self.gauss.strain(u, self.means)

    def stress_rows(self, stress: np.ndarray) -> np.ndarray:
        """Numbers of ``stress`` of stress rows (m, components)."""
        return stress @ self._way

    def tangent_rows(self, tangent: np.ndarray) -> np.ndarray:
        """Numbers of ``tangent`` of ∂σ/∂ε (m, components, components)."""
        i, j = self._entries
        return (self._way.T @ tangent @ self._way)[:, i, j]
