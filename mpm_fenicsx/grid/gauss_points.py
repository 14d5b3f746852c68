"""The Gauss points of a grid: strain there, and fields of numbers there that forms can read."""

from __future__ import annotations

import basix
import numpy as np
import ufl
from dolfinx import fem

from ..common import tensors
from ..common.compiled import digits, jit
from . import dolfinx_versions
from .cell_means import CellMeans
from .grid import Grid

DEGREE = 3
PLACE = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
"""Of the Gauss points along a direction of the reference cell."""


@jit
def _strain(nodes, slopes, shear, u, out):
    """Strain rows at Gauss points: ``slopes`` (cells, q, k, dim)."""
    dim = u.shape[1]
    g = np.zeros((dim, dim))
    for c in range(len(nodes)):
        for q in range(slopes.shape[1]):
            g[:] = 0.0
            for k in range(nodes.shape[1]):
                for i in range(dim):
                    for j in range(dim):
                        g[i, j] += u[nodes[c, k], i] * slopes[c, q, k, j]
            row = out[c * slopes.shape[1] + q]
            for i in range(3):
                row[i] = g[i, i] if i < dim else 0.0
            for k in range(len(shear)):
                row[3 + k] = g[shear[k, 0], shear[k, 1]] + g[shear[k, 1], shear[k, 0]]


class GaussPoints:
    """2^dim Gauss points a cell, of all local and ghost cells, numbered cell by cell.

    ``digit`` (cells, 2^dim, dim): 0 for the lower one along each direction of a rectilinear grid, 1
    for the upper; ``x`` (points, dim), m: where they are; ``volume`` (points,), m³: the weight of
    each in an integral.
    """

    def __init__(self, grid: Grid):
        self.grid = grid
        x = grid.mesh.geometry.x[dolfinx_versions.cell_vertices(grid.mesh)][..., : grid.dim]
        kind = basix.CellType.quadrilateral if grid.dim == 2 else basix.CellType.hexahedron
        places, weights = basix.make_quadrature(kind, DEGREE)
        corner = digits(2, grid.dim)
        values, slopes = _trilinear(places, corner)
        jacobian = np.einsum("cki,qkj->cqij", x, slopes)
        self._nodes = dolfinx_versions.cell_dofs(grid.space)
        self._slopes = np.ascontiguousarray(
            np.einsum("qkj,cqji->cqki", slopes, np.linalg.inv(jacobian))
        )
        self._volumes = np.abs(np.linalg.det(jacobian)) * weights
        self.volume = self._volumes.ravel()
        place = np.einsum("qk,cki->cqi", values, x)
        self.x = place.reshape(-1, grid.dim)
        self.digit = (place > x.mean(axis=1)[:, None]).astype(np.int8)
        self._values = values
        self._shear = np.array(tensors.SHEAR[grid.dim])

    @property
    def size(self) -> np.ndarray:
        """Size of the cell of each point (points,), m."""
        volume = self._volumes.sum(axis=1)
        return np.repeat(volume ** (1 / self.grid.dim), self._volumes.shape[1])

    def __len__(self) -> int:
        return len(self.volume)

    def strain(self, u: np.ndarray, means: CellMeans | None = None) -> np.ndarray:
        """Strain rows (points, components) of nodal displacements (nodes, dim), in which volume
        changes by the ``means`` of cells, if these are given."""
        out = np.empty((len(self), tensors.components(self.grid.dim)))
        _strain(self._nodes, self._slopes, self._shear, u, out)
        if means is None:
            return out
        return tensors.dilate(out, np.repeat(means.divergence(u), self.digit.shape[1]))

    def interpolate(self, nodal: np.ndarray) -> np.ndarray:
        """Values (points,) of nodal numbers (nodes,)."""
        return (nodal[self._nodes] @ self._values.T).ravel()

    def gradient(self, u: np.ndarray) -> np.ndarray:
        """Gradients (points, dim, dim) of nodal displacements (nodes, dim)."""
        dim = self.grid.dim
        return np.matmul(u[self._nodes].transpose(0, 2, 1)[:, None], self._slopes).reshape(
            -1, dim, dim
        )

    def means(self) -> CellMeans:
        """The mean of the gradient over each cell."""
        share = self._volumes / self._volumes.sum(axis=1, keepdims=True)
        return CellMeans(self._nodes, np.einsum("cq,cqki->cki", share, self._slopes))

    def mean_of_cells(self, values: np.ndarray) -> np.ndarray:
        """Means (cells, …) of values at the points (points, …)."""
        share = self._volumes / self._volumes.sum(axis=1, keepdims=True)
        return np.einsum("cq,cq...->c...", share, values.reshape(*share.shape, *values.shape[1:]))

    def slopes_at(self, nodes: np.ndarray) -> np.ndarray:
        """∂N/∂x (cells, points, k, dim), 1/m, of ``nodes`` (cells, k), those of each cell in any
        order."""
        order = np.argsort(self._nodes, axis=1)
        place = np.argsort(np.argsort(nodes, axis=1), axis=1)
        order = np.take_along_axis(order, place, axis=1)
        return np.ascontiguousarray(
            np.take_along_axis(self._slopes, order[:, None, :, None], axis=2)
        )

    def at_corners(self, values: np.ndarray) -> np.ndarray:
        """Values (cells, 2^dim, f) at the corners of cells, x fastest, of the function that is
        bilinear (trilinear) in each cell and has ``values`` (points, f) here; rectilinear grids."""
        per_cell = self.digit.shape[1]
        line = np.array([[PLACE[1] - c, c - PLACE[0]] for c in (0, 1)]) * np.sqrt(3.0)
        corner = digits(2, self.grid.dim)
        weight = line[corner[None, :, None, :], self.digit[:, None, :, :]].prod(axis=3)
        return np.einsum("ckq,cqf->ckf", weight, values.reshape(-1, per_cell, values.shape[1]))


class GaussField:
    """``size`` numbers at every Gauss point, as a coefficient of forms and as rows (points,
    size)."""

    def __init__(self, grid: Grid, size: int):
        self.function = fem.Function(dolfinx_versions.quadrature_space(grid.mesh, DEGREE, size))
        dofs = dolfinx_versions.cell_dofs(self.function.function_space).ravel()
        if not np.array_equal(dofs, np.arange(len(dofs))):
            raise RuntimeError("Gauss points are not numbered cell by cell in this DOLFINx")
        self.rows = self.function.x.array.reshape(-1, size)

    def gather(self) -> None:
        """Add what ghost cells hold to their owners."""
        dolfinx_versions.gather(self.function)


def measure(dx: ufl.Measure) -> ufl.Measure:
    """``dx`` by a sum over the Gauss points."""
    return dx(metadata={"quadrature_degree": DEGREE, "quadrature_scheme": "default"})


def _trilinear(places: np.ndarray, corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bilinear (trilinear) shape functions (q, k) and their slopes (q, k, dim) at reference places
    (q, dim)."""
    dim = corner.shape[1]
    one = np.where(corner, places[:, None], 1.0 - places[:, None])
    slopes = np.empty((*one.shape[:2], dim))
    for d in range(dim):
        slopes[..., d] = (2 * corner[:, d] - 1) * np.delete(one, d, axis=2).prod(axis=2)
    return one.prod(axis=2), slopes
