"""Accelerations at the end of a step, made to fit the force of the stress that material points then
bear."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from dolfinx import fem

from ..grid import dolfinx_versions
from ..mapping.methods import AccelerationCorrection
from ..mapping.velocities import Deposit
from .equilibrium import Equilibrium


class Correction:
    """Corrects nodal velocity and acceleration at the end of a step by the mismatch of forces -(ΔF
    - K u).

    K u is the increment of internal force that the step's matrix foresees, eq. (7), and ΔF that of
    the stress which points take from their own strain.  Where points go on with the acceleration
    that K u gives, the next step begins with forces that do not fit it, and waves lose energy in
    proportion to Δt, the more so where K locks.
    """

    def __init__(self, equilibrium: Equilibrium):
        self._equilibrium = equilibrium
        equilibrium.foresee()
        self._force = fem.Function(equilibrium.motion.grid.space)

    def correct(
        self,
        end: tuple[np.ndarray, np.ndarray],
        add_change: Callable[[np.ndarray], None],
    ) -> None:
        """Correct velocity and acceleration (nodes, dim) at the end of the step.

        ``add_change`` adds ΔF to nodal forces (nodes, dim), N: of the change of the points' stress,
        per volume before the step and against gradients there.
        """
        equilibrium, stepping = self._equilibrium, self._equilibrium.motion.stepping
        force = equilibrium.motion.nodal(self._force)
        force[:] = 0.0
        equilibrium.add_foreseen(self._force)
        np.negative(force, out=force)
        add_change(force)
        dolfinx_versions.gather(self._force)
        self._force.x.array[equilibrium.fixed] = 0.0
        change = self._acceleration(self._force.x.array).reshape(force.shape)
        end[0][:] -= stepping.gamma * stepping.dt * change
        end[1][:] -= change

    def _acceleration(self, force: np.ndarray) -> np.ndarray:
        """Of a force (dofs,), N."""
        raise NotImplementedError


class LumpedCorrection(Correction):
    """By the lumped mass.

    A mode of stiffness κ at the points and k in the matrix then has an amplification matrix of
    determinant 1, and neither gains nor loses while (κ - k) Δt² / 4m <= 1.
    """

    def __init__(
        self,
        equilibrium: Equilibrium,
        deposit: Deposit,
        beside: np.ndarray | float = 0.0,
    ):
        super().__init__(equilibrium)
        self._deposit, self._beside = deposit, beside

    def _acceleration(self, force: np.ndarray) -> np.ndarray:
        mass, motion = self._deposit.mass + self._beside, self._equilibrium.motion
        if self._deposit.sides is not None:
            self._deposit.sides.add_up(mass[:, None])
            self._deposit.sides.add_up(motion.nodal(self._force))
        share = np.divide(
            1.0, motion.stepping.inertia * mass, out=np.zeros_like(mass), where=mass > 0.0
        )
        return (share[:, None] * motion.nodal(self._force)).ravel()


class ImplicitCorrection(Correction):
    """By the matrix of the step, (κ M + β Δt² K) δa = force, κ what ``stepping.inertia`` weighs.

    It is what one more iteration of the step would change the acceleration by; displacement stays
    as it was solved for, for a step that is iterated until the points' forces are in balance
    forgets what (7) does for stability.
    """

    def _acceleration(self, force: np.ndarray) -> np.ndarray:
        stepping = self._equilibrium.motion.stepping
        return self._equilibrium.response(force) / (stepping.beta * stepping.dt**2)


def correction_of(
    kind: AccelerationCorrection,
    equilibrium: Equilibrium,
    deposit: Deposit,
    beside: np.ndarray | float = 0.0,
) -> Correction | None:
    """The correction of a kind; None for no correction.  ``beside`` (nodes,), kg: lumped mass of
    finite elements that share nodes with the points."""
    match kind:
        case AccelerationCorrection.LUMPED:
            return LumpedCorrection(equilibrium, deposit, beside)
        case AccelerationCorrection.IMPLICIT:
            return ImplicitCorrection(equilibrium)
    return None
