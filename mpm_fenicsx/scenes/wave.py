"""Standing P and S waves in an undamped elastic body, exact modes of it.  Units: m, s, kg, Pa.

wave = Wave("S", "diagonal", poisson=0.3, cells=10, courant=0.5)
run = wave.material_points(DM_GC)
run.until(100 * wave.dt)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

YOUNG, DENSITY = 20e6, 1500.0  # Pa, kg/m³; only Poisson's ratio and the Courant number matter
AMPLITUDE = 1e-6  # m/s, in cells of 1 m: points move by 1e-7 of a cell at most


def soil(poisson: float) -> mpm.LinearElastic:
    """Elastic soil of some Poisson's ratio."""
    return mpm.LinearElastic(YOUNG, poisson, DENSITY)


@dataclass(frozen=True)
class Wave:
    """A standing wave in a box of cells of 1 m between smooth walls, an exact mode of the elastic
    body.

    Along an axis, with k = 2π/λ and rollers where the motion is along the wall or none:

        P  v = (sin kx, 0)    u_x = 0 at x = 0, L;    u_y = 0 below and above
        S  v = (0, sin kx)    u_y = 0 at x = 0, L;    u_x = 0 below and above

    On the diagonal, with rollers all round, the sum of two plane waves along (1, ±1) and so of K =
    k√2, λ = 2π/K:

        P  v = (sin kx cos ky, cos kx sin ky)     curl v = 0
        S  v = (sin kx cos ky, -cos kx sin ky)    div v = 0

    Each gives ρ ∂²v/∂t² = -ρ K²c² v with the P or S wave's speed c, no normal velocity and no shear
    at a roller, so that T = 2π/(K c).  The rollers along an axis bear σ_xx or σ_yy = λ ∂u_x/∂x, and
    leave the rest free of stress.

    ``kind``: "P" or "S"; ``direction``: "axis" or "diagonal"; ``poisson``; ``cells`` a wavelength,
    on the diagonal the nearest that fits; ``courant`` number of the P wave; ``half_waves`` in the
    box, by default 4 along an axis, or 1 each way on the diagonal.
    """

    kind: str
    direction: str
    poisson: float
    cells: int
    courant: float
    half_waves: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "half_waves", self.half_waves or (1 if self.diagonal else 4))

    @property
    def diagonal(self) -> bool:
        """Whether it runs across the cells."""
        return self.direction == "diagonal"

    @property
    def length(self) -> int:
        """Cells of the box along x."""
        return round(self.half_waves * self.cells / (np.sqrt(2) if self.diagonal else 2))

    @property
    def k(self) -> float:
        """Wave number along x (1/m)."""
        return self.half_waves * np.pi / self.length

    @property
    def number(self) -> float:
        """Wave number K (1/m)."""
        return self.k * np.sqrt(2) if self.diagonal else self.k

    @property
    def period(self) -> float:
        """Exact period T (s)."""
        material = soil(self.poisson)
        return (
            2 * np.pi / (self.number * (material.s_speed if self.kind == "S" else material.p_speed))
        )

    @property
    def dt(self) -> float:
        """Step (s)."""
        return self.courant / soil(self.poisson).p_speed

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """The mode (n, 2), m/s, at places x (n, 2)."""
        a, b = (self.k * x[:, d] for d in range(2))
        if self.diagonal:
            sign = -1.0 if self.kind == "S" else 1.0
            v = np.sin(a) * np.cos(b), sign * np.cos(a) * np.sin(b)
        else:
            v = (np.sin(a), 0.0 * a) if self.kind == "P" else (0.0 * a, np.sin(a))
        return AMPLITUDE * np.stack(v, axis=1)

    def grid_and_walls(self) -> tuple[mpm.Grid, list[mpm.Fixed]]:
        """Along an axis the box is a cell wide, for nothing changes across it."""
        size = (self.length, self.length if self.diagonal else 1)
        grid = mpm.Grid.box((0, 0), size, size)
        ends, sides = grid.facets("left", "right"), grid.facets("bottom", "top")
        across = not self.diagonal and self.kind == "S"
        return grid, [mpm.Fixed(ends, "xy"[across]), mpm.Fixed(sides, "yx"[across])]

    def finite_elements(self) -> mpm.FiniteElements:
        """A run that begins with the mode's velocity, without stress."""
        grid, walls = self.grid_and_walls()
        run = mpm.FiniteElements(grid, soil(self.poisson), mpm.Newmark(self.dt), walls)
        nodal = run.nodal("velocity")
        nodal[:] = self.velocity(grid.space.tabulate_dof_coordinates()[: len(nodal)])
        return run

    def material_points(self, mapping: mpm.Mapping = mpm.DM_GC) -> mpm.Simulation:
        """The same, of four points a cell."""
        grid, walls = self.grid_and_walls()
        body = mpm.MaterialPoints.fill(grid, soil(self.poisson), 4)
        body.velocity = self.velocity(body.x)
        return mpm.Simulation(grid, body, mpm.Newmark(self.dt), walls, mapping)
