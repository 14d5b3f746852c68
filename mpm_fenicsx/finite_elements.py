"""The twin: a finite element run of the same terms, material and stepping, with the same forms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np
from dolfinx import fem
from ufl import inner

from . import fenicsx, kernels, tensors
from .equilibrium import Equilibrium
from .finite_strain_elements import FiniteStrainElements
from .gauss import GaussPoints
from .grid import Grid
from .kinematics import FINITE_STRAIN
from .motion import Motion
from .newton import Newton
from .run import Run
from .scene import Scene
from .terms import elastic_work, elasticity, inertia
from .time_stepping import Newmark, QuasiStatic
from .yielding import Yielding, YieldingElements


class FiniteElements(Run):
    """Finite element run on the whole grid, bilinear (trilinear) elements, in the configuration at rest.

    At small strain the tangent does not change, so it is assembled and factored once; ``reassemble`` does it every
    step, as a material point run must, for a fair clock.  ``solver``: PETSc options.  ``b_bar``: volume changes by the
    cell's mean, which cures locking where ν comes near ½ or flow keeps the volume.  ``start``: the run whose state
    this one goes on from, at time 0 again; a quasi-static one is at rest.
    """

    bodies = ()  # no material points

    def __init__(self, grid: Grid, material, stepping: Newmark | QuasiStatic, terms: Sequence,
                 reassemble: bool = False, newton: Newton | None = None,
                 solver: Mapping[str, object] | None = None, b_bar: bool = False,
                 start: FiniteElements | None = None):
        super().__init__("FE", grid, stepping, terms)
        self.material, self.b_bar = material, b_bar
        self.reassemble = reassemble or material.kinematics is FINITE_STRAIN
        motion = self.motion = Motion(grid, stepping)
        self.displacement = fem.Function(grid.space, name="displacement")
        numbers = material.density, *material.kinematics.lame(material)
        density, λ, μ = (fem.Constant(grid.mesh, np.array(v)) for v in numbers)
        self._lame = λ, μ
        scene = self.scene = Scene(grid, motion, density, motion.region.dx(metadata={"quadrature_degree": 3}))
        internal = [elasticity(scene, scene.dx, λ, μ, self.displacement, b_bar)]
        internal += [inertia(scene)] if stepping.dynamic else []
        self.contributions = internal + [term.bind(scene) for term in self.terms]
        if not reassemble:
            direct = "mumps" if grid.comm.size > 1 else "petsc"
            solver = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": direct,
                      **(solver or {})}
        self.yielding = self._can_yield()
        self.equilibrium = Equilibrium(motion, self.contributions, scene.fixed, solver, self.yielding, newton)
        if start is not None:
            self._go_on_from(start)

    def _can_yield(self) -> Yielding | None:
        """What yielding or finite strain adds to the step, where the material is of that kind."""
        if self.material.kinematics is FINITE_STRAIN:
            if self.b_bar:
                raise ValueError(f"b_bar is for small strain only, got {self.material!r}")
            return FiniteStrainElements(self.motion, GaussPoints(self.grid), self.material)
        if not self.material.history:
            return None
        return YieldingElements(self.motion, GaussPoints(self.grid, self.b_bar), self.material)

    def attempt(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> None:
        """Solve for the displacement from ``start`` to ``end`` (s)."""
        reassemble = self.reassemble or stepping != self.motion.stepping
        self.motion.use(stepping)
        self.scene.prepare(start, end)
        self.equilibrium.solve(reassemble=reassemble)

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
        """What supports bear at the present displacement and loads, and what is out of balance elsewhere."""
        self.scene.prepare(self.time, self.time)
        return self.equilibrium.support(None)

    def _go_on_from(self, start: FiniteElements) -> None:
        if (start.grid, start.material, start.b_bar) != (self.grid, self.material, self.b_bar):
            raise ValueError("start must be a finite element run on the same grid, of the same material, b_bar alike")
        fields = [(self.displacement, start.displacement)]
        if self.stepping.dynamic and start.stepping.dynamic:
            fields += [(self.motion.v, start.motion.v), (self.motion.a, start.motion.a)]
        for f, before in fields:
            f.x.array[:] = before.x.array
        if self.yielding is not None:
            self.yielding.take(start.yielding)

    def state(self) -> dict[str, np.ndarray]:
        """What the next step depends on: displacement and motion, springs, stress and history; not copied."""
        law = {} if self.yielding is None else self.yielding.memory()
        return {**super().state(), "displacement": self.displacement.x.array,
                **{f"yielding/{name}": value for name, value in law.items()}}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take the values of ``state`` in place of the present ones."""
        super().restore(state)
        if self.yielding is not None:
            self.yielding.derive()

    def identity(self) -> dict[str, str]:
        """What a checkpoint's run must have in common with this one."""
        return {**super().identity(), "material": repr(self.material), "b_bar": str(self.b_bar)}

    # -- what recorders ask for -----------------------------------------------------------------------------------

    def sampler(self, field: str) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Nodes and their values; for stress the cell centres, where it is most accurate."""
        grid, motion = self.grid, self.motion
        if field == "stress":
            corners = grid.mesh.geometry.x[fenicsx.cell_vertices(grid.mesh)][: grid.owned_cells, :, : grid.dim]
            return corners.mean(axis=1), self.stress
        if field != "displacement" and not self.stepping.dynamic:
            raise ValueError(f"field {field!r} is not part of this scene")
        known = {"displacement": self.displacement} if field == "displacement" else \
            {"velocity": motion.v, "acceleration": motion.a}
        values = motion.nodal(known[field])
        owned = grid.space.dofmap.index_map.size_local
        return grid.space.tabulate_dof_coordinates()[:owned, : grid.dim], lambda rows: values[rows]

    def stress(self, cells: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa, at the centres of ``cells``."""
        grid = self.grid
        if self.yielding is not None:
            return self.yielding.state.reshape(grid.cells, -1, self.yielding.state.shape[1])[cells].mean(axis=1)
        slope = (2 * kernels.digits(2, grid.dim) - 1) / 2 ** (grid.dim - 1)  # ∂N/∂ξ at the centre
        x = grid.mesh.geometry.x[fenicsx.cell_vertices(grid.mesh)[cells]][..., : grid.dim]
        u = self.motion.nodal(self.displacement)[fenicsx.cell_dofs(grid.space)[cells]]
        gradient = np.einsum("cki,kj->cij", u, slope) @ np.linalg.inv(np.einsum("cki,kj->cij", x, slope))
        strain = tensors.strain(gradient)
        return self.material.update(strain, np.zeros_like(strain))

    def grid_fields(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """What to show on nodes, displacement and velocity, and in cells, stress at their centres."""
        motion, known = self.motion, {"displacement": self.displacement}
        if self.stepping.dynamic:
            known["velocity"] = motion.v
        nodal = {name: motion.nodal(field) for name, field in known.items()}
        return nodal, {"stress": self.stress(np.arange(self.grid.owned_cells))}

    @cached_property
    def _energies(self) -> dict[str, object]:
        motion, scene, u = self.motion, self.scene, self.displacement
        found = {}
        if self.yielding is None:
            found["strain"] = 0.5 * elastic_work(motion, scene.dx, *self._lame, u, u, self.b_bar)
        if self.stepping.dynamic:
            found["kinetic"] = 0.5 * inner(scene.density * motion.v, motion.v) * scene.dx
        return {name: fenicsx.compile_form(form) for name, form in found.items()}

    def energy(self) -> dict[str, float]:
        """Kinetic and strain energy and plastic work (J) of this rank's cells."""
        found = {name: fenicsx.assemble_scalar(form) for name, form in self._energies.items()}
        if self.yielding is not None:
            found.update(self.yielding.energy(self.grid.owned_cells))
        return found
