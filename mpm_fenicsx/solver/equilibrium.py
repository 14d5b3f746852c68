"""Equilibrium of a step, on PETSc: compiled and allocated once, then only numbers change."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from ..common.errors import SolverError
from ..common.ranks import of_all
from ..dynamics.motion import Motion
from ..grid import dolfinx_versions
from ..mapping.tied_sides import TiedSides
from ..mapping.ties import Ties
from ..response.response import Response
from ..terms.contribution import Contribution
from .active_nodes import Part, of_nodes
from .base_matrix import Base
from .blocks import POSSIBLE
from .changing_factors import ChangingFactors
from .condensed_part import CondensedPart
from .linear_solver import (
    RESCUE,
    Scaling,
    from_table,
    linear_solver,
    prepare_multigrid,
    warn_of_unread,
)
from .matrix_update import Update
from .solver import Solver
from .solver_choice import Choice, System
from .tangent import Tangent

# of the largest diagonal: rows below are round-off; a cut of 1e-4 both ways leaves real ones of
# 1e-18
IDLE = 1e-20

ASKEW = 1e-8
"""Of the matrix: what round-off may leave of a symmetric one."""

LOOSE = 1e-2  # relative tolerance that no response is solved with less than


class Equilibrium:
    """R(u) = 0 with the derivative K of the residual R; each solve starts from u = 0.

    ``body``: virtual work of the stress that the increment u adds, elastic; ``others``: what
    inertia and all terms contribute; ``fixed``: Dirichlet conditions (the motion knows which of
    them are not zero).
    ``response``: what the law adds to elasticity where it can yield: a step then goes on from its
    first solve, by ``Newton.iterate``.  Without it the step is linear.
    ``factored``: K does not change, and is factored once.  PETSc's options in ``solver`` are on top
    of what suits the system (see ``solver_choice``): its size, ``crossings``, how many of the
    smallest cells P waves run through in a second, and ``symmetric``, whether K is so.
    ``nodes`` (all ranks) that hold material at the start: all of the grid, if None.
    ``reuse``: where fields of the tangent stay as they are in most cells, only the others are
    assembled.  ``sides``: opposite sides of the grid whose nodes move together, if any.
    """

    def __init__(
        self,
        motion: Motion,
        body: Contribution,
        others: Sequence[Contribution],
        fixed: list,
        solver: Solver,
        response: Response | None = None,
        reuse: bool = False,
        factored: bool = False,
        crossings: float = 0.0,
        nodes: int | None = None,
        sides: TiedSides | None = None,
    ):
        self.motion, self.bcs = motion, fixed
        self.yielding, self._one_solve = response, solver.newton.tolerance is None
        self.symmetric = all(c.symmetric for c in others)
        V = motion.grid.space
        self._base = Base.of(motion, others)
        self._loads = [c.force for c in others if c.force]
        others = [c for c in others if not c.history]
        residual = sum((c.work for c in others), body.work)
        self.symmetric = self.symmetric and (response is None or response.symmetric)
        stiffness = 0 if response is None else response.stiffness
        self._tangent = Tangent(motion, residual, stiffness, self.symmetric)
        self._masses = [c.mass for c in others if c.mass is not None]
        residual = sum((c.work for c in others if c.mass is None), body.work)
        if response is not None:
            residual = residual + response.work
        elif residual and not motion.moved:
            # a linear step asks for the residual at u = 0 only, which costs less
            residual = ufl.replace(residual, {motion.u: ufl.zero(motion.u.ufl_shape)})
        tangent = self._tangent.form
        self.update = Update.of(motion, tangent, self.symmetric) if reuse else None
        self._factors = ChangingFactors(motion, others)
        self._body_work = body.work
        self._residual = dolfinx_versions.compile_form(residual)
        self._known = 1.0 + motion.stepping.start  # what was there before the step weighs so much
        self._factored, self._crossings = factored, crossings
        # whether the matrix is one of rows, as ties on ranks and shifted pivots want it, and
        # multigrid has failed: the next step depends on it, to round-off
        self.memory = np.zeros(2, dtype=bool)
        self._options = {**(solver.petsc or {}), **from_table(solver.prefix)}
        self._prefix, self._unread = solver.prefix, list(self._options)
        if nodes is None:
            nodes = V.dofmap.index_map.size_global
        self._unknowns = motion.grid.dim * nodes
        self._system: System | None = None
        self.choice = self._suited()
        self._kind = self._kind_of_matrix()
        self._tied: PETSc.Mat | None = None  # P that the part was made for
        with motion.region.whole():
            self._allocate()
        self.force = fem.Function(V, name="residual")
        self.increment = fem.Function(V, name="increment")
        self._owned = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
        self.fixed = np.zeros(len(self.force.x.array), dtype=bool)
        for bc in fixed:
            dofs, _ = bc.dof_indices()
            self.fixed[dofs] = True
        self.idle = np.zeros(self._owned, dtype=bool)
        self.ksp = self._solver()
        self._looked = self._altered = False
        self._bent = True  # the matrix is not K at u = 0
        self.solves = self.iterations = self.rescues = 0
        # once a node is light, or where sides are tied
        self.ties = None if sides is None else Ties(motion.grid, self.fixed, sides)
        self.strict = 0.0
        self._rescue: PETSc.KSP | None = None

    def _suited(self) -> Choice:
        """The solver that suits the system as it is; the same on all ranks."""
        grid, stepping = self.motion.grid, self.motion.stepping
        system = System(
            grid.comm.size,
            grid.dim,
            self.symmetric,
            self._unknowns,
            stepping.dynamic,
            self._crossings * stepping.dt if stepping.dynamic else 0.0,
            self._factored,
            bool(self.memory[1]),
        )
        if system != self._system:
            self._system, self._its_choice = system, system.choice
        return self._its_choice

    def _kind_of_matrix(self) -> str | None:
        """PETSc's name of the format: of blocks where the solver takes them, and the user's
        options leave it what it is."""
        alone = self.motion.grid.comm.size == 1
        jacobi = {**self.choice.options, **self._options}["pc_type"] == "jacobi"
        plain = not self._options if alone and not jacobi else self._leave_the_solver
        # PETSc shifts pivots of rows, not of blocks; with facets between cells an incomplete factor
        # needs that
        blocks = self.choice.blocks and plain and self.motion.region.dS is None
        return "baij" if blocks else None

    @property
    def _wanted_kind(self) -> str | None:
        """The same, but of rows where these have been needed before."""
        return None if self.memory[0] else self._kind_of_matrix()

    @property
    def _leave_the_solver(self) -> bool:
        """Whether the user's options say no more than when to stop, or ask for Jacobi."""
        return all(
            name.startswith("ksp_") or (name, value) == ("pc_type", "jacobi")
            for name, value in self._options.items()
        )

    def _solver(self) -> PETSc.KSP:
        ksp = linear_solver(self.part.matrix, self.choice.options, self._options, self._prefix)
        self._scaling = Scaling(ksp, self._options)
        return ksp

    def _choose(self) -> None:
        """Another solver, where another suits."""
        choice = self._suited()
        same, self.choice = choice.options == self.choice.options, choice
        if not same:
            self.ksp.destroy()
            self.ksp = self._solver()

    def __str__(self) -> str:
        """Which solver, and why."""
        options = ", ".join(
            name if value is None else f"{name}={value}" for name, value in self._options.items()
        )
        note = f"; with {options}" if options else ""
        return f"{self.choice.name} ({self.choice.why}){note}"

    def _allocate(self) -> None:
        """The matrix, with room for what the region may come to integrate over; nothing is tied in
        it yet."""
        self.matrix = dolfinx_versions.create_matrix(self._tangent.compiled, self._kind)
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, self.symmetric)
        # PETSc drops entries that the first assembly leaves out, and ours needs all of them
        if self.motion.region.follows or self._tangent.inserts:
            dolfinx_versions.assemble_matrix(self.matrix, self._tangent.compiled, [])
            self.matrix.assemble()
        for known in (self._tangent, self._base, self.update):
            if known is not None:
                known.forget()
        self._diagonal = self.matrix.createVecLeft()
        self._plain = None if self.update is None else self.matrix.createVecLeft()
        self.part = Part(self.matrix, self.symmetric)
        self._tied = self._condensed = None

    def assemble_tangent(self) -> None:
        """K with the law's tangent as it is, and the part of it that is to be solved."""
        self._choose()
        if self._wanted_kind != self._kind:
            self._change_matrix(self._wanted_kind)
        if self.motion.region.outgrown:
            with self.motion.region.room():
                self._allocate()
            self._reset()
        retied = self._retie()
        if not self._bring_up_to_date() and not retied:
            return
        if self._plain is not None:
            self.matrix.getDiagonal(self._plain)
        if self.symmetric and not self._looked:
            self._look_for_symmetry()
        self._condense(retied)
        self.part.diagonal(self._diagonal)
        d = self._diagonal.array
        free, comm = ~self.fixed[: self._owned], self.motion.grid.comm
        largest = of_all(comm, float(d[free].max(initial=0.0)), MPI.MAX)
        self.idle = d <= IDLE * largest
        if self.update is not None:
            bare = self.update.bare[: self._owned // self.motion.grid.dim]
            if self._base is not None:
                bare = bare & self._base.bare
            if self.ties is not None:
                bare = self.ties.all_copies(bare)
            self.idle |= np.repeat(bare, self.motion.grid.dim)
        bare = self.idle | ~free
        if self._tied is not None:
            self.idle &= free & ~self.ties.tied[: self._owned]
        d[bare] = largest if largest > 0.0 else 1.0
        if self.part.take(~bare, self._diagonal):
            self._reset()
        nodes = np.count_nonzero(of_nodes(~bare, self.motion.grid.dim))
        self._unknowns = self.motion.grid.dim * of_all(comm, nodes)
        self._choose()
        if self._wanted_kind != self._kind:  # of so many unknowns another solver is the better one
            self.assemble_tangent()
            return
        if self._scaling.wanted:
            least = of_all(comm, float(d.min(initial=largest)), MPI.MIN)
            self._scaling.suit(least, largest)
        self.ksp.setOperators(self.part.matrix)
        prepare_multigrid(self.ksp, self.part.matrix, self._places)

    def _look_for_symmetry(self) -> None:
        """Raise ``ValueError`` once, where K is not symmetric though terms and laws say so."""
        self._looked = True
        x, y = (self.matrix.createVecRight() for _ in range(2))
        z = self.matrix.createVecLeft()
        rng = np.random.default_rng(self.motion.grid.comm.rank)
        x.array[:], y.array[:] = rng.normal(size=(2, len(x.array)))
        self.matrix.mult(x, z)
        one, size = z.dot(y), z.norm() * y.norm()
        self.matrix.mult(y, z)
        if abs(one - z.dot(x)) > ASKEW * size:
            raise ValueError(
                f"terms: the matrix is askew by {abs(one - z.dot(x)) / size:.2g}, though every "
                "term says that its work has a symmetric derivative: a Contribution whose work has "
                "not says symmetric=False"
            )

    def _retie(self) -> bool:
        """Make ready for ties that are others than in the last step; whether they are."""
        P = self.ties.P if self.ties is not None else None
        if P is self._tied:
            return False
        # PETSc takes products of rows, not of blocks
        if self._kind is not None and not self._alone:
            self.memory[0] = True
            self._change_matrix(None)
        elif self.update is not None and self.part.matrix is self.matrix:
            self.matrix.setDiagonal(self._plain)  # rows without material have another one
        self._tied, self._condensed = P, None
        self._reset()
        return True

    @property
    def _alone(self) -> bool:
        """Whether the matrix is of one rank, and ours to read."""
        return POSSIBLE and self.motion.grid.comm.size == 1

    def _change_matrix(self, kind: str | None) -> None:
        """A matrix of another format in place of that so far."""
        self._kind = kind
        with self.motion.region.whole():
            self._allocate()
        self._reset()

    def _places(self) -> np.ndarray:
        """Nodes (n, dim), m, of the part that is solved."""
        dim = self.motion.grid.dim
        x = self.motion.grid.space.tabulate_dof_coordinates()[: self._owned // dim, :dim]
        return x.ravel()[self.part._rows].reshape(-1, dim)

    def _condense(self, retied: bool) -> None:
        """The part of K of the nodes that are not tied."""
        own = self._alone and self._tied is not None
        if self._tied is not None and not own:
            self._condensed = self.ties.condense(self.matrix, self._condensed)
        if not retied:
            return
        if own:
            self.part = CondensedPart(self.matrix, self.ties.free, self.symmetric)
        else:
            A = self.matrix if self._tied is None else self._condensed
            self.part = Part(A, self.symmetric)

    def _bring_up_to_date(self) -> bool:
        """K in the matrix; False if that has not changed."""
        A, update = self.matrix, self.update
        if update is not None and update.follow() and not self._altered:
            if not update.changed:
                return False
            if self.part.matrix is A:
                A.setDiagonal(self._plain)  # rows without material have another one
            update.add(A, self.bcs, self.fixed)
        else:
            if self._base is None:
                A.zeroEntries()
            else:
                self._base.put(A, self.bcs)
            self._tangent.add(A, self.bcs, self.fixed)
            if self.yielding is not None and self.yielding.summed:
                A.assemble(True)  # flushes: the diagonal was set, now is added to
                self.yielding.add_stiffness(A, self.fixed)
            if update is not None:
                update.remember()
        A.assemble()
        return True

    def _reset(self) -> None:
        for ksp in (self.ksp, self._rescue):
            if ksp is not None:
                ksp.reset()

    def solve(self, internal: np.ndarray | None = None, reassemble: bool = True) -> None:
        """Solve for the motion's u; ``internal`` (dofs,), N: internal force that is no form, summed
        at points.

        ``reassemble`` K first; without it K at u = 0 is taken to be that of the last step.
        Raises ``SolverError`` if PETSc or Newton does not converge.
        """
        self._clear()
        self._altered = self._factors.changed()
        if reassemble or self._bent or self._altered:
            self.assemble_tangent()
            self._altered = False
            self._bent = False
        self.first = self.refresh(internal)
        self.correct()

    def initial_acceleration(self) -> np.ndarray:
        """Nodal accelerations (dofs,), m/s², of the balance of forces at the start of the step, M a
        = P - F - Z v, and of nodes whose acceleration is known: those of a step so short that
        stiffness does not count, by its own forms.
        """
        motion, looked = self.motion, self._looked
        self._looked = True  # stiffness does not count here, and what of it is askew is not seen
        with motion.vanishing_step() as factor:
            self._clear()
            for known in motion.moved:
                motion.u.x.array[known.dofs] = known.before[1] / factor
            self.assemble_tangent()
            self.refresh(None)
            self._solve()
        self._bent, self._looked = True, looked
        found = factor * (motion.u.x.array + self.increment.x.array)
        motion.u.x.array[:] = 0.0
        return found

    def initial_force(self, internal: np.ndarray) -> fem.Function:
        """P - F - Z v, N, at the start of the step, of every node on its own; ``internal`` (dofs,),
        N, as in ``solve``."""
        with self.motion.vanishing_step():
            self._clear()
            self.motion.u.x.array[:] = 0.0
            force = -self._assemble(internal) / self._known
        self.force.x.array[:] = force
        self.force.x.array[self.fixed] = 0.0
        dolfinx_versions.share(self.force)
        return self.force

    def _clear(self) -> None:
        self.motion.clear()
        if self.motion.moved and self.ties is not None and self.ties.P is not None:
            self.ties.follow(self.motion.u)
        if self.yielding is not None:
            self.yielding.clear()

    def response(self, force: np.ndarray) -> np.ndarray:
        """K⁻¹ of a force (dofs,), N, zero at fixed dofs, with K as it was last solved with, and as
        exact as that was: relative to the first residual of the step.  The motion stays as it
        is."""
        if not force.any() and self.motion.grid.comm.size == 1:
            return np.zeros_like(force)
        r = self.force.x.array
        r[:] = force
        r[self.fixed] = 0.0
        r[: self._owned][self.idle] = 0.0
        size, tolerances = self._norm(), self.ksp.getTolerances()
        if size > 0.0:
            loose = tolerances[0] * max(self.first / size, 1.0)
            self.ksp.setTolerances(min(loose, LOOSE), *tolerances[1:])
        preconditioner = self.ksp.getPC()
        preconditioner.setReusePreconditioner(
            True
        )  # scaling the matrix twice makes PETSc think that it has changed
        try:
            self._solve()
        finally:
            preconditioner.setReusePreconditioner(False)
            self.ksp.setTolerances(*tolerances)
        return self.increment.x.array.copy()

    def bend(self) -> None:
        """K at the motion's u."""
        self.assemble_tangent()
        self._bent = True

    def _assemble(self, internal: np.ndarray | None) -> np.ndarray:
        r = self.force.x.array
        r[:] = 0.0 if internal is None else self._known * internal
        if self.yielding is not None:
            self.yielding.add_force(r)
        if self._residual is not None:
            dolfinx_versions.assemble_vector(self.force, self._residual)
        if self._masses:
            acceleration = self.motion.balanced_acceleration()
            for mass in self._masses:
                force = r.reshape(acceleration.shape)
                mass.add_times(acceleration, self.motion.region.cells, force)
        dolfinx_versions.gather_to_owner(self.force)
        if self._base is not None:
            self._base.add_force(r)
        return r

    def refresh(self, internal: np.ndarray | None) -> float:
        """Assemble the residual at the motion's u; its norm over free dofs (N)."""
        r = self._assemble(internal)
        np.negative(r, out=r)
        if self._tied is not None:
            self.ties.pass_on_free(self.force)
        r[self.fixed] = 0.0
        r[: self._owned][self.idle] = 0.0
        return self._norm()

    def correct(self) -> None:
        """Add K⁻¹ of the residual to the motion's u."""
        self._solve()
        self.solves, self.iterations = self.solves + 1, self._iterations
        self.motion.u.x.array[:] += self.increment.x.array

    def _solve(self) -> None:
        """K⁻¹ of the residual, as ``increment``; where the solver is ours and fails, by a full
        factor."""
        if self._tied is not None:
            self.ties.pass_on_free(self.force)
        reason = self._run(self.ksp)
        if self._unread:
            names, self._unread = self._unread, []
            warn_of_unread(self.ksp, names)
        if reason < 0 and self._kind is not None and self._alone and not self.memory[0]:
            self._turn_to_rows()
            reason = self._run(self.ksp)
        if reason < 0 and self.choice.iterates and not self._options:
            self.memory[1] |= self.choice.multigrid
            if self._rescue is None:
                self._rescue = linear_solver(self.part.matrix, RESCUE)
            self._rescue.setOperators(self.part.matrix)
            reason, self.rescues = self._run(self._rescue), self.rescues + 1
        self._iterations = self.ksp.getIterationNumber()
        if reason < 0 or not np.isfinite(self.part.x.norm()):
            raise SolverError(
                f"linear solver stopped with PETSc reason {reason} after {self._iterations} "
                f"iterations; {self.largest()}"
            )
        self.part.give(self.increment.x.array[: self._owned])
        dolfinx_versions.share(self.increment)
        if self._tied is not None:
            self.ties.follow_free(self.increment)

    def _turn_to_rows(self) -> None:
        """The part as rows, and all of the matrix from the next step on: PETSc shifts pivots of
        rows where an incomplete factor breaks down, as that of soil near incompressible does."""
        self.memory[0], rows = True, self.part.matrix.convert("aij", PETSc.Mat())
        rows.setOption(PETSc.Mat.Option.SYMMETRIC, self.symmetric)
        self._reset()
        self.ksp.setOperators(rows)

    def largest(self) -> str:
        """Where the residual is largest, or not a number, in words; the same on all ranks."""
        grid = self.motion.grid
        size = np.linalg.norm(self.motion.nodal(self.force)[: self._owned // grid.dim], axis=1)
        size[np.isnan(size)] = np.inf
        node = int(np.argmax(size)) if len(size) else 0
        place = (
            grid.space.tabulate_dof_coordinates()[node, : grid.dim]
            if len(size)
            else np.zeros(grid.dim)
        )
        most, place = max(grid.comm.allgather((float(size.max(initial=-1.0)), tuple(place))))
        what = (
            f"largest residual {most:.3g} N"
            if np.isfinite(most)
            else "residual that is not a number"
        )
        return f"{what} at the node x={np.array(place)}"

    def _run(self, ksp: PETSc.KSP) -> int:
        part = self.part
        part.load(self.force.x.array[: self._owned])
        ksp.solve(part.b, part.x)
        return ksp.getConvergedReason()

    def _norm(self) -> float:
        r = self.force.x.array[: self._owned]
        return float(np.sqrt(of_all(self.motion.grid.comm, float(r @ r))))

    def support(self, internal: np.ndarray | None) -> tuple[np.ndarray, float]:
        """What supports bear as things stand, at u = 0 (dofs,), N, zero where nothing is fixed and
        at ghosts; and what is out of balance at free dofs, relative to ``scale``."""
        self.motion.u.x.array[:] = 0.0
        if self.yielding is not None:
            self.yielding.clear()
        size = self.scale(internal)
        r = self._assemble(internal)
        if self.ties is not None:
            self.ties.pass_on_at_sides(self.force)
        raw = r.copy()
        if self.ties is not None and self.ties.P is not None:
            self.ties.pass_on(self.force)
        borne = np.where(self.fixed, r, 0.0)
        borne[self._owned :] = 0.0
        whole = r.copy()
        found = []
        for left in (raw, whole):
            r[:] = left
            r[self.fixed] = 0.0
            found.append(self._norm() / size if size > 0.0 else 0.0)
        self.strict = found[0]
        return borne, found[1]

    @cached_property
    def _body(self) -> list:
        """The increment of internal force, but for what the law's ``add_force`` adds."""
        work = self._body_work
        if self.yielding is not None:
            work += self.yielding.work
        return dolfinx_versions.compile_form(work)

    @cached_property
    def _forces(self) -> list:
        return [self._body, *(dolfinx_versions.compile_form(form) for form in self._loads)]

    def foresee(self) -> None:
        """Compile what ``add_foreseen`` wants, which else its first call does."""
        _ = self._body

    def add_foreseen(self, force: fem.Function) -> None:
        """Add the increment of internal force at the motion's u (N) that the step was solved
        with."""
        if self.yielding is not None and self._one_solve:
            # one solve: the response as it is linear about the start, at this u
            self.yielding.clear()
        if self.yielding is not None:
            self.yielding.add_force(force.x.array)
        dolfinx_versions.assemble_vector(force, self._body)

    def scale(self, internal: np.ndarray | None) -> float:
        """Size of the forces that are in equilibrium (N): loads and internal force, inertia left
        out."""
        total = 0.0
        for form in self._forces:
            r = self.force.x.array
            r[:] = 0.0
            if form is self._forces[0]:
                if internal is not None:
                    r[:] = self._known * internal
                if self.yielding is not None:
                    self.yielding.add_force(r)
            dolfinx_versions.assemble_vector(self.force, form)
            dolfinx_versions.gather_to_owner(self.force)
            total += self._norm()
        return total
