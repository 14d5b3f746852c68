"""A basin of soft soil in rock, and a shear wave that comes up below it.

Soil lies in level rock, round in plan, with a level bottom and edges that rise to the surface; a
vertical SV wave, Ricker's pulse of velocity, comes up from the half-space below and moves along x.
Base and sides absorb; the sides bear the free field of rock.  Above the middle the ground moves as
level layers do, exactly (``level``), until waves that the edges have made arrive, of which no
column knows.  The soil fills whole cells (``thickness``).  Units: m, s, kg, Pa.

    scene = Basin()
    run = scene.finite_elements()
    watch = run.record(Surface(scene))
    run.until(scene.end)
    watch.peaks() / scene.outcrop
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

from ..analytical.site_response import HalfSpace, Layer, LayeredGround

SIDES = "left", "right", "back", "front"

rock = mpm.LinearElastic(young=1.5e9, poisson=0.25, density=2200.0)
soil = mpm.LinearElastic(young=50e6, poisson=0.3, density=1800.0)


@dataclass(frozen=True)
class Basin:
    """The basin, the box of rock around it and the wave.

    ``radius`` (m) of the soil at the surface, its ``depth`` (m) and the width (m) of its ``edge``,
    over which it rises from there; ``cell`` (m), across and down; the box is ``width`` (m) from
    side to side and ``height`` (m) deep.  ``peak``: velocity (m/s) of the wave that
    comes up; its spectrum is largest at ``frequency`` (Hz), by default that of the soil's first
    mode in the middle, were it level.  ``ratio``: damping of the soil, Rayleigh's, at the frequency
    and at three times it; 0 for none.  ``filled``: whether there is soil, or rock alone.
    ``steps`` and ``periods``: of time, in a period, and in all.
    Raises ``ValueError`` for a basin that does not fit into its box.
    """

    radius: float = 40.0
    depth: float = 10.0
    edge: float = 8.0
    cell: tuple[float, float] = (2.0, 2.0)
    width: float = 104.0
    height: float = 16.0
    peak: float = 0.1
    frequency: float | None = None
    ratio: float = 0.03
    filled: bool = True
    steps: int = 40
    periods: float = 6.0

    def __post_init__(self) -> None:
        if self.frequency is None:
            object.__setattr__(self, "frequency", soil.s_speed / (4.0 * self.depth))
        across, down = self.cell
        room = 0.5 * self.width - self.radius, self.height - self.depth
        if room[0] < across or room[1] < down:
            raise ValueError(
                f"radius = {self.radius:g} m and depth = {self.depth:g} m leave {room[0]:g} m and "
                f"{room[1]:g} m of rock in a box of {self.width:g} m × {self.height:g} m: leave a "
                "cell or more"
            )
        for name, size, cell in (("width", self.width / 2, across), ("height", self.height, down)):
            if abs(size / cell - round(size / cell)) > 1e-9:
                raise ValueError(
                    f"{name} must be made of whole cells of {cell:g} m, half of the width too, got "
                    f"{getattr(self, name):g} m"
                )

    @property
    def step(self) -> float:
        """Of time (s)."""
        return 1.0 / (self.steps * self.frequency)

    @property
    def end(self) -> float:
        """Of the run (s)."""
        return self.periods / self.frequency

    @property
    def outcrop(self) -> float:
        """Largest velocity (m/s) of the surface of rock alone."""
        return 2.0 * self.peak

    @property
    def motion(self) -> mpm.Waveform:
        """Of the wave that comes up, at the base: its middle is there after 1.3 periods."""
        return mpm.Waveform.ricker(self.frequency, self.peak, 1.3 / self.frequency)

    # -- the ground ------------------------------------------------------------------------------

    def thickness(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Depth (m) of the soil below places of the surface, of whole cells."""
        across, down = self.cell
        centre = [(np.floor(np.asarray(a, float) / across) + 0.5) * across for a in (x, z)]
        share = np.clip((self.radius - np.hypot(*centre)) / self.edge, 0.0, 1.0)
        return self.filled * down * np.round(self.depth * share / down)

    def is_soil(self, x: np.ndarray) -> np.ndarray:
        """Which places x (3, n), m, are of soil."""
        return x[1] > -self.thickness(x[0], x[2])

    @property
    def materials(self) -> list:
        """Pairs (material, where)."""
        return [(soil, self.is_soil), (rock, lambda x: ~self.is_soil(x))]

    @property
    def damping(self) -> mpm.RayleighDamping | None:
        """Of the soil."""
        if not (self.ratio and self.filled):
            return None
        f = self.frequency
        return mpm.RayleighDamping(self.ratio, (f, 3.0 * f), material=soil)

    def grid(self) -> mpm.Grid:
        """The box: its surface at y = 0, the middle of the basin at x = z = 0."""
        half = 0.5 * self.width
        across, down = round(self.width / self.cell[0]), round(self.height / self.cell[1])
        low, high = (-half, -self.height, -half), (half, 0.0, half)
        return mpm.Grid.box(low, high, (across, down, across))

    def base(self, grid: mpm.Grid) -> list:
        """Rock below, and the wave that comes up through it."""
        on = grid.facets("bottom")
        return [mpm.ViscousBoundary(on, rock), mpm.IncidentWave(on, rock, self.motion)]

    def terms(self, grid: mpm.Grid) -> list:
        """The base, sides that bear the free field of rock, and damping."""
        found = self.base(grid)
        for side in SIDES:
            on = grid.facets(side)
            found += [mpm.ViscousBoundary(on, rock), mpm.FreeField(on, rock, self.base)]
        damping = self.damping
        return found if damping is None else [*found, damping]

    def finite_elements(self, **options) -> mpm.FiniteElements:
        """The run on the grid's cells."""
        grid, material = self.grid(), self.materials if self.filled else rock
        return mpm.FiniteElements(
            grid, material, mpm.Newmark(self.step), self.terms(grid), **options
        )

    def material_points(self, mapping=mpm.DM_GC, **options) -> mpm.Simulation:
        """The same with eight material points a cell."""
        grid, pairs = self.grid(), self.materials if self.filled else [(rock, lambda x: x[1] < 0)]
        bodies = [mpm.MaterialPoints.fill(grid, law, 8, inside=where) for law, where in pairs]
        return mpm.Simulation(
            grid, bodies, mpm.Newmark(self.step), self.terms(grid), mapping=mapping, **options
        )

    # -- what is known ---------------------------------------------------------------------------

    def level(self, thickness: float, times: np.ndarray) -> np.ndarray:
        """Velocity (n,), m/s, of the surface at ``times`` (s), equal steps from 0, of level soil so
        thick (m) on the same rock: exact."""
        times = np.asarray(times, float)
        below = HalfSpace(rock.density, rock.s_speed)
        if thickness == 0.0:
            return 2.0 * self.motion.velocity(times - self.height / rock.s_speed)
        damping = self.damping
        α, β = (damping.alpha, damping.beta) if damping else (0.0, 0.0)
        layer = Layer(soil.density, soil.s_speed, 0.0, α, β, thickness=thickness)
        # the wave comes by at the foot of the soil
        up = self.motion.velocity(times - (self.height - thickness) / rock.s_speed)
        ground = LayeredGround((layer,), below)
        return ground.motion_at(0.0, up, times[1] - times[0], kind="up-going")[: len(times)]

    def arrival(self, x: float = 0.0, z: float = 0.0) -> float:
        """Time (s) at which P waves in soil, begun where the level part ends as the pulse begins,
        0.7 periods before its middle, can be at a place (m) of the level part."""
        way = max(self.radius - self.edge - float(np.hypot(x, z)), 0.0)
        return 0.6 / self.frequency + self.height / rock.s_speed + way / soil.p_speed


