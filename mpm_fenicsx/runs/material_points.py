"""The material point run: locate, project, solve, carry, record."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..common.errors import RunError
from ..common.ranks import anywhere, together, warn
from ..common.spread import Part, Spread
from ..dynamics.motion import Motion
from ..dynamics.time_stepping import Newmark, QuasiStatic
from ..grid.gauss_points import GaussPoints
from ..grid.grid import Grid
from ..mapping.composite_patches import Composite
from ..mapping.internal_force import ConstantStress, InternalForce, LinearStress
from ..mapping.mapped_stress import MappedStress, PointStressField
from ..mapping.material_means import MaterialMeans
from ..mapping.methods import DM_GC, AccelerationCorrection
from ..mapping.methods import Mapping as PointMapping
from ..mapping.pressure_by_cells import PressureByCells
from ..mapping.projection import DOUBLE_MAPPED
from ..mapping.properties import Properties
from ..mapping.shape_functions import Stencil
from ..mapping.tied_sides import TiedSides
from ..mapping.ties import Holding, Ties
from ..mapping.velocities import TRANSITS, Deposit, KnownVelocity, trapezoidal
from ..points.inside import among
from ..points.interfaces import warn_of_interfaces
from ..points.location import enter, numbers_of
from ..points.material_points import MaterialPoints
from ..points.migration import Migration, resized
from ..response.elastic_means import ElasticMeans
from ..response.finite_strain import finite_strain_of
from ..response.nonlocal_strain import averages_of_points
from ..response.response import Response
from ..response.small_strain import YieldingPoints
from ..response.small_strain_at_points import YieldingAtPoints
from ..solver.acceleration_correction import correction_of
from ..solver.equilibrium import Equilibrium
from ..solver.solver import Solver
from ..terms.body import distortion, elasticity, inertia
from ..terms.doubtful_boundaries import warn_of_doubtful
from ..terms.doubtful_ground import warn_of_gaps, warn_of_other_ground
from ..terms.meeting_supports import refuse_disagreement
from ..terms.reach import check_reach, filled, refuse_overlaps
from ..terms.scene import Scene
from ..terms.tied import tied_sides
from . import samples
from .doubtful_soil import warn_of_locking, warn_of_stress
from .identity import described
from .options import (
    InitialAcceleration,
    check_start,
    choices,
    chosen_b_bar,
    chosen_correction,
    courant_number,
    nodes_of,
    of_today,
    unusual,
    warn_of_courant,
)
from .redistribution import weights
from .release import release
from .removal import OnExit, Removed, removal_of
from .repartitioning import Repartition, Repartitioner, divide
from .run import Run
from .scene_checks import bodies_of


class Simulation(Run):
    """Implicit material point run on a background grid.

    ``bodies``: one body of material points, or several; ``stepping``: Newmark or QuasiStatic;
    ``terms``: boundaries and loads.
    ``mapping``: the method, with all that is about the way between points and grid (default DM-GC);
    ``solver``: how the equations of a step are solved.
    ``initial_acceleration``: that of the balance of forces, unless points are given one (what
    another run has left is not given), or zero as in the paper.
    ``repartition``: when the grid is cut anew among several ranks; never, if None.
    ``on_exit``: what becomes of points that leave the grid; they stop the run, or with ``REMOVE``
    are taken out, which ``removed`` gives account of.
    ``print(run)`` says what was chosen.
    ``old``: arguments of releases before, with a ``DeprecationWarning``.

    Raises ``ValueError`` for a scene that cannot run, naming what is wrong.
    """

    def __init__(
        self,
        grid: Grid,
        bodies: MaterialPoints | Sequence[MaterialPoints] | None = None,
        stepping: Newmark | QuasiStatic | None = None,
        terms: Sequence = (),
        mapping: PointMapping = DM_GC,
        solver: Solver | None = None,
        initial_acceleration: InitialAcceleration = InitialAcceleration.BALANCED,
        repartition: Repartition | None = None,
        on_exit: OnExit = OnExit.STOP,
        **old,
    ):
        if bodies is None and "points" in old:
            warnings.warn(
                "points of Simulation is now bodies=...", DeprecationWarning, stacklevel=2
            )
            bodies = old.pop("points")
        self.bodies = bodies_of(bodies)
        mapping, solver = of_today("Simulation", mapping, solver, old)
        check_start(initial_acceleration)
        super().__init__(mapping.name, grid, stepping, terms)
        self.mapping, self.solver = mapping, solver
        if mapping.correction not in (None, AccelerationCorrection.OFF) and not stepping.dynamic:
            raise ValueError(
                f"correction is of accelerations, and {stepping} has none, got {mapping.correction}"
            )
        self.b_bar = chosen_b_bar(
            mapping.b_bar,
            [body.material for body in self.bodies],
            mapping.integrate is DOUBLE_MAPPED,
        )
        self.initial_acceleration, self._unmoved, self._left = initial_acceleration, [], []
        self.released = 0  # cells of far fields
        if stepping.dynamic:
            self._unmoved = [body for body in self.bodies if body.acceleration is None]
            self._left = [body for body in self.bodies if body.left_by_run]
        # as bodies are at the start: what hangs on these must not change when the grid is divided
        self._bound_for_rest: bool | None = None
        self._nodes: int | None = None
        self.repartitioner = None if repartition is None else Repartitioner(repartition)
        self.removal = removal_of(on_exit)
        self._bind()
        scene = self.scene
        if self.repartitioner is not None:
            self.repartitioner.check(scene)
        refuse_disagreement(scene)
        refuse_overlaps(grid, self.bodies, self.cells)
        check_reach(scene, self.bodies, self.cells, self.stencils)
        warn_of_doubtful(scene, self.terms, self.bodies)
        if mapping.b_bar is None and not self.b_bar:
            laws = [body.material for body in self.bodies]
            warn_of_locking(grid.comm, laws, self.name, mapping.integrate is DOUBLE_MAPPED)
        if scene.plain:
            warn_of_gaps(scene, filled(grid, self.bodies, self.cells))
            warn_of_other_ground(scene, self._ground())
        self._make()
        for average in self.averages:
            average.warn_of_size()

    def build(self) -> None:
        """Make anew all that lies on the grid as it is divided among the ranks."""
        self._bind()
        self._make()

    def _bind(self) -> None:
        """Where points are, and what the terms ask of the grid."""
        grid, stepping, mapping, solver = self.grid, self.stepping, self.mapping, self.solver
        motion = self.motion = Motion(grid, stepping)
        self.migration = Migration(grid) if grid.comm.size > 1 else None
        self.cells = [enter(body, grid, self.migration) for body in self.bodies]
        if self.removal is not None:  # rows change: points need numbers on one rank, too
            for body, cell in zip(self.bodies, self.cells, strict=True):
                if body.number is None:
                    body.number = numbers_of(grid, body.x, cell)
        sides = tied_sides(grid, self.terms)
        self._lattice = grid.lattice
        if sides is not None:
            self._check_sides(sides)
            self._lattice = motion.region.lattice = sides.lattice
            for body in self.bodies:
                if body.jumped is None:
                    body.jumped = np.zeros_like(body.x)
        self.stencils = [
            Stencil(grid, len(body), mapping.support, self._lattice) for body in self.bodies
        ]
        self.composites = self._composite_patches() if mapping.composite else []
        self.means = MaterialMeans(grid) if self.b_bar else None
        self.stress = self._internal_force_of(mapping)
        self._stress_field: PointStressField | None = None
        reuse = solver.reuse if motion.region.follows else 0.0
        given = self.properties = Properties(motion, mapping, self.bodies, self.stencils, reuse)
        density, λ, μ = given.fields
        scene = self.scene = Scene(
            grid,
            motion,
            density,
            given.mass_dx,
            lame=(λ, μ),
            stiffness_dx=given.stiffness_dx,
            of_material=given.of,
            b_bar=self.b_bar,
            partly_filled=True,
            body_force=given.body_force,
            occupied=self._occupied(),
            sides=sides,
        )
        scene.take_cells(self.terms)
        self._plain = scene.plain_cells()
        self._goes_on = {
            one: scene.goes_on(body.material.lame)
            for one, body in zip(self.composites, self.bodies, strict=False)
        }
        # the means of the material in each cell bear the rest
        body = elasticity(scene) if self.means is None else distortion(scene)
        others = [inertia(scene)] if stepping.dynamic else []
        others += scene.bind(self.terms)
        self.contributions = [body, *others]
        self._reuse = reuse

    def _check_sides(self, sides: TiedSides) -> None:
        """Raise ``ValueError`` for sides that points, or this mapping, cannot go on over."""
        if not sides.whole:
            raise ValueError(
                "components of Tied: material points leave on one side and come in on the other, "
                "which takes all components; leave them out"
            )
        if self.mapping.linear:
            raise ValueError(
                f"Tied: stress that is linear over support domains, as {self.mapping.name} has it, "
                "does not go on over tied sides; take DM_GC"
            )

    def _of(self, number: int) -> str:
        """Which body, in a message, where there are several."""
        return f"body {number}, " if len(self.bodies) > 1 else ""

    def _mass_beside(self) -> np.ndarray | float:
        """Lumped mass (nodes,), kg, of finite elements beside the points."""
        return sum((part.lumped for part in self.scene.plain if part.heavy), 0.0)

    def _ground(self) -> np.ndarray:
        """ρ (kg/m³), λ and μ (Pa) of the material in each cell (3, cells), zero where there are no
        points."""
        found = np.zeros((3, self.grid.cells))
        for body, cell in zip(self.bodies, self.cells, strict=True):
            law = body.material
            found[:, cell] = np.array([[law.density], [law.lame[0]], [law.lame[1]]])
        return np.array([self.grid.share_cells(row) for row in found])

    def _occupied(self) -> np.ndarray:
        """Which cells (cells,), bool, hold material points."""
        held = np.zeros(self.grid.cells, dtype=bool)
        for cell in self.cells:
            held[cell] = True
        return self.grid.share_cells(held)

    def _make(self) -> None:
        """What a step works with."""
        grid, stepping, mapping, solver = self.grid, self.stepping, self.mapping, self.solver
        motion, scene, reuse = self.motion, self.scene, self._reuse
        body, *others = self.contributions
        self.yielding = self._can_yield()
        self.averages = averages_of_points(motion, self.bodies, self.stencils, self.cells)
        self.courant_number = courant_number(grid, self.bodies, stepping)
        if self._nodes is None:
            self._nodes = nodes_of(grid, self.cells)
        self.equilibrium = Equilibrium(
            motion,
            body,
            others,
            scene.fixed,
            solver,
            self.yielding,
            reuse > 0.0,
            crossings=self.courant_number / stepping.dt,
            nodes=self._nodes,
            sides=scene.sides,
        )
        if reuse and (self.yielding is not None or self.equilibrium.update is None):
            raise ValueError(
                f"reuse = {reuse} is for elastic bodies of small strain, without GhostPenalty and "
                "b_bar"
            )
        # a term on the facets between cells, GhostPenalty, does in its own way what ties do
        self._holds = mapping.hold_cut_cells and motion.region.dS is None
        if self._bound_for_rest is None:
            self._bound_for_rest = not stepping.dynamic or (scene.body_loaded and self._stressed())
        self._acts_everywhere = self._bound_for_rest or scene.body_loaded or scene.cuts_cells
        self.holding: Holding | None = None
        self._internal = np.zeros((grid.nodes, grid.dim))
        self._held = np.zeros(grid.cells, np.int8)  # cells that hold material
        self.correction_kind = mapping.correction or chosen_correction(
            mapping, stepping, self.courant_number
        )
        self.correction = None
        known = stepping.dynamic and (motion.at_rest or motion.moved)
        self.supports = (
            KnownVelocity(motion, self.courant_number / stepping.dt / TRANSITS, self._lattice)
            if known
            else None
        )
        if stepping.dynamic:
            fair = [part for part in scene.plain if part.fair]
            self.deposit = Deposit(motion, scene.mass, mapping.sweeps, fair, scene.sides)
            for body in self.bodies:
                body.enter_dynamics()
            self.correction = correction_of(
                self.correction_kind,
                self.equilibrium,
                self.deposit,
                self._mass_beside(),
            )

    def change_step(self, stepping: Newmark | QuasiStatic) -> None:
        """Go on with another step from the time reached; what is chosen by the Courant number is
        chosen anew."""
        super().change_step(stepping)
        self.courant_number = courant_number(self.grid, self.bodies, stepping)
        if stepping.dynamic and self.mapping.correction is None:
            self.correction_kind = chosen_correction(self.mapping, stepping, self.courant_number)
            self.correction = correction_of(
                self.correction_kind,
                self.equilibrium,
                self.deposit,
                self._mass_beside(),
            )

    def _internal_force_of(self, mapping: PointMapping) -> InternalForce:
        if mapping.stress is DOUBLE_MAPPED:
            found = MappedStress(self.motion)
        else:
            found = LinearStress(self.grid) if mapping.linear else ConstantStress(self.grid)
        return found if self.means is None else PressureByCells(found, self.means)

    def _composite_patches(self) -> list[Composite]:
        """One for each body; bodies of one material share theirs."""
        patches: list[Composite] = []
        for n, body in enumerate(self.bodies):
            like = next((m for m in range(n) if self.bodies[m].material == body.material), None)
            patches.append(Composite(self.grid, self._lattice) if like is None else patches[like])
        return patches

    def __str__(self) -> str:
        """What the run is made of, what was chosen for it, and what it therefore pays for."""
        points = " + ".join(str(len(body)) for body in self.bodies)
        options = unusual(self.mapping)
        name = f"{self.name} with {options}" if options else self.name
        lines = [
            f"{name} on {self.grid.cells} cells in {self.grid.dim}D, {points} material points",
            f"step: {self.stepping}",
        ]
        if self.stepping.dynamic:
            lines += [
                f"Courant number of P waves: {self.courant_number:.3g}",
                f"acceleration corrected: {self.correction_kind.value}"
                + (" (chosen by the Courant number)" if self.mapping.correction is None else "")
                + f"; sweeps: {self.deposit.sweeps}",
                f"initial acceleration: {self.initial_acceleration.value}",
            ]
        if self.b_bar:
            chosen = " (chosen for the materials)" if self.mapping.b_bar is None else ""
            lines.append(f"volume changes by the means of cells: B-bar{chosen}")
        lines += map(str, self.averages)
        lines.append(f"solver: {self.equilibrium}")
        for term, contribution in zip(self.terms, self.scene.contributions, strict=False):
            note = f": {contribution.note}" if contribution.note else ""
            lines.append(f"term: {type(term).__name__}{note}")
        if self.removal is not None:
            lines.append(
                "points that leave the grid are taken out: {} so far, {:.6g} kg, {:.6g} J".format(
                    *self.removed
                )
            )
        return "\n".join(lines)

    # -- the step ----------------------------------------------------------------------------------

    def begin(self) -> None:
        """Before the first step: doubts are said, and points that bring no acceleration take that
        of the balance."""
        warn_of_interfaces(self.grid, self.bodies, self.cells)
        warn_of_courant(self.grid.comm, self.courant_number, self.stepping)
        self._warn_of_no_start()
        warn_of_stress(self.grid.comm, self.bodies)
        comm = self.grid.comm
        given = [comm.allreduce(int(body.acceleration.any())) for body in self._unmoved]
        unmoved = [*self._left, *(b for b, n in zip(self._unmoved, given, strict=True) if not n)]
        if (
            not self.stepping.dynamic
            or not (comm.allreduce(len(unmoved)) or self.scene.plain)
            or self.initial_acceleration is InitialAcceleration.ZERO
        ):
            return
        self.prepare(self.time, self.time)
        self.predict()
        force = self.equilibrium.initial_force(self._internal_force())
        ties = self.holding.ties if self.holding is not None and self.holding.ties.light else None
        nodal = self.deposit.acceleration(force, ties, self._mass_beside())
        for part in self.scene.plain:
            part.start_with(nodal)
        for body, stencil in zip(self.bodies, self.stencils, strict=True):
            if any(body is one for one in unmoved):
                body.acceleration[:] = stencil.at_points(nodal)

    def _warn_of_no_start(self) -> None:
        """Warn where points bear their weight, and a far field beside them does not yet."""
        if not (self.stepping.dynamic and self.scene.body_loaded and self.scene.plain):
            return
        comm, far = self.grid.comm, [part for part in self.scene.plain if part.heavy]
        moved = comm.allreduce(int(any(part.U.x.array.any() for part in far)))
        if far and not moved and self._stressed():
            warn(
                comm,
                "points bear stress under a body force, and the FarField beside them none, so that "
                "it falls: give it the static run that they come from, FarField(..., start=run)",
                4,
            )

    def attempt(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> None:
        """Solve for the grid's motion from ``start`` to ``end`` (s); points stay where they are."""
        self.motion.use(stepping)
        self.prepare(start, end)
        self.predict()
        self.solve()

    def prepare(self, start: float, end: float) -> None:
        """Where points are, what they give to the grid's fields and terms, and which cells that
        concerns."""
        if self.scene.drifting is not None:
            self.scene.drifting.prepare()
        self.locate()
        self.project()
        self.scene.prepare(start, end)
        self.hold()
        self.scene.mark(self._held)
        self.motion.region.cover(self._held)

    def locate(self) -> None:
        """Cell, weights and gradients of every point."""
        for n, body in enumerate(self.bodies):
            if len(self.cells[n]) != len(body):  # another run has moved its points to other ranks
                self.cells[n] = self.grid.find(body.x)
                self._make_room(n)
            self.grid.walk(body.x, self.cells[n])
        if self.migration is None:
            self._take_out(self.cells)
            self._refuse_lost(self.cells)
        else:
            self._migrate()
        for body, cell, stencil in zip(self.bodies, self.cells, self.stencils, strict=True):
            stencil.place(body.x, body.half, cell)
        for composite in dict.fromkeys(self.composites):
            of_material = [
                c for c, one in zip(self.cells, self.composites, strict=True) if one is composite
            ]
            self._hold(of_material)
            if self._plain is not None:
                self._held[self._goes_on[composite]] = 1
            composite.place(self.grid.share_cells(self._held))
        if len(self.composites) != 1 or self._plain is not None:
            self._hold(self.cells)
        if self._plain is not None:
            self._refuse_in_plain()

    def _hold(self, cells: Sequence[np.ndarray]) -> None:
        """Mark the cells of points (n,) of some bodies, and no others."""
        self._held[:] = 0
        for cell in cells:
            self._held[cell] = 1

    def _bring_in(self) -> None:
        """Points that have left through a tied side come in on the other."""
        sides = self.scene.sides
        for body, cell in zip(self.bodies, self.cells, strict=True):
            jump = sides.bring_in(body.x, cell)
            if jump is not None:
                body.jumped += jump
            if body.seat is not None:
                body.seat[:] = sides.inside(body.seat)

    def _refuse_in_plain(self) -> None:
        """Raise ``RunError``, on all ranks, where a point has come into a plain cell."""
        message = None
        for number, (body, cell) in enumerate(zip(self.bodies, self.cells, strict=True)):
            inside = np.flatnonzero(self._plain[cell])
            if len(inside):
                row = inside[0] if body.number is None else body.number[inside[0]]
                owner = next(p.owner for p in self.scene.plain if p.marks[cell[inside[0]]])
                message = (
                    f"{self._of(number)}material point {row} at x={body.x[inside[0]]} has come "
                    f"into a cell of the {owner}: give it fewer cells, or let the grid follow"
                )
        self._stop_together(message)

    def _migrate(self) -> None:
        """Points go to the ranks that own their cells."""
        clouds = [(body.x, cell) for body, cell in zip(self.bodies, self.cells, strict=True)]
        going = self.migration.destinations(clouds)
        if going.lost:
            going.cells[:] = self._take_out(going.cells)
            self._refuse_lost(going.cells)
        for n, (body, moving) in enumerate(zip(self.bodies, going.moving, strict=True)):
            if moving:
                arrays, rows, cells = self.migration.send(
                    {"cell": self.cells[n], **body.state()}, going.cells[n], going.far
                )
                self.cells[n] = arrays.pop("cell")
                self.cells[n][rows] = cells
                body.take(arrays)
                self._make_room(n)
        self.arrangement += any(going.moving)

    def _make_room(self, number: int) -> None:
        """The stencil of a body is as long as that."""
        if len(self.stencils[number]) != len(self.bodies[number]):
            self.stencils[number].resize(len(self.bodies[number]))

    def _take_out(self, cells: list[np.ndarray]) -> list[np.ndarray]:
        """Leave out points with a cell (n,) below zero, if this run does so; the cells of all
        others.  Collective."""
        if self.removal is None:
            return cells
        known = self.cells
        stays = [np.flatnonzero(cell >= 0) for cell in cells]
        found = self.removal.take_out(self, cells)
        self.cells = [cell[rows] for cell, rows in zip(known, stays, strict=True)]
        for n in range(len(self.bodies)):
            self._make_room(n)
        self.arrangement += any(len(a) != len(b) for a, b in zip(known, self.cells, strict=True))
        return found

    def _refuse_lost(self, cells: Sequence[np.ndarray]) -> None:
        """Raise ``RunError``, on all ranks, where a point of a body has a cell (n,) below zero."""
        message = None
        for number, (body, cell) in enumerate(zip(self.bodies, cells, strict=True)):
            lost = np.flatnonzero(cell < 0)
            if len(lost):
                row = lost[0] if body.number is None else body.number[lost[0]]
                message = (
                    f"{self._of(number)}material point {row} at x={body.x[lost[0]]} lies outside "
                    "the grid: give it more cells there, or on_exit=REMOVE, with which such points "
                    "are taken out"
                )
                if self.migration is None:
                    cell[lost] = 0  # whence to walk, should they be put back
        self._stop_together(message)

    def project(self) -> None:
        """Density and Lamé's constants of the points onto the grid's discontinuous fields."""
        self.properties.project()
        if self.means is not None:
            self.means.place(self.bodies, self.stencils)
        if self.yielding is not None:
            self.yielding.place()

    def hold(self) -> None:
        """Tie the light nodes of cut cells where something acts, to those beside them."""
        if not self._holds or not (self._acts_everywhere or self.scene.patches):
            return
        if self.holding is None:
            if self.equilibrium.ties is None:
                self.equilibrium.ties = Ties(self.grid, self.equilibrium.fixed)
            self.holding = Holding(
                self.properties.fills(),
                self.equilibrium.ties,
                self._acts_everywhere,
                self._bound_for_rest,
                self._plain,
            )
            self._loaded = np.zeros_like(self._held)
        self._loaded[:] = 0
        self.scene.mark_loaded(self._loaded)
        self.holding.refresh(self._held, self._loaded)

    def predict(self) -> None:
        """Nodal velocity and acceleration before the step, from the points."""
        if self.stepping.dynamic:
            self.deposit.predict(self.bodies, self.stencils)
            if self.holding is not None and self.holding.ties.light:
                self.holding.ties.follow_with_momentum(self.motion.v, self.deposit.mass)
                self.motion.know_start(*map(self.motion.nodal, (self.motion.v, self.motion.a)))

    def solve(self, push: np.ndarray | float = 0.0) -> None:
        """Internal force at the points, tangent of the fields, one linear solve; ``push`` (dofs,),
        N, from outside."""
        internal = self._internal_force() - push
        self.equilibrium.solve(internal)
        self.iterate(internal)

    def carry(self) -> None:
        """Points take position, velocity, stress and the stretch of their support domains from the
        grid."""
        motion = self.motion
        u = motion.nodal(motion.u)
        before, after = (
            ((motion.nodal(motion.v), motion.nodal(motion.a)), motion.end())
            if self.stepping.dynamic
            else (None, None)
        )
        message, found = None, []
        logarithm = None if self.means is None else self.means.log_stretch(u)
        for number, (body, stencil) in enumerate(zip(self.bodies, self.stencils, strict=True)):
            gradient = self._recover(number, u)
            if self.composites:
                stretch = stencil.stretch_at_points(u)
            else:
                stretch = 1.0 + np.einsum("nii->ni", gradient)
            J = None if logarithm is None else np.exp(stencil.mean_of_cells(logarithm))
            try:
                found.append((gradient, body.stretches(gradient, stretch, J)))
            except ValueError as error:
                message = f"{self._of(number)}{error}"
        self._stop_together(message)  # before anything has changed
        if self.scene.drifting is not None:
            self.scene.drifting.check()
        before_step = [body.stress for body in self.bodies]
        with together(self.grid.comm, Exception):
            for body, stencil, (gradient, _) in zip(self.bodies, self.stencils, found, strict=True):
                kinematics, volumetric = body.material.kinematics, None
                if self.means is not None:
                    of_cells = logarithm if kinematics.finite else self.means.divergence(u)
                    volumetric = stencil.mean_of_cells(of_cells)
                kinematics.respond(body, gradient, volumetric)
        if self.correction is not None:
            gradients = [gradient for gradient, _ in found]
            self.correction.correct(
                after, lambda force: self._add_change(force, before_step, gradients)
            )
        for body, stencil, (_, stretches) in zip(self.bodies, self.stencils, found, strict=True):
            if not self.stepping.dynamic:
                body.deform(stencil.at_points(u), *stretches)
                continue
            if self.mapping.transfer is trapezoidal:
                stencil.advance(body, u, after[1], motion.stepping, *stretches)
            else:
                velocities = body.velocity, body.acceleration
                transfer = stencil.at_points, before, after, motion.stepping
                self.mapping.transfer(*velocities, *transfer)
                body.deform(stencil.at_points(u), *stretches)
            body.leave()
            if self.supports is not None:
                self.supports.take_up(body.velocity, body.mass, stencil, after[0])
        if self.scene.sides is not None:
            self._bring_in()
        for average in self.averages:
            average.refresh()
        if self.supports is not None:
            self.supports.add_up()
        self.scene.carry()
        self.collect()

    def filled_cells(self) -> np.ndarray:
        """Which cells (cells,) points, or parts of their support domains, lie in."""
        self.locate()
        self.project()
        fills = self.properties.fills()
        fills.weigh(np.arange(self.grid.cells), self._held)
        return fills.there if self._plain is None else fills.there | self._plain

    def balance(self) -> tuple[np.ndarray, float]:
        """What supports bear with the points and loads as they are, and what is out of balance
        elsewhere."""
        self.prepare(self.time, self.time)
        return self.equilibrium.support(self._internal_force())

    def _add_change(
        self, force: np.ndarray, before: Sequence[np.ndarray], gradients: Sequence[np.ndarray]
    ) -> None:
        """Add to nodal forces (nodes, dim), N, what the step has changed of the internal force;
        stress rows ``before`` (n, components), Pa, ``gradients`` (n, dim, dim) of the points."""
        if self.means is not None:
            u = self.motion.nodal(self.motion.u)
            self.stress.add_change(self.bodies, self.stencils, force, before, gradients, u)
            return
        changes = [
            body.material.kinematics.change(old, body.stress, gradient)
            for body, old, gradient in zip(self.bodies, before, gradients, strict=True)
        ]
        self.stress.add(self.bodies, self.stencils, force, changes)

    def _internal_force(self) -> np.ndarray:
        self._internal[:] = 0.0
        self.stress.add(self.bodies, self.stencils, self._internal)
        return self._internal.ravel()

    def state(self) -> dict[str, np.ndarray]:
        """What the next step depends on, by name; not copied."""
        bodies = [
            {"cell": cell, **body.state()}
            for cell, body in zip(self.cells, self.bodies, strict=True)
        ]
        found = {
            f"bodies/{n}/{name}": value
            for n, body in enumerate(bodies)
            for name, value in body.items()
        }
        given = {f"properties/{name}": value for name, value in self.properties.state().items()}
        more = {} if self.repartitioner is None else {"repartition": self.repartitioner.memory}
        if self.removal is not None:
            more["removed"] = self.removal.memory
        if self.supports is not None:
            more["supports"] = self.supports.taken
        return {**super().state(), **found, **given, **more}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take the values of ``state``; points may have moved to other ranks since, or left."""
        if self.migration is not None or self.removal is not None:
            for n, body in enumerate(self.bodies):
                rows = len(state[f"bodies/{n}/cell"])
                if rows != len(body):
                    body.take(resized(body.state(), rows))
                    self.cells[n] = np.zeros(rows, np.int32)
                    self._make_room(n)
            if self.migration is not None:
                self.scene.make_room(state)
            self.arrangement += 1
        super().restore(state)

    def spread(self) -> dict[str, Spread]:
        """How the arrays of ``state`` lie on the ranks."""
        found = {name: Spread.ROWS for name in self.state() if name.startswith("bodies/")}
        given = {f"properties/{name}": Spread.CELLS for name in self.properties.state()}
        own = (
            ("repartition", self.repartitioner),
            ("removed", self.removal),
            ("supports", self.supports),
        )
        more = {name: Spread.ALIKE for name, one in own if one is not None}
        return {**super().spread(), **found, **given, **more}

    def clouds(self) -> dict[str, int]:
        """Bodies and surfaces by their names in ``state``, and how many of their points in a row
        are one face."""
        return {f"bodies/{n}": 1 for n in range(len(self.bodies))} | super().clouds()

    def step(self) -> None:
        """One step of length ``stepping.dt``, before which the grid may be divided anew.

        Raises as ``Run.step`` does.
        """
        if self.repartitioner is not None:
            self.repartitioner.look(self)
        super().step()

    def divide(self, weight: np.ndarray) -> None:
        """Divide the grid anew among the ranks, by the weight of each of this rank's own cells
        (cells,), and go on as if nothing had happened.  Collective."""
        divide(self, weight)

    def far_field_strain(self) -> float:
        """The largest shear strain (-), the difference of principal strains, in far fields, at the
        centres of their cells; 0 where there is none.  Collective."""
        return max((p.largest_strain() for p in self.scene.plain if p.heavy), default=0.0)

    def release(
        self, where: Callable, per_cell: int | None = None, material=None
    ) -> MaterialPoints:
        """Make material points of cells of a far field, in mid-run: those whose centres x (dim, n),
        m, lie where ``where`` says.  See ``runs.release``.  Collective."""
        return release(self, where, per_cell, material)

    def forget_fields(self) -> None:
        """Fields on the mesh that is about to go are no numbers from now on, so that what has been
        built from them shows it."""
        if self._stress_field is not None:
            self._stress_field.function.x.array[:] = np.nan

    def lie_as(self, parts: Sequence[Part]) -> None:
        """Divide the grid as it was where the parts come from.  Collective."""
        weight = weights(self.grid, parts)
        if weight is not None:
            self.divide(weight)

    def move_points(self, cloud: str, arrays: dict[str, np.ndarray]) -> None:
        """Bodies and surfaces become points of other arrays, before the run is built anew."""
        kind, n = cloud.split("/")
        points = self.bodies[int(n)] if kind == "bodies" else self.scene.patches[int(n)].points
        known = points.state() if kind == "bodies" else points.rows()
        points.take({name: value for name, value in arrays.items() if name in known})

    def take_points(self, cloud: str, arrays: dict[str, np.ndarray]) -> None:
        """Points become those of other arrays, by the names of ``state`` below theirs."""
        if not cloud.startswith("bodies/"):
            return super().take_points(cloud, arrays)
        n = int(cloud.split("/")[1])
        self.cells[n] = arrays.pop("cell")
        self.bodies[n].take(arrays)
        self._make_room(n)

    def arrays_that_move(self) -> set[str]:
        """Names in ``state`` of arrays whose rows may be on another rank at another time."""
        if self.migration is None and self.removal is None:
            return set()
        bodies = {name for name in self.state() if name.startswith("bodies/")}
        return bodies | (set() if self.migration is None else self.scene.arrays_that_move())

    def identity(self) -> dict[str, str]:
        """What a checkpoint's run must have in common with this one.  Collective."""
        counts = [self.grid.comm.allreduce(len(body)) for body in self.bodies]
        words = [f"{count} points" for count in counts]
        if self.removal is not None:
            whole = sum(counts) + self.removal.removed.points
            words = [f"some of {whole} points"] * len(counts)
        bodies = {
            f"body {n}": f"{word} of {described(body.material)}"
            for n, (word, body) in enumerate(zip(words, self.bodies, strict=True))
        }
        way = choices(self.mapping)
        del way["transfer"]
        mapping = ", ".join(f"{name}={value}" for name, value in way.items())
        released = {"released cells": str(self.released)} if self.released else {}
        return {**released, **super().identity(), **bodies, "mapping": mapping}

    # -- what recorders ask for --------------------------------------------------------------------

    def sampler(self, field: str) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Places of the samples (n, dim), and their values: material points, all bodies one after
        the other, and after them the far fields' nodes, for stress their cells' centres."""
        places = np.concatenate([one.places for one in self._samples(field)])
        return places, lambda rows: samples.read(self._samples(field), rows)

    def numbers_of(self, field: str, rows: np.ndarray) -> np.ndarray:
        """Body and number (m, 2) of samples; on one rank the number of a point is its row, unless
        it has come from a run on several."""
        return samples.named(self._samples(field), rows)

    def rows_of(self, field: str, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows (k,) of those samples of ``numbers`` (m, 2) that are on this rank now, and which
        (k,) of them these are, in their order."""
        return samples.found(self._samples(field), numbers)

    def _samples(self, field: str) -> list[samples.Samples]:
        far = [part for part in self.scene.plain if part.heavy]
        return samples.samples_of(field, self.bodies, far)

    def holds(self, at: np.ndarray) -> bool:
        """Whether a place (dim,), m, lies among this rank's material points, or in a far field."""
        far = [part.marks for part in self.scene.plain if part.heavy]
        cell = int(self.grid.find(at[None])[0]) if far else -1
        return among(self.bodies, at) or (cell >= 0 and any(marks[cell] for marks in far))

    def energy(self) -> dict[str, float]:
        """Kinetic and strain energy (J) of this rank's points."""
        found = {
            "plastic": sum(
                b.material.kinematics.plastic_work(b) for b in self.bodies if not b.material.linear
            ),
            "strain": sum(b.material.kinematics.energy(b) for b in self.bodies),
        }
        if self.stepping.dynamic:
            found["kinetic"] = sum(
                0.5 * float(body.mass @ (body.velocity**2).sum(axis=1)) for body in self.bodies
            )
        if self.removal is not None:
            found["removed"] = self.removed.energy if self.grid.comm.rank == 0 else 0.0
        if self.supports is not None:
            found["supports"] = float(self.supports.taken[0]) if self.grid.comm.rank == 0 else 0.0
        return self.scene.add_energy(found)

    @property
    def removed(self) -> Removed:
        """Points that have left the grid and were taken out (``on_exit=REMOVE``): how many, their
        mass (kg) and their energy (J)."""
        return Removed(0, 0.0, 0.0) if self.removal is None else self.removal.removed

    def end_of_step(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodal velocity (m/s) and acceleration (m/s²) (nodes, dim) at the end of the last step,
        of which the points have taken theirs.  Raises ``ValueError`` in statics."""
        if not self.stepping.dynamic:
            raise ValueError(f"end_of_step is of dynamic runs, got {self.stepping}")
        velocity, acceleration = self.motion.end()
        for part in self.scene.plain:
            velocity[part.own] = self.motion.nodal(part.V)[part.own]
            acceleration[part.own] = self.motion.nodal(part.A)[part.own]
        return velocity, acceleration

    def grid_fields(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """What to show on nodes, increment and velocity at the end of the step, and displacement
        where there are cells without points (a far field, a layer), zero elsewhere; and in cells,
        nothing."""
        nodal = {"displacement_increment": self.motion.nodal(self.motion.u)}
        if self.stepping.dynamic:
            nodal["velocity"] = self.end_of_step()[0]
        if self.scene.plain:
            nodal["displacement"] = sum(self.motion.nodal(part.U) for part in self.scene.plain)
        return nodal, {}

    def stress_field(self) -> PointStressField:
        """The points' stress on the grid, double-mapped (eq. 7), as it is now: a dolfinx function.

        Each call brings the same field up to date; what is built from it follows.
        """
        if self._stress_field is None:
            self._stress_field = PointStressField(self.grid)
        self.locate()
        self._stress_field.refresh(self.bodies, self.stencils)
        return self._stress_field

    def _stressed(self) -> bool:
        """Whether points bear stress as they are, on any rank."""
        return bool(self.grid.comm.allreduce(int(any(body.stress.any() for body in self.bodies))))

    def _can_yield(self) -> Response | None:
        """What yielding or finite strain adds to the step, where there is a body of that kind."""
        finite = finite_strain_of(
            self.motion,
            self.bodies,
            self.stencils,
            self.mapping.integrate,
            self._recover,
            self.means,
        )
        if finite is not None:
            return finite
        if all(body.material.linear for body in self.bodies):
            return None if self.means is None else ElasticMeans(self.motion, self.means)
        if self.mapping.integrate is DOUBLE_MAPPED:
            gauss = GaussPoints(self.grid)
            return YieldingPoints(self.motion, gauss, self.bodies, self.stencils, self.means)
        return YieldingAtPoints(self.motion, self.bodies, self.stencils, self._recover)

    def _recover(self, number: int, u: np.ndarray) -> np.ndarray:
        """Displacement gradients (n, dim, dim) that a body takes from nodal u."""
        if self.composites:
            return self.composites[number].gradient_at_points(
                self.bodies[number].x, self.cells[number], u
            )
        return self.stencils[number].gradient_at_points(u)

    def _stop_together(self, message: str | None) -> None:
        message = anywhere(self.grid.comm, message)
        if message:
            raise RunError(message)
