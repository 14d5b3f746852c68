"""The twin: a finite element run of the same terms, materials and stepping, with the same forms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from ufl import inner

from ..common import tensors
from ..common.checks import an_object
from ..common.compiled import digits
from ..common.spread import Part, Spread
from ..dynamics.motion import Motion
from ..dynamics.time_stepping import Newmark, QuasiStatic
from ..grid import dolfinx_versions
from ..grid.gauss_points import GaussPoints
from ..grid.grid import Grid
from ..grid.stress_field import StressField
from ..mapping.methods import Mapping as PointMapping
from ..materials.law_checks import check_law
from ..points.inside import in_mesh
from ..response.cell_materials import CellMaterials
from ..response.finite_strain_elements import FiniteStrainElements
from ..response.response import Response
from ..response.small_strain import YieldingElements
from ..solver.equilibrium import Equilibrium
from ..solver.solver import Solver
from ..terms.body import elastic_work, elasticity, inertia
from ..terms.doubtful_boundaries import warn_of_doubtful
from ..terms.meeting_supports import refuse_disagreement
from ..terms.scene import Scene
from .b_bar_checks import warn_of_laws
from .identity import described
from .options import InitialAcceleration, check_start, crossings, solver_of_today
from .run import Run
from .scene_checks import check_flags

ALIKE = 1e-2
"""Of the largest acceleration: by no more does that of a run before differ from the balance of its
own loads."""


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
        b_bar: bool = False,
        start: FiniteElements | None = None,
        initial_acceleration: InitialAcceleration = InitialAcceleration.BALANCED,
        **old,
    ):
        super().__init__("FE", grid, stepping, terms)
        solver = self.solver = solver_of_today("FiniteElements", solver, old)
        if isinstance(reassemble, PointMapping):
            raise ValueError(f"finite elements take no mapping, got {reassemble}: leave it out")
        check_flags(reassemble=reassemble, b_bar=b_bar)
        if solver.reuse:
            raise ValueError(
                f"reuse of Solver is for material points, got {solver.reuse}: without reassemble "
                "finite elements keep the whole matrix"
            )
        check_start(initial_acceleration)
        materials = self.materials = CellMaterials.of(grid, material)
        for law in materials.materials:
            check_law(law, grid.dim)
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
        warn_of_doubtful(grid, self.terms)
        if b_bar:
            warn_of_laws(grid.comm, materials.materials)
        self.yielding = self._can_yield()
        self.equilibrium = Equilibrium(
            motion,
            body,
            others,
            scene.fixed,
            solver,
            self.yielding,
            factored=not reassemble,
            crossings=crossings(grid, materials.materials),
        )
        self._goes_on = start is not None
        if start is not None:
            self._go_on_from(start)

    def __str__(self) -> str:
        """What the run is made of, and what was chosen for it."""
        lines = [
            f"finite elements on {self.grid.cells} cells in {self.grid.dim}D",
            f"step: {self.stepping}",
            f"solver: {self.equilibrium}",
        ]
        return "\n".join([*lines, *(f"term: {type(term).__name__}" for term in self.terms)])

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

    def _can_yield(self) -> Response | None:
        """What yielding or finite strain adds to the step, where a material is of that kind."""
        if self.materials.finite:
            if self.b_bar:
                raise ValueError(f"b_bar is for small strain only, got {self.material!r}")
            return FiniteStrainElements(self.motion, GaussPoints(self.grid), self.materials)
        if all(law.linear for law in self.materials.materials):
            return None
        return YieldingElements(self.motion, GaussPoints(self.grid, self.b_bar), self.materials)

    def begin(self) -> None:
        """Before the first step: the acceleration of the balance of forces, unless one is given."""
        motion = self.motion
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
        return GaussPoints(self.grid, self.b_bar) if self.yielding is None else self.yielding.gauss

    def gauss_places(self) -> np.ndarray:
        """Where the Gauss points are at rest (points, dim), m: 2^dim a cell, cell after cell."""
        return self._gauss.x

    def gauss_stress(self) -> np.ndarray:
        """Stress rows (points, components), Pa, at the Gauss points."""
        if self.yielding is not None and not self.scene.plain:
            return self.yielding.state
        gauss = self._gauss
        cells = np.repeat(np.arange(self.grid.cells), gauss.digit.shape[1])
        strain = gauss.strain(self.nodal("displacement"))
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
