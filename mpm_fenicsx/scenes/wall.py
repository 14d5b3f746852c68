"""A smooth wall gives way, or is pushed, before level Mohr-Coulomb soil: Rankine's earth pressures.

A strip of soil between the wall and a smooth end, on rollers, at rest under its weight; the wall
moves as one piece by ``travel``, which makes all of the soil flow.  The stress is then linear in
the depth, and the force on the wall exact (``analytical.earth_pressure``), whatever the dilation
angle; but where flow is not associated bands may take the place of that answer.  The soil is so
stiff that it flows at a travel of 1e-4 of its height.  Units: m, s, kg, Pa.

    wall = Wall(passive=True, friction_angle=30.0)
    run = wall.finite_elements()
    run.until(1.0)
    wall.error(run)
"""

from __future__ import annotations

from dataclasses import dataclass

import mpm_fenicsx as mpm

from ..analytical.earth_pressure import active_force, passive_force

G = 9.81


@dataclass(frozen=True)
class Wall:
    """A wall that is pushed (``passive``) or gives way, and the soil before it.

    ``friction_angle`` and ``dilation_angle`` (degrees), ``cohesion`` (Pa), ``density`` (kg/m³),
    ``young`` (Pa) and ``poisson``, ``K0`` at the start; ``height`` and ``width`` (m) of the soil,
    ``cells`` across its width, all square; ``travel`` (m) of the wall at the end, in ``steps``.
    """

    passive: bool
    friction_angle: float = 30.0
    dilation_angle: float = 30.0
    cohesion: float = 0.0
    density: float = 1800.0
    young: float = 0.6e9
    poisson: float = 0.3
    K0: float = 0.5
    height: float = 4.0
    width: float = 1.0
    cells: int = 4
    travel: float = 4e-4
    steps: int = 20

    @property
    def soil(self) -> mpm.MohrCoulomb:
        """Soil of constant strength."""
        elastic = mpm.LinearElastic(self.young, self.poisson, self.density)
        return mpm.MohrCoulomb(elastic, self.cohesion, self.friction_angle, self.dilation_angle)

    @property
    def exact(self) -> float:
        """Force (N/m) on the wall."""
        force = passive_force if self.passive else active_force
        return force(self.height, self.density * G, self.cohesion, self.friction_angle)

    def grid(self) -> mpm.Grid:
        """Cells of the soil."""
        return mpm.Grid.box(
            (0.0, 0.0),
            (self.width, self.height),
            (self.cells, round(self.cells * self.height / self.width)),
        )

    def terms(self, grid: mpm.Grid) -> list:
        """The wall on the left, which moves evenly."""
        sign = 1.0 if self.passive else -1.0
        return [
            mpm.Fixed(grid.facets("bottom"), "y"),
            mpm.Fixed(grid.facets("right"), "x"),
            mpm.Fixed(grid.facets("left"), "x", lambda t: sign * self.travel * t),
            mpm.Gravity((0.0, -G)),
        ]

    @property
    def at_rest(self) -> mpm.GeostaticStress:
        """Stress at the start."""
        return mpm.GeostaticStress(self.soil, self.height, self.K0, G)

    def finite_elements(self, **options) -> mpm.FiniteElements:
        """The twin; ``options`` of ``FiniteElements``."""
        grid = self.grid()
        return mpm.FiniteElements(
            grid,
            self.soil,
            mpm.QuasiStatic(self.steps),
            self.terms(grid),
            stress=self.at_rest,
            **options,
        )

    def material_points(self, mapping: mpm.Mapping = mpm.DM_GC, **options) -> mpm.Simulation:
        """Material points, four a cell; ``options`` of ``Simulation``."""
        grid = self.grid()
        points = mpm.MaterialPoints.fill(grid, self.soil, per_cell=4, stress=self.at_rest)
        return mpm.Simulation(
            grid, points, mpm.QuasiStatic(self.steps), self.terms(grid), mapping, **options
        )

    def force(self, run: mpm.Simulation | mpm.FiniteElements) -> float:
        """What the wall bears (N/m), pushing back."""
        borne = run.balance()[0].reshape(-1, 2)
        wall = run.grid.space.tabulate_dof_coordinates()[:, 0] < 1e-9
        return float(borne[: len(wall)][wall, 0].sum())

    def error(self, run: mpm.Simulation | mpm.FiniteElements) -> float:
        """Of the force, relative."""
        return self.force(run) / self.exact - 1.0
