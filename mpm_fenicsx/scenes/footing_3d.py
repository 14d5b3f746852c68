"""A square or rectangular footing loads a block of soil: a quarter of it, between two planes of
symmetry, in three dimensions.

y points up; x = 0 and z = 0 are the planes of symmetry.  The other sides and the base are fixed
(rollers, and a base that sticks), viscous or viscoelastic.  The footing is flexible: a uniform
pressure that grows over a ramp, or comes at once, and stays.  Units: m, s, kg, Pa.

Exact are, of elastic soil between fixed boundaries, the settlement at rest
(``analytical.footing``: the very box, by a double series of cosines) and, of a half-space at rest,
Schleicher's.  How soil yields under the footing has no exact answer here.

    scene = Footing("viscoelastic")
    run = scene.material_points()
    settlement = run.record(scene.settlement(run))
    run.until(0.3)
    -settlement.values[:, 1]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

from ..analytical import footing

BOUNDARIES = ("fixed", "viscous", "viscoelastic")

soil = mpm.LinearElastic(young=20e6, poisson=0.3, density=1800.0)
cohesion = 20e3
clay = mpm.VonMises(soil, peak=cohesion, residual=cohesion, softening=0.0)
SOILS = {"elastic": soil, "clay": clay}
"""Both with the moduli of ``soil``, so that their waves are the same; clay flows at q = √3 c."""


@dataclass(frozen=True)
class Footing:
    """The footing, its soil and what holds it.

    ``boundary``: one of ``BOUNDARIES``; ``law``: the soil; ``half`` of the footing's sides along x
    and z (m); ``width`` and ``depth`` of the quarter block (m); ``cell`` (m), ``step`` (s);
    ``load`` (Pa), reached after ``ramp`` (s), at once where that is 0.  ``full``: the whole block
    without planes of symmetry, four times as dear.  ``far`` (m, finite elements only): so much more
    soil around and below, in cells that grow, so that echoes come later.
    """

    boundary: str = "viscoelastic"
    law: mpm.Law = soil
    half: tuple[float, float] = (1.0, 1.0)
    width: float = 4.0
    depth: float = 4.0
    cell: float = 0.5
    step: float = 2e-3
    load: float = 50e3
    ramp: float = 0.02
    full: bool = False
    far: float = 0.0

    def pressure(self, t: np.ndarray | float) -> np.ndarray:
        """On the footing (Pa) at times t (s)."""
        t = np.asarray(t, float)
        return self.load * (np.clip(t / self.ramp, 0.0, 1.0) if self.ramp else (t > 0.0))

    def under(self, x: np.ndarray) -> np.ndarray:
        """Whether places x (3, n), m, lie under the footing."""
        a, b = (one + 1e-9 for one in self.half)
        return (np.abs(x[0]) < a) & (np.abs(x[2]) < b)

    # -- grids -------------------------------------------------------------------------------------

    def lines(self, around: int = 0, above: int = 0) -> list[np.ndarray]:
        """Grid lines along x, y and z, with so many more cells around and below, and above."""
        count, rows = (round(length / self.cell) for length in (self.width, self.depth))
        before = -count - around if self.full else 0
        across = self.cell * np.arange(before, count + around + 1)
        up = self.cell * np.arange(-around, rows + above + 1)
        if self.far:
            growth = 1.2
            first = growth * self.cell
            number = np.ceil(np.log1p(self.far * (growth - 1) / first) / np.log(growth))
            more = np.cumsum(self.cell * growth ** np.arange(1, number + 1))
            across = np.concatenate((across, across[-1] + more))
            up = np.concatenate((-more[::-1], up))
        return [across, up, across]

    def surface_of(self, grid: mpm.Grid):
        """Facets of the mesh by the sides' names and, with ``where``, the footing's."""
        return lambda *sides, where=None: grid.facets("footing" if where else sides[0], *sides[1:])

    # -- scenes ------------------------------------------------------------------------------------

    def terms(self, surface, grid: mpm.Grid) -> list:
        """The scene; ``surface`` gives facets to finite elements and surface points to material
        points."""
        load = mpm.Traction(
            surface("top", where=self.under), lambda t: (0.0, -float(self.pressure(t)), 0.0)
        )
        planes = [] if self.full else [("left", "x"), ("back", "z")]
        outer = ("left", "right", "back", "front") if self.full else ("right", "front")
        edges = [mpm.Fixed(grid.facets(side), across) for side, across in planes]
        if self.boundary == "fixed":
            edges += [
                mpm.Fixed(grid.facets(side), "x" if side in ("left", "right") else "z")
                for side in outer
            ]
            return [load, *edges, mpm.Fixed(grid.facets("bottom"))]
        edge = surface(*outer, "bottom")
        return [
            load,
            *edges,
            mpm.ViscousBoundary(edge, soil)
            if self.boundary == "viscous"
            else mpm.ViscoelasticBoundary(edge, soil, self.depth),
        ]

    def material_points(
        self, mapping: mpm.Mapping = mpm.DM_GC, per_cell: int = 8, static: bool = False, **options
    ) -> mpm.Simulation:
        """Material points on a grid with a layer of cells more above and, where boundaries drift,
        around; ``static``: the load in one step without inertia.  ``options`` of ``Simulation``."""
        W, D = self.width, self.depth
        grid = mpm.Grid.rectilinear(self.lines(int(self.boundary != "fixed"), 1))
        points = mpm.MaterialPoints.fill(
            grid,
            self.law,
            per_cell,
            inside=lambda x: (np.abs(x[0]) < W) & (np.abs(x[2]) < W) & (x[1] > 0.0) & (x[1] < D),
        )
        terms = self.terms(points.surface, grid)
        return mpm.Simulation(grid, points, self.stepping(static), terms, mapping, **options)

    def finite_elements(self, static: bool = False, **options) -> mpm.FiniteElements:
        """The twin, on the block itself; ``options`` of ``FiniteElements``."""
        top = self.depth
        grid = mpm.Grid.rectilinear(
            self.lines(), {"footing": lambda x: self.under(x) & (np.abs(x[1] - top) < 1e-9)}
        )
        terms = self.terms(self.surface_of(grid), grid)
        return mpm.FiniteElements(grid, self.law, self.stepping(static), terms, **options)

    def stepping(self, static: bool) -> mpm.Newmark | mpm.QuasiStatic:
        """One step without inertia, or steps in time."""
        return mpm.QuasiStatic(1) if static else mpm.Newmark(self.step)

    def place(self, run) -> np.ndarray:
        """Where a run's settlement is looked at (3,), m: at the centre, a node, in finite elements;
        of points a quarter of a cell beside it along x and z, where the first ones lie.  At the
        centre a quarter block has points on one side only, and what is drawn on from them is 3 %
        off at h = 0.5 m."""
        beside = 0.25 * self.cell if run.bodies else 0.0
        return np.array([beside, self.depth, beside])

    def settlement(self, run) -> mpm.Probe:
        """Recorder of the displacement there."""
        return mpm.Probe("displacement", self.place(run))

    # -- what is known -----------------------------------------------------------------------------

    def at_rest(self, place: np.ndarray) -> float:
        """Settlement (m) at a place (3,), m, of the surface, elastic, between fixed boundaries:
        exact at small strain."""
        box = self.half, (self.width, self.width), self.depth, self.load
        below = place[None, [0, 2]]
        return float(footing.settlement_of_a_box(below, *box, soil.young, soil.poisson)[0])

    @property
    def mean_at_rest(self) -> float:
        """Mean settlement (m) under the footing, of the same."""
        box = self.half, (self.width, self.width), self.depth
        return footing.mean_settlement_of_a_box(*box, self.load, soil.young, soil.poisson)

    @property
    def on_a_half_space(self) -> float:
        """Settlement (m) of the centre, elastic, at rest, on soil without end (Schleicher 1926)."""
        return 4.0 * footing.corner_of_a_half_space(self.half, self.load, soil.young, soil.poisson)


def mean_settlement(run, load: float, area: float) -> float:
    """Mean settlement (m) under a footing of ``area`` (m²) that bears ``load`` (Pa) in a static run
    at rest: that of an elastic body's energy, ½ F w."""
    return 2.0 * run.grid.comm.allreduce(run.energy()["strain"]) / (load * area)
