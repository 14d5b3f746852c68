"""The motion of one step on the grid, as fields and as UFL expressions."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem

from . import fenicsx
from .grid import Grid
from .kernels import jit
from .region import Region
from .time_stepping import Newmark, QuasiStatic


class Motion:
    """Displacement increment ``u`` of the step and, in dynamics, velocity ``v`` and acceleration ``a`` before it.

    Forms integrate over the cells of ``region``.  ``velocity`` and ``acceleration`` are the expressions in the balance
    of forces (see ``time_stepping``), affine in u; their factors are constants, so that a new time step compiles
    nothing.
    """

    def __init__(self, grid: Grid, stepping: Newmark | QuasiStatic):
        self.grid, self.stepping, self.region = grid, stepping, Region(grid)
        self.u = fem.Function(grid.space, name="displacement")
        self.w = ufl.TestFunction(grid.space)
        self.moved: list[tuple[np.ndarray, np.ndarray]] = []  # dofs whose displacement in the step is given, and it
        if stepping.dynamic:
            self.v = fem.Function(grid.space, name="velocity")
            self.a = fem.Function(grid.space, name="acceleration")
            self._factors = [fem.Constant(grid.mesh, np.zeros(3)) for _ in range(2)]
            self.dt = fem.Constant(grid.mesh, np.array(0.0))
            self.use(stepping)
            fields = (self.u, self.v, self.a)
            self.velocity, self.acceleration = (sum(c[i] * f for i, f in enumerate(fields)) for c in self._factors)

    def use(self, stepping: Newmark | QuasiStatic) -> None:
        """Take the factors of another time step."""
        self.stepping = stepping
        if not stepping.dynamic:
            return
        for constant, factors in zip(self._factors, stepping.balanced, strict=True):
            constant.value[:] = factors
        self.dt.value = np.array(stepping.dt)

    def known(self, force):
        """A force that was there before the step, constant in it, as it counts in the balance."""
        start = self.stepping.start
        return force if start == 0.0 else fem.Constant(self.grid.mesh, np.array(1.0 + start)) * force

    def nodal(self, f: fem.Function) -> np.ndarray:
        """Values of a vector field, a view (nodes, dim)."""
        return f.x.array.reshape(-1, self.grid.dim)

    def end(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodal velocity and acceleration (nodes, dim) at the end of the step."""
        u, v, a = self.nodal(self.u), self.nodal(self.v), self.nodal(self.a)
        found = np.empty_like(u), np.empty_like(u)
        _affine(self.stepping.velocity, self.stepping.acceleration, u, v, a, *found)
        return found

    def state(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        fields = {"u": self.u, "v": self.v, "a": self.a} if self.stepping.dynamic else {"u": self.u}
        return {name: f.x.array for name, f in fields.items()}

    def clear(self) -> None:
        """Start a step: no displacement yet but the given one."""
        self.u.x.array[:] = 0.0
        for dofs, by in self.moved:
            self.u.x.array[dofs] = by

    def share(self) -> None:
        """Give the increment to the ghosts."""
        fenicsx.share(self.u)


@jit
def _affine(c, d, u, v, a, first, second):
    """c·(u, v, a) and d·(u, v, a), in one go over nodal values (nodes, dim)."""
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            first[i, k] = c[0] * u[i, k] + c[1] * v[i, k] + c[2] * a[i, k]
            second[i, k] = d[0] * u[i, k] + d[1] * v[i, k] + d[2] * a[i, k]
