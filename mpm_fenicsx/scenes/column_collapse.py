"""A column of soil is let go on a rough base and runs out: dry grains, and clay.

Half of it is computed, behind a smooth wall, at finite strain.  Grains that flow at constant volume
on a plane bear τ/σ = sin φ there: φ = 35° is a slope at rest of 29.8°.  Experiments in channels
found run-outs in proportion to the aspect ratio a = H/d_0 of columns that are not tall,
(d - d_0)/d_0 = 1.2 a (Lube, Huppert, Sparks & Freundt, Phys. Rev. E 72, 2005, a < 1.8) and about
1.0 a (Lajeunesse, Monnier & Homsy, Phys. Fluids 17, 2005, a < 3).  They are laws of experiments and
no exact answers.  Clay of c = 5 kPa, 2 m × 4 m, has none either; its energy must balance.  Run-outs
grow as cells shrink: of a = 1 by 17 % from h = 0.125 to 0.0625 m, to 1.16 of Lube's law, and of the
clay by 8 % from 0.25 to 0.125 m at its end (by 1 % until 1.5 s).  Units: m, s, kg, Pa.

    column = granular(aspect=1.0)
    run = column.material_points()
    run.until(column.end)
    column.run_out(run), lube(1.0), lajeunesse(1.0)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

G = 9.81
MASS = 0.99
"""Of the column lies within the front: single grains ahead of it are not counted."""


def lube(aspect: float) -> float:
    """(d - d_0)/d_0 of the aspect ratio a < 1.8, after Lube et al. (2005)."""
    return 1.2 * aspect


def lajeunesse(aspect: float) -> float:
    """(d - d_0)/d_0 of the aspect ratio a < 3, after Lajeunesse et al. (2005)."""
    return 1.0 * aspect


@dataclass(frozen=True)
class Column:
    """A column of ``material`` (at finite strain), ``width`` d_0 (m) from the wall to its free side
    and ``height`` H (m).

    ``cell`` (m); ``step`` and ``end`` (s); ``room`` (m): the length of the grid; ``K0``: horizontal
    stress over vertical stress at the start, as between the walls that held it.
    """

    material: object
    width: float
    height: float
    cell: float
    step: float
    end: float
    room: float
    K0: float
    tolerance: float = 1e-4

    def material_points(self, mapping: mpm.Mapping = mpm.DM_GC, **options) -> mpm.Simulation:
        """Four points a cell; ``options`` of ``Simulation``."""
        h = self.cell
        counts = round(self.room / h), round(self.height / h) + 2
        grid = mpm.Grid.box((0.0, 0.0), (counts[0] * h, counts[1] * h), counts)
        points = mpm.MaterialPoints.fill(
            grid,
            self.material,
            per_cell=4,
            inside=lambda x: (x[0] < self.width) & (x[1] < self.height),
            stress=mpm.GeostaticStress(self.material, self.height, self.K0, G),
        )
        terms = [
            mpm.Fixed(grid.facets("left"), "x"),
            mpm.Fixed(grid.facets("bottom")),
            mpm.Gravity((0.0, -G)),
        ]
        options = {"solver": mpm.Solver(newton=mpm.Newton(self.tolerance)), **options}
        return mpm.Simulation(grid, points, mpm.Newmark(self.step), terms, mapping, **options)

    def front(self, run: mpm.Simulation) -> float:
        """Distance (m) from the wall within which 99 % of the mass lies."""
        (points,) = run.bodies
        order = np.argsort(points.x[:, 0])
        mass = np.cumsum(points.mass[order]) / points.mass.sum()
        return float(points.x[order, 0][np.searchsorted(mass, MASS)])

    def run_out(self, run: mpm.Simulation) -> float:
        """(d - d_0)/d_0 (-) of the front."""
        return self.front(run) / self.width - 1.0

    def strays(self, run: mpm.Simulation) -> int:
        """How many points have no other within a cell."""
        x = run.bodies[0].x
        return int((_nearest(x) > self.cell).sum())


def granular(aspect: float, **changes) -> Column:
    """Dry grains, φ = 35° and ψ = 0, 1 m wide and ``aspect`` m high; ``changes`` of ``Column``."""
    soil = mpm.MohrCoulomb(mpm.Hencky(20e6, 0.3, 1800.0), 0.0, 35.0, 0.0)
    chosen = {
        "width": 1.0,
        "height": aspect,
        "cell": 0.125,
        "step": 2.5e-3,
        "end": 1.2 + 0.6 * aspect,
        "room": 4.0 if aspect < 1.2 else 6.0,
        "K0": 0.43,
        **changes,
    }
    return Column(soil, **chosen)


def clay(**changes) -> Column:
    """Undrained clay of c = 5 kPa, 2 m × 4 m; ``changes`` of ``Column``."""
    soil = mpm.VonMises(mpm.Hencky(2e6, 0.4, 1800.0), peak=5e3, residual=5e3, softening=0.0)
    chosen = {
        "width": 2.0,
        "height": 4.0,
        "cell": 0.25,
        "step": 5e-3,
        "end": 3.0,
        "room": 14.0,
        "K0": 1.0,
        "tolerance": 1e-6,
        **changes,
    }
    return Column(soil, **chosen)


def _nearest(x: np.ndarray) -> np.ndarray:
    """Distance (n,), m, from each place x (n, dim) to the next one."""
    from scipy.spatial import cKDTree

    return cKDTree(x).query(x, k=2)[0][:, 1]
