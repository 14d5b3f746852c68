"""The stress of material points, double-mapped onto the grid as eq. (7) maps their moduli.

In cell c, φ the part of it that material fills and N_k, m_k as in ``DOUBLE_MAPPED``,

    (φσ)_ck = Σ_p V_p σ_p / |c| · ⟨N_k⟩_p / m_k,    φ_ck the same of 1,    σ_ck = (φσ)_ck / φ_ck.

The weights are positive, so that σ_ck lies between the stresses of the points around.  A uniform
stress is met exactly; of a linear one the mean over each full cell is exact, the slope inside is a
third of it where points are many and a quarter where there are two in a row: the mapping smooths.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem

from ..common import tensors
from ..dynamics.motion import Motion
from ..grid import dolfinx_versions, weak_forms
from ..grid.grid import Grid
from ..grid.stress_field import StressField
from ..points.material_points import MaterialPoints
from .projection import DOUBLE_MAPPED, Projection
from .shape_functions import Stencil

EMPTY = 1e-12
"""Part of a cell: what is less full holds no material."""


class MappedStress:
    """The internal force of that field: ∫ φσ : ε(w) dx, in place of a sum over points.

    Along a row of cells, in 1D, it is the sum over points of GIMP to the last digit, for ∇N is
    constant there; across, it sees a third of what stress changes within a cell.
    """

    def __init__(self, motion: Motion):
        grid = self.grid = motion.grid
        self._columns = tensors.in_plane(grid.dim)
        self._projection = Projection(grid, DOUBLE_MAPPED, len(self._columns))
        stress = weak_forms.tensor(self._projection.fields, grid.dim)
        dx = motion.region.dx(metadata={"quadrature_degree": DOUBLE_MAPPED.quadrature})
        self._work = dolfinx_versions.compile_form(weak_forms.internal_work(stress, motion.w) * dx)
        self._force = fem.Function(grid.space)

    def add(
        self,
        bodies: Sequence[MaterialPoints],
        stencils: Sequence[Stencil],
        internal: np.ndarray,
        stresses: Sequence[np.ndarray] | None = None,
    ) -> None:
        """Add the force of all bodies to ``internal`` (nodes, dim), N: of their own stress, or of
        ``stresses``, as ``InternalForce`` takes them, what is skew as a sum over points."""
        self._projection.clear()
        given = [body.stress for body in bodies] if stresses is None else stresses
        for body, stencil, stress in zip(bodies, stencils, given, strict=True):
            if stress.ndim == 2:
                rows = stress[:, self._columns]
            else:
                rows, skew = tensors.symmetric_row(stress)
                if skew.any():
                    stencil.deposit_divergence(body.volume[:, None, None] * skew, internal)
            self._projection.add(stencil, body.volume[:, None] * rows)
        self._projection.finish()
        self._force.x.array[:] = 0.0
        dolfinx_versions.assemble_vector(self._force, self._work)
        internal += self._force.x.array.reshape(internal.shape)


class PointStressField(StressField):
    """σ_ck of material points."""

    def __init__(self, grid: Grid):
        super().__init__(grid)
        self._projection = Projection(grid, DOUBLE_MAPPED, self._rows.shape[1] + 1)
        self._order = self._projection.dofs.astype(np.int64)
        self._fill_dofs = grid.tensor_order(self.fill.function_space, 1)

    def refresh(self, bodies: Sequence[MaterialPoints], stencils: Sequence[Stencil]) -> None:
        """Bring it to where the points are, as ``stencils`` know it, and to what they bear."""
        self._projection.clear()
        for body, stencil in zip(bodies, stencils, strict=True):
            values = np.column_stack((body.stress, np.ones(len(body))))
            self._projection.add(stencil, body.volume[:, None] * values)
        self._projection.finish()
        for f in self._projection.fields:
            dolfinx_versions.share(f)
        mapped = np.stack([f.x.array[self._order] for f in self._projection.fields], axis=-1)
        fill = mapped[..., -1]
        self.filled = (fill > EMPTY).all(axis=1)
        share = np.divide(1.0, fill, out=np.zeros_like(fill), where=fill > EMPTY)
        self.put(mapped[..., :-1] * share[..., None])
        self.fill.x.array[self._fill_dofs] = fill
