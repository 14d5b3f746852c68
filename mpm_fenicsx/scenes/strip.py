"""A smooth rigid strip is pressed into weightless soil: the problems of Prandtl and Reissner.

Its settlement is given.  Von Mises soil without softening flows in plane strain at a shear stress
of q/√3 = c, and the strip carries (2 + π) c (Prandtl 1921), ``EXACT``; Mohr-Coulomb soil beside
which there is a surcharge p carries c N_c + p N_q (Reissner 1924).  One symmetric half; rollers at
the sides, base fixed.  The soil is stiff on purpose (E = 10⁵ c): the strip collapses within 0.8 mm
of settlement on 1 m of half-width (with friction it needs a few times as much), so that the exact
answer, which knows no change of geometry, holds for points that move.  Units: m, s, kg, Pa.

    strip = Strip(poisson=0.49)
    run = strip.material_points(replace(DM_GC, b_bar=True))
    run.until(1.0)
    strip.load(run) / strip.cohesion - EXACT

    strip = cohesive_strip(friction_angle=20.0, dilation_angle=20.0)
    run = strip.material_points()
    run.until(1.0)
    strip.load(run) / strip.capacity - 1.0
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import mpm_fenicsx as mpm

from ..analytical.bearing_capacity import bearing_capacity

EXACT = 2.0 + np.pi
"""Capacity over cohesion (-)."""


@dataclass(frozen=True)
class Strip:
    """The strip's half and its soil.

    ``half`` of the strip (m), ``width`` and ``depth`` of half the body (m); ``settlement`` (m) at
    the end, which grows with the square of time, in ``steps``; ``young``, ``cohesion`` (Pa);
    ``cell`` (m) beside the strip's edge, growing by ``growth`` from cell to cell.
    ``friction_angle`` and ``dilation_angle`` (degrees) of Mohr-Coulomb soil, 0 for that of von
    Mises; ``surcharge`` (Pa) beside the strip, which is also the isotropic pressure at the start.
    ``ends_in_cell``: the strip ends in the middle of a cell and not on a grid line.  Its motion
    fades within a cell, so that on a grid line it is wider than ``half`` by half a cell.
    """

    poisson: float
    cell: float = 0.05
    half: float = 1.0
    width: float = 5.0
    depth: float = 3.0
    young: float = 1e9
    cohesion: float = 10e3
    settlement: float = 0.8e-3
    steps: int = 30
    growth: float = 1.15
    friction_angle: float = 0.0
    dilation_angle: float = 0.0
    surcharge: float = 0.0
    ends_in_cell: bool = False

    @property
    def soil(self) -> mpm.VonMises | mpm.MohrCoulomb:
        """Soil of constant strength."""
        elastic = mpm.LinearElastic(self.young, self.poisson, 2000.0)
        if self.friction_angle:
            return mpm.MohrCoulomb(elastic, self.cohesion, self.friction_angle, self.dilation_angle)
        return mpm.VonMises(elastic, peak=self.cohesion, residual=self.cohesion, softening=0.0)

    @property
    def capacity(self) -> float:
        """Pressure (Pa) that the strip bears, c N_c + p N_q; exact where flow is associated."""
        return bearing_capacity(self.cohesion, self.friction_angle, self.surcharge)

    def at_rest(self, x: np.ndarray) -> np.ndarray:
        """Stress rows (n, 4), Pa, at the start at x (2, n): the surcharge from all sides."""
        return np.tile([-self.surcharge, -self.surcharge, -self.surcharge, 0.0], (x.shape[1], 1))

    def away(self, length: float) -> np.ndarray:
        """Grid lines from 0 to ``length`` (m), cells growing from about ``cell``."""
        growth = self.growth
        count = int(np.ceil(np.log1p(length * (growth - 1.0) / self.cell) / np.log(growth)))
        lines = np.append(0.0, np.cumsum(growth ** np.arange(count)))
        return length * lines / lines[-1]

    def grid(self) -> mpm.Grid:
        """Cells that are smallest at the strip's edge; its facets are "strip"."""
        near = 0.5 * self.cell if self.ends_in_cell else 0.0
        half, beyond = self.half - near, self.half + near
        right = beyond + self.away(self.width - beyond)
        x = np.append(half - self.away(half)[::-1], right if self.ends_in_cell else right[1:])
        y = self.depth - self.away(self.depth)[::-1]
        return mpm.Grid.rectilinear(
            [x, y],
            {
                "strip": lambda p: (p[1] > self.depth - 1e-9) & (p[0] < half + 1e-9),
                "beside": lambda p: (p[1] > self.depth - 1e-9) & (p[0] > half - 1e-9),
            },
        )

    def terms(self, grid: mpm.Grid) -> list:
        """The scene."""
        beside = [mpm.Traction(grid.facets("beside"), (0.0, -self.surcharge))]
        return [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.Fixed(grid.facets("bottom")),
            mpm.Fixed(grid.facets("strip"), "y", lambda t: -self.settlement * t**2),
            *(beside if self.surcharge else []),
        ]

    def finite_elements(self, **options) -> mpm.FiniteElements:
        """The twin; ``options`` of ``FiniteElements``."""
        grid = self.grid()
        if self.surcharge:
            options = {"stress": self.at_rest, **options}
        return mpm.FiniteElements(
            grid, self.soil, mpm.QuasiStatic(self.steps), self.terms(grid), **options
        )

    def material_points(self, mapping: mpm.Mapping = mpm.DM_GC, **options) -> mpm.Simulation:
        """Material points, four a cell; ``options`` of ``Simulation``."""
        grid = self.grid()
        stress = self.at_rest if self.surcharge else None
        points = mpm.MaterialPoints.fill(grid, self.soil, per_cell=4, stress=stress)
        return mpm.Simulation(
            grid, points, mpm.QuasiStatic(self.steps), self.terms(grid), mapping, **options
        )

    def load(self, run: mpm.Simulation | mpm.FiniteElements) -> float:
        """Mean pressure under the strip (Pa), read off the stresses by virtual work: w = y/H is
        zero at the base and 1 at the top, where the strip pushes and the surcharge, so that both
        carry ∫ σ_yy dV / H."""
        if run.bodies:
            (points,) = run.bodies
            work = points.volume @ points.stress[:, 1]
        else:
            work = run.grid.lattice.volume @ run.stress(np.arange(run.grid.cells))[:, 1]
        beside = self.surcharge * (self.width - self.half)
        return (-work / self.depth - beside) / self.half


def cohesive_strip(friction_angle: float, dilation_angle: float, **changes) -> Strip:
    """On cohesive soil with friction, which carries c N_c; ``changes`` of ``Strip``."""
    strip = Strip(
        friction_angle=friction_angle,
        dilation_angle=dilation_angle,
        **{"poisson": 0.3, "ends_in_cell": True, "growth": 1.03, **changes},
    )
    return strip if "settlement" in changes else replace(strip, settlement=_to_collapse(strip))


def surcharged_strip(friction_angle: float, dilation_angle: float, **changes) -> Strip:
    """On soil without cohesion beside 10 kPa, which carries p N_q; ``changes`` of ``Strip``."""
    chosen = {"cohesion": 0.0, "surcharge": 10e3, **changes}
    return cohesive_strip(friction_angle, dilation_angle, **chosen)


def _to_collapse(strip: Strip) -> float:
    """Settlement (m) at which the load has levelled off: four times q B/E, of half the width B."""
    return 4.0 * strip.capacity * strip.half / strip.young
