"""What tests must see of a run that is no business of its users, each with the reason.

Tests speak through the public interface; where a truth is about the equations themselves, the
solver that is asked or what a scene pays for, they ask here, and nowhere else.
``test_architecture.py`` holds that.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import dense
import numpy as np
import ufl
from dolfinx import fem

from mpm_fenicsx.grid import dolfinx_versions, weak_forms

# -- the equations of a step -----------------------------------------------------------------------


def prepared(run, start=None, end=None):
    """The run, ready for the solve of its next step, or of one from ``start`` to ``end`` (s): tests
    of equations stop there, and want no ties, which ``Simulation.prepare`` would make."""
    if run.bodies:
        run.locate()
        run.project()
    start = run.time if start is None else start
    run.scene.prepare(start, run.next_time if end is None else end)
    if run.bodies:
        run.predict()
    return run


class Equations:
    """K u = r as they stand, copied: tests compare them with sums by hand, which no answer of a
    run can replace, for a wrong row may still give a right motion."""

    def __init__(self, run):
        self._equilibrium, self._comm = run.equilibrium, run.grid.comm

    @cached_property
    def matrix(self) -> np.ndarray:
        """K (dofs, dofs) of every node, tied or not."""
        return dense.dense(self._equilibrium.matrix)

    @cached_property
    def solved(self) -> np.ndarray:
        """The part of the matrix that PETSc gets: which rows it leaves out is what is tested."""
        return dense.dense(self._equilibrium.part.matrix)

    @cached_property
    def ties(self) -> np.ndarray | None:
        """P (dofs, dofs) that K was condensed with, None without: PᵀKP is checked by hand."""
        tied = self._equilibrium._tied
        return None if tied is None else dense.dense(tied)

    @cached_property
    def residual(self) -> np.ndarray:
        """r (dofs,), N."""
        return self._equilibrium.force.x.array.copy()

    @cached_property
    def idle(self) -> np.ndarray:
        """Which dofs (dofs,) have no material and are not solved for."""
        return self._equilibrium.idle.copy()

    @cached_property
    def fixed(self) -> np.ndarray:
        """Which dofs (dofs,) supports hold: a balance by hand holds at the others."""
        return self._equilibrium.fixed.copy()


def equations(run, assemble: bool = False) -> Equations:
    """Those of the last solve, or with K assembled for the run as it is: a test of K needs no
    solve, and one of K u = 0 must not have one."""
    if assemble:
        run.equilibrium.assemble_tangent()
    return Equations(run)


def condition(run) -> float:
    """Condition number of K with unit diagonal, idle rows left out: small cuts must not show."""
    found = equations(run, assemble=True)
    A = found.matrix[np.ix_(~found.idle, ~found.idle)]
    value = np.linalg.eigvalsh(A / np.sqrt(np.outer(A.diagonal(), A.diagonal())))
    return value[-1] / value[0]


def tangent(run, plastic: bool = True) -> np.ndarray:
    """K (dofs, dofs) at the run's increment, with what the law adds or without: that is what
    differences of the residual are compared with, before anything is solved."""
    run.yielding.clear()
    if plastic:
        run.yielding.evaluate()
    found = equations(run, assemble=True)
    assert not found.idle.any()
    return found.matrix


def differences(run, step: float) -> np.ndarray:
    """dr/du (dofs, dofs) by central differences of ``step`` (m): a run never asks for its residual
    at an increment that it has not solved for."""
    u, columns = run.nodal("increment").ravel(), []
    start = u.copy()
    for j in range(len(u)):
        sides = []
        for sign in (1, -1):
            u[:] = start
            u[j] += sign * step
            run.yielding.evaluate()
            run.equilibrium.refresh(None)
            sides.append(equations(run).residual)
        columns.append((sides[1] - sides[0]) / (2 * step))
    u[:] = start
    return np.array(columns).T


def kept_matrix(run) -> tuple[np.ndarray, np.ndarray]:
    """K that is brought up to date cell by cell, and the same assembled anew of the same fields:
    that they are one is what ``reuse`` promises."""
    equilibrium = run.equilibrium
    A = dolfinx_versions.create_matrix(equilibrium._tangent.compiled, "aij")
    dolfinx_versions.assemble_matrix(A, equilibrium._tangent.compiled, equilibrium.bcs)
    A.assemble()
    return equations(run).matrix, dense.dense(A)


def inserted_matrix(run) -> tuple[np.ndarray, np.ndarray]:
    """K of a run as it is, once as our own loop writes it and once as DOLFINx assembles the same
    form: that they are one is no answer of a run.  Refuses a run without the loop."""
    equilibrium = run.equilibrium
    assert equilibrium._tangent._unit is not None
    found = []
    for compiled in (None, equilibrium._tangent.compiled):
        A = equilibrium.matrix.copy()
        A.zeroEntries()
        if equilibrium._base is not None:
            equilibrium._base.put(A, equilibrium.bcs)
        if compiled is None:
            equilibrium._tangent.add(A, equilibrium.bcs, equilibrium.fixed)
        else:
            dolfinx_versions.assemble_matrix(A, compiled, equilibrium.bcs)
        A.assemble()
        found.append(dense.dense(A.convert("aij")))
    return tuple(found)


def inserted_apart(run) -> tuple[float, float]:
    """Norm of the difference between the matrix that our loop writes and DOLFINx's, and of the
    latter, of all ranks: no motion tells so exactly where a rank has put what."""
    equilibrium = run.equilibrium
    assert equilibrium._tangent.inserts
    ours = equilibrium.matrix
    theirs = ours.duplicate()
    for A in (ours, theirs):
        A.zeroEntries()
    equilibrium._tangent.add(ours, equilibrium.bcs, equilibrium.fixed)
    dolfinx_versions.assemble_matrix(theirs, equilibrium._tangent.compiled, equilibrium.bcs)
    for A in (ours, theirs):
        A.assemble()
    size = theirs.norm()
    theirs.axpy(-1.0, ours)
    return theirs.norm(), size


def inserted_fields(run) -> list:
    """The fields whose values our own loop reads."""
    return run.equilibrium._tangent._unit.fields


def matrix_of_ranks(run):
    """K as PETSc holds it on all ranks, zero on the diagonal of idle rows, where any number will
    do: dense ones are of one rank."""
    run.equilibrium.assemble_tangent()
    A = run.equilibrium.matrix
    diagonal = A.getDiagonal()
    diagonal.array[run.equilibrium.idle] = 0.0
    A.setDiagonal(diagonal)
    return A


def in_blocks(run) -> bool:
    """Whether K is stored in blocks: without ties it must stay so, which only shows in time."""
    return run.equilibrium.matrix.getType().endswith("baij")


def solved_imbalance(run) -> tuple[float, float]:
    """Norm of the residual of a prepared step when it is solved, and the size of the forces at
    work, N: a step that is carried on tells neither."""
    internal = None
    if run.bodies:
        run.solve()
        internal = run._internal.ravel()
    else:
        run.equilibrium.solve()
        run.iterate(None)
    run.yielding.evaluate()
    return run.equilibrium.refresh(internal), run.equilibrium.scale(internal)


def scale(run) -> float:
    """Size of the forces at work in a finite element run as it stands, N: Newton's measure, which
    is known by hand for a uniform stress."""
    run.motion.clear()
    run.yielding.clear()
    return run.equilibrium.scale(None)


def residuals(run) -> list[float]:
    """A list that every norm of the residual will be added to: the order of Newton's convergence
    shows in them alone."""
    found, refresh = [], run.equilibrium.refresh

    def noted(internal):
        found.append(refresh(internal))
        return found[-1]

    run.equilibrium.refresh = noted
    return found


def largest_residual(run, node: int, force) -> str:
    """What is said of a residual that is ``force`` (dim,), N, at one node alone: no load brings
    that about."""
    residual = run.equilibrium.force
    residual.x.array[:] = 0.0
    residual.x.array.reshape(-1, run.grid.dim)[node] = force
    return run.equilibrium.largest()


def under_way(equilibrium) -> tuple[float, bool]:
    """Length of the step, s, that Newton is asked to solve, and whether it yields: a Newton of a
    test's own is given the equilibrium and nothing else."""
    return equilibrium.motion.stepping.dt, equilibrium.yielding.evaluate()


