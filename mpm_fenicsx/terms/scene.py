"""What terms write their virtual work into: the motion, the density, and the surfaces they act
on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem

from ..common.checks import in_short
from ..common.ranks import anywhere, together, warn
from ..common.spread import Spread
from ..dynamics.motion import Motion
from ..grid import dolfinx_versions
from ..grid.consistent_mass import ConsistentMass
from ..grid.form_degree import degree
from ..grid.grid import Grid
from ..mapping.tied_sides import TiedSides
from .boundary_patches import patch
from .contribution import Contribution
from .drift import Drift
from .load_functions import TRIALS, Load, as_load
from .plain_cells import PlainCells, mixed_velocity


@dataclass
class Scene:
    """What a run offers to its terms, and what these leave with it.

    ``grid`` and ``motion`` (u, v, a and the test function w).  ``density`` ρ (kg/m³) is a field or
    a constant that ``dx`` integrates, ``lame`` are λ and μ (Pa), which ``stiffness_dx`` does;
    with material points they are less where a cell is partly filled, and ``partly_filled`` says
    that cells may be.  ``of_material`` gives the same three with those of all other materials left
    out.
    ``b_bar``: volume changes cell by cell (see ``body.elastic_work``).
    ``body_force`` makes ρb (N/m³) of a body force per mass that varies in space, and what refreshes
    it: at nodes, where it is not given.
    ``occupied`` (cells,), bool: which cells hold material points at the start; all, if None.
    ``at_rest``: integrals are taken in the configuration at rest, where surface points stay.
    ``sides``: opposite sides of the grid whose nodes move together, if any.

    ``contributions``: what the terms do, in their order; ``patches``: the surfaces that they act
    on; ``fixed``: Dirichlet conditions, and ``supports`` the terms that set them; ``plain``: cells
    without points that terms have taken, with a motion of their own; ``empty`` (cells,), bool:
    cells that terms keep free of material; ``damped``: the materials that terms damp, None for all;
    ``beside``: what terms do in plain cells besides, assembled once; ``terms``: all that are bound;
    ``ahead``: functions of a step's start and end (s) that go before everything else in it, as
    loads ask what they find.
    """

    grid: Grid
    motion: Motion
    density: object = None
    dx: ufl.Measure | None = None
    lame: tuple = ()
    stiffness_dx: ufl.Measure | None = None
    of_material: Callable | None = None
    b_bar: bool = False
    partly_filled: bool = False
    body_force: Callable | None = None
    at_rest: bool = False
    occupied: np.ndarray | None = None
    sides: TiedSides | None = None
    fixed: list = field(default_factory=list)
    supports: list = field(default_factory=list)
    contributions: list[Contribution] = field(default_factory=list)
    patches: list = field(default_factory=list)
    plain: list[PlainCells] = field(default_factory=list)
    loads: list[Load] = field(default_factory=list)
    drifting: Drift | None = None
    empty: np.ndarray | None = None
    damped: list = field(default_factory=list)
    beside: list[Contribution] = field(default_factory=list)
    body_loaded: bool = False
    terms: Sequence = ()
    ahead: list[Callable[[float, float], None]] = field(default_factory=list)
    _binding: str = field(default="", repr=False)
    _parts: dict[int, PlainCells] = field(default_factory=dict, repr=False)

    def bind(self, terms: Sequence) -> list[Contribution]:
        """What the terms do, one contribution a term."""
        self.terms = terms
        for term in terms:
            self._binding = type(term).__name__
            try:
                found = term.bind(self)
            except AttributeError as error:
                if error.obj is self.motion:
                    raise AttributeError(f"terms: bind of {self._binding}: {error}") from error
                raise
            if not isinstance(found, Contribution):
                raise ValueError(
                    f"terms: bind of {self._binding} must return a Contribution, got "
                    f"{in_short(found)}"
                )
            found.term = self._binding
            found.check()
            self._check_work(found)
            self.contributions.append(found)
        self._binding = ""
        self.contributions += self.beside
        for term in terms:
            if hasattr(term, "beside_others") and hasattr(term, "check"):
                term.check(self)
        if self.sides is not None:
            self._fix_copies()
        drift = self.drifting = self._drift()
        if drift is not None:
            self.contributions.append(
                Contribution(
                    after=[drift.carry],
                    memory={"offset": drift.offset, "moved": drift.moved},
                    spread={"moved": Spread.NODES},
                )
            )
        return self.contributions

    def _fix_copies(self) -> None:
        """Where a node of tied sides is fixed, or moved, all its copies are.  Collective."""
        motion, sides, dim = self.motion, self.sides, self.grid.dim
        motion.at_rest[:] = [sides.with_copies(dofs) for dofs in motion.at_rest]
        for known in motion.moved:
            known.dofs = sides.with_copies(known.dofs)
        fixed = [bc.dof_indices()[0] for bc in self.fixed]
        fixed = np.unique(np.concatenate([np.zeros(0, np.int32), *fixed]))
        more = np.setdiff1d(sides.with_copies(fixed), fixed)
        for c in range(dim):
            dofs = more[more % dim == c].astype(np.int32)
            self.fixed.append(fem.dirichletbc(np.array(0.0), dofs, self.grid.space.sub(c)))
        for part in self.plain:
            ends = np.zeros(self.grid.nodes)
            ends[part.nodes] = 1.0
            apart = np.flatnonzero(sides.largest(ends) > ends)
            at = self.grid.space.tabulate_dof_coordinates()[apart[:1], :dim]
            fault = f"{part.owner} ends at x={at[0].round(9) + 0.0}" if len(apart) else None
            fault = anywhere(self.grid.comm, fault)
            if fault:
                raise ValueError(
                    f"{fault}, on a tied side, and there are none of its cells opposite: give it "
                    "the same cells on both sides"
                )

    def _check_work(self, found: Contribution) -> None:
        """Raise ``ValueError`` for work that is no virtual work, or not linear in u."""
        whose = f"work of {self._binding}"
        if not isinstance(found.work, ufl.Form):
            if isinstance(found.work, int | float) and found.work == 0:
                return
            raise ValueError(f"terms: {whose} must be a form, got {in_short(found.work)}")
        if len(found.work.arguments()) != 1:
            raise ValueError(
                f"terms: {whose} must be linear in the test function w of the motion, and has "
                f"{len(found.work.arguments())} test and trial functions"
            )
        if degree(found.work, self.motion.u) > 1:
            raise ValueError(
                f"terms: {whose} is not linear in the increment u; a step is iterated for laws "
                "alone, so take what is not linear at the start of the step, in before"
            )

    def take_cells(self, terms: Sequence) -> None:
        """Terms that are made of plain cells take theirs, layers beside others last."""
        takers = [term for term in terms if hasattr(term, "take_cells")]
        for term in sorted(takers, key=lambda term: term.beside_others):
            term.take_cells(self)

    def _drift(self) -> Drift | None:
        """What watches how far points have come from the plain cells that they are bonded to; None
        where they are beside none.  Collective."""
        if self.occupied is None or not self.plain:
            return None
        nodes = dolfinx_versions.cell_dofs(self.grid.space)[self.occupied]
        of_points = np.unique(nodes)
        beside = [part for part in self.plain if np.isin(part.nodes, of_points).any()]
        shared = np.intersect1d(of_points, np.concatenate([part.nodes for part in self.plain]))
        if not self.grid.comm.allreduce(len(shared)):
            return None
        follows = any(part.follows for part in self.plain)
        return Drift(self.grid, self.motion, beside or self.plain, shared, follows)

    def filled(self) -> np.ndarray:
        """Which cells (cells,), bool, hold material: points, or what terms have taken so far."""
        everywhere = np.ones(self.grid.cells, dtype=bool)
        found = everywhere if self.occupied is None else self.occupied.copy()
        for part in self.plain:
            found |= part.marks
        return found

    def claim(self, term, marks: np.ndarray) -> PlainCells:
        """Cells (cells,), bool, become plain ones: those of the term.

        Raises ``ValueError``, on all ranks, for no cells at all, cells with material points, and
        such as another term has.
        """
        grid, name = self.grid, type(term).__name__
        marks = grid.share_cells(np.asarray(marks, dtype=bool))
        if not grid.comm.allreduce(int(marks[: grid.owned_cells].any())):
            raise ValueError(f"{name}: no cell of the grid is in it")
        fault = None
        for part in self.plain:
            if (part.marks & marks).any():
                at = self._centre(part.marks & marks)
                fault = f"{name} and {part.owner} both have the cell at x={at}"
        if self.occupied is not None and (self.occupied & marks).any():
            at = self._centre(self.occupied & marks)
            fault = (
                f"{name}: there are material points in the cell at x={at}: leave them out, or give "
                "it cells without"
            )
        fault = anywhere(grid.comm, fault)
        if fault:
            raise ValueError(fault)
        self.plain.append(PlainCells(grid, self.motion, marks, name, self.sides))
        self._parts[id(term)] = self.plain[-1]
        return self.plain[-1]

    def part(self, term) -> PlainCells:
        """The cells that a term has claimed."""
        return self._parts[id(term)]

    def bring_into(self, term, layer) -> None:
        """A motion comes in through the cells of another term.  Raises ``ValueError`` for a term
        that has none, or through whose one comes in already."""
        name = type(layer).__name__
        if id(layer) not in self._parts:
            raise ValueError(f"on: the {name} is none of the scene's terms: add it to them")
        if self.part(layer).brought is not None:
            raise ValueError(
                f"on: {type(term).__name__} is the second motion that comes in through one {name}: "
                "give it all that comes in at once"
            )
        self.part(layer).bring()

    def _centre(self, marks: np.ndarray) -> np.ndarray:
        """Centre (dim,), m, of the first of the cells that are marked."""
        return self.grid.centres[int(np.argmax(marks))]

    def not_the_body(self) -> np.ndarray | None:
        """Which cells (cells,), bool, are not the body's where that fills the grid: plain and empty
        ones; None where it has all."""
        plain = self.plain_cells()
        found = [marks for marks in (plain, self.empty) if marks is not None]
        return np.any(found, axis=0) if found else None

    def plain_cells(self) -> np.ndarray | None:
        """Which cells (cells,), bool, are plain; None where no term has any."""
        return np.any([part.marks for part in self.plain], axis=0) if self.plain else None

    def goes_on(self, lame: tuple[float, float]) -> np.ndarray:
        """Which plain cells (cells,), bool, are ground of these λ and μ (Pa), so that strain goes
        on in them: those of a far field of that material, and none of a layer, whose lengths are
        no lengths of the body's."""
        found = np.zeros(self.grid.cells, dtype=bool)
        for part in self.plain:
            if part.heavy:
                dofs = dolfinx_versions.cell_dofs(part.λ.function_space)[:, 0]
                λ, μ = part.λ.x.array[dofs], part.μ.x.array[dofs]
                found |= part.marks & np.isclose(λ, lame[0]) & np.isclose(μ, lame[1])
        return found

    def add_energy(self, found: dict[str, float]) -> dict[str, float]:
        """``found`` with the energies (J) of plain cells, of this rank."""
        for part in self.plain:
            for name, value in part.energy().items():
                found[name] += value
        return found

    @cached_property
    def mass(self) -> ConsistentMass:
        """The body's consistent mass."""
        return ConsistentMass(self.grid, self.density, self.dx)

    @cached_property
    def velocity(self):
        """Velocity in the balance of forces, as each cell has it."""
        return mixed_velocity(self.motion, self.plain)

    def patch(self, surface):
        """The boundary patch of a surface, one for all terms that act on it."""
        found = next((p for p in self.patches if p.surface is surface), None)
        if found is None:
            found = patch(surface, self)
            self.patches.append(found)
        if self._binding and self._binding not in found.acting:
            found.acting.append(self._binding)
        return found

    @property
    def cuts_cells(self) -> bool:
        """Whether a surface is an edge of any slope, so that a body ends anywhere in its cells."""
        return any(p.points is not None and p.points.cuts_cells for p in self.patches)

    def load(self, name: str, value, numbers: int | None = None) -> tuple[Load, bool]:
        """A load as ``as_load`` returns it, of so many ``numbers`` at a place (dim, if None), with
        an eye on its values.  Collective; raises ``ValueError`` on all ranks, also where one gives
        a load that depends on place and another one that does not."""
        low, high = self.grid.lower_corner, self.grid.upper_corner
        places = low + np.linspace(0.1, 0.9, TRIALS)[:, None] * (high - low)
        with together(self.grid.comm, Exception):
            load, placed = as_load(name, value, numbers or self.grid.dim, places)
        self.check_alike(name, "one of time and place" if placed else "one of time alone")
        self.loads.append(load)
        return load, placed

    def check_alike(self, name: str, kind: str) -> None:
        """Raise ``ValueError``, on all ranks, naming ``name`` where they have not given it as the
        same ``kind``: they would wait for one another for ever.  Collective."""
        first, *others = self.grid.comm.allgather(kind)
        for rank, other in enumerate(others, start=1):
            if other != first:
                raise ValueError(
                    f"{name} must be of one kind on all ranks, got {first} on rank 0 and {other} "
                    f"on rank {rank}"
                )

    def prepare(self, start: float, end: float) -> None:
        """Bring coefficients to the step from ``start`` to ``end`` (s).

        Raises ``ValueError`` on all ranks, naming it, where a load is not a number on one.
        """
        for load in self.loads:
            load.fault = None
        with together(self.grid.comm):
            for known in self.motion.moved:
                known.prepare(start, end, self.motion.stepping)
        for go in self.ahead:
            go(start, end)
        for part in self.plain:
            part.know_start()
        for p in self.patches:
            p.prepare(start, end)
        for contribution in self.contributions:
            for refresh in contribution.before:
                refresh(start, end)
        fault = anywhere(
            self.grid.comm, next((load.fault for load in self.loads if load.fault), None)
        )
        if fault:
            raise ValueError(fault)

    def mark(self, cells: np.ndarray) -> None:
        """Mark the cells that hold surface points."""
        for p in self.patches:
            p.mark(cells)

    def mark_loaded(self, cells: np.ndarray) -> None:
        """Mark the cells (cells,) on which surfaces act: 2 where surface points do, 1 where facets
        do."""
        for p in self.patches:
            p.mark_loaded(cells)

    def go_on_from(self, other: Scene) -> None:
        """Springs take over what those of another scene on the same surface have accumulated.

        Raises ``ValueError`` where only a part of a surface had springs before; warns where springs
        of before are on none of the surfaces that have springs now, and other surfaces are new.
        """
        before = [p for p in other.patches if p.has_springs]
        gone, new = list(before), []
        for p in self.patches:
            if p.has_springs:
                same = p.take(before)
                gone = [q for q in gone if q not in same]
                new += [] if same else [p]
        if gone and new:
            warn(
                self.grid.comm,
                f"start: springs on {new[0]} start unstressed, and what those of the run before "
                f"bear on {gone[0]} is gone: give the same facets, or the same surface points, if "
                "they are the same springs",
                4,
            )

    def carry(self) -> None:
        """After the step: surfaces move, springs remember, terms do what they do then."""
        for p in self.patches:
            p.carry()
        for contribution in self.contributions:
            for follow in contribution.after:
                follow()

    def make_room(self, state: Mapping[str, np.ndarray]) -> None:
        """Surface points become as many as they are in ``state``: on several ranks they move."""
        for k, p in enumerate(self.patches):
            if p.points is not None:
                p.make_room(len(state[f"surfaces/{k}/x"]))

    def clouds(self) -> dict[str, int]:
        """Surface points by their names in ``state``, and how many of them in a row are one
        face."""
        return {
            f"surfaces/{k}": p.points.per_face
            for k, p in enumerate(self.patches)
            if p.points is not None
        }

    def take_points(self, cloud: str, arrays: dict[str, np.ndarray]) -> None:
        """Surface points become those of other arrays."""
        self.patches[int(cloud.split("/")[1])].take_points(arrays)

    def spread(self) -> dict[str, Spread]:
        """How the arrays of ``state`` lie on the ranks."""
        surfaces = {
            f"surfaces/{k}/{name}": Spread.NODES if p.points is None else Spread.ROWS
            for k, p in enumerate(self.patches)
            for name in p.state()
        }
        terms = {
            f"terms/{k}/{name}": contribution.spread.get(name, Spread.ALIKE)
            for k, contribution in enumerate(self.contributions)
            for name in contribution.memory
        }
        return surfaces | terms

    def arrays_that_move(self) -> set[str]:
        """Names in ``state`` of the arrays of surface points."""
        return {
            f"surfaces/{k}/{name}"
            for k, p in enumerate(self.patches)
            if p.points is not None
            for name in p.state()
        }

    def state(self) -> dict[str, np.ndarray]:
        """Arrays of surfaces and terms that a restart needs, by name; not copied."""
        kinds = {
            "surfaces": [p.state() for p in self.patches],
            "terms": [contribution.memory for contribution in self.contributions],
        }
        return {
            f"{kind}/{k}/{name}": value
            for kind, parts in kinds.items()
            for k, part in enumerate(parts)
            for name, value in part.items()
        }
