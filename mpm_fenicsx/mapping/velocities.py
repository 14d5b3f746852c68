"""Velocity and acceleration between points and grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import ufl
from dolfinx import fem

from ..common.checks import whole
from ..common.compiled import jit
from ..common.ranks import of_all
from ..dynamics.motion import Motion
from ..dynamics.time_stepping import Newmark
from ..grid import dolfinx_versions, weak_forms
from ..grid.cells import Lattice
from ..grid.consistent_mass import ConsistentMass
from ..points.material_points import MaterialPoints
from .shape_functions import Stencil
from .tied_sides import TiedSides
from .ties import Ties

TRANSITS = 4.0
"""Times that a P wave takes through a cell, in which points at supports give up a velocity that is
strange there."""


class Deposit:
    """Nodal velocity and acceleration before the step, from the points.

    Division of nodal momentum by nodal mass smooths: M̄⁻¹M, the mean of neighbours, is left in it.
    Each of ``sweeps``

        v += v₁ − M̄⁻¹M v

    with the consistent mass M, its row sums M̄ and v₁ the divided values takes some of it out.
    Nodes of known motion have what is known, whatever points deposit there. ``consistent``: M of
    points; ``mass`` (nodes,), kg, is the lumped one.
    ``beside``: finite elements that count at the nodes which they share with points, by their
    consistent mass; each with a ``density`` that ``dx`` integrates, ``V`` and ``A``, and ``own``
    nodes that it does not share.  ``sides``: tied sides, copies of whose nodes count together, if
    any; in ``mass`` each has its own.
    """

    def __init__(
        self,
        motion: Motion,
        consistent: ConsistentMass,
        sweeps: int,
        beside: Sequence = (),
        sides: TiedSides | None = None,
    ):
        self.motion, self.sweeps, self._beside = motion, whole("sweeps", sweeps, least=0), beside
        self._consistent, self.sides = consistent, sides
        V = dolfinx_versions.space(motion.grid.mesh, "Lagrange", 1, (1 + 2 * motion.grid.dim,))
        self._sums = fem.Function(V)  # mass, momentum, mass times acceleration
        self.mass = np.zeros(motion.grid.nodes)
        w = ufl.TestFunction(V)
        masses = [weak_forms.inertia(p.density, self._sums, w) * p.edge_dx for p in beside]
        self._shared = dolfinx_versions.compile_form(sum(masses))
        if self.sweeps or beside:
            self._smooth = fem.Function(V)

    def predict(self, bodies: Sequence[MaterialPoints], stencils: Sequence[Stencil]) -> None:
        """Set the motion's v and a."""
        grid = self.motion.grid
        nodal = self._sums.x.array.reshape(grid.nodes, 1 + 2 * grid.dim)
        nodal[:] = 0.0
        for body, stencil in zip(bodies, stencils, strict=True):
            stencil.deposit_motion(body.mass, body.velocity, body.acceleration, nodal)
        dolfinx_versions.gather(self._sums)
        self.mass[:] = nodal[:, 0]
        if self._beside:
            self._add_beside(nodal)
        velocity, acceleration = self._divided(nodal)
        self.motion.nodal(self.motion.v)[:] = velocity
        self.motion.nodal(self.motion.a)[:] = acceleration

    def acceleration(
        self, force: fem.Function, ties: Ties | None, beside: np.ndarray | int = 0
    ) -> np.ndarray:
        """Nodal accelerations (nodes, dim) of forces (N) by the same mass and, where no node is
        tied, sweeps; or by that and mass (nodes,), kg, of finite elements ``beside``."""
        found = self.motion.nodal(force)
        if ties is not None:
            ties.accelerate(force, self.mass + beside)
            self.motion.know_start(np.zeros_like(found), found)
            return found
        if np.ndim(beside):
            mass = self.mass + beside
            if self.sides is not None:
                self.sides.add_up(mass[:, None])
                self.sides.add_up(found)
            found /= np.where(mass > 0.0, mass, np.inf)[:, None]
            self.motion.know_start(np.zeros_like(found), found)
            return found
        nodal = self._sums.x.array.reshape(len(found), 1 + 2 * self.motion.grid.dim)
        nodal[:] = 0.0
        nodal[:, 0], nodal[:, 1 + self.motion.grid.dim :] = self.mass, found
        return self._divided(nodal)[1].copy()

    def _add_beside(self, nodal: np.ndarray) -> None:
        """Add mass, momentum and mass times acceleration of the finite elements beside."""
        from_points = nodal.copy()
        nodal[:] = 0.0
        for part in self._beside:
            nodal[part.nodes] = self._of(part, part.nodes)
        sums = self._smooth.x.array.reshape(nodal.shape)
        sums[:] = 0.0
        dolfinx_versions.assemble_vector(self._smooth, self._shared)
        dolfinx_versions.gather(self._smooth)
        nodal[:] = from_points
        for part in self._beside:
            nodal[part.shared] += sums[part.shared]
            nodal[part.own] = self._of(part, part.own)

    def _of(self, part, nodes: np.ndarray) -> np.ndarray:
        """1, velocity and acceleration of finite elements at their nodes (n,)."""
        motion = self.motion
        moving = [motion.nodal(f)[nodes] for f in (part.V, part.A)]
        return np.hstack((np.ones((len(nodes), 1)), *moving))

    def _divided(self, nodal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and acceleration (nodes, dim) of ``nodal`` mass, momentum and mass times
        acceleration."""
        dim, sides = self.motion.grid.dim, self.sides
        if sides is not None:
            sides.add_up(nodal)
        _divide(nodal)
        velocity, acceleration = nodal[:, 1 : 1 + dim], nodal[:, 1 + dim :]
        divided = nodal.copy() if self.sweeps else nodal
        self.motion.know_start(velocity, acceleration)
        if self.sweeps:
            smooth = self._smooth.x.array.reshape(nodal.shape)
            nodal[:, 0] = 1.0
            for _ in range(self.sweeps):
                smooth[:] = 0.0
                self._consistent.add_times(nodal, self.motion.region.cells, smooth)
                if self._shared is not None:
                    dolfinx_versions.assemble_vector(self._smooth, self._shared)
                dolfinx_versions.gather(self._smooth)
                if sides is not None:
                    sides.add_up(smooth)
                _sharpen(divided, smooth, nodal)
                for part in self._beside:
                    nodal[part.own] = divided[part.own]
                self.motion.know_start(velocity, acceleration)
        return velocity, acceleration


class KnownVelocity:
    """Points at nodes of known motion take up the velocity there.

    Their own goes on by accelerations, and those of such nodes are known: what a point had of
    velocity when it came to a wall, or when its base set off, it would keep for ever.  So,
    component by component,

        v_p -= r w_p (v_p - Σ_i S_ip v_i),    w_p = Σ_i S_ip over nodes i of known motion,

    which leaves a velocity that is linear in space as it is.  ``taken`` (1,), J, is the energy that
    this has taken off the points of all ranks.  All of it at once takes energy off
    waves at a support: r = min(1, ``rate`` Δt), ``rate`` (1/s) once in ``TRANSITS`` times that a
    wave takes through a cell.
    """

    def __init__(self, motion: Motion, rate: float, lattice: Lattice):
        grid, self.motion, self.rate = motion.grid, motion, rate
        self.known, self.taken, self._now = np.zeros((grid.nodes, grid.dim)), np.zeros(1), 0.0
        for dofs in (*motion.at_rest, *(known.dofs for known in motion.moved)):
            self.known.reshape(-1)[dofs] = 1.0
        at = self.known.any(axis=1)[lattice.nodes].any(axis=1)
        self._near = lattice.spread(at)  # support domains reach into the next cell

    def take_up(
        self, velocity: np.ndarray, mass: np.ndarray, stencil: Stencil, end: np.ndarray
    ) -> None:
        """Change velocities (n, dim) of the points of a stencil, of ``mass`` (n,), kg; ``end``
        (nodes, dim): those at the end of the step."""
        grid, rate = self.motion.grid, min(1.0, self.rate * self.motion.stepping.dt)
        where = self._near, stencil.cell
        taken = _take_up(
            (grid.axes, stencil.reach),
            where,
            stencil.weights,
            (self.known, end),
            velocity,
            mass,
            rate,
        )
        self._now += taken

    def add_up(self) -> None:
        """Count what the step has taken, on all ranks.  Collective."""
        self.taken += of_all(self.motion.grid.comm, self._now)
        self._now = 0.0


@jit
def _take_up(layout, where, weights, nodal, velocity, mass, rate):
    """v_p -= r w_p (v_p - Σ_i S_ip v_i), w_p = Σ_i S_ip of known motion; returns the energy (J)
    that this takes.

    ``layout`` (axes, reach); ``where`` (near (cells,), cell (n,)): points elsewhere are left as
    they are; ``nodal`` (known, end), (nodes, dim) each.
    """
    axes, reach = layout
    near, cell = where
    around, first, line = weights
    known, end = nodal
    dim, n, taken = len(axes), len(reach), 0.0
    for p in range(len(first)):
        if not near[cell[p]]:
            continue
        for d in range(dim):
            share = there = 0.0
            for k in range(n if dim == 3 else 1):
                for j in range(n):
                    across = line[p, 1, j] * (line[p, 2, k] if dim == 3 else 1.0)
                    for i in range(n):
                        w = across * line[p, 0, i]
                        node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                        share += w * known[node, d]
                        there += w * end[node, d]
            before = velocity[p, d]
            now = before - rate * share * (before - there)
            velocity[p, d] = now
            taken += 0.5 * mass[p] * (before * before - now * now)
    return taken


@jit
def _divide(nodal):
    """Divide nodal values (nodes, f) by the first of them, mass; zero where there is none."""
    for i in range(len(nodal)):
        share = 1.0 / nodal[i, 0] if nodal[i, 0] > 0.0 else 0.0
        for f in range(nodal.shape[1]):
            nodal[i, f] *= share


@jit
def _sharpen(divided, smooth, nodal):
    """Add to nodal values (nodes, f) what the averages ``smooth``, their mass first, lack of the
    ``divided`` ones."""
    for i in range(len(nodal)):
        if smooth[i, 0] > 0.0:
            share = 1.0 / smooth[i, 0]
            for f in range(1, nodal.shape[1]):
                nodal[i, f] += divided[i, f] - share * smooth[i, f]


def trapezoidal(
    v: np.ndarray,
    a: np.ndarray,
    at_points: Callable,
    before: tuple,
    after: tuple,
    stepping: Newmark,
) -> None:
    """Points carry their acceleration: v += Δt ((1 - γ) a + γ a₁(x_p)), γ = ½ unless asked, then a
    = a₁(x_p)."""
    a_end = at_points(after[1])
    v += stepping.dt * ((1.0 - stepping.gamma) * a + stepping.gamma * a_end)
    a[:] = a_end


def flip(
    v: np.ndarray,
    a: np.ndarray,
    at_points: Callable,
    before: tuple,
    after: tuple,
    stepping: Newmark,
) -> None:
    """Points take the grid's change of velocity: v += (v₁ − v₀)(x_p), and its acceleration."""
    v += at_points(after[0] - before[0])
    a[:] = at_points(after[1])