# -- its terms -------------------------------------------------------------------------------------


def force_of(run, contribution: int) -> np.ndarray:
    """Nodal forces (nodes, dim), N, of the virtual work of one contribution at the motion as it is:
    a run knows their sum only."""
    work = run.contributions[contribution].work
    return dense.vector(run.grid.space, work).reshape(-1, run.grid.dim)


def loads(run) -> np.ndarray:
    """Nodal forces (nodes, dim), N, of what terms take to be loads: M a = P is checked by hand."""
    forms = sum(c.force for c in run.contributions if c.force)
    return dense.vector(run.grid.space, forms).reshape(-1, run.grid.dim)


def foreseen_force(run) -> np.ndarray:
    """The increment of internal force (nodes, dim), N, that the step was solved with: what the
    stress of the points lacks of it is the correction, by hand."""
    work = run.contributions[0].work + (run.yielding.work if run.yielding else 0)
    found = dense.vector(run.grid.space, work)
    if run.yielding:
        run.yielding.add_force(found)
    return found.reshape(-1, run.grid.dim)


def times_mass(run, nodal: np.ndarray) -> np.ndarray:
    """M of nodal values (nodes, dim), with the consistent matrix: momentum and inertia on the grid,
    which a run does not add up."""
    f = fem.Function(run.grid.space)
    f.x.array[:] = nodal.ravel()
    w = ufl.TestFunction(run.grid.space)
    work = weak_forms.inertia(run.scene.density, f, w) * run.scene.dx
    return dense.vector(run.grid.space, work).reshape(nodal.shape)


