"""Plastic strain that is averaged over a length: κ̄ - l²∇²κ̄ = κ, on the grid, after each step.

    Σ_cells ∫ v (κ̄ w + l² ∇κ̄·∇w) = ∫ vκ w

v is the part of the grid that the material fills, and vκ its plastic strain, double-mapped by eq.
(7) as moduli are: cells without material take no part, and nothing flows over the material's
surface. Each material has a solve of its own, which all its bodies share.
"""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from ..common.errors import SolverError
from ..common.ranks import warn
from ..dynamics.motion import Motion
from ..grid import dolfinx_versions, weak_forms
from ..grid.gauss_points import GaussField, GaussPoints, measure
from ..grid.grid import Grid
from ..mapping.projection import DOUBLE_MAPPED, Projection
from ..mapping.shape_functions import Stencil
from ..materials.over_nonlocal import AVERAGE, AVERAGED
from ..points.material_points import MaterialPoints
from .cell_materials import CellMaterials, MaterialRows

TOLERANCE = 1e-10
"""Of the right-hand side: so much may the solve leave."""
CELLS = 2.0
"""So many cells should a length have at least."""


class GridAverage:
    """Nodal averages of what a form gives: ``volume`` v, ``moment`` vκ, fields that ``dx``
    integrates.

    Rows are scaled to a unit diagonal, so that a node with little material weighs as much as
    others, and one without has a row of its own.  The solve starts from zero: a run that goes on
    from a checkpoint finds the same digits.
    """

    def __init__(self, motion: Motion, length: float, volume, moment, dx: ufl.Measure):
        grid = self.grid = motion.grid
        V = dolfinx_versions.space(grid.mesh, "Lagrange", 1)
        w, trial = ufl.TestFunction(V), ufl.TrialFunction(V)
        squared = fem.Constant(grid.mesh, np.array(length**2))
        self._tangent = dolfinx_versions.compile_form(
            weak_forms.averaging(volume, squared, trial, w) * dx
        )
        self._source = dolfinx_versions.compile_form(moment * w * dx)
        with motion.region.whole():  # a place for every entry that may come
            self._matrix = dolfinx_versions.create_matrix(self._tangent)
            dolfinx_versions.assemble_matrix(self._matrix, self._tangent, [])
            self._matrix.assemble()
        self._nodal = fem.Function(V)
        self._owned = V.dofmap.index_map.size_local
        self._dofs = np.empty(grid.nodes, np.int32)  # of the grid's nodes
        self._dofs[dolfinx_versions.cell_dofs(grid.space)] = dolfinx_versions.cell_dofs(V)
        self._b, self._x = self._matrix.createVecs()
        self._scale = self._matrix.createVecLeft()
        ksp = self._ksp = PETSc.KSP().create(grid.comm)
        ksp.setType("cg")
        # blocks of ranks have incomplete factors of their own
        ksp.getPC().setType("icc" if grid.comm.size == 1 else "bjacobi")
        ksp.setTolerances(rtol=TOLERANCE)
        self.assembled = False

    def assemble(self) -> None:
        """Refresh the matrix for the volume as it is now."""
        A, scale = self._matrix, self._scale
        A.zeroEntries()
        dolfinx_versions.assemble_matrix(A, self._tangent, [])
        A.assemble()
        A.getDiagonal(scale)
        empty = scale.array <= 0.0
        scale.array[empty] = 1.0
        if self.grid.comm.allreduce(int(empty.any())):
            A.setDiagonal(scale)
        scale.array[:] = 1.0 / np.sqrt(scale.array)
        A.diagonalScale(scale, scale)
        self._ksp.setOperators(A)
        self.assembled = True

    def solve(self) -> np.ndarray:
        """Averages at the grid's nodes (nodes,).  Raises ``SolverError``.  Collective."""
        f, scale = self._nodal, self._scale.array
        f.x.array[:] = 0.0
        dolfinx_versions.assemble_vector(f, self._source)
        dolfinx_versions.gather_to_owner(f)
        self._b.array[:] = scale * f.x.array[: self._owned]
        self._ksp.solve(self._b, self._x)
        if self._ksp.getConvergedReason() < 0:
            raise SolverError(
                f"the average of plastic strain is not found: conjugate gradients stop with "
                f"PETSc's reason {self._ksp.getConvergedReason()}"
            )
        f.x.array[: self._owned] = scale * self._x.array
        dolfinx_versions.share(f)
        return f.x.array[self._dofs]


