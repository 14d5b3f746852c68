"""What volume changes by the cell's mean work against where all is elastic."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from ..dynamics.motion import Motion
from ..mapping.material_means import MaterialMeans
from .cell_work import add_elastic_stiffness
from .response import Response


class ElasticMeans(Response):
    """The bulk of elastic points, K_c V_c θ_c against θ: linear in u, so that a step is one
    solve."""

    summed = True

    def __init__(self, motion: Motion, means: MaterialMeans):
        super().__init__(motion, [])
        self._means, own = means, motion.grid.owned_cells
        self._own = means.nodes[:own].astype(np.int32)

    def place(self) -> None:
        """The means are where points are."""

    def evaluate(self) -> bool:
        """Nothing yields."""
        return False

    def add_force(self, internal: np.ndarray) -> None:
        """Add Σ_c K_c V_c θ_c G_c to the internal force (dofs,), N."""
        u = self.motion.nodal(self.motion.u)
        self._means.add_elastic_force(u, internal.reshape(u.shape), len(self._own))

    def add_stiffness(self, A: PETSc.Mat, fixed: np.ndarray) -> None:
        """Add Σ_c K_c V_c G_c ⊗ G_c, but for rows and columns of ``fixed`` dofs (dofs,), bool."""
        add_elastic_stiffness(A, self._means, self._own, fixed)