def mass_and_stiffness(run) -> tuple[np.ndarray, np.ndarray]:
    """M and K (dofs, dofs) of the body alone, of the fields that points have projected: eq. (12)
    takes them one by one, a step adds them up."""
    u, w = ufl.TrialFunction(run.grid.space), ufl.TestFunction(run.grid.space)
    density, λ, μ = run.properties.fields
    stress = weak_forms.hooke(λ, μ, weak_forms.strain(u))
    forms = ufl.inner(density * u, w), weak_forms.internal_work(stress, w)
    return tuple(dense.matrix(form * run.scene.dx) for form in forms)


def displaced(scene, nodal: np.ndarray | None = None) -> np.ndarray:
    """The increment (nodes, dim), m, of a scene without a run, set to ``nodal`` or to that of a
    step's start: nothing solves for it."""
    if nodal is None:
        scene.motion.clear()
    else:
        scene.motion.u.x.array[:] = np.asarray(nodal).ravel()
    return scene.motion.nodal(scene.motion.u)


def term_system(scene, work, rng=None) -> tuple[np.ndarray, ufl.Form]:
    """Residual (dofs,) of one term's work and the form of its derivative, for a random motion if
    ``rng`` is given: a run has no motion that a test may choose."""
    motion = scene.motion
    if rng is not None:
        for f in (motion.u, motion.v, motion.a):
            f.x.array[:] = rng.normal(size=len(f.x.array))
    derivative = ufl.derivative(work, motion.u, ufl.TrialFunction(scene.grid.space))
    return dense.vector(scene.grid.space, work), derivative


# -- between points and grid -----------------------------------------------------------------------


