"""A long cylindrical cavity in Mohr-Coulomb soil is blown up, or gives way as a tunnel does.

A quarter of it, between rollers; pressure acts on the true circle of the wall, and far edges bear
what unbounded soil would bear there, so that ``analytical.cavity`` is exact for it.  That answer
knows no change of geometry: the soil is stiff on purpose, 100 times as stiff as sand, and displaces
its wall by 0.03 % of the radius.  Units: m, s, kg, Pa.

    cavity = Cavity(pressure=400e3, friction_angle=30.0)
    run = cavity.material_points()
    run.until(1.0)
    cavity.errors(run)
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

import mpm_fenicsx as mpm

from ..analytical.cavity import CylindricalCavity

RADIUS = 1.0
"""Of the cavity (m)."""


@dataclass(frozen=True)
class Cavity:
    """A cavity of 1 m at whose wall the pressure goes from ``at_rest`` to ``pressure`` (Pa), evenly
    in ``steps``.

    ``cohesion`` (Pa), ``friction_angle`` and ``dilation_angle`` (degrees), ``young`` (Pa) and
    ``poisson`` of the soil; ``cells`` a radius at the wall; ``size`` of the quarter (m), edge of a
    square of points and radius of a mesh, by default beyond the plastic zone.
    """

    pressure: float
    friction_angle: float
    dilation_angle: float = 0.0
    cohesion: float = 10e3
    at_rest: float = 100e3
    young: float = 5e9
    poisson: float = 0.3
    cells: int = 20
    steps: int = 20
    size: float | None = None

    def exact(self, pressure: float | None = None) -> CylindricalCavity:
        """The answer at ``pressure`` (Pa), that of the end by default."""
        return CylindricalCavity(
            self.at_rest,
            self.pressure if pressure is None else pressure,
            self.cohesion,
            self.friction_angle,
            self.dilation_angle,
            self.young,
            self.poisson,
            RADIUS,
        )

    @property
    def soil(self) -> mpm.MohrCoulomb:
        """Soil of constant strength."""
        elastic = mpm.LinearElastic(self.young, self.poisson, 2000.0)
        return mpm.MohrCoulomb(elastic, self.cohesion, self.friction_angle, self.dilation_angle)

    @cached_property
    def extent(self) -> float:
        """``size``, or what leaves elastic ground around the plastic zone (m)."""
        return self.size or max(3.0, 1.6 * self.exact().plastic_radius)

    def at(self, t: float) -> float:
        """Pressure (Pa) at the wall at the load parameter t, 0 to 1."""
        return self.at_rest + (self.pressure - self.at_rest) * t

    def stress_at_start(self, x: np.ndarray) -> np.ndarray:
        """Rows (n, 4), Pa, at x (2, n)."""
        p = -self.at_rest
        return np.tile([p, p, p, 0.0], (x.shape[1], 1))

    def far_traction(self, t: float, x: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """What unbounded soil bears (n, 2), Pa, at x (n, 2) on faces of one ``normal`` (2,)."""
        r = np.linalg.norm(x, axis=1)
        out = x / r[:, None]
        radial, hoop, _ = self.exact(self.at(t)).stress(np.maximum(r, RADIUS))
        along = (out @ normal)[:, None] * out
        return -radial[:, None] * along - hoop[:, None] * (normal - along)

    # -- runs ------------------------------------------------------------------------------------

    def finite_elements(self, **options) -> mpm.FiniteElements:
        """On a mesh in polar coordinates, cells ``cells`` a radius at the wall and growing with the
        radius; ``options`` of ``FiniteElements``."""
        grid = self.polar_grid()
        rings = mpm.Pressure(grid.facets("wall"), self.at)

        def beyond(t, x):
            return self.exact(self.at(t)).stress(self.extent)[0] * np.ones(len(x))

        terms = [*self.rollers(grid), rings, mpm.Pressure(grid.facets("far"), beyond)]
        return mpm.FiniteElements(
            grid,
            self.soil,
            mpm.QuasiStatic(self.steps),
            terms,
            stress=self.stress_at_start,
            **options,
        )

    def polar_grid(self) -> mpm.Grid:
        """A quarter of a ring, whose cells are as wide as they are long."""
        count = int(np.ceil(np.log(self.extent / RADIUS) / np.log1p(1.0 / self.cells)))
        r = np.geomspace(RADIUS, self.extent, count + 1)
        angle = np.linspace(0.0, 0.5 * np.pi, round(0.5 * np.pi * self.cells) + 1)
        R, A = np.meshgrid(r, angle)
        first = (np.arange(len(angle) - 1)[:, None] * len(r) + np.arange(count)).ravel()
        quads = first[:, None] + [0, 1, len(r) + 1, len(r)]
        x = np.stack((R * np.cos(A), R * np.sin(A), 0.0 * R), axis=-1).reshape(-1, 3)
        return _grid_of(x, quads, self.extent)

    def material_points(self, mapping: mpm.Mapping = mpm.DM_GC, **options) -> mpm.Simulation:
        """On a grid of rectangles that the wall cuts, square near it and growing outwards, four
        points a cell; ``options`` of ``Simulation``."""
        lines = self.lines()
        grid = mpm.Grid.rectilinear([lines, lines])
        points = mpm.MaterialPoints.fill(
            grid,
            self.soil,
            per_cell=4,
            inside=lambda x: np.hypot(*x) > RADIUS,
            cut=True,
            stress=self.stress_at_start,
        )
        terms = [*self.rollers(grid), mpm.Pressure(self.wall(), self.at)]
        for side, normal in (("right", np.array([1.0, 0.0])), ("top", np.array([0.0, 1.0]))):
            terms.append(
                mpm.Traction(grid.facets(side), lambda t, x, n=normal: self.far_traction(t, x, n))
            )
        return mpm.Simulation(grid, points, mpm.QuasiStatic(self.steps), terms, mapping, **options)

    def lines(self) -> np.ndarray:
        """Grid lines from the centre, evenly to a quarter beyond the wall, then growing by 5 % a
        cell."""
        h, even = RADIUS / self.cells, round(1.25 * self.cells)
        rest = self.extent - even * h
        count = int(np.ceil(np.log1p(rest * 0.05 / h) / np.log(1.05)))
        grown = np.cumsum(1.05 ** np.arange(1, count + 1))
        return np.append(h * np.arange(even + 1), even * h + rest * grown / grown[-1])

    def wall(self) -> mpm.SurfacePoints:
        """A quarter of the circle, in arcs of half a cell."""
        arcs = 4 * int(np.ceil(np.pi * self.cells))
        wall = mpm.SurfacePoints.circle(
            (0.0, 0.0), RADIUS, 2.0 * np.pi * RADIUS / arcs * (1.0 + 1e-9), hole=True
        )
        wall.keep(np.flatnonzero((wall.x > 0.0).all(axis=1)))
        return wall

    def rollers(self, grid: mpm.Grid) -> list[mpm.Fixed]:
        """On the two lines of symmetry."""
        return [mpm.Fixed(grid.facets("left"), "x"), mpm.Fixed(grid.facets("bottom"), "y")]

    # -- what is compared ------------------------------------------------------------------------

    def wall_displacement(self, run: mpm.Simulation | mpm.FiniteElements) -> float:
        """Outward displacement of the wall (m), its mean."""
        if run.bodies:
            wall = next(term.on for term in run.terms if isinstance(term, mpm.Pressure))
            return float(wall.area @ np.linalg.norm(wall.x, axis=1) / wall.area.sum()) - RADIUS
        nodes, values = run.sampler("displacement")
        r = np.linalg.norm(nodes, axis=1)
        wall = np.flatnonzero(r < RADIUS * (1.0 + 1e-6))
        return float((values(wall) * nodes[wall]).sum(axis=1).mean() / RADIUS)

    def stresses(self, run: mpm.Simulation | mpm.FiniteElements) -> tuple[np.ndarray, ...]:
        """Distance from the centre (n,), m, and the pressures radial and hoop (n,), Pa."""
        if run.bodies:
            x, rows = run.bodies[0].x, run.bodies[0].stress
        else:
            x, values = run.sampler("stress")
            rows = values(np.arange(len(x)))
        r = np.linalg.norm(x, axis=1)
        out, stress = x / r[:, None], mpm.tensors.matrix(rows, 2)
        radial = -np.einsum("ni,nij,nj->n", out, stress, out)
        return r, radial, -(stress[:, 0, 0] + stress[:, 1, 1]) - radial

    def plastic_radius(self, run: mpm.Simulation | mpm.FiniteElements) -> float:
        """R (m), from the stress around it: (σ_r - σ_θ)/2 = (p_y - p_0) R²/r² where soil is
        elastic, the median over what lies between 1.15 and 1.5 R."""
        exact = self.exact()
        r, radial, hoop = self.stresses(run)
        around = (r > 1.15 * exact.plastic_radius) & (r < 1.5 * exact.plastic_radius)
        square = 0.5 * (radial - hoop) * r**2 / (exact.yield_pressure - self.at_rest)
        return float(np.sqrt(np.median(square[around])))

    def errors(self, run: mpm.Simulation | mpm.FiniteElements) -> dict[str, float]:
        """Relative errors of the wall's displacement and of the plastic radius."""
        exact = self.exact()
        return {
            "displacement": self.wall_displacement(run) / float(exact.displacement(RADIUS)) - 1.0,
            "plastic_radius": self.plastic_radius(run) / exact.plastic_radius - 1.0,
        }


def _grid_of(x: np.ndarray, quads: np.ndarray, far: float) -> mpm.Grid:
    """Grid of nodes x (n, 3) and quadrilaterals (m, 4), with the facets "wall" and "far"."""
    import meshio

    def ring(radius: float):
        return lambda x: np.abs(np.hypot(x[0], x[1]) - radius) < 1e-6 * radius

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ring.vtu"
        meshio.write(path, meshio.Mesh(x, [("quad", quads)]))
        return mpm.Grid.read(path, facets={"wall": ring(RADIUS), "far": ring(far)})
