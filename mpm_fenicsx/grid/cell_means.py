"""Volume changes cell by cell: the operator from nodal displacements to one number a cell."""

from __future__ import annotations

import numpy as np

from ..common import tensors
from ..common.compiled import jit


class CellMeans:
    """A mean of the gradient over each cell, or over the material in it.

    ``nodes`` (cells, k): those of each cell; ``slopes`` (cells, k, dim), 1/m: the mean of ∂N/∂x.
    ``bulk`` (cells,), N m: what elastic material works against θ with, K V, where forms leave that
    to the means; None where they do not.
    """

    bulk: np.ndarray | None = None

    def __init__(self, nodes: np.ndarray, slopes: np.ndarray):
        self.nodes, self.slopes = nodes, np.ascontiguousarray(slopes)

    def divergence(self, u: np.ndarray) -> np.ndarray:
        """θ (cells,) of nodal displacements (nodes, dim)."""
        return np.einsum("cki,cki->c", self.slopes, u[self.nodes])

    def gradient(self, u: np.ndarray) -> np.ndarray:
        """Mean gradients (cells, dim, dim) of nodal displacements (nodes, dim)."""
        return np.einsum("cki,ckj->cij", u[self.nodes], self.slopes)

    def pushed(self, u: np.ndarray) -> np.ndarray:
        """``after`` the displacements (nodes, dim)."""
        return self.after(np.eye(self.slopes.shape[2]) + self.gradient(u))

    def after(self, F: np.ndarray) -> np.ndarray:
        """∂N/∂x (cells, k, dim), 1/m, after mean deformations F (cells, dim, dim): F⁻ᵀ times the
        slopes; not numbers where that turns inside out."""
        det = np.linalg.det(F)
        safe = np.where((det > 0.0)[:, None, None], F, np.nan)
        with np.errstate(invalid="ignore"):
            inverse = tensors.cofactor(safe - np.eye(F.shape[1])) / det[:, None, None]
        return np.einsum("ckj,cij->cki", self.slopes, inverse)

    def log_stretch(self, u: np.ndarray) -> np.ndarray:
        """ln det F (cells,) of the mean gradient; not a number where that turns inside out."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(tensors.stretch(self.gradient(u)))

    def add_force(
        self, pressure: np.ndarray, nodal: np.ndarray, slopes: np.ndarray | None = None
    ) -> None:
        """Add Σ_c P_c G_ci of P, N m, of the first cells or all of them, to ``nodal`` (nodes, dim),
        N; G are other ``slopes`` where these are given."""
        _add_force(self.nodes, self.slopes if slopes is None else slopes, pressure, nodal)

    def add_elastic_force(self, u: np.ndarray, nodal: np.ndarray, cells: int) -> None:
        """Add Σ_c K_c V_c θ_c G_ci of displacements u (nodes, dim) to ``nodal`` (nodes, dim), N, of
        the first ``cells``, where the means bear what is elastic."""
        if self.bulk is not None and u.any():
            self.add_force((self.bulk * self.divergence(u))[:cells], nodal)


@jit
def _add_force(nodes, slopes, pressure, out):
    for c in range(len(pressure)):
        if pressure[c] != 0.0:
            for k in range(nodes.shape[1]):
                for d in range(slopes.shape[2]):
                    out[nodes[c, k], d] += pressure[c] * slopes[c, k, d]
