"""A pressure or shear pulse runs down a column in three dimensions, on a fixed, viscous or
viscoelastic base.

The column of ``scenes.column`` with a square section.  The P wave runs between rollers; the S
wave, whose motion is horizontal and oblique to the cells, between walls that hold it vertically and
let it slip sideways.  Either is one-dimensional, and d'Alembert's answer (``analytical.column``) is
exact for it at small strain.  Units: m, s, kg, Pa.

    scene = Column3D("S", "viscous")
    run = scene.material_points()
    watch = Watch(run, scene)
    run.until(end)
    watch.errors()
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

from ..analytical.column import Column
from ..analytical.waves import relative_error
from .column import BASES, PLACES, end, height, pulse, radius, soil

WAVES = ("P", "S")
LOADS = {"P": 300e3, "S": 0.3e3}
"""Largest traction (Pa): the paper's pressure, under which points cross cells; and a shear under
which they stay near the walls of the grid, for these do not go with the body."""

width = 1.0
oblique = np.radians(30.0)
DIRECTIONS = {
    "P": np.array([0.0, -1.0, 0.0]),
    "S": np.array([np.cos(oblique), 0.0, np.sin(oblique)]),
}
"""Of the load and the motion."""

__all__ = ["BASES", "DIRECTIONS", "LOADS", "WAVES", "Column3D", "Watch", "end", "height"]


@dataclass(frozen=True)
class Column3D:
    """The column on one kind of base, under one kind of wave.

    ``wave``: "P" or "S"; ``base``: one of ``BASES``; ``load`` (Pa) at most, by default that of
    ``LOADS``; ``cell`` (m), ``step`` (s); ``history`` (t, load): the traction (Pa).
    """

    wave: str
    base: str
    load: float | None = None
    cell: float = 0.5
    step: float = 2e-3
    history: Callable = pulse

    def __post_init__(self) -> None:
        if self.load is None:
            object.__setattr__(self, "load", LOADS[self.wave])

    @property
    def direction(self) -> np.ndarray:
        """Unit vector (3,) of load and motion."""
        return DIRECTIONS[self.wave]

    @property
    def speed(self) -> float:
        """Of the wave (m/s)."""
        return soil.p_speed if self.wave == "P" else soil.s_speed

    @property
    def impedance(self) -> float:
        """ρc (Pa s/m)."""
        return soil.density * self.speed

    def along(self, field: str, rows: np.ndarray) -> np.ndarray:
        """What the exact answer speaks of (n,): motion along ``direction``, or the traction
        d·σ·e_y, Pa, that goes down with it, of rows (n, 3) or, of stress, (n, 6)."""
        if field != "stress":
            return rows @ self.direction
        return rows[:, [3, 1, 4]] @ self.direction  # xy, yy, yz

    def terms(self, surface: Callable, grid: mpm.Grid) -> list:
        """The scene; ``surface`` gives facets to finite elements and surface points to material
        points."""
        walls = grid.facets("left", "right"), grid.facets("back", "front")
        foot = {
            "fixed": lambda: mpm.Fixed(grid.facets("bottom")),
            "viscous": lambda: mpm.ViscousBoundary(surface("bottom"), soil),
            "viscoelastic": lambda: mpm.ViscoelasticBoundary(surface("bottom"), soil, radius),
        }
        return [
            *(
                mpm.Fixed(wall, across if self.wave == "P" else "y")
                for wall, across in zip(walls, "xz", strict=True)
            ),
            mpm.Traction(
                surface("top"), lambda t: tuple(float(self.history(t, self.load)) * self.direction)
            ),
            foot[self.base](),
        ]

    def grid(self, below: float = 0.0, above: float = 0.0) -> mpm.Grid:
        """Cells of ``cell``, with room (m) below and above the column."""
        across = round(width / self.cell)
        rows = round((height + below + above) / self.cell)
        return mpm.Grid.box(
            (0.0, -below, 0.0), (width, height + above, width), (across, rows, across)
        )

    def finite_elements(self, **options) -> mpm.FiniteElements:
        """The twin; ``options`` of ``FiniteElements``."""
        grid = self.grid()
        terms = self.terms(grid.facets, grid)
        return mpm.FiniteElements(grid, soil, mpm.Newmark(self.step), terms, **options)

    def material_points(
        self, mapping: mpm.Mapping = mpm.DM_GC, per_cell: int = 8, **options
    ) -> mpm.Simulation:
        """Material points, with a metre of room above and, for an absorbing base to drift, below;
        ``options`` of ``Simulation``."""
        grid = self.grid(0.0 if self.base == "fixed" else 1.0, 1.0)
        points = mpm.MaterialPoints.fill(
            grid, soil, per_cell, inside=lambda x: (x[1] > 0.0) & (x[1] < height)
        )
        terms = self.terms(points.surface, grid)
        return mpm.Simulation(grid, points, mpm.Newmark(self.step), terms, mapping, **options)

    def answer(self, until: float = end) -> Column:
        """The exact column, at small strain, up to a time (s)."""
        G = soil.lame[1]
        spring = 2 * G / radius if self.wave == "P" else G / (2 * radius)
        return Column(
            height,
            self.speed,
            soil.density,
            lambda t: self.history(t, self.load),
            until,
            self.base == "fixed",
            spring if self.base == "viscoelastic" else 0.0,
        )


class Watch:
    """Traction (Pa) and displacement (m) of a run at mid-height, base and top, along the load,
    beside the exact ones; and the wave that comes up at mid-height."""

    def __init__(self, run, scene: Column3D, until: float = end):
        self.scene, self.exact = scene, scene.answer(until)
        middle = width / 2
        self.probes = {
            name: run.record(mpm.Probe(field, (middle, height - depth, middle)))
            for name, (field, depth) in PLACES.items()
        }
        self._velocity = run.record(mpm.Probe("velocity", (middle, height / 2, middle)))

    @property
    def times(self) -> np.ndarray:
        """When it looked (s): at the start and after each step."""
        return self._velocity.times

    def pairs(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """What was found and what is known, at all times."""
        known = {"stress": self.exact.pressure, "displacement": self.exact.displacement}
        return {
            name: (
                self.scene.along(field, self.probes[name].values),
                known[field](depth, self.times),
            )
            for name, (field, depth) in PLACES.items()
        }

    def upward(self) -> tuple[np.ndarray, np.ndarray]:
        """Traction (Pa) of the wave that comes up at mid-height, ½ (Z v − σ), found and known: what
        the base sends back, and what of this comes back again from the top and the base."""
        Z, depth = self.scene.impedance, height / 2
        found = Z * self.scene.along("velocity", self._velocity.values)
        known = Z * self.exact.velocity(depth, self.times)
        stress = self.pairs()["pressure_mid"]
        return 0.5 * (found - stress[0]), 0.5 * (known - stress[1])

    def errors(self) -> dict[str, float]:
        """Relative L2 over time."""
        return {f"error_{name}": relative_error(*pair) for name, pair in self.pairs().items()}
