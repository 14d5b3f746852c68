"""Finite strain of finite elements, the reference being the mesh at rest (total Lagrangian)."""

from __future__ import annotations

import numpy as np

from ..common import tensors
from ..common.ranks import anywhere, together
from ..dynamics.motion import Motion
from ..grid import dolfinx_versions
from ..grid.cell_means import CellMeans
from ..grid.gauss_points import GaussPoints
from ..materials.kinematics import FINITE_STRAIN
from ..materials.material import given_at
from .cell_materials import CellMaterials, MaterialRows, put_together
from .finite_strain import FiniteStrainAtGaussPoints
from .small_strain import energies, first_history


class FiniteStrainElements(FiniteStrainAtGaussPoints):
    """The response of finite elements: ∫ P : ∇w over the mesh, which does not move.

    Gauss points carry Cauchy's ``state`` (points, components), Pa, the deformation F and the
    materials' history.  Those of small strain, of which the forms carry the response, keep F = 1.
    ``stress`` (points, components), Pa, is that at the start, of F = 1.
    Raises ``ValueError`` for materials that yield at small strain, and for a stress where there are
    any of small strain.
    """

    def __init__(
        self,
        motion: Motion,
        gauss: GaussPoints,
        materials: CellMaterials,
        means: CellMeans | None = None,
        stress: np.ndarray | None = None,
    ):
        super().__init__(motion, gauss, materials.materials, means)
        dim = motion.grid.dim
        self.parts = materials.parts(gauss.digit.shape[1])
        for part in self.parts:
            if not part.finite and not part.material.linear:
                raise ValueError(
                    "material: one that yields at small strain cannot share a run with one of "
                    f"finite strain, got {part.material!r}"
                )
            if stress is not None and not part.finite:
                raise ValueError(
                    "stress at the start needs materials of one kind, and one of small strain "
                    f"shares this run with others of finite strain: make it a Hencky, got "
                    f"{part.material!r}"
                )
        self.state = np.zeros((len(gauss), tensors.components(dim)))
        if stress is not None:
            self.state[:] = stress
        self.deformation = np.tile(np.eye(dim), (len(gauss), 1, 1))
        self.size = gauss.size if any(law.length for law in materials.materials) else None
        self.history = first_history(motion.grid.comm, self.parts, self.state, self.size)
        self._one = np.ones(len(gauss))
        self.derive()

    def derive(self) -> None:
        """Refresh what follows from the state."""
        self._kirchhoff = self._volume_ratio(self.deformation)[:, None] * self.state
        self._before = self._strained()
        if self.motion.stepping.start:
            self._work_of_start()

    def _volume_ratio(self, F: np.ndarray) -> np.ndarray:
        """J (points,) that stress belongs to: of the deformations (points, dim, dim), or of the
        cells' means of them."""
        if self.means is None:
            return np.linalg.det(F)
        return np.repeat(np.linalg.det(self.gauss.mean_of_cells(F)), self.gauss.digit.shape[1])

    def _work_of_start(self) -> None:
        """What stress before the step works with, weighed by ``stepping.start``."""
        start, τ = self.motion.stepping.start, self._kirchhoff.copy()
        for part in self.parts:
            if not part.finite:
                τ[part.rows] = 0.0
        rows = self.fields.stress_rows(τ)
        size = self.motion.grid.dim**2
        P = rows[:, :size].reshape(self.deformation.shape) @ np.linalg.inv(
            self.deformation
        ).transpose(0, 2, 1)
        self._nominal = np.zeros_like(self.stress.rows)
        self._nominal[:, :size] = start * P.reshape(len(P), size)
        if self.means is not None:
            pressure = start * self.fields.in_cells(rows[:, -1])
            slopes = self.means.after(self.gauss.mean_of_cells(self.deformation))
            self.fields.beside = [(pressure, slopes)]

    def _strained(self) -> tuple[np.ndarray, np.ndarray]:
        """``FINITE_STRAIN``'s state of all Gauss points."""
        zero = np.zeros_like(self.deformation), np.zeros(len(self.deformation))

        def state(part: MaterialRows) -> tuple[np.ndarray, np.ndarray]:
            if not part.finite:
                return tuple(a[part.rows] for a in zero)
            return FINITE_STRAIN.state(part.material, self._kirchhoff[part.rows])

        return put_together(self.parts, state, zero)

    def _step(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F at the end of the step, and the gradient f - 1 of the step, f = F Fₙ⁻¹."""
        gradient = self.gauss.gradient(u)
        return self.deformation + gradient, gradient @ np.linalg.inv(self.deformation)

    def _respond(self, u: np.ndarray) -> None:
        F, gradient = self._step(u)
        fields = self.fields
        if self.means is not None:
            before, after = (self.gauss.mean_of_cells(f) for f in (self.deformation, F))
            with np.errstate(invalid="ignore", divide="ignore"):
                fields.begin(gradient, np.log(np.linalg.det(after) / np.linalg.det(before)))
            fields.slopes = self.means.after(after)
        with together(self.motion.grid.comm, Exception):
            for part in self.parts:
                if part.finite:
                    rows, every = part.rows, part.numbers
                    given = given_at(part.given(self.size, slice(None)), every)
                    history = part.columns(self.history)[every]
                    law = self._law(part.material, history, given)
                    self.stress.rows[rows], self.tangent.rows[rows] = fields.rows(
                        law, self._before, self._one, (gradient, F), (every, every)
                    )
        fields.push(F)
        if self.motion.stepping.start:
            self.stress.rows += self._nominal

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        return {"stress": self.state, "history": self.history, "deformation": self.deformation}

    def inspect(self) -> None:
        """Raise ``ValueError`` on all ranks, naming a cell that the step turns inside out."""
        grid, message = self.motion.grid, None
        F, _ = self._step(self.motion.nodal(self.motion.u))
        J = np.linalg.det(F)
        if not J.min(initial=1.0) > 0.0:
            g = int(np.argmin(J))
            cell = g // self.gauss.digit.shape[1]
            x = grid.mesh.geometry.x[
                dolfinx_versions.cell_vertices(grid.mesh)[cell], : grid.dim
            ].mean(axis=0)
            message = f"cell {cell} with its centre at x={x} turns inside out: det F = {J[g]:.3g}"
        message = anywhere(grid.comm, message)
        if message:
            raise ValueError(message)

    def carry(self) -> None:
        """State at the end of the step."""
        F, gradient = self._step(self.motion.nodal(self.motion.u))
        J = self._volume_ratio(F)
        shift = np.zeros(len(J))
        if self.means is not None:
            before = self._volume_ratio(self.deformation)
            shift = np.log(J / before / tensors.stretch(gradient)) / 3.0

        def respond(part: MaterialRows) -> tuple[np.ndarray, ...]:
            law, rows = part.material, part.rows
            history, given = part.columns(self.history)[rows], part.given(self.size, rows)
            if not part.finite:
                strain = self._small_strain(gradient)[rows]
                return self.deformation[rows], *law.respond(strain, self.state[rows], history)
            strain, *_ = FINITE_STRAIN.trial(self._before, gradient, part.numbers, part.numbers)
            strain[:, :3] += shift[rows, None]
            τ, history = law.respond(strain, np.zeros_like(strain), history, given)
            return F[rows], τ / J[rows, None], history

        with together(self.motion.grid.comm, Exception):
            self.deformation, self.state, self.history = put_together(
                self.parts, respond, (self.deformation, self.state, self.history)
            )
        self.derive()

    def _small_strain(self, gradient: np.ndarray) -> np.ndarray:
        """Strain rows (points, components) of gradients at F = 1."""
        strain = tensors.strain(gradient)
        if self.means is not None:
            θ = self.means.divergence(self.motion.nodal(self.motion.u))
            strain = tensors.dilate(strain, np.repeat(θ, self.gauss.digit.shape[1]))
        return strain

    def energy(self, cells: int) -> dict[str, float]:
        """Strain energy and plastic work (J) of the first ``cells`` cells."""
        points = cells * self.gauss.digit.shape[1]
        return energies(
            self.parts, points, self.gauss.volume, self._kirchhoff, self.history, self.size
        )
