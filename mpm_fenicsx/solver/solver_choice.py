"""Which linear solver suits a system of equations, and why.

Conjugate gradients take some 13 C iterations with Jacobi's preconditioner at a Courant number C of
the fastest P wave in the smallest cell (up to what statics would take), a quarter of that with an
incomplete factor, and 11 to 20 with algebraic multigrid, which costs as much as 100 to 200 of the
former to set up.  Jacobi's iterations do not depend on how many ranks share the matrix; blocks of
an incomplete factor lose half of its worth on two.  A factor is exact to round-off and asks for
nothing, but its cost grows faster than the system, in 3D most of all.
"""

from __future__ import annotations

from dataclasses import dataclass, field

FEW = {1: 10_000, 2: 10_000, 3: 3_000}
"""Unknowns by dimension, up to which PETSc's own factor is no dearer than a twentieth of a second's
work; above, MUMPS needs a third to a tenth of its time."""
MANY = {1: 60_000, 2: 60_000, 3: 10_000}
"""Unknowns by dimension, from which multigrid takes less than two thirds of the time of MUMPS in
one solve (2D: half of it at 97,000; 3D: 0.6 at 9,450)."""
HUGE = {1: 1_000_000, 2: 1_000_000, 3: 100_000}
"""Unknowns by dimension, up to which a factor that is used in every step of a dynamic run pays for
itself and fits into memory."""
STIFF_ON_ONE = 40.0
"""Courant number from which multigrid takes less time than an incomplete factor on one rank."""
STIFF = 15.0
"""Courant number from which multigrid takes less time than Jacobi's preconditioner."""

CG: dict[str, object] = {"ksp_type": "cg"}
GMRES: dict[str, object] = {
    "ksp_type": "gmres",
    "ksp_gmres_restart": 60,
    # stopped by the residual itself: that of a bad factor says nothing when it is small
    "ksp_pc_side": "right",
}


@dataclass(frozen=True)
class System:
    """What a run's system of equations is like.

    ``ranks`` that share it, ``dim`` of the grid, ``symmetric``; ``unknowns`` that are solved for;
    ``dynamic``, with the ``courant`` number of the fastest P wave in the smallest cell;
    ``constant``: the matrix stays as it is; ``hard``: multigrid has failed here.
    """

    ranks: int
    dim: int
    symmetric: bool
    unknowns: int
    dynamic: bool = False
    courant: float = 0.0
    constant: bool = False
    hard: bool = False

    @property
    def choice(self) -> Choice:
        """The solver that suits it."""
        if not self.dynamic:
            return self._in_statics()
        if self.constant and self.unknowns <= HUGE[self.dim]:
            return self._factor(f"{self._size}, factored once")
        return self._in_dynamics()

    @property
    def _size(self) -> str:
        return f"{self.unknowns} unknowns, {self.ranks} rank{'s' if self.ranks > 1 else ''}"

    def _in_statics(self) -> Choice:
        if self.hard:
            return self._factor(f"{self._size}, multigrid has failed")
        if self.unknowns <= MANY[self.dim]:
            return self._factor(self._size)
        return self._multigrid(self._size, 1e-12)

    def _in_dynamics(self) -> Choice:
        why = f"Courant number {self.courant:.3g}, {self._size}"
        if self.hard:
            return self._factor(f"{why}, multigrid has failed")
        alone = self.ranks == 1
        large = self.unknowns > MANY[self.dim]
        if self.courant > (STIFF_ON_ONE if alone else STIFF) and (large or not alone):
            return self._multigrid(why, 1e-11)
        if alone:
            words, name = (
                ("incomplete Cholesky factor", "icc")
                if self.symmetric
                else ("incomplete LU factor", "ilu")
            )
            return self._krylov(words, why, {"pc_type": name, "ksp_max_it": 300}, 1e-11, True)
        options = {"pc_type": "jacobi", "ksp_max_it": 600}
        return self._krylov("Jacobi", why, options, 1e-11, True)

    def _factor(self, why: str) -> Choice:
        mumps = self.ranks > 1 or self.unknowns > FEW[self.dim]
        options = {
            "ksp_type": "preonly",
            "pc_type": "cholesky" if self.symmetric else "lu",
            "pc_factor_mat_solver_type": "mumps" if mumps else "petsc",
        }
        kind = "Cholesky" if self.symmetric else "LU"
        return Choice(f"full {kind} factor of {'MUMPS' if mumps else 'PETSc'}", why, options)

    def _krylov(
        self, words: str, why: str, options: dict, tolerance: float, blocks: bool = False
    ) -> Choice:
        krylov, name = (CG, "conjugate gradients") if self.symmetric else (GMRES, "GMRES")
        options = {**krylov, "ksp_rtol": tolerance, **options}
        return Choice(f"{name}, {words}", why, options, iterates=True, blocks=blocks)

    def _multigrid(self, why: str, tolerance: float) -> Choice:
        options = {
            "pc_type": "gamg",
            "ksp_max_it": 150,
            "mg_levels_ksp_type": "chebyshev",
            "mg_levels_pc_type": "jacobi",
            # of a step before, it would make a run that goes on from a checkpoint another one
            "pc_gamg_reuse_interpolation": False,
        }
        return self._krylov("algebraic multigrid", why, options, tolerance)


@dataclass(frozen=True)
class Choice:
    """A solver, in words and in PETSc's ``options``, and ``why`` it was chosen.

    ``iterates``: it may fail, and a factor then comes to the rescue; ``blocks``: it takes matrices
    of dense blocks, which are assembled faster.
    """

    name: str
    why: str
    options: dict[str, object] = field(default_factory=dict)
    iterates: bool = False
    blocks: bool = False

    @property
    def multigrid(self) -> bool:
        """Whether it is algebraic multigrid."""
        return self.options["pc_type"] == "gamg"
