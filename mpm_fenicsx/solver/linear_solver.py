"""The linear solver that suits a run, from PETSc."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from itertools import count

from petsc4py import PETSc

from ..dynamics.motion import Motion

RESCUE = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
"""For when the solver of a run fails."""

_number = count()


def linear_solver(A: PETSc.Mat, motion: Motion, options: Mapping[str, object] | None) -> PETSc.KSP:
    """Conjugate gradients with an incomplete Cholesky factor in dynamics, a full factor in statics;
    ``options`` without prefix on top of that."""
    several = motion.grid.comm.size > 1
    if motion.stepping.dynamic:
        # block Jacobi would do on several ranks, but there PETSc 3.18 lets the blocks' factors turn
        # indefinite
        chosen = {
            "ksp_type": "cg",
            "ksp_rtol": 1e-11,
            **(
                {"pc_type": "asm", "pc_asm_type": "basic", "sub_pc_type": "icc"}
                if several
                else {"pc_type": "icc"}
            ),
        }
        chosen["ksp_max_it"] = 300
    else:
        chosen = {
            "ksp_type": "preonly",
            "pc_type": "cholesky",
            "pc_factor_mat_solver_type": "mumps" if several else "petsc",
        }
    chosen.update(options or {})
    if chosen["pc_type"] in ("icc", "asm"):
        # small cuts leave rows 1e12 times smaller than others, which the factor takes for zero
        # unless they are scaled; a full factor does without, and would be made anew for every solve
        chosen = {"ksp_diagonal_scale": True, "ksp_diagonal_scale_fix": True, **chosen}
    ksp = PETSc.KSP().create(motion.grid.comm)
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
