"""The internal force where volume changes cell by cell: pressure pulls by the same means."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common import tensors
from ..points.material_points import MaterialPoints
from .internal_force import InternalForce
from .material_means import MaterialMeans
from .shape_functions import Stencil


class PressureByCells:
    """The deviator of stress as ``of_deviator`` takes it, and Σ_c P_c G_ci of its mean."""

    def __init__(self, of_deviator: InternalForce, means: MaterialMeans):
        self._of_deviator, self._means = of_deviator, means

    def add(
        self,
        bodies: Sequence[MaterialPoints],
        stencils: Sequence[Stencil],
        internal: np.ndarray,
        stresses: Sequence[np.ndarray] | None = None,
    ) -> None:
        """Add the force of all bodies to ``internal`` (nodes, dim), N: of their own stress, or of
        stress rows ``stresses`` (n, components), Pa."""
        rows = [body.stress for body in bodies] if stresses is None else stresses
        self._of_deviator.add(bodies, stencils, internal, [tensors.deviator(row) for row in rows])
        pressures = [
            body.volume * tensors.mean(row) for body, row in zip(bodies, rows, strict=True)
        ]
        self._means.add_force(self._means.pressures(stencils, pressures), internal)

    def add_change(
        self,
        bodies: Sequence[MaterialPoints],
        stencils: Sequence[Stencil],
        internal: np.ndarray,
        before: Sequence[np.ndarray],
        gradients: Sequence[np.ndarray],
        u: np.ndarray,
    ) -> None:
        """Add what the step has changed of it, against gradients before the step.

        ``before``: stress rows (n, components), Pa, before it; ``gradients`` (n, dim, dim) that
        points have recovered of the nodal displacements u (nodes, dim).
        """
        if not any(body.material.kinematics.finite for body in bodies):
            changes = [body.stress - old for body, old in zip(bodies, before, strict=True)]
            self.add(bodies, stencils, internal, changes)
            return
        means, logarithm = self._means, self._means.log_stretch(u)
        # pressure pulls against gradients after the step, or before it
        deviators, turned, plain = [], [], []
        for body, at, old, gradient in zip(bodies, stencils, before, gradients, strict=True):
            now, V, p = tensors.deviator(body.stress), body.volume, tensors.mean(body.stress)
            before_step = tensors.deviator(old)
            if body.material.kinematics.finite:
                J = np.exp(at.mean_of_cells(logarithm))
                per = J / tensors.stretch(gradient)
                turned_by = tensors.cofactor(gradient) * per[:, None, None]
                now, before_step = (tensors.matrix(row, body.dim) for row in (now, before_step))
                now = now @ turned_by
                turned.append((at, J * V * p))
                p = 0.0
            deviators.append(now - before_step)
            plain.append(V * (p - tensors.mean(old)))
        self._of_deviator.add(bodies, stencils, internal, deviators)
        means.add_force(means.pressures(*zip(*turned, strict=True)), internal, means.pushed(u))
        means.add_force(means.pressures(stencils, plain), internal)
