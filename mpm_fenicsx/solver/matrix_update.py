"""A matrix brought up to date where its fields have changed, instead of assembled anew."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc
from ufl.algorithms import expand_derivatives

from ..common.compiled import jit
from ..dynamics.motion import Motion
from ..grid import dolfinx_versions
from .tangent import Tangent

MANY = 0.5
"""Of the cells with material: to add the changes of more costs as much as to start anew."""
FALLEN = 1e-3
"""Of what a cell has held: above, what round-off of that has left is nothing to what it holds."""
ROUND_OFF = 1e-12
"""Ten thousand times that of the matrix: of a cell that holds s of what a full one does, the
farthest node has s^7/3 of a full one's stiffness (a corner in 3D), which sums of up to the cell's
largest value so far must not spoil."""


class Update:
    """Adds the form ``tangent``, of what its fields have changed by since it was last assembled, to
    the matrix.

    ``cells``: this rank's own where something has changed, ``changed`` in number on all ranks;
    ``bare`` (nodes,): where the matrix is nothing but round-off, right for this rank's own.
    """

    def __init__(
        self,
        motion: Motion,
        fields: list[fem.Function],
        change: ufl.Form,
        by: list[fem.Function],
        symmetric: bool,
    ):
        self.motion, self._fields, self._by = motion, fields, by
        grid = motion.grid
        self.cells = self._covered = motion.region.cells
        self._ghosts = np.arange(grid.owned_cells, grid.cells, dtype=np.int32)
        self.changed = 0
        self._marks = sorted({part.subdomain_id() for part in change.integrals()})
        self._domains = [(mark, self.cells) for mark in self._marks]
        parts = [part.reconstruct(subdomain_data=self._domains) for part in change.integrals()]
        self._tangent = Tangent(motion, 0, ufl.Form(parts), symmetric)
        self._dofs = [dolfinx_versions.cell_dofs(f.function_space) for f in fields]
        self._before = [np.zeros_like(f.x.array) for f in fields]
        self._peak = np.zeros((len(fields), grid.cells))
        self.bare = np.zeros(grid.nodes, dtype=bool)
        self._stepping: object = None

    @classmethod
    def of(cls, motion: Motion, tangent: ufl.Form, symmetric: bool) -> Update | None:
        """That of a tangent, or None where it takes more than integrals over cells that are linear
        in its fields, and where forms cannot follow (see ``Region``)."""
        tangent = expand_derivatives(tangent)
        fields = list(tangent.coefficients())
        by = [fem.Function(f.function_space) for f in fields]
        if not fields or not motion.region.follows or not all(map(_cell_by_cell, fields)):
            return None
        change = expand_derivatives(
            sum(ufl.derivative(tangent, *pair) for pair in zip(fields, by, strict=True))
        )
        twice = expand_derivatives(
            sum(ufl.derivative(change, *pair) for pair in zip(fields, by, strict=True))
        )
        if not twice.empty() or {part.integral_type() for part in change.integrals()} != {"cell"}:
            return None
        return cls(motion, fields, change, by, symmetric)

    def follow(self) -> bool:
        """See what has changed; False where that is too much to be added, and the matrix is to be
        made anew."""
        if self._stepping != self.motion.stepping:
            return False
        grid, cells = self.motion.grid, self.motion.region.cells
        self.bare[:] = True
        at = (
            cells if cells is self._covered else np.union1d(cells, self._covered)
        )  # elsewhere are and were zeros
        self._covered = cells
        if len(self._ghosts):  # nodes of this rank's own may have material there alone
            at = np.concatenate((at, self._ghosts))
        full = self._peak.max(axis=1, initial=0.0)
        if grid.comm.size > 1:
            grid.comm.Allreduce(MPI.IN_PLACE, full, op=MPI.MAX)
        changed, little = np.zeros(grid.cells, dtype=bool), False
        for f, by, dofs, before, peak, most in zip(
            self._fields, self._by, self._dofs, self._before, self._peak, full, strict=True
        ):
            little |= _differ(
                at,
                dofs,
                (f.x.array, before, by.x.array),
                most,
                (peak, changed),
                grid.lattice.nodes,
                self.bare,
            )
        self.cells = np.flatnonzero(changed[: grid.owned_cells]).astype(np.int32)
        found = np.array([len(self.cells), len(cells), little])
        if grid.comm.size > 1:
            grid.comm.Allreduce(MPI.IN_PLACE, found)
        self.changed, held, little = found
        return not little and self.changed <= MANY * held

    def forget(self) -> None:
        """What the matrix held is lost, or it is another one: the next one is made anew."""
        self._stepping = None
        self._tangent.forget()

    def add(self, A: PETSc.Mat, bcs: list, fixed: np.ndarray) -> None:
        """Add what has changed, as ``Tangent.add`` does."""
        self._domains[:] = [(mark, self.cells) for mark in self._marks]
        self._tangent.add(A, bcs, fixed, self.cells)

    def remember(self) -> None:
        """The matrix is that of the fields as they are."""
        self._stepping, self.cells = self.motion.stepping, self.motion.region.cells
        self._covered = self.cells
        self.bare[:] = False
        for f, dofs, before, peak in zip(
            self._fields, self._dofs, self._before, self._peak, strict=True
        ):
            before[:] = f.x.array
            np.abs(before[dofs]).max(axis=1, out=peak)


def _cell_by_cell(f: fem.Function) -> bool:
    dofs = dolfinx_versions.cell_dofs(f.function_space)
    return len(np.unique(dofs)) == dofs.size


@jit
def _differ(cells, dofs, values, full, of_cells, nodes, bare):
    """Differences ``by`` = now - before in cells, then before = now; marks cells that have one,
    nodes with material.

    ``values`` (now, before, by); ``of_cells`` (peak, changed), ``peak`` (cells,): largest |value|
    so far; ``full``: that of full cells.  Returns whether a cell that has changed holds so little
    that what it has held counts (``ROUND_OFF``).
    """
    now, before, by = values
    peak, changed = of_cells
    little = False
    for c in cells:
        size, differs = 0.0, False
        for k in range(dofs.shape[1]):
            i = dofs[c, k]
            by[i] = now[i] - before[i]
            before[i] = now[i]
            size = max(size, abs(now[i]))
            differs |= by[i] != 0.0
        if size > 0.0:
            for k in range(nodes.shape[1]):
                bare[nodes[c, k]] = False
        changed[c] |= differs
        peak[c] = max(peak[c], size)
        if differs and 0.0 < size < FALLEN * peak[c]:
            little |= (size / full) ** (7.0 / 3.0) < ROUND_OFF * peak[c] / full
    return little
