"""Finite strain of finite elements, the reference being the mesh at rest (total Lagrangian)."""

from __future__ import annotations

import numpy as np

from ..common import tensors
from ..common.ranks import anywhere, together
from ..dynamics.motion import Motion
from ..grid import dolfinx_versions
from ..grid.gauss_points import GaussPoints
from ..materials.kinematics import FINITE_STRAIN
from .cell_materials import CellMaterials, MaterialRows, put_together
from .finite_strain import FiniteStrainAtGaussPoints
from .small_strain import energies, first_history


class FiniteStrainElements(FiniteStrainAtGaussPoints):
    """The response of finite elements: ∫ P : ∇w over the mesh, which does not move.

    Gauss points carry Cauchy's ``state`` (points, components), Pa, the deformation F and the
    materials' history.  Those of small strain, of which the forms carry the response, keep F = 1.
    Raises ``ValueError`` for materials that yield at small strain.
    """

    def __init__(self, motion: Motion, gauss: GaussPoints, materials: CellMaterials):
        super().__init__(motion, gauss, materials.materials)
        dim = motion.grid.dim
        self.parts = materials.parts(gauss.digit.shape[1])
        for part in self.parts:
            if not part.finite and not part.material.linear:
                raise ValueError(
                    "material: one that yields at small strain cannot share a run with one of "
                    f"finite strain, got {part.material!r}"
                )
        self.state = np.zeros((len(gauss), tensors.components(dim)))
        self.deformation = np.tile(np.eye(dim), (len(gauss), 1, 1))
        self.size = gauss.size if any(law.length for law in materials.materials) else None
        self.history = first_history(motion.grid.comm, self.parts, self.state, self.size)
        self._one = np.ones(len(gauss))
        self.derive()

    def derive(self) -> None:
        """Refresh what follows from the state."""
        self._kirchhoff = np.linalg.det(self.deformation)[:, None] * self.state
        self._before = self._strained()
        if self.motion.stepping.start:
            τ, dim = tensors.matrix(self._kirchhoff, self.motion.grid.dim), self.motion.grid.dim
            P = τ @ np.linalg.inv(self.deformation).transpose(0, 2, 1)
            self._nominal = self.motion.stepping.start * P.reshape(len(P), dim * dim)
            for part in self.parts:
                if not part.finite:
                    self._nominal[part.rows] = 0.0

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
        with together(self.motion.grid.comm, Exception):
            for part in self.parts:
                if part.finite:
                    rows, every = part.rows, part.numbers
                    given = part.given(self.size, slice(None))
                    states = self._before, self._one, part.columns(self.history), given
                    self.stress.rows[rows], self.tangent.rows[rows] = self._response(
                        part.material, states, gradient, F, every, every
                    )
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

        def respond(part: MaterialRows) -> tuple[np.ndarray, ...]:
            law, rows = part.material, part.rows
            history, given = part.columns(self.history)[rows], part.given(self.size, rows)
            if not part.finite:
                strain = tensors.strain(gradient[rows])
                return self.deformation[rows], *law.respond(strain, self.state[rows], history)
            strain, *_ = FINITE_STRAIN.trial(self._before, gradient, part.numbers, part.numbers)
            τ, history = law.respond(strain, np.zeros_like(strain), history, given)
            return F[rows], τ / np.linalg.det(F[rows])[:, None], history

        with together(self.motion.grid.comm, Exception):
            self.deformation, self.state, self.history = put_together(
                self.parts, respond, (self.deformation, self.state, self.history)
            )
        self.derive()

    def energy(self, cells: int) -> dict[str, float]:
        """Strain energy and plastic work (J) of the first ``cells`` cells."""
        points = cells * self.gauss.digit.shape[1]
        return energies(
            self.parts, points, self.gauss.volume, self._kirchhoff, self.history, self.size
        )