def shape_functions(run, body: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """S_ip (points, nodes) and ∇S_ip (points, nodes, dim), 1/m, of where points were located last:
    sums over points by hand are made of them."""
    stencil, points = run.stencils[body], len(run.bodies[body])
    S = np.zeros((points, run.grid.nodes))
    slope = np.zeros((points, run.grid.nodes, run.grid.dim))
    rows = np.arange(points)[:, None]
    np.add.at(S, (rows, stencil.nodes), stencil.values)
    np.add.at(slope, (rows, stencil.nodes), stencil.gradients)
    return S, slope


def recovered_gradient(run, x: np.ndarray) -> np.ndarray:
    """Displacement gradients (points, dim, dim) of the last step at points that were at ``x``: they
    have moved since."""
    u = run.nodal("increment")
    if run.composites:
        return run.composites[0].gradient_at_points(x, run.cells[0], u)
    return run.stencils[0].gradient_at_points(u)


def projected(run) -> np.ndarray:
    """Density as cells hold it (cells, dofs, fields): on ranks it is the first thing to differ."""
    projection = run.properties.projections[0]
    return np.stack([f.x.array[projection.dofs] for f in projection.fields], -1)


def ghosts_agree(run) -> bool:
    """Whether ranks know the motion of others' nodes as their owners do: one rank's answers may be
    right when they do not."""
    fields = run.motion.u, run.motion.v, run.motion.a
    before = [f.x.array.copy() for f in fields]
    for f in fields:
        dolfinx_versions.share(f)
    return all(np.array_equal(f.x.array, b) for f, b in zip(fields, before, strict=True))


# -- yielding --------------------------------------------------------------------------------------


@dataclass
class GaussResponse:
    """What the law adds to elasticity at Gauss points: ``yields`` anywhere; ``stress`` (points,
    components in the plane), Pa, and ``tangent``, Pa, rows of ``tensors.entries``."""

    yields: bool
    stress: np.ndarray | None = None
    tangent: np.ndarray | None = None


def response(run, anew: bool = True) -> GaussResponse:
    """The law's response at the increment as it is now, or as it was asked last: the law is tested
    where the equations take it up, before a step is made of it."""
    law = run.yielding
    if anew:
        law.evaluate()
    rows = [getattr(law, name).rows.copy() for name in ("stress", "tangent") if hasattr(law, name)]
    return GaussResponse(law.active, *rows)


def gauss_weights(run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of a point of the first body and a Gauss point, and their weights: the double mapping
    of the law is these numbers."""
    return run.yielding._pairs[0]


# -- ties ------------------------------------------------------------------------------------------


def tied(run) -> np.ndarray | None:
    """Which nodes (nodes,) are tied, None where the run has no cause to look: no answer of the run
    depends on it but by their cure."""
    if run.holding is None:
        assert run.equilibrium.ties is None
        return None
    found = run.holding.ties.tied.reshape(-1, run.grid.dim).any(axis=1)
    assert run.holding.ties.P is not None or not found.any()
    return found


def tied_components(run) -> np.ndarray:
    """Which dofs (dofs,) follow others: PᵀKP is checked by hand, row by row."""
    return run.holding.ties.tied.copy()


def through_ties(run, motion: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A motion (nodes, dim) with that of tied nodes put right, and forces with those on tied nodes
    passed on: what both keep is exact, and solved-for motions are too few to tell."""
    f, found = fem.Function(run.grid.space), []
    for way, values in ((run.holding.ties.follow, motion), (run.holding.ties.pass_on, force)):
        f.x.array[:] = values.ravel()
        way(f)
        found.append(f.x.array.reshape(values.shape).copy())
    return tuple(found)


# -- contact ---------------------------------------------------------------------------------------


def gaps(contact):
    """The gaps of the step with the forces over them: lever arms and the transpose are theirs, and
    a run gives resultants only."""
    return contact.gaps


def touching(contact):
    """The first pair of surfaces: which points face which faces is settled there."""
    return contact.gaps.pairs[0][2]


# -- what a scene pays for -------------------------------------------------------------------------


@dataclass
class Bill:
    """What is there to be paid for in each step.

    ``surfaces`` and ``supports``: how many the terms have left; ``refreshed``: how many
    coefficients each term renews; ``tangents``: in how many parts K is compiled; ``density``: the
    kind of field; ``facets_between_cells``: whether forms go over them; ``nodes_of_a_point``: how
    many it may reach; ``fields_kept_apart``: whether K has other fields than those projected.
    """

    surfaces: int
    supports: int
    refreshed: list[int]
    tangents: int
    density: str
    facets_between_cells: bool
    nodes_of_a_point: int = 0
    fields_kept_apart: bool = False


def bill(run) -> Bill:
    """What a scene pays for: that something is absent shows in no answer, but in time."""
    scene = run.scene
    found = Bill(
        len(scene.patches),
        len(scene.fixed),
        [len(contribution.before) for contribution in scene.contributions],
        len(run.equilibrium._tangent.compiled),
        type(scene.density).__name__,
        run.motion.region.dS is not None,
    )
    if run.bodies:
        found.nodes_of_a_point = run.stencils[0].nodes.shape[1]
        projected = [f for p in run.properties.projections for f in p.fields]
        pairs = zip(run.properties.fields, projected, strict=True)
        found.fields_kept_apart = not all(f is g for f, g in pairs)
    return found


def assembled(run) -> tuple[int, int] | None:
    """In how many cells K was brought up to date in the last step, and how many have material; None
    without ``reuse``: the saving shows in time only."""
    update = run.equilibrium.update
    return None if update is None else (len(update.cells), len(run.motion.region.cells))


def gone_over(run) -> list[int]:
    """How many cells forms go over in a step, how many bear surface points' loads, how many facets
    between cells there are, the unknowns that are solved for unless they are stored in blocks, and
    in how many cells K is brought up to date, on all ranks: what follows the material shows in no
    answer, but in time."""
    region, equilibrium, comm = run.motion.region, run.equilibrium, run.grid.comm
    counts = [len(cells) for _, cells in region._domains]
    counts += [len(facets) for _, facets in region._seams] if region.dS is not None else []
    counts += [len(equilibrium.update.cells)] if equilibrium.update is not None else []
    blocks = equilibrium.matrix.getType().endswith("baij")
    return [comm.allreduce(n) for n in counts] + [
        0 if blocks else equilibrium.part.matrix.getSize()[0]
    ]


def allocated(run) -> tuple:
    """Which objects and memory a step works in: a step that allocates is right, and slow."""
    equilibrium, motion = run.equilibrium, run.motion
    fields = [*run.properties.fields, motion.u, equilibrium.force, equilibrium.matrix]
    fields += [equilibrium.ksp, *((motion.v, motion.a) if run.stepping.dynamic else ())]
    arrays = [a for s in run.stencils for a in (s.first, s.line, s.slope, s.side, s.span, s.share)]
    info = equilibrium.matrix.getInfo()
    return (
        [id(o) for o in fields],
        [a.ctypes.data for a in arrays],
        info["mallocs"],
        info["nz_allocated"],
    )


def linear_solver(run):
    """PETSc's solver: options reach it, and which kind it is, is no one's business but theirs who
    give options."""
    return run.equilibrium.ksp


class Counting:
    """A solver that counts."""

    def __init__(self, ksp):
        self.ksp, self.solves = ksp, 0

    def solve(self, b, x):
        """Solve, and count."""
        self.solves += 1
        self.ksp.solve(b, x)

    def __getattr__(self, name):
        return getattr(self.ksp, name)


def counting(run) -> Counting:
    """The run's solver, which counts from here on: ``run.solves`` leaves out those that correct."""
    run.equilibrium.ksp = Counting(run.equilibrium.ksp)
    return run.equilibrium.ksp


def plain(run):
    """Cells without points, and what moves there: a run tells of the points alone."""
    return run.scene.plain


def at_nodes(run, field):
    """Values (nodes, dim) of a field of plain cells, which a run keeps to itself."""
    return run.motion.nodal(field)


def let_drift(run):
    """A run that does not look how far material has come from its plain cells, to see what else
    stops it."""
    run.scene.drifting.check = lambda: None


def mean_divergence(run, u) -> np.ndarray:
    """θ (cells,) of nodal u where points are now: a run has it only inside of a step."""
    prepared(run)
    return run.means.divergence(u)


def internal_force(run) -> np.ndarray:
    """Of the points' stress (dofs,), N, before anything is solved."""
    prepared(run)
    return run._internal_force().copy()
