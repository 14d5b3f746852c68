"""The twin: a finite element run of the same terms, materials and stepping, with the same forms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from ufl import inner

from ..common import tensors
from ..common.checks import an_object, check_flags
from ..common.compiled import digits
from ..common.ranks import together
from ..common.spread import Part, Spread
from ..dynamics.motion import Motion
from ..dynamics.time_stepping import Newmark, QuasiStatic
from ..grid import dolfinx_versions
from ..grid.gauss_points import GaussPoints
from ..grid.grid import Grid
from ..grid.stress_field import StressField
from ..mapping.methods import Mapping as PointMapping
from ..materials.law_checks import check_law
from ..points.geostatic_stress import stress_at
from ..points.inside import in_mesh
from ..response.cell_materials import CellMaterials
from ..response.finite_strain_elements import FiniteStrainElements
from ..response.nonlocal_strain import averages_of_elements
from ..response.response import Response
from ..response.small_strain import YieldingElements
from ..solver.equilibrium import Equilibrium
from ..solver.solver import Solver
from ..terms.body import elastic_work, elasticity, inertia
from ..terms.doubtful_boundaries import warn_of_doubtful
from ..terms.doubtful_ground import warn_of_other_ground
from ..terms.meeting_supports import refuse_disagreement
from ..terms.scene import Scene
from ..terms.tied import tied_sides
from .doubtful_soil import warn_of_locking
from .identity import described
from .options import InitialAcceleration, check_start, chosen_b_bar, crossings, solver_of_today
from .run import Run

ALIKE = 1e-2
"""Of the largest acceleration: by no more does that of a run before differ from the balance of its
own loads."""
COPIES = 1e-9
"""Of the largest value: so far copies of a node of tied sides may be apart at the start."""


class FiniteElements(Run):
    """Finite element run on the whole grid, bilinear (trilinear) elements, in the configuration at
    rest.

    ``material``: one; or the bodies of a material point run, at rest, which must fill the grid's
    cells, each with points of one material; or pairs (material, where), ``where`` mapping x
    (dim, n), m, to bool (n,) at the cells' centres, on any mesh.  See ``CellMaterials``.
    At small strain the tangent does not change, so it is assembled and factored once;
    ``reassemble`` does it every step, as a material point run must, for a fair clock.  ``solver``:
    PETSc options.  ``b_bar``: volume changes by the cell's mean, which cures locking where ν comes
    near ½ or flow keeps the volume. ``initial_acceleration``: that of the balance of forces at the
    start, unless nodes have one, or zero.

    ``start``: the run whose state this one goes on from: displacement, stress and history, velocity
    and acceleration (a quasi-static one is at rest), and what springs have accumulated on the same
    facets; springs on other facets start unstressed, surface points carry theirs.  Time is 0 again:
    loads are asked from there on, and ``Fixed`` moves by what its value changes from there on.
    ``stress``: that at the start, where displacement is zero: a function of x (dim, n), m, to rows
    (n, components), Pa, such as ``GeostaticStress``, asked at the Gauss points.
    Raises ``ValueError`` naming what is wrong.
    """

    def __init__(
        self,
        grid: Grid,
        material,
        stepping: Newmark | QuasiStatic,
        terms: Sequence,
        reassemble: bool = False,
        solver: Solver | None = None,
        b_bar: bool | None = None,
        start: FiniteElements | None = None,
        initial_acceleration: InitialAcceleration = InitialAcceleration.BALANCED,
        stress: Callable[[np.ndarray], np.ndarray] | None = None,
        **old,
    ):
        super().__init__("FE", grid, stepping, terms)
        solver = self.solver = solver_of_today("FiniteElements", solver, old)
        if isinstance(reassemble, PointMapping):
            raise ValueError(f"finite elements take no mapping, got {reassemble}: leave it out")
        check_flags(reassemble=reassemble)
        if b_bar is not None:
            check_flags(b_bar=b_bar)
        if solver.reuse:
            raise ValueError(
                f"reuse of Solver is for material points, got {solver.reuse}: without reassemble "
                "finite elements keep the whole matrix"
            )
        check_start(initial_acceleration)
        materials = self.materials = CellMaterials.of(grid, material)
        for law in materials.materials:
            check_law(law, grid.dim)
        asked, b_bar = b_bar, chosen_b_bar(b_bar, materials.materials)
        if asked is None and not b_bar:
            warn_of_locking(grid.comm, materials.materials, "FiniteElements")
        self.material, self.b_bar = materials.one, b_bar
        self.initial_acceleration = initial_acceleration
        self.reassemble = reassemble or materials.finite
        motion = self.motion = Motion(grid, stepping)
        self.displacement = fem.Function(grid.space, name="displacement")
        dx = motion.region.dx(metadata={"quadrature_degree": 3})
        scene = self.scene = Scene(
            grid,
            motion,
            dx=dx,
            stiffness_dx=dx,
            of_material=self._fields_of,
            b_bar=b_bar,
            at_rest=True,
            sides=tied_sides(grid, self.terms),
        )
        scene.take_cells(self.terms)
        motion.region.leave_out(scene.not_the_body())
        materials = self.materials = materials.without(scene.not_the_body())
        numbers = [(law.density, *law.kinematics.reference(law)) for law in materials.materials]
        scene.density, *scene.lame = (
            materials.field(values) for values in zip(*numbers, strict=True)
        )
        body = elasticity(scene, self.displacement)
        others = [inertia(scene)] if stepping.dynamic else []
        others += scene.bind(self.terms)
        self.contributions = [body, *others]
        refuse_disagreement(scene)
        warn_of_doubtful(scene, self.terms)
        if scene.plain:
            of = np.array([(law.density, *law.lame) for law in materials.materials])
            inside = materials.number >= 0
            warn_of_other_ground(scene, np.where(inside, of[materials.number].T, 0.0))
        self.yielding = self._can_yield(stress, start)
        self.averages = []
        if self.yielding is not None:
            self.averages = averages_of_elements(
                motion, self.yielding.gauss, materials, self.yielding.parts
            )
        for average in self.averages:
            average.warn_of_size()
        self.equilibrium = Equilibrium(
            motion,
            body,
            others,
            scene.fixed,
            solver,
            self.yielding,
            factored=not reassemble,
            crossings=crossings(grid, materials.materials),
            sides=scene.sides,
        )
        self._goes_on = start is not None
        if start is not None:
            self._go_on_from(start)

    def __str__(self) -> str:
        """What the run is made of, and what was chosen for it."""
        lines = [
            f"finite elements on {self.grid.cells} cells in {self.grid.dim}D",
            f"step: {self.stepping}",
            *map(str, self.averages),
            f"solver: {self.equilibrium}",
        ]
        for term, contribution in zip(self.terms, self.scene.contributions, strict=False):
            note = f": {contribution.note}" if contribution.note else ""
            lines.append(f"term: {type(term).__name__}{note}")
        return "\n".join(lines)

    def _fields_of(self, material) -> tuple:
        """ρ, λ and μ of one material, zero in cells of others."""
        known = self.materials.materials
        if material not in known:
            raise ValueError(f"no cell is of the material {material!r}")
        numbers = [
            (law.density, *law.kinematics.reference(law)) if law == material else (0.0, 0.0, 0.0)
            for law in known
        ]
        return tuple(self.materials.field(values) for values in zip(*numbers, strict=True))

    def _can_yield(self, stress: Callable | None, start: FiniteElements | None) -> Response | None:
        """What yielding, finite strain or stress at the start adds to the step, if anything."""
        if stress is not None and start is not None:
            raise ValueError("stress at the start is that of start where start is given: give one")
        stressed = stress is not None or getattr(start, "yielding", None) is not None
        if all(law.linear for law in self.materials.materials) and not stressed:
            return None
        gauss, rows = GaussPoints(self.grid), None
        if stress is not None:
            if self.scene.plain:
                raise ValueError(
                    "stress at the start is not for runs with FarField or AbsorbingLayer, whose "
                    "cells start without: let a static run find it and go on from it by start="
                )
            with together(self.grid.comm, Exception):
                rows = stress_at(stress, gauss.x.T)
        kind = FiniteStrainElements if self.materials.finite else YieldingElements
        means = gauss.means() if self.b_bar else None
        return kind(self.motion, gauss, self.materials, means, rows)

    def begin(self) -> None:
        """Before the first step: the acceleration of the balance of forces, unless one is given."""
        motion = self.motion
        self._check_copies()
        there = self.stepping.dynamic and self.grid.comm.allreduce(int(motion.a.x.array.any()))
        step = self.stepping
        # not so in generalised α
        at_end = step.dynamic and step.balanced == (step.velocity, step.acceleration)
        given = there and not (self._goes_on and at_end)
        if (
            not self.stepping.dynamic
            or given
            or self.initial_acceleration is InitialAcceleration.ZERO
        ):
            return
        self.scene.prepare(self.time, self.time)
        motion.know_start(motion.nodal(motion.v), motion.nodal(motion.a))
        balanced = self.equilibrium.initial_acceleration()
        change = (
            np.abs(balanced - motion.a.x.array).max(initial=0.0),
            np.abs(balanced).max(initial=0.0),
        )
        change, size = (
            self.grid.comm.allreduce(change[0], MPI.MAX),
            self.grid.comm.allreduce(change[1], MPI.MAX),
        )
        if (
            change > ALIKE * size
        ):  # else the loads are those of the run before, which goes on bit for bit
            motion.a.x.array[:] = balanced

    def _check_copies(self) -> None:
        """Raise ``ValueError``, on all ranks, where nodes of tied sides start apart; else they
        start alike to the last bit."""
        if self.scene.sides is None:
            return
        for name, f in self._nodal_fields().items():
            values = self.motion.nodal(f)
            apart = self.scene.sides.differs(values)
            size = self.grid.comm.allreduce(np.abs(values).max(initial=0.0), MPI.MAX)
            if apart > COPIES * size:
                raise ValueError(
                    f"{name} of nodes that lie opposite each other on tied sides differs by "
                    f"{apart:.3g} at the start: give both the same"
                )
            if name != "increment" and apart > 0.0:
                self.equilibrium.ties.follow(f)

    def attempt(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> None:
        """Solve for the displacement from ``start`` to ``end`` (s)."""
        motion = self.motion
        reassemble = self.reassemble or stepping != motion.stepping
        motion.use(stepping)
        self.scene.prepare(start, end)
        if stepping.dynamic:
            motion.know_start(motion.nodal(motion.v), motion.nodal(motion.a))
        self.equilibrium.solve(reassemble=reassemble)
        self.iterate(None)

    def carry(self) -> None:
        """Displacement, velocity and acceleration at the end of the step."""
        motion = self.motion
        if self.yielding is not None:
            self.yielding.inspect()  # before anything has changed
        if self.stepping.dynamic:
            motion.nodal(motion.v)[:], motion.nodal(motion.a)[:] = motion.end()
        self.displacement.x.array[:] += motion.u.x.array
        if self.yielding is not None:
            self.yielding.carry()
        for average in self.averages:
            average.refresh(self.yielding.history)
        self.scene.carry()
        self.collect()

    def filled_cells(self) -> np.ndarray:
        """All cells (cells,) hold material."""
        return np.ones(self.grid.cells, dtype=bool)

    def balance(self) -> tuple[np.ndarray, float]:
        """What supports bear at the present displacement and loads, and what is out of balance
        elsewhere."""
        self.scene.prepare(self.time, self.time)
        return self.equilibrium.support(None)

    def _go_on_from(self, start: FiniteElements) -> None:
        an_object("start", start, FiniteElements, "a finite element run")
        alike = (start.grid, start.b_bar) == (self.grid, self.b_bar)
        if not alike or not self.materials.alike(start.materials):
            raise ValueError(
                "start must be a finite element run on the same grid, of the same material in "
                f"every cell, b_bar alike, got one of {start.material!r}, b_bar={start.b_bar}"
            )
        fields = [(self.displacement, start.displacement)]
        if self.stepping.dynamic and start.stepping.dynamic:
            fields += [(self.motion.v, start.motion.v), (self.motion.a, start.motion.a)]
        for f, before in fields:
            f.x.array[:] = before.x.array
        if self.yielding is not None:
            self.yielding.take(start.yielding)
        self.scene.go_on_from(start.scene)

    def state(self) -> dict[str, np.ndarray]:
        """What the next step depends on: displacement and motion, springs, stress and history; not
        copied."""
        law = {} if self.yielding is None else self.yielding.memory()
        return {
            **super().state(),
            "displacement": self.displacement.x.array,
            **{f"yielding/{name}": value for name, value in law.items()},
        }

    def spread(self) -> dict[str, Spread]:
        """How the arrays of ``state`` lie on the ranks."""
        law = {} if self.yielding is None else self.yielding.memory()
        return {
            **super().spread(),
            "displacement": Spread.NODES,
            **{f"yielding/{name}": Spread.CELLS for name in law},
        }

    def receive(self, parts: Sequence[Part]) -> None:
        """Take the state that lay on other ranks, of which each rank now holds some parts."""
        super().receive(parts)
        if self.yielding is not None:
            self.yielding.derive()

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take the values of ``state`` in place of the present ones."""
        super().restore(state)
        if self.yielding is not None:
            self.yielding.derive()

    def identity(self) -> dict[str, str]:
        """What a checkpoint's run must have in common with this one."""
        return {
            **super().identity(),
            "material": described(self.material),
            "b_bar": str(self.b_bar),
        }

    # -- what recorders ask for --------------------------------------------------------------------

    def sampler(self, field: str) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Nodes and their values; for stress the cell centres, where it is most accurate."""
        grid = self.grid
        if field == "stress":
            corners = grid.mesh.geometry.x[dolfinx_versions.cell_vertices(grid.mesh)][
                : grid.owned_cells, :, : grid.dim
            ]
            return corners.mean(axis=1), self.stress
        if field != "displacement" and not self.stepping.dynamic:
            raise ValueError(f"field {field!r} is not part of this scene")
        values = self.nodal(field)
        owned = grid.space.dofmap.index_map.size_local
        return grid.space.tabulate_dof_coordinates()[:owned, : grid.dim], lambda rows: values[rows]

    def numbers_of(self, field: str, rows: np.ndarray) -> np.ndarray:
        """Numbers (m, 1) of nodes, or of cells for stress."""
        return self._numbers(field)[rows][:, None]

    def rows_of(self, field: str, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows (k,) of those of ``numbers`` (m, 1) that are this rank's, and which (k,) of them
        these are."""
        mine = {number: row for row, number in enumerate(self._numbers(field).tolist())}
        found = [(mine[n], k) for k, n in enumerate(numbers[:, 0].tolist()) if n in mine]
        rows, which = np.array(found, np.int64).reshape(-1, 2).T
        return rows, which

    def _numbers(self, field: str) -> np.ndarray:
        grid = self.grid
        if field == "stress":
            return grid.cell_numbers[: grid.owned_cells]
        return grid.node_numbers[: grid.space.dofmap.index_map.size_local]

    def _nodal_fields(self) -> dict[str, fem.Function]:
        return {**super()._nodal_fields(), "displacement": self.displacement}

    def holds(self, at: np.ndarray) -> bool:
        """Whether a place (dim,), m, lies in one of this rank's cells."""
        return in_mesh(self.grid, at)

    def stress(self, cells: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa, at the centres of ``cells``."""
        grid, plain = self.grid, self.scene.plain
        found = None
        if self.yielding is not None:
            state = self.yielding.state
            found = state.reshape(-1, self.yielding.gauss.digit.shape[1], state.shape[1])[
                cells
            ].mean(axis=1)
            if not plain:
                return found
        slope = (2 * digits(2, grid.dim) - 1) / 2 ** (grid.dim - 1)  # ∂N/∂ξ at the centre
        x = grid.mesh.geometry.x[dolfinx_versions.cell_vertices(grid.mesh)[cells]][..., : grid.dim]
        u = self.nodal("displacement")[dolfinx_versions.cell_dofs(grid.space)[cells]]
        gradient = np.einsum("cki,kj->cij", u, slope) @ np.linalg.inv(
            np.einsum("cki,kj->cij", x, slope)
        )
        strain = tensors.strain(gradient)
        if found is None:
            found = self.materials.elastic_stress(cells, strain)
        return self._with_far_fields(found, cells, strain)

    def _with_far_fields(
        self, stress: np.ndarray, cells: np.ndarray, strain: np.ndarray
    ) -> np.ndarray:
        """Stress rows (n, components), Pa, in ``cells`` (n,) with those of far fields of that
        strain."""
        for part in self.scene.plain:
            here = part.marks[cells] & part.heavy
            if here.any():
                stress = stress.copy()
                stress[here] = part.stress(cells[here], strain[here])
        return stress

    def stress_field(self) -> StressField:
        """Stress as it is now, bilinear (trilinear) through the Gauss points of each cell: a
        dolfinx function.

        Each call brings the same field up to date.  Raises ``ValueError`` for a mesh that is not
        rectilinear.
        """
        self._stress_field.put(self._gauss.at_corners(self.gauss_stress()))
        return self._stress_field

    @cached_property
    def _stress_field(self) -> StressField:
        return StressField(self.grid)

    @cached_property
    def _gauss(self) -> GaussPoints:
        return GaussPoints(self.grid) if self.yielding is None else self.yielding.gauss

    def gauss_places(self) -> np.ndarray:
        """Where the Gauss points are at rest (points, dim), m: 2^dim a cell, cell after cell."""
        return self._gauss.x

    def gauss_stress(self) -> np.ndarray:
        """Stress rows (points, components), Pa, at the Gauss points."""
        if self.yielding is not None and not self.scene.plain:
            return self.yielding.state
        gauss = self._gauss
        cells = np.repeat(np.arange(self.grid.cells), gauss.digit.shape[1])
        means = gauss.means() if self.b_bar else None
        strain = gauss.strain(self.nodal("displacement"), means)
        if self.yielding is not None:
            return self._with_far_fields(self.yielding.state, cells, strain)
        found = self.materials.elastic_stress(cells, strain)
        return self._with_far_fields(found, cells, strain)

    def gauss_history(self) -> np.ndarray:
        """The material's state variables (points, variables) at the Gauss points; of several
        materials in as many columns as the one with most has.  Elastic ones have none."""
        if self.yielding is not None:
            return self.yielding.history
        return np.zeros((len(self._gauss), 0))

    def grid_fields(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """What to show on nodes, displacement and velocity, and in cells, stress at their centres
        and, where there are several materials, their numbers."""
        motion, known = self.motion, {"displacement": self.displacement}
        if self.stepping.dynamic:
            known["velocity"] = motion.v
        nodal = {name: motion.nodal(field) for name, field in known.items()}
        cells = np.arange(self.grid.owned_cells)
        shown = {"stress": self.stress(cells)}
        if len(self.materials.materials) > 1:
            shown["material"] = self.materials.number[cells].astype(np.int32)
        return nodal, shown

    @cached_property
    def _energies(self) -> dict[str, object]:
        motion, scene, u = self.motion, self.scene, self.displacement
        found = {}
        if self.yielding is None:
            found["strain"] = 0.5 * elastic_work(scene, u, u)
        if self.stepping.dynamic:
            found["kinetic"] = 0.5 * inner(scene.density * motion.v, motion.v) * scene.dx
        return {name: dolfinx_versions.compile_form(form) for name, form in found.items()}

    def energy(self) -> dict[str, float]:
        """Kinetic and strain energy and plastic work (J) of this rank's cells."""
        found = {
            name: dolfinx_versions.assemble_scalar(form) for name, form in self._energies.items()
        }
        if self.yielding is not None:
            found.update(self.yielding.energy(self.grid.owned_cells))
        return self.scene.add_energy(found)
