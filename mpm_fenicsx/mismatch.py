"""What the points' own force at the end of a step and the one that the step was solved with differ by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem

from . import fenicsx, tensors
from .equilibrium import Equilibrium
from .points import MaterialPoints
from .shapes import Stencil
from .velocities import Deposit


class Mismatch:
    """Corrects nodal accelerations at the end of a step by -M̄⁻¹ (ΔF - K u).

    K u is the increment of internal force that the step's matrix foresees, eq. (7), and ΔF = Σ V Δσ ∇S that of the
    stress which points take from their own strain.  Where points go on with the acceleration that K u gives, the next
    step begins with forces that do not fit it, and waves lose energy in proportion to Δt, the more so where K locks.
    With the corrected one a mode of stiffness κ at the points and k in the matrix has an amplification matrix of
    determinant 1, and neither gains nor loses while (κ - k) Δt² / 4m <= 1.
    """

    def __init__(self, equilibrium: Equilibrium, deposit: Deposit):
        self._equilibrium, self._deposit = equilibrium, deposit
        self._force = fem.Function(equilibrium.motion.grid.space)

    def correct(self, end: tuple[np.ndarray, np.ndarray], bodies: Sequence[MaterialPoints],
                stencils: Sequence[Stencil], before: Sequence[np.ndarray]) -> None:
        """Correct velocity and acceleration (nodes, dim) at the end of the step; ``before`` it the bodies' stresses
        (n, components), Pa, were these."""
        equilibrium, motion = self._equilibrium, self._equilibrium.motion
        force = motion.nodal(self._force)
        force[:] = 0.0
        equilibrium.add_foreseen(self._force)
        np.negative(force, out=force)
        for body, stencil, stress in zip(bodies, stencils, before, strict=True):
            change = tensors.matrix(body.stress - stress, motion.grid.dim)
            stencil.deposit_divergence(body.volume[:, None, None] * change, force)
        fenicsx.gather(self._force)
        self._force.x.array[equilibrium.fixed] = 0.0
        mass, stepping = self._deposit.mass, motion.stepping
        share = np.divide(-1.0, stepping.inertia * mass, out=np.zeros_like(mass), where=mass > 0.0)
        force *= share[:, None]
        end[0][:] += stepping.gamma * stepping.dt * force
        end[1][:] += force
