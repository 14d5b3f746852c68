"""Bodies that are no rectangles on grid lines, at rest under gravity, and then released onto
dashpots.

Exact: a base bears the weight (``borne`` is 1 along gravity), and nothing moves at the release and
after (``fastest`` is 0).  Units: m, s, kg, Pa.

    rest = AtRest("slope", 0.15, DM_GC)
    run = rest.release()
    run.until(0.1)
    rest.borne(), rest.fastest()
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
WEAK, WEAK_BLOCK = (mpm.VonMises(SOIL, peak, 2 / 3 * peak, softening=20e3) for peak in (6e3, 12e3))
"""2 m of soil yield at the foot; a block with free sides, which of the first collapses, of the
second."""
G, H, CELLS = 9.81, 0.25, 8
HEIGHT = CELLS * H
SPEED = G * HEIGHT / SOIL.p_speed  # of a wave that takes all the weight off the base
BODIES = {  # what is inside, in cells; cells across; and walls
    "slope": (lambda x, y: x + y < 12, 12, ["left"]),
    "step": (lambda x, y: (x < 6) | (y < 4), 12, ["left", "right"]),
    "embankment": (lambda x, y: (x + y < 20) & (x - y > 2), 22, []),
    "block": (lambda x, y: (x > 4) & (x < 10), 14, []),
}


class AtRest:
    """A body of ``BODIES`` whose grid's lines, but for those of base and walls, lie ``offset`` of a
    cell aside.

    ``base``: the components that are fixed there, all by default.  In 3D it is two cells deep
    between rollers.
    """

    def __init__(
        self,
        name: str,
        offset: float,
        mapping: mpm.Mapping,
        soil=SOIL,
        base: str | None = None,
        dim: int = 2,
    ):
        shape, self.across, self.walls = BODIES[name]
        self.mapping, self.soil, self.offset, self.dim = mapping, soil, offset, dim
        upper = [self.across * H, HEIGHT, 2 * H][:dim]
        place = mpm.Grid.box([0] * dim, upper, [self.across, CELLS, 2][:dim])
        self.body = mpm.MaterialPoints.fill(
            place, soil, 2**dim, inside=lambda x: shape(x[0] / H, x[1] / H)
        )
        grid = self.grid(0)
        self.supports = {"bottom": base, **dict.fromkeys(self.walls, "x")}
        self.static = mpm.Simulation(
            grid,
            self.body,
            mpm.QuasiStatic(1),
            [
                mpm.Gravity((0.0, -G, 0.0)[:dim]),
                *self.rollers(grid),
                *(mpm.Fixed(grid.facets(side), axes) for side, axes in self.supports.items()),
            ],
            mapping,
        )
        self.static.step()
        self.left = self.static.settle()

    def grid(self, room: int) -> mpm.Grid:
        """Lines of the grid; with ``room`` there are so many cells more below and beside the
        walls."""
        n, lines = self.across, []
        for count, wall in ((n, "right" in self.walls), (CELLS, False)):
            inner = (np.arange(1, count + (0 if wall else 2)) + self.offset) * H
            end = [count * H] if wall else []
            lines.append(np.concatenate(([0.0], inner, end)))
        before, after = -H * np.arange(room, 0, -1), H * np.arange(1, room + 1)
        lines = [np.concatenate((before, line, line[-1] + after)) for line in lines]
        return mpm.Grid.rectilinear([*lines, H * np.arange(3)][: self.dim])

    def rollers(self, grid: mpm.Grid) -> list:
        """What keeps a body in 3D between its two sides."""
        return [mpm.Fixed(grid.facets("back", "front"), "z")] if self.dim == 3 else []

    def release(self, dt: float = 1e-3) -> mpm.Simulation:
        """The same body between dashpots which bear what the fixed edges bore, steps of dt (s)."""
        surfaces = [self.body.surface("bottom", where=lambda x: x[1] < 1e-6 * H)]
        for wall in self.walls:
            at = 0.0 if wall == "left" else self.across * H
            surfaces.append(
                self.body.surface(wall, where=lambda x, at=at: np.abs(x[0] - at) < 1e-6 * H)
            )
        carried = self.static.reactions(*surfaces)
        grid = self.grid(3)
        return mpm.Simulation(
            grid,
            self.body,
            mpm.Newmark(dt),
            [
                mpm.Gravity((0.0, -G, 0.0)[: self.dim]),
                *carried,
                *(mpm.ViscousBoundary(on, SOIL) for on in surfaces),
                *self.rollers(grid),
            ],
            self.mapping,
        )

    def borne(self) -> np.ndarray:
        """What the base bears of the weight, and both walls together of what is pushed against
        them (dim,).  Collective."""
        comm, force = self.static.grid.comm, self.static.balance()[0].reshape(-1, self.dim)
        return comm.allreduce(force.sum(axis=0)) / (G * comm.allreduce(self.body.mass.sum()))

    def fastest(self) -> float:
        """Largest velocity of all ranks, of ``SPEED``.  Collective."""
        here = float(np.abs(self.body.velocity).max(initial=0.0))
        return self.static.grid.comm.allreduce(here, op=MPI.MAX) / SPEED
