"""What yielding takes off the elastic step where the integrals are taken at the material points."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import ufl

from ..common import tensors
from ..common.ranks import together
from ..dynamics.motion import Motion
from ..grid import weak_forms
from ..mapping.projection import AT_POINTS, Projection
from ..mapping.shape_functions import Stencil
from ..points.material_points import MaterialPoints
from .response import Response


class YieldingAtPoints(Response):
    """The laws of material points, asked once at each point with the strain it will recover.

    Stress is summed at the points; the tangent is projected like the moduli, so that with linear
    shape functions it is the derivative of the sum, and with support domains nearly so.
    ``recover`` maps a body's number and nodal u to displacement gradients (n, dim, dim).
    """

    def __init__(
        self,
        motion: Motion,
        bodies: Sequence[MaterialPoints],
        stencils: Sequence[Stencil],
        recover: Callable[[int, np.ndarray], np.ndarray],
    ):
        super().__init__(motion, [body.material for body in bodies if not body.material.linear])
        grid = motion.grid
        self._bodies, self._stencils, self._recover = bodies, stencils, recover
        entries, _ = tensors.entries(len(self._plane), self.symmetric)
        self._tangent = Projection(grid, AT_POINTS, len(entries))
        self._force = np.zeros((grid.nodes, grid.dim))
        self._rows = [np.arange(len(body), dtype=np.int32) for body in bodies]
        dx = motion.region.dx(metadata={"quadrature_degree": AT_POINTS.quadrature})
        tangent = weak_forms.plastic_stiffness(
            ufl.as_vector(self._tangent.fields), ufl.TrialFunction(grid.space), motion.w
        )
        self.stiffness = tangent * dx

    def place(self) -> None:
        """Every point is its own place; there may be others than before."""
        if any(len(rows) != len(body) for rows, body in zip(self._rows, self._bodies, strict=True)):
            self._rows = [np.arange(len(body), dtype=np.int32) for body in self._bodies]

    def clear(self) -> None:
        """Nothing yields."""
        super().clear()
        self._force[:] = 0.0
        self._tangent.clear()
        for field in self._tangent.fields:
            field.x.array[:] = 0.0

    def add_force(self, internal: np.ndarray) -> None:
        """Add Σ_p V_p σ_p ∇S_ip of the stress beyond elasticity."""
        internal += self._force.ravel()

    def _respond(self, u: np.ndarray) -> None:
        for number, (body, stencil) in enumerate(zip(self._bodies, self._stencils, strict=True)):
            law, every = body.material, self._rows[number]
            if law.linear:
                continue
            strain = tensors.strain(self._recover(number, u))
            state = body.stress, body.remembered, body.parameters
            with together(self.motion.grid.comm, Exception):
                lame = law.kinematics.moduli(body)
                rows, stress, tangent = self._law(law, strain, state, every, every, lame)
            self.active = self.active or len(rows) > 0
            i, j = tensors.entries(len(self._plane), self.symmetric)
            beyond, moduli = np.zeros_like(body.stress), np.zeros((len(body), len(i)))
            beyond[rows], moduli[rows] = stress, tangent[:, self._plane[i], self._plane[j]]
            force = body.volume[:, None, None] * tensors.matrix(beyond, body.dim)
            stencil.deposit_divergence(force, self._force)
            self._tangent.add(stencil, body.volume[:, None] * moduli)
        self._tangent.finish()