class Surface:
    """Recorder of the velocity of all nodes of the surface: ``times`` (n,), s, ``x`` (m, 3), m, and
    ``values`` (n, m, 3), m/s.  For one rank."""

    def __init__(self, scene: Basin):
        self.scene, self._times, self._values = scene, [], []

    def attach(self, run) -> None:
        """Find the nodes."""
        x = run.grid.space.tabulate_dof_coordinates()
        self._nodes = np.flatnonzero(x[:, 1] > -1e-9)
        self.x = x[self._nodes]

    def __call__(self, run) -> None:
        """Take what they do now."""
        self._times.append(run.time)
        self._values.append(run.nodal("velocity")[self._nodes].copy())

    @property
    def times(self) -> np.ndarray:
        """Times (n,), s."""
        return np.array(self._times)

    @property
    def values(self) -> np.ndarray:
        """Velocities (n, m, 3), m/s."""
        return np.array(self._values)

    def at(self, x: float, z: float) -> np.ndarray:
        """Velocity (n, 3), m/s, of the node nearest to a place (m)."""
        return self.values[:, ((self.x[:, [0, 2]] - (x, z)) ** 2).sum(axis=1).argmin()]

    def peaks(self, component: int | None = 0) -> np.ndarray:
        """Largest velocity (m,), m/s, of each node: along x, or of another component."""
        return np.abs(self.values[:, :, component]).max(axis=0)

    def on_lattice(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lines of x (k,) and z (k,), m, and ``values`` (m,) of nodes as rows of z, columns of
        x."""
        order = np.lexsort(np.round(self.x[:, [0, 2]].T, 6))
        lines = [np.unique(np.round(self.x[:, d], 6)) for d in (0, 2)]
        return *lines, np.asarray(values)[order].reshape(len(lines[1]), len(lines[0]))
