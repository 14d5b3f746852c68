"""A slope of 1:2 in Mohr-Coulomb soil: how much less strength it would stand, and where it runs to
with less.

The first example of Griffiths and Lane (Géotechnique 49, 1999): c = 0.05 γ H, φ = 20°, ψ = 0, on a
firm base, crest 1.2 H wide; H = 10 m here.  Strength is reduced to c/F and tan φ/F; they find a
factor of safety of 1.4, limit equilibrium 1.38.  ``stands(F)`` is the static run under its weight,
and ``collapse(F)`` the dynamic one at finite strain, when strength drops to what F says at once.
Units: m, s, kg, Pa.

    slope = FailingSlope()
    slope.movement(1.3), slope.movement(1.45)
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, degrees, radians, tan

import numpy as np

import mpm_fenicsx as mpm

G = 9.81
FACTOR = 1.4
"""Of safety, after Griffiths and Lane."""
FAILS = 1.0
"""E d/γH² beyond which the slope is said to have failed: twice that of one that stands easily."""


@dataclass(frozen=True)
class FailingSlope:
    """The slope and its soil.

    ``cell`` (m); ``height`` H (m); ``unit_weight`` γ (N/m³); ``cohesion`` (Pa), ``friction_angle``
    and ``dilation_angle`` (degrees); ``young`` (Pa), ``poisson``; ``steps`` in which the static
    run applies the weight.
    """

    cell: float = 1.0
    height: float = 10.0
    unit_weight: float = 20e3
    cohesion: float = 10e3
    friction_angle: float = 20.0
    dilation_angle: float = 0.0
    young: float = 1e8
    poisson: float = 0.3
    steps: int = 10

    @property
    def toe(self) -> float:
        """Where the slope meets the base (m)."""
        return 3.2 * self.height

    def soil(self, factor: float, elastic=mpm.LinearElastic) -> mpm.MohrCoulomb:
        """With its strength divided by ``factor``, at small strain or on ``Hencky``."""
        friction = degrees(atan(tan(radians(self.friction_angle)) / factor))
        density = self.unit_weight / G
        return mpm.MohrCoulomb(
            elastic(self.young, self.poisson, density),
            self.cohesion / factor,
            friction,
            self.dilation_angle,
        )

    def inside(self, x: np.ndarray) -> np.ndarray:
        """Whether places x (2, n) lie in the slope (n,), bool."""
        return x[1] < np.minimum(self.height, 0.5 * (self.toe - x[0]))

    def grid(self, room: float = 0.2) -> mpm.Grid:
        """Cells of the slope, with ``room`` (in H) beyond its toe and a row above its crest."""
        h = self.cell
        counts = round((self.toe + room * self.height) / h), round(self.height / h) + 1
        return mpm.Grid.box((0.0, 0.0), (counts[0] * h, counts[1] * h), counts)

    def supports(self, grid: mpm.Grid) -> list[mpm.Fixed]:
        """Rollers behind, and a rough base."""
        return [mpm.Fixed(grid.facets("left"), "x"), mpm.Fixed(grid.facets("bottom"))]

    def stands(self, factor: float, mapping: mpm.Mapping = mpm.DM_GC) -> mpm.Simulation:
        """The static run under the weight, applied in ``steps``, points cut along the slope."""
        grid = self.grid()
        points = mpm.MaterialPoints.fill(grid, self.soil(factor), 4, inside=self.inside, cut=True)
        weight = mpm.Gravity(lambda t: (0.0, -G * t))
        return mpm.Simulation(
            grid, points, mpm.QuasiStatic(self.steps), [*self.supports(grid), weight], mapping
        )

    def movement(self, factor: float, mapping: mpm.Mapping = mpm.DM_GC) -> float:
        """E d/γH² (-) of the largest displacement d under the weight; infinite where there is no
        equilibrium."""
        run = self.stands(factor, mapping)
        (points,) = run.bodies
        start = points.x.copy()
        try:
            run.until(1.0)
        except mpm.RunError:
            return np.inf
        d = np.linalg.norm(points.x - start, axis=1).max()
        return float(d * self.young / (self.unit_weight * self.height**2))

    def factor_of_safety(
        self, factors: tuple[float, ...] = (1.3, 1.35, 1.4, 1.45, 1.5), **options
    ) -> tuple[float, float]:
        """The last of ``factors`` (increasing) that the slope stands, and the first that it does
        not."""
        for before, factor in zip((0.0, *factors), factors, strict=False):
            if self.movement(factor, **options) > FAILS:
                return before, factor
        raise ValueError(f"factors must end where the slope fails, got {factors}")

    def collapse(
        self, factor: float, dt: float = 0.01, room: float = 3.0, **options
    ) -> mpm.Simulation:
        """The dynamic run after strength has dropped to that of ``factor``: stress that the weaker
        soil cannot bear is returned to its yield surface, and what is out of balance moves it."""
        static = self.stands(1.0)
        static.until(1.0)
        static.settle(1e-8)
        rest, weak = static.bodies[0], self.soil(factor)
        stress, _ = weak.respond(np.zeros_like(rest.stress), rest.stress, np.zeros((len(rest), 2)))
        points = mpm.MaterialPoints(
            self.soil(factor, mpm.Hencky),
            rest.x.copy(),
            rest.half.copy(),
            rest.volume.copy(),
            stress,
        )
        grid = self.grid(room)
        terms = [*self.supports(grid), mpm.Gravity((0.0, -G))]
        return mpm.Simulation(grid, points, mpm.Newmark(dt), terms, **options)

    def run_out(self, points: mpm.MaterialPoints) -> float:
        """How far beyond the old toe 99 % of the mass lies within (m)."""
        order = np.argsort(points.x[:, 0])
        mass = np.cumsum(points.mass[order]) / points.mass.sum()
        return float(points.x[order, 0][np.searchsorted(mass, 0.99)] - self.toe)
