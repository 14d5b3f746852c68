"""The motion of one step on the grid, as fields and as UFL expressions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import numpy as np
import ufl
from dolfinx import fem

from ..common.compiled import jit
from ..grid import dolfinx_versions
from ..grid.active_cells import Region
from ..grid.grid import Grid
from .time_stepping import Newmark, QuasiStatic

VANISHING = 1e-16
"""Of the step: its square is so small that stiffness is nothing beside inertia, up to Courant
numbers of 1e3."""


IN_DYNAMICS = ("velocity", "acceleration", "v", "a", "dt")


class KnownMotion:
    """Motion of nodes that is given: what ``prescribed`` says of them, step by step.

    ``dofs`` (n,): which; ``increment`` (m) of the step; ``before`` and ``after`` it (2,), velocity
    (m/s) and acceleration (m/s²).
    """

    def __init__(self, dofs: np.ndarray, prescribed):
        self.dofs, self.prescribed = dofs, prescribed
        self.increment, self.before, self.after = 0.0, np.zeros(2), np.zeros(2)

    def prepare(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> None:
        """Bring it to the step from ``start`` to ``end`` (s)."""
        self.increment, self.before[:], self.after[:] = self.prescribed.step(start, end, stepping)


class Motion:
    """Displacement increment ``u`` of the step (m) and, in dynamics, velocity ``v`` (m/s) and
    acceleration ``a`` (m/s²) before it: fields on ``grid``.

    ``w``: the test function.  ``stepping``: the rule of time, and in dynamics ``dt`` (s), its step,
    a constant of forms.  Forms integrate over the cells of ``region``.  ``velocity`` and
    ``acceleration`` are the expressions in the balance of forces (see ``time_stepping``), affine in
    u; their factors are constants, so that a new time step compiles nothing.
    """

    def __init__(self, grid: Grid, stepping: Newmark | QuasiStatic):
        self.grid, self.stepping, self.region = grid, stepping, Region(grid)
        self.u = fem.Function(grid.space, name="displacement")
        self.w = ufl.TestFunction(grid.space)
        self.at_rest: list[np.ndarray] = []  # dofs that do not move
        self._rests, self._resting = 0, ()
        self.moved: list[KnownMotion] = []
        if stepping.dynamic:
            self.v = fem.Function(grid.space, name="velocity")
            self.a = fem.Function(grid.space, name="acceleration")
            self._factors = [fem.Constant(grid.mesh, np.zeros(3)) for _ in range(2)]
            self.dt = fem.Constant(grid.mesh, np.array(0.0))
            self.use(stepping)
            self.velocity, self.acceleration = self.balanced(self.v, self.a)

    def __getattr__(self, name: str) -> NoReturn:
        """Raises ``AttributeError``, which says so where it is statics that lack the name."""
        message = f"{type(self).__name__!r} object has no attribute {name!r}"
        if name in IN_DYNAMICS and "stepping" in vars(self):
            message = (
                f"motion.{name} is there in dynamics alone, and the run steps with "
                f"{self.stepping}: step with Newmark, or let the term ask motion.stepping.dynamic "
                "first"
            )
        raise AttributeError(message, name=name, obj=self)

    def use(self, stepping: Newmark | QuasiStatic) -> None:
        """Take the factors of another time step."""
        self.stepping = stepping
        if not stepping.dynamic:
            return
        for constant, factors in zip(self._factors, stepping.balanced, strict=True):
            constant.value[:] = factors
        self.dt.value = np.array(stepping.dt)

    def known(self, force):
        """A force that is there before the step, and constant in it, as it counts in the balance:
        by 1 at the end of the step and by ``stepping.start`` at its start."""
        start = self.stepping.start
        return (
            force if start == 0.0 else fem.Constant(self.grid.mesh, np.array(1.0 + start)) * force
        )

    def balanced(self, v: fem.Function, a: fem.Function, u=None) -> tuple:
        """Velocity and acceleration in the balance of forces, of nodes that have ``v`` and ``a``
        before the step and move by ``u`` in it, an expression, if not by that of the motion."""
        u = self.u if u is None else u
        return tuple(sum(c[i] * f for i, f in enumerate((u, v, a))) for c in self._factors)

    def balanced_acceleration(self) -> np.ndarray:
        """That expression's values (nodes, dim), m/s², at u as it is."""
        fields = [self.nodal(f) for f in (self.u, self.v, self.a)]
        out = np.empty_like(fields[0])
        _combine(self._factors[1].value, *fields, out)
        return out

    def numbers(self) -> np.ndarray:
        """What forms know of the step: the factors in the balance, and its length."""
        if not self.stepping.dynamic:
            return np.zeros(0)
        return np.array([*(n for c in self._factors for n in c.value), float(self.dt.value)])

    def nodal(self, f: fem.Function) -> np.ndarray:
        """Values of a vector field, a view (nodes, dim)."""
        return f.x.array.reshape(-1, self.grid.dim)

    @contextmanager
    def vanishing_step(self) -> Iterator[float]:
        """Within, forms are those of a step so short that inertia alone resists: u times the number
        given is the acceleration at its end, and velocity is that before it."""
        factor, known = 1.0 / (VANISHING * self.stepping.dt**2), 1.0 + self.stepping.start
        self._factors[0].value[:] = 0.0, known, 0.0
        self._factors[1].value[:] = factor, 0.0, 0.0
        yield factor / known
        self.use(self.stepping)

    def know_start(self, v: np.ndarray, a: np.ndarray) -> None:
        """Give nodal velocity and acceleration (nodes, dim) before the step what is known of
        them."""
        self._know(v, a, [known.before for known in self.moved])

    def _know(self, v: np.ndarray, a: np.ndarray, of_moved: list[np.ndarray]) -> None:
        if len(self.at_rest) != self._rests:
            self._rests = len(self.at_rest)
            dofs = np.unique(np.concatenate(self.at_rest))
            self._resting = tuple(np.divmod(dofs, self.grid.dim))
        if self._rests:
            v[self._resting] = a[self._resting] = 0.0
        for known, (velocity, acceleration) in zip(self.moved, of_moved, strict=True):
            node, component = np.divmod(known.dofs, self.grid.dim)
            v[node, component], a[node, component] = velocity, acceleration

    def end(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodal velocity and acceleration (nodes, dim) at the end of the step."""
        u, v, a = self.nodal(self.u), self.nodal(self.v), self.nodal(self.a)
        found = np.empty_like(u), np.empty_like(u)
        self._advance(np.arange(len(u)), u, v, a, *found)
        self._know(*found, [known.after for known in self.moved])
        return found

    def advance(
        self, nodes: np.ndarray, u: np.ndarray, v: fem.Function, a: fem.Function, known: bool
    ) -> None:
        """Take v and a at ``nodes`` (n,), which move by ``u`` (nodes, dim), m, from the start of
        the step to its end; there they are what is known of them, if ``known``."""
        v, a = self.nodal(v), self.nodal(a)
        self._advance(nodes, u, v, a, v, a)
        if known:
            self._know(v, a, [of.after for of in self.moved])

    def _advance(self, nodes: np.ndarray, u, v, a, first: np.ndarray, second: np.ndarray) -> None:
        step = self.stepping
        _affine(nodes, step.velocity, step.acceleration, u, v, a, first, second)

    def state(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        fields = {"u": self.u, "v": self.v, "a": self.a} if self.stepping.dynamic else {"u": self.u}
        return {name: f.x.array for name, f in fields.items()}

    def clear(self) -> None:
        """Start a step: no displacement yet but the given one."""
        self.u.x.array[:] = 0.0
        for known in self.moved:
            self.u.x.array[known.dofs] = known.increment

    def share(self) -> None:
        """Give the increment to the ghosts."""
        dolfinx_versions.share(self.u)


@jit
def _combine(factors, u, v, a, out):
    """c₀ u + c₁ v + c₂ a, each (nodes, dim)."""
    for i in range(len(out)):
        for d in range(out.shape[1]):
            out[i, d] = factors[0] * u[i, d] + factors[1] * v[i, d] + factors[2] * a[i, d]


@jit
def _affine(nodes, c, d, u, v, a, first, second):
    """c·(u, v, a) and d·(u, v, a), in one go over values (nodes, dim) at some nodes; where v and a
    are."""
    for i in nodes:
        for k in range(u.shape[1]):
            at_u, at_v, at_a = u[i, k], v[i, k], a[i, k]
            first[i, k] = c[0] * at_u + c[1] * at_v + c[2] * at_a
            second[i, k] = d[0] * at_u + d[1] * at_v + d[2] * at_a