class NonlocalStrain:
    """What averages of points and of finite elements have in common: a ``material`` with
    ``averaging``, and the columns of its history."""

    def __init__(self, grid: Grid, material, cells: np.ndarray):
        self.grid, self.material, self.averaging = grid, material, material.averaging
        self._size = _largest(grid, cells)
        names = tuple(material.history)
        missing = [name for name in (AVERAGED, AVERAGE) if name not in names]
        if missing:
            raise ValueError(
                f"material: {type(material).__name__} with averaging needs the state variables "
                f"{AVERAGED} and {AVERAGE}, and lacks {', '.join(missing)}"
            )
        self.strain, self.average = names.index(AVERAGED), names.index(AVERAGE)

    def __str__(self) -> str:
        factor = "incomplete Cholesky factor" if self.grid.comm.size == 1 else "block Jacobi"
        return (
            f"softening over {self.averaging.length:g} m, weight {self.averaging.weight:g}: "
            f"conjugate gradients, {factor}"
        )

    def warn_of_size(self) -> None:
        """Warn of a length below two cells.  Collective."""
        size = self.grid.comm.allreduce(self._size, op=MPI.MAX)
        if self.averaging.length < CELLS * size * (1.0 - 1e-9):
            warn(
                self.grid.comm,
                f"length of averaging is {self.averaging.length:g} m, and cells are up to "
                f"{size:g} m: below two cells bands follow the mesh, so take smaller cells, or a "
                "length with a softening that belongs to it",
                3,
            )

    def refresh(self) -> None:
        """Give κ̄ to the history, for κ as it is now.  Collective."""
        raise NotImplementedError


class NonlocalStrainOfPoints(NonlocalStrain):
    """κ̄ of the points of bodies of one material."""

    def __init__(
        self, motion: Motion, bodies: Sequence[tuple[MaterialPoints, Stencil]], cells: np.ndarray
    ):
        super().__init__(motion.grid, bodies[0][0].material, cells)
        self._bodies = bodies
        self._projection = Projection(motion.grid, DOUBLE_MAPPED, 2)
        dx = motion.region.dx(metadata={"quadrature_degree": DOUBLE_MAPPED.quadrature})
        self._grid_average = GridAverage(
            motion, self.averaging.length, *self._projection.fields, dx
        )

    def refresh(self) -> None:
        """Give κ̄ to the points, by the weights with which they have strained.  Collective."""
        if not _any_strain(self.grid, [body.history[:, self.strain] for body, _ in self._bodies]):
            return
        projection = self._projection
        projection.clear()
        for body, stencil in self._bodies:
            moment = body.volume * body.history[:, self.strain]
            projection.add(stencil, np.column_stack((body.volume, moment)))
        projection.finish()
        self._grid_average.assemble()
        nodal = np.maximum(self._grid_average.solve(), 0.0)[:, None]
        for body, stencil in self._bodies:
            body.history[:, self.average] = stencil.at_points(nodal)[:, 0]


class NonlocalStrainOfElements(NonlocalStrain):
    """κ̄ at the Gauss points of finite elements of one material; the mesh is the one at rest."""

    def __init__(
        self, motion: Motion, gauss: GaussPoints, materials: CellMaterials, part: MaterialRows
    ):
        super().__init__(motion.grid, part.material, part.numbers // gauss.digit.shape[1])
        self._gauss, self._part = gauss, part
        volume = materials.field([float(law == part.material) for law in materials.materials])
        self._moment = GaussField(motion.grid, 1)
        self._grid_average = GridAverage(
            motion,
            self.averaging.length,
            volume,
            self._moment.function[0],
            measure(motion.region.dx),
        )

    def refresh(self, history: np.ndarray) -> None:
        """Give κ̄ to the history (points, columns) of all Gauss points.  Collective."""
        rows = self._part.rows
        if not _any_strain(self.grid, [history[rows, self.strain]]):
            return
        self._moment.rows[rows, 0] = history[rows, self.strain]
        if not self._grid_average.assembled:
            self._grid_average.assemble()
        nodal = np.maximum(self._grid_average.solve(), 0.0)
        history[rows, self.average] = self._gauss.interpolate(nodal)[rows]


def averages_of_points(
    motion: Motion,
    bodies: Sequence[MaterialPoints],
    stencils: Sequence[Stencil],
    cells: Sequence[np.ndarray],
) -> list[NonlocalStrainOfPoints]:
    """One for each material that softens over a length."""
    found = []
    for material in _averaging([body.material for body in bodies]):
        mine = [k for k, body in enumerate(bodies) if body.material == material]
        held = np.concatenate([cells[k] for k in mine])
        pairs = [(bodies[k], stencils[k]) for k in mine]
        found.append(NonlocalStrainOfPoints(motion, pairs, held))
    return found


def averages_of_elements(
    motion: Motion, gauss: GaussPoints, materials: CellMaterials, parts: Sequence[MaterialRows]
) -> list[NonlocalStrainOfElements]:
    """One for each material that softens over a length."""
    return [
        NonlocalStrainOfElements(motion, gauss, materials, part)
        for part in parts
        if _averaging([part.material])
    ]


def _averaging(materials: Sequence) -> list:
    """Those that soften over a length, each once."""
    found = []
    for material in materials:
        if getattr(material, "averaging", None) is not None and material not in found:
            found.append(material)
    return found


def _any_strain(grid: Grid, columns: Sequence[np.ndarray]) -> bool:
    """Whether anything has flowed, on any rank; until then all averages are zero."""
    here = any(bool(column.any()) for column in columns)
    return here if grid.comm.size == 1 else bool(grid.comm.allreduce(int(here)))


def _largest(grid: Grid, cells: np.ndarray) -> float:
    """Largest extent (m) of any of some cells (n,), along any axis; 0 of none."""
    corners = grid.mesh.geometry.x[dolfinx_versions.cell_vertices(grid.mesh)[np.unique(cells)]]
    return float(np.ptp(corners, axis=1).max(initial=0.0))
