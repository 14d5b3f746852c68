"""Finite strain of finite elements, the reference being the mesh at rest (total Lagrangian)."""

from __future__ import annotations

import numpy as np

from . import fenicsx, tensors
from .finite_strain import FiniteStrainAtGaussPoints
from .gauss import GaussPoints
from .kinematics import FINITE_STRAIN
from .motion import Motion
from .partition import anywhere, together


class FiniteStrainElements(FiniteStrainAtGaussPoints):
    """The response of finite elements: ∫ P : ∇w over the mesh, which does not move.

    Gauss points carry Cauchy's ``state`` (points, components), Pa, the deformation F and the material's history.
    """

    def __init__(self, motion: Motion, gauss: GaussPoints, material):
        super().__init__(motion, gauss)
        self.material, dim = material, motion.grid.dim
        self.state = np.zeros((len(gauss), tensors.components(dim)))
        self.deformation = np.tile(np.eye(dim), (len(gauss), 1, 1))
        self.history = np.zeros((len(gauss), len(material.history)))
        self.size = gauss.size if material.length else None
        with together(motion.grid.comm):  # what the law refuses it refuses here, on all ranks
            material.respond(np.zeros_like(self.state), self.state, self.history, self.size)
        self._all = np.arange(len(gauss), dtype=np.int32)
        self._one = np.ones(len(gauss))
        self.derive()

    def derive(self) -> None:
        """Refresh what follows from the state."""
        self._kirchhoff = np.linalg.det(self.deformation)[:, None] * self.state
        self._before = FINITE_STRAIN.state(self.material, self._kirchhoff)
        if self.motion.stepping.start:
            τ, dim = tensors.matrix(self._kirchhoff, self.motion.grid.dim), self.motion.grid.dim
            P = τ @ np.linalg.inv(self.deformation).transpose(0, 2, 1)
            self._nominal = self.motion.stepping.start * P.reshape(len(P), dim * dim)

    def _step(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F at the end of the step, and the gradient f - 1 of the step, f = F Fₙ⁻¹."""
        gradient = self.gauss.gradient(u)
        return self.deformation + gradient, gradient @ np.linalg.inv(self.deformation)

    def _respond(self, u: np.ndarray) -> None:
        F, gradient = self._step(u)
        states = self._before, self._one, self.history, self.size
        rows = self._all
        self.stress.rows[:], self.tangent.rows[:] = self._response(self.material, states, gradient, F, rows, rows)
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
            x = grid.mesh.geometry.x[fenicsx.cell_vertices(grid.mesh)[cell], : grid.dim].mean(axis=0)
            message = f"cell {cell} with its centre at x={x} turns inside out: det F = {J[g]:.3g}"
        message = anywhere(grid.comm, message)
        if message:
            raise ValueError(message)

    def carry(self) -> None:
        """State at the end of the step."""
        F, gradient = self._step(self.motion.nodal(self.motion.u))
        strain, *_ = FINITE_STRAIN.trial(self._before, gradient, self._all, self._all)
        τ, self.history = self.material.respond(strain, np.zeros_like(strain), self.history, self.size)
        self.deformation, self.state = F, τ / np.linalg.det(F)[:, None]
        self.derive()

    def energy(self, cells: int) -> dict[str, float]:
        """Strain energy and plastic work (J) of the first ``cells`` cells."""
        count = cells * self.gauss.digit.shape[1]
        volume, size = self.gauss.volume[:count], None if self.size is None else self.size[:count]
        found = {"strain": float(volume @ self.material.energy(self._kirchhoff[:count]))}
        if self.material.history:
            found["plastic"] = float(volume @ self.material.plastic_work(self.history[:count], size))
        return found
