"""A linear solver of PETSc with options from a run, and from PETSc's table."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping
from itertools import count

import numpy as np
from petsc4py import PETSc

from ..common.ranks import warn

RESCUE = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
"""For when the solver of a run fails."""
OF_ROWS = ("icc", "ilu", "asm")
"""Small cuts leave rows 1e12 times smaller than others, which an incomplete factor takes for zero
unless they are scaled; a full factor does without, and would be made anew for every solve."""
UNEVEN = 1e-4
"""Of the largest entry of the diagonal: rows below are such, and all are scaled.  To scale and to
scale back costs as much as the factor."""
SCALES = ("ksp_diagonal_scale", "ksp_diagonal_scale_fix")
OF_GMRES = ("ksp_gmres_restart", "ksp_pc_side")
"""Not for another method that a user asks for, which may refuse them."""
BY_ENERGY = ("gamg", "ml", "hypre")
"""They are stopped by the energy of what is left."""
OF_NODES = ("gamg", "ml")
"""They want to know what rigid bodies do."""

_number = count()


def from_table(prefix: str) -> dict[str, str | None]:
    """Options that PETSc's table has under a prefix (command line, PETSC_OPTIONS, files), None for
    one without a value; they count as read."""
    if not prefix:
        return {}
    table = PETSc.Options(prefix)
    return {key: table.getString(key, "") or None for key in table.getAll()}


def linear_solver(
    A: PETSc.Mat,
    suited: Mapping[str, object],
    options: Mapping[str, object] | None = None,
    prefix: str = "",
) -> PETSc.KSP:
    """A solver with the options that are ``suited``, and ``options`` without prefix on top, under a
    prefix of its own that ends with ``prefix``.

    Raises ``ValueError`` for options that PETSc does not take.
    """
    options = options or {}
    if options.get("ksp_type", suited["ksp_type"]) != suited["ksp_type"]:
        suited = {key: value for key, value in suited.items() if key not in OF_GMRES}
    chosen = {**suited, **options}
    method, preconditioner = (str(chosen[key]) for key in ("ksp_type", "pc_type"))
    if preconditioner == "jacobi" and method != "cg":
        chosen = {**dict.fromkeys(SCALES, True), **chosen}
    elif method == "cg" and preconditioner in BY_ENERGY:
        # the norm in which small rows weigh as much as others, without scaling
        chosen = {"ksp_norm_type": "natural", **chosen}
    ksp = PETSc.KSP().create(A.comm)
    own = f"mpm_{next(_number)}_{prefix}"
    ksp.setOptionsPrefix(own)
    store = PETSc.Options(own)
    for key, value in chosen.items():
        store[key] = value
    ksp.setOperators(A)
    # solvers of blocks and other packages' factors read theirs only when they are set up, and again
    # after a reset
    weakref.finalize(ksp, _forget, own, [*chosen, *SCALES])
    try:
        ksp.setFromOptions()
    except PETSc.Error as error:
        raise ValueError(
            f"solver: PETSc takes none of this kind, or not with these values, got {options} "
            f"(error code {error.ierr})"
        ) from None
    return ksp


class Scaling:
    """Scales the rows of a solver where they are ``UNEVEN`` and its preconditioner is one
    ``OF_ROWS``, unless its ``options`` say whether to."""

    def __init__(self, ksp: PETSc.KSP, options: Mapping[str, object]):
        self._ksp, self._on = ksp, False
        asked = any(name in options for name in SCALES)
        self.wanted = ksp.getPC().getType() in OF_ROWS and not asked

    def suit(self, least: float, largest: float) -> None:
        """Take the extremes of the diagonal, which are those of all ranks."""
        uneven = least < UNEVEN * largest
        if uneven is self._on:
            return
        self._on, store = uneven, PETSc.Options(self._ksp.getOptionsPrefix())
        for name in SCALES:
            store[name] = uneven
        self._ksp.setFromOptions()


def warn_of_unread(ksp: PETSc.KSP, names: list[str]) -> None:
    """Warn of options that a solver has not asked for, though it has solved; PETSc tells it since
    3.20."""
    table, own = PETSc.Options(), ksp.getOptionsPrefix()
    if not hasattr(table, "used"):
        return
    unread = [name for name in names if not table.used(own + name)]
    if unread:
        warn(
            ksp.comm,
            f"petsc: PETSc has not asked for {', '.join(unread)}: misspelt, or of a solver that is "
            "not at work here",
            2,
        )


def prepare_multigrid(ksp: PETSc.KSP, A: PETSc.Mat, places: Callable[[], np.ndarray]) -> None:
    """Where the solver is multigrid, start it anew for the numbers that ``A`` has now, with the
    motions that it must not see as stiff: those of rigid bodies, of the nodes of ``A`` at
    ``places()`` (n, dim), m, which nobody else asks for.  Collective."""
    if ksp.getPC().getType() not in OF_NODES:
        return
    ksp.getPC().setType("none")  # else PETSc 3.18 refuses levels of another size, reset or not
    ksp.getPC().setFromOptions()
    ksp.setOperators(A)
    if not A.getNearNullSpace():
        at, x = places(), A.createVecLeft()
        x.setBlockSize(at.shape[1])
        x.array[:] = at.ravel()
        A.setNearNullSpace(PETSc.NullSpace().createRigidBody(x))


def _forget(prefix: str, keys: list[str]) -> None:
    """Take options out of PETSc's table, which warns of those that nobody has read when the process
    ends."""
    if PETSc.Sys.isFinalized():
        return
    store = PETSc.Options(prefix)
    for key in keys:
        store.delValue(key)
