"""The linear solve of a step, on PETSc: compiled and allocated once, then only numbers change."""

from __future__ import annotations

from collections.abc import Mapping

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from . import fenicsx
from .motion import Motion

IDLE = 1e-20  # of the largest diagonal: rows below are round-off; a cut of 1e-4 both ways leaves real ones of 1e-18


class SolverError(RuntimeError):
    """A step that could not be solved; says which, when and why."""


class Equilibrium:
    """One Newton step from u = 0: K u = -R(0) with K the derivative of the residual R.

    ``residual`` is the UFL sum of all virtual work; ``fixed`` Dirichlet conditions (all zero); ``options`` PETSc
    options without prefix, on top of what suits the stepping.
    """

    def __init__(self, motion: Motion, residual, fixed: list, options: Mapping[str, object] | None = None):
        self.motion, self.bcs = motion, fixed
        V = motion.grid.space
        self._residual = fenicsx.compile_form(residual)
        self._tangent = fenicsx.compile_form(ufl.derivative(residual, motion.u, ufl.TrialFunction(V)))
        self.matrix = fenicsx.create_matrix(self._tangent)
        self.force = fem.Function(V, name="residual")
        self._owned = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
        size = (self._owned, V.dofmap.index_map.size_global * V.dofmap.index_map_bs)
        self._b, self._x = (PETSc.Vec().createWithArray(f.x.array[: self._owned], size=size, comm=motion.grid.comm)
                            for f in (self.force, motion.u))
        self._fixed = np.zeros(len(self.force.x.array), dtype=bool)
        for bc in fixed:
            dofs, _ = bc.dof_indices()
            self._fixed[dofs] = True
        self._diagonal = self.matrix.createVecLeft()
        self.idle = np.zeros(self._owned, dtype=bool)
        self.ksp = _solver(self.matrix, motion, options)
        self.iterations = 0

    def assemble_tangent(self) -> None:
        """K at u = 0; fixed nodes and nodes that touch no material keep a diagonal."""
        A = self.matrix
        A.zeroEntries()
        fenicsx.assemble_matrix(A, self._tangent, self.bcs)
        A.assemble()
        A.getDiagonal(self._diagonal)
        d = self._diagonal.array
        free = ~self._fixed[: self._owned]
        largest = self.motion.grid.comm.allreduce(float(d[free].max(initial=0.0)), op=MPI.MAX)
        self.idle = d <= IDLE * largest
        if largest > 0.0:
            d[self.idle | ~free] = largest
        else:
            d[:] = 1.0
        A.setDiagonal(self._diagonal)
        self.ksp.setOperators(A)

    def solve(self, internal: np.ndarray | None = None) -> None:
        """Solve for the increment; ``internal`` (dofs,), N: internal force that is no form, summed at points.

        Raises ``SolverError`` if PETSc does not converge.
        """
        self.motion.clear()
        r = self.force.x.array
        r[:] = 0.0 if internal is None else internal
        if self._residual is not None:
            fenicsx.assemble_vector(self.force, self._residual)
        fenicsx.gather_to_owner(self.force)
        np.negative(r, out=r)
        r[self._fixed] = 0.0
        r[: self._owned][self.idle] = 0.0
        self.ksp.solve(self._b, self._x)
        reason = self.ksp.getConvergedReason()
        self.iterations = self.ksp.getIterationNumber()
        if reason < 0 or not np.isfinite(self._x.norm()):
            raise SolverError(f"linear solver stopped with PETSc reason {reason} after {self.iterations} iterations")
        self.motion.share()


def _solver(A: PETSc.Mat, motion: Motion, options: Mapping[str, object] | None) -> PETSc.KSP:
    """Conjugate gradients with an incomplete Cholesky factor in dynamics, a full factor in statics."""
    several = motion.grid.comm.size > 1
    if motion.stepping.dynamic:
        # block Jacobi would do on several ranks, but there PETSc 3.18 lets the blocks' factors turn indefinite
        chosen = {"ksp_type": "cg", "ksp_rtol": 1e-11, **({"pc_type": "asm", "pc_asm_type": "basic",
                  "sub_pc_type": "icc"} if several else {"pc_type": "icc"})}
    else:
        chosen = {"ksp_type": "preonly", "pc_type": "cholesky",
                  "pc_factor_mat_solver_type": "mumps" if several else "petsc"}
    chosen.update(options or {})
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    ksp = PETSc.KSP().create(motion.grid.comm)
    prefix = f"mpm_{id(ksp)}_"
    ksp.setOptionsPrefix(prefix)
    store = PETSc.Options(prefix)
    for key, value in chosen.items():
        store[key] = value
    ksp.setOperators(A)
    ksp.setFromOptions()
    for key in chosen:
        del store[key]
    return ksp
