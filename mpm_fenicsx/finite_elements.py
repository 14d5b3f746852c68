"""The twin: a finite element run of the same terms, material and stepping, with the same forms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from dolfinx import fem

from .equilibrium import Equilibrium
from .grid import Grid
from .motion import Motion
from .run import Run
from .scene import Scene
from .terms import elasticity, inertia
from .time_stepping import Newmark, QuasiStatic


class FiniteElements(Run):
    """Small-strain finite element run on the whole grid, bilinear (trilinear) elements.

    The tangent does not change, so it is assembled and factored once; ``reassemble`` does it every step, as a
    material point run must, for a fair clock.  ``solver``: PETSc options.
    """

    def __init__(self, grid: Grid, material, stepping: Newmark | QuasiStatic, terms: Sequence,
                 reassemble: bool = False, solver: Mapping[str, object] | None = None):
        super().__init__("FE", grid, stepping)
        self.material, self.reassemble = material, reassemble
        motion = self.motion = Motion(grid, stepping)
        self.displacement = fem.Function(grid.space, name="displacement")
        density, λ, μ = (fem.Constant(grid.mesh, np.array(v)) for v in (material.density, *material.lame))
        scene = self.scene = Scene(grid, motion, density, grid.dx(metadata={"quadrature_degree": 3}))
        internal = [elasticity(scene, λ, μ, self.displacement)] + ([inertia(scene)] if stepping.dynamic else [])
        self.contributions = internal + [term.bind(scene) for term in terms]
        if not reassemble:
            direct = "mumps" if grid.comm.size > 1 else "petsc"
            solver = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": direct,
                      **(solver or {})}
        self.equilibrium = Equilibrium(motion, sum(c.work for c in self.contributions), scene.fixed, solver)

    def step(self) -> None:
        """One step of length ``stepping.dt``.  Raises ``RunError`` naming step and time."""
        with self.reported():
            self.scene.prepare(self.time, self.next_time)
            if self.reassemble or not self.steps:
                self.equilibrium.assemble_tangent()
            self.equilibrium.solve()
            self.carry()
        self.finish()

    def carry(self) -> None:
        """Displacement, velocity and acceleration at the end of the step."""
        motion = self.motion
        if self.stepping.dynamic:
            motion.nodal(motion.v)[:], motion.nodal(motion.a)[:] = motion.end()
        self.displacement.x.array[:] += motion.u.x.array
        self.scene.carry()
