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
        work = sum(c.work for c in contributions)
        self._tangent = dolfinx_versions.compile_form(_derivative(motion, work, motion.u))
        self._matrix: PETSc.Mat | None = None
        self._of = np.zeros(0)
        self._forces = [Force(motion, f, c.work) for c in contributions for f in c.history]
        self._all: tuple[csr_matrix, np.ndarray] | None = None
        self._stiffness = Force(motion, motion.u, work)

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
        now = self.motion.numbers()
        parts = [*self._forces, *([self._stiffness] if self.motion.u.x.array.any() else [])]
        for part in parts:
            if not part.known(now):
                self._all = None
                with self.motion.grid.where_made():
                    part.assemble(now)
        if self.motion.grid.comm.size > 1:
            for part in parts:
                part.add(force)
            return
        if self._all is None:
            self._all = hstack([part.rows() for part in self._forces], format="csr")
            self._values = np.zeros(self._all.shape[1])
        np.concatenate([part.field.x.array for part in self._forces], out=self._values)
        force += self._all @ self._values
        if len(parts) > len(self._forces):
            self._stiffness.add(force)


class Force:
    """The force of one field, a matrix times its values."""

    def __init__(self, motion: Motion, field: fem.Function, work: ufl.Form):
        self._size, form = len(motion.u.x.array), _derivative(motion, work, field)
        # parts one by one, for each has places of its own in a matrix
        self.field, self._parts = field, dolfinx_versions.compile_form(form) or []
        self._matrices: list[PETSc.Mat] = []
        self._of: np.ndarray | None = None

    def known(self, now: np.ndarray) -> bool:
        """Whether its matrix is that of ``now``: what the form knows of the step."""
        return self._of is not None and np.array_equal(now, self._of)

    def add(self, force: np.ndarray) -> None:
        """Add it to ``force`` (dofs,)."""
        for matrix in self._matrices:
            self._x.array[:] = self.field.x.array[: len(self._x.array)]
            matrix.mult(self._x, self._y)
            force[: len(self._y.array)] += self._y.array

    def rows(self) -> csr_matrix:
        """The matrix, on one rank."""
        empty = csr_matrix((self._size, len(self.field.x.array)))
        each = [csr_matrix(m.getValuesCSR()[::-1], shape=m.getSize()) for m in self._matrices]
        return sum(each, empty)

    def assemble(self, now: np.ndarray) -> None:
        """Its matrix, for ``now``."""
        self._of = now
        if not self._matrices:
            self._matrices = [dolfinx_versions.create_matrix([part]) for part in self._parts]
            self._x, self._y = self._matrices[0].createVecs() if self._parts else (None, None)
        for matrix, part in zip(self._matrices, self._parts, strict=True):
            matrix.zeroEntries()
            dolfinx_versions.assemble_matrix(matrix, [part], [])
            matrix.assemble()


def _derivative(motion: Motion, work, field: fem.Function) -> ufl.Form:
    return ufl.derivative(work, field, ufl.TrialFunction(field.function_space))
