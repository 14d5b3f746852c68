"""What depends on the length of the step alone: assembled once, from the forms, as matrices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc
from scipy.sparse import csr_matrix, hstack

from ..dynamics.motion import Motion
from ..grid import dolfinx_versions
from ..terms.contribution import Contribution


class Base:
    """Contributions whose work is linear in u and in the fields of their ``history``.

    Their part of K, and the force of each field, are matrices, which stay while the step does.
    ``bare`` (nodes,), bool: for which of this rank's own nodes K has nothing of them.
    """

    def __init__(self, motion: Motion, contributions: Sequence[Contribution]):
        self.motion = motion
        self._tangent = _derivative(sum(c.work for c in contributions), motion.u)
        self._matrix: PETSc.Mat | None = None
        self._of = self._of_forces = self._of_stiffness = np.full(1, np.nan)  # of no step yet
        self._forces = [Force(f, _derivative(c.work, f)) for c in contributions for f in c.history]
        self._stiffness = Force(motion.u, self._tangent)
        self._all: csr_matrix | None = None  # of all forces, on one rank

    @classmethod
    def of(cls, motion: Motion, contributions: Sequence[Contribution]) -> Base | None:
        """That of the contributions, or None where none has a history."""
        constant = [c for c in contributions if c.history]
        return cls(motion, constant) if constant else None

    def put(self, A: PETSc.Mat, bcs: list) -> None:
        """A becomes the constant part of K, rows and columns of ``bcs`` empty but for a unit
        diagonal."""
        now = self.motion.numbers()
        alike = self._matrix is not None and self._matrix.type == A.type
        if alike and np.array_equal(now, self._of):
            self._matrix.copy(A, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            return
        A.zeroEntries()
        with self.motion.grid.where_made():
            dolfinx_versions.assemble_matrix(A, self._tangent, bcs)
        A.assemble()
        self._of = now
        self._matrix = A.copy()
        diagonal = A.getDiagonal().array.reshape(-1, self.motion.grid.dim)
        self.bare = ~diagonal.any(axis=1)

    def forget(self) -> None:
        """The matrix has another format from now on."""
        self._matrix = None

    def add_force(self, force: np.ndarray) -> None:
        """Add their forces (dofs,), N, at the motion's u."""
        now, alone = self.motion.numbers(), self.motion.grid.comm.size == 1
        if not np.array_equal(now, self._of_forces):
            self._of_forces = now
            self._assemble(self._forces)
            if alone:
                rows = [part.rows(len(force)) for part in self._forces]
                self._all = hstack(rows, format="csr")
                self._values = np.zeros(self._all.shape[1])
        if alone:
            np.concatenate([part.field.x.array for part in self._forces], out=self._values)
            force += self._all @ self._values
        else:
            for part in self._forces:
                part.add(force)
        if self.motion.u.x.array.any():
            if not np.array_equal(now, self._of_stiffness):
                self._of_stiffness = now
                self._assemble([self._stiffness])
            self._stiffness.add(force)

    def _assemble(self, parts: Sequence[Force]) -> None:
        with self.motion.grid.where_made():
            for part in parts:
                part.assemble()


class Force:
    """The force of one field, a matrix times its values; ``parts``: its compiled form."""

    def __init__(self, field: fem.Function, parts: list | None):
        # parts one by one, for each has places of its own in a matrix
        self.field, self._parts = field, parts or []
        self._matrices: list[PETSc.Mat] = []

    def assemble(self) -> None:
        """Its matrix, for the step as it is."""
        self._matrices = []
        for part in self._parts:
            matrix = dolfinx_versions.create_matrix([part])
            dolfinx_versions.assemble_matrix(matrix, [part], [])
            matrix.assemble()
            self._matrices.append(matrix)
        if self._matrices:
            self._x, self._y = self._matrices[0].createVecs()

    def add(self, force: np.ndarray) -> None:
        """Add it to ``force`` (dofs,)."""
        for matrix in self._matrices:
            self._x.array[:] = self.field.x.array[: len(self._x.array)]
            matrix.mult(self._x, self._y)
            force[: len(self._y.array)] += self._y.array

    def rows(self, size: int) -> csr_matrix:
        """The matrix, with ``size`` rows, on one rank; it is not kept here any longer."""
        empty = csr_matrix((size, len(self.field.x.array)))
        each = [csr_matrix(m.getValuesCSR()[::-1], shape=m.getSize()) for m in self._matrices]
        self._matrices = []
        return sum(each, empty)


def _derivative(work, field: fem.Function) -> list | None:
    """The compiled derivative of work by a field."""
    trial = ufl.TrialFunction(field.function_space)
    return dolfinx_versions.compile_form(ufl.derivative(work, field, trial))
