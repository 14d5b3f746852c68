"""A smooth rigid strip is pressed into weightless cohesive soil: Prandtl's problem.

Its settlement is given, on von Mises soil without softening: in plane strain that flows at a shear
stress of q/√3 = c, and the strip carries (2 + π) c (Prandtl 1921), ``EXACT``.  One symmetric half;
rollers at the sides, base fixed.  The soil is stiff on purpose (E = 10⁵ c): the strip collapses
within 0.8 mm of settlement on 1 m of half-width, so that the exact answer, which knows no change of
geometry, holds for points that move.  Units: m, s, kg, Pa.

    strip = Strip(poisson=0.49)
    run = strip.material_points(replace(DM_GC, b_bar=True))
    run.until(1.0)
    strip.load(run) / strip.cohesion - EXACT
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

EXACT = 2.0 + np.pi
"""Capacity over cohesion (-)."""


@dataclass(frozen=True)
class Strip:
    """The strip's half and its soil.

    ``half`` of the strip (m), ``width`` and ``depth`` of half the body (m); ``settlement`` (m) at
    the end, which grows with the square of time, in ``steps``; ``young``, ``cohesion`` (Pa);
    ``cell`` (m) beside the strip's edge, growing by ``growth`` from cell to cell.
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

    @property
    def soil(self) -> mpm.VonMises:
        """Soil of constant cohesion."""
        return mpm.VonMises(
            mpm.LinearElastic(self.young, self.poisson, 2000.0),
            peak=self.cohesion,
            residual=self.cohesion,
            softening=0.0,
        )

    def away(self, length: float) -> np.ndarray:
        """Grid lines from 0 to ``length`` (m), cells growing from about ``cell``."""
        growth = self.growth
        count = int(np.ceil(np.log1p(length * (growth - 1.0) / self.cell) / np.log(growth)))
        lines = np.append(0.0, np.cumsum(growth ** np.arange(count)))
        return length * lines / lines[-1]

    def grid(self) -> mpm.Grid:
        """Cells that are smallest at the strip's edge; its facets are "strip"."""
        half = self.half
        x = np.append(half - self.away(half)[::-1], half + self.away(self.width - half)[1:])
        y = self.depth - self.away(self.depth)[::-1]
        return mpm.Grid.rectilinear(
            [x, y], {"strip": lambda p: (p[1] > self.depth - 1e-9) & (p[0] < half + 1e-9)}
        )

    def terms(self, grid: mpm.Grid) -> list:
        """The scene."""
        return [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.Fixed(grid.facets("bottom")),
            mpm.Fixed(grid.facets("strip"), "y", lambda t: -self.settlement * t**2),
        ]

    def finite_elements(self, **options) -> mpm.FiniteElements:
        """The twin; ``options`` of ``FiniteElements``."""
        grid = self.grid()
        return mpm.FiniteElements(
            grid, self.soil, mpm.QuasiStatic(self.steps), self.terms(grid), **options
        )

    def material_points(self, mapping: mpm.Mapping = mpm.DM_GC, **options) -> mpm.Simulation:
        """Material points, four a cell; ``options`` of ``Simulation``."""
        grid = self.grid()
        points = mpm.MaterialPoints.fill(grid, self.soil, per_cell=4)
        return mpm.Simulation(
            grid, points, mpm.QuasiStatic(self.steps), self.terms(grid), mapping, **options
        )

    def load(self, run: mpm.Simulation | mpm.FiniteElements) -> float:
        """Mean pressure under the strip (Pa), read off the stresses by virtual work: w = y/H is
        zero at the base and 1 at the top, where only the strip pushes, so that it carries
        ∫ σ_yy dV / H."""
        if run.bodies:
            (points,) = run.bodies
            work = points.volume @ points.stress[:, 1]
        else:
            work = run.grid.lattice.volume @ run.stress(np.arange(run.grid.cells))[:, 1]
        return -work / (self.depth * self.half)
