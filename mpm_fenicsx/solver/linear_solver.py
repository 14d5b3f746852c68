"""The linear solver that suits a run, from PETSc."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count

from mpi4py import MPI

from petsc4py import PETSc

RESCUE = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
"""For when the solver of a run fails."""

GMRES = {"ksp_type": "gmres", "ksp_gmres_restart": 60}

_number = count()


@dataclass(frozen=True)
class SolverKind:
    """What a run's matrix is like: on which ranks, whether it is solved with a ``full`` factor, and
    whether it is ``symmetric``."""

    comm: MPI.Comm
    full: bool
    symmetric: bool

    @property
    def options(self) -> dict[str, object]:
        """PETSc's options that suit it.

        A full factor in statics, and where K stays as it is; else a Krylov solver with an
        incomplete factor.
        """
        several = self.comm.size > 1
        if self.full:
            return {
                "ksp_type": "preonly",
                "pc_type": "cholesky" if self.symmetric else "lu",
                "pc_factor_mat_solver_type": "mumps" if several else "petsc",
            }
        incomplete = "icc" if self.symmetric else "ilu"
        krylov = {"ksp_type": "cg"} if self.symmetric else GMRES
        # block Jacobi would do on several ranks, but there PETSc 3.18 lets the blocks' factors turn
        # indefinite
        return {
            **krylov,
            "ksp_rtol": 1e-11,
            "ksp_max_it": 300,
            **(
                {"pc_type": "asm", "pc_asm_type": "basic", "sub_pc_type": incomplete}
                if several
                else {"pc_type": incomplete}
            ),
        }


def linear_solver(
    A: PETSc.Mat, suited: Mapping[str, object], options: Mapping[str, object] | None = None
) -> PETSc.KSP:
    """A solver with the options that are ``suited``, and ``options`` without prefix on top.

    Raises ``ValueError`` for options that PETSc does not take.
    """
    chosen = dict(suited)
    chosen.update(options or {})
    if chosen["pc_type"] in ("icc", "ilu", "asm"):
        # small cuts leave rows 1e12 times smaller than others, which the factor takes for zero
        # unless they are scaled; a full factor does without, and would be made anew for every solve
        chosen = {"ksp_diagonal_scale": True, "ksp_diagonal_scale_fix": True, **chosen}
    ksp = PETSc.KSP().create(A.comm)
    prefix = f"mpm_{next(_number)}_"
    ksp.setOptionsPrefix(prefix)
    store = PETSc.Options(prefix)
    for key, value in chosen.items():
        store[key] = value
    ksp.setOperators(A)
    # solvers of blocks and other packages' factors read theirs only when they are set up, and again
    # after a reset
    weakref.finalize(ksp, _forget, prefix, list(chosen))
    try:
        ksp.setFromOptions()
    except PETSc.Error as error:
        raise ValueError(
            f"solver: PETSc takes none of this kind, or not with these values, got {options} "
            f"(error code {error.ierr})"
        ) from None
    return ksp


def _forget(prefix: str, keys: list[str]) -> None:
    """Take options out of PETSc's table, which warns of those that nobody has read when the process
    ends."""
    if PETSc.Sys.isFinalized():
        return
    store = PETSc.Options(prefix)
    for key in keys:
        store.delValue(key)
