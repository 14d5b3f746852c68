"""What a law adds to the elastic step: the interface that the solver knows."""

from __future__ import annotations

import numpy as np

from ..common import tensors
from ..dynamics.motion import Motion


class Yielding:
    """What the law adds to the elastic response: ``work`` and ``stiffness`` as forms, or a force
    summed at points."""

    work: object = 0
    stiffness: object = 0

    def __init__(self, motion: Motion):
        self.motion = motion
        self._plane = tensors.in_plane(motion.grid.dim)
        self._upper = np.triu_indices(len(self._plane))
        self.active = False

    def clear(self) -> None:
        """Nothing yields."""
        self.active = False

    def evaluate(self) -> bool:
        """Refresh everything for the motion's u; True where anything yields on any rank."""
        self.clear()
        self._respond(self.motion.nodal(self.motion.u))
        self.active = bool(self.motion.grid.comm.allreduce(int(self.active)))
        return self.active

    def add_force(self, internal: np.ndarray) -> None:
        """Add what is no form to the internal force (dofs,), N."""

    def inspect(self) -> None:
        """Raise ``ValueError`` where the step that is solved cannot be carried."""

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied; material points carry their own."""
        return {}

    def take(self, other: Yielding) -> None:
        """Go on from another run's state."""
        mine = self.memory()
        for name, value in other.memory().items():
            mine[name][:] = value
        self.derive()

    def derive(self) -> None:
        """Refresh what follows from the memory."""

    def _respond(self, u: np.ndarray) -> None:
        raise NotImplementedError

    def _law(self, material, strain, state, at, of) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which pairs of strain ``at`` and state ``of`` yield; beyond elasticity their stress, and
        their tangent in the plane."""
        stress, history, size = state
        rows = material.yields(strain, stress, history, at, of, size)
        at, of = at[rows], of[rows]
        ε, σ = strain[at], stress[of]
        new, _, tangent = material.tangent(ε, σ, history[of], None if size is None else size[of])
        i, j = self._upper
        elastic = material.elastic.tangent(ε[:1], σ[:1], None)[2]
        return (
            rows,
            new - material.elastic.update(ε, σ),
            (tangent - elastic)[:, self._plane[i], self._plane[j]],
        )
