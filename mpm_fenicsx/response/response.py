"""What a law adds to the elastic step: the interface that the solver knows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from ..common import tensors
from ..common.ranks import of_all
from ..dynamics.motion import Motion
from ..materials.material import given_at, hooke, stiffness


class Response:
    """What laws add to the elastic response: ``work`` and ``stiffness`` as forms, or a force summed
    at points or in cells; ``summed``: the stiffness is, too.

    ``symmetric``: whether the tangents of all ``materials`` are, so that half of them is carried.
    """

    work: object = 0
    stiffness: object = 0
    summed = False

    def __init__(self, motion: Motion, materials: Sequence):
        self.motion = motion
        self.symmetric = all(material.symmetric for material in materials)
        self._plane = tensors.in_plane(motion.grid.dim)
        self.active = False

    def clear(self) -> None:
        """Nothing yields."""
        self.active = False

    def evaluate(self) -> bool:
        """Refresh everything for the motion's u; True where anything yields on any rank."""
        self.clear()
        self._respond(self.motion.nodal(self.motion.u))
        self.active = bool(of_all(self.motion.grid.comm, int(self.active)))
        return self.active

    def add_force(self, internal: np.ndarray) -> None:
        """Add what is no form to the internal force (dofs,), N."""

    def add_stiffness(self, A: PETSc.Mat, fixed: np.ndarray) -> None:
        """Add the derivative of that to the matrix, but for rows and columns of ``fixed`` dofs
        (dofs,), bool."""

    def inspect(self) -> None:
        """Raise ``ValueError`` where the step that is solved cannot be carried."""

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied; material points carry their own."""
        return {}

    def take(self, other: Response) -> None:
        """Go on from another run's state."""
        mine = self.memory()
        for name, value in other.memory().items():
            mine[name][:] = value
        self.derive()

    def derive(self) -> None:
        """Refresh what follows from the memory."""

    def _respond(self, u: np.ndarray) -> None:
        raise NotImplementedError

    def _law(
        self, material, strain, state, at, of, lame, every: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which pairs of strain ``at`` and state ``of`` yield; their stress (m, components) and
        tangent (m, components, components) beyond the reference of ``lame``.

        ``every``: all do, for ``lame`` is not the reference that the law knows.
        """
        stress, history, given = state
        rows = np.arange(len(at))
        if not every:
            rows = material.yields(strain, stress, history, at, of, given)
        at, of = at[rows], of[rows]
        ε, σ = strain[at], stress[of]
        new, _, tangent = material.tangent(ε, σ, history[of], given_at(given, of))
        lame = tuple(value if np.ndim(value) == 0 else value[of] for value in lame)
        return rows, new - hooke(lame, ε, σ), tangent - stiffness(lame, self.motion.grid.dim)
