"""Bars whose motion is chosen and whose body force follows from it (``analytical.bar.Bar``), as
runs of both kinds:

    standing   ends held, tiny amplitude: points stay in their cells
    moving     free ends, the same while the bar drifts over a fifth of its length, support domains
               of one size
    random     the same with support domains of random sizes, which tile the bar
    large      ends held, A = 0.05 L in Hencky's finite strain: strains of 31 %, points cross cells

A bar of 1 m × 0.1 m with rollers along it, ν = 0, over one period of the motion.  What is tiny
strains by 6e-6, so that the linear answer is exact to that share.  Units: m, s, kg, Pa.

    moving = BARS["moving"]
    run = material_points(moving, DM_GC, cell=0.05, dt=moving.period / 80)
    watch = Watch(run, moving)
    run.until(moving.period, lambda steps: watch())
    watch.errors()
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import mpm_fenicsx as mpm

from ..analytical.bar import Bar
from ..mapping.shape_functions import Stencil

length, height = 1.0, 0.1
young, density = 1e6, 1000.0
tiny, jitter = (
    1e-6,
    0.3,
)  # amplitude over length; how far the edges of random domains lie from even ones, in domains
standing = Bar(length, young, density, tiny * length)
moving = replace(standing, free=True, drift=0.2 * length / standing.period)
BARS = {
    "standing": standing,
    "moving": moving,
    "random": moving,
    "large": replace(standing, amplitude=0.05 * length, hencky=True),
}


def terms(bar: Bar, grid: mpm.Grid, dt: float, where) -> list:
    """The scene; ``where`` (x, t) says which X is at x."""

    def force(t, x):
        return np.column_stack((bar.body_force(where(x[:, 0], t - dt), t), np.zeros(len(x))))

    ends = [] if bar.free else [mpm.Fixed(grid.facets("left", "right"), "x")]
    return [mpm.Fixed(grid.facets("bottom", "top"), "y"), mpm.Gravity(force), *ends]


def material(bar: Bar):
    """The bar's material."""
    return (mpm.Hencky if bar.hencky else mpm.LinearElastic)(young, 0.0, density)


def finite_elements(bar: Bar, cell: float, dt: float, **options) -> mpm.FiniteElements:
    """The twin, on the bar at rest, where no drift is seen."""
    bar = replace(bar, drift=0.0)
    grid = mpm.Grid.box((0, 0), (length, height), (round(length / cell), round(height / cell)))
    run = mpm.FiniteElements(
        grid, material(bar), mpm.Newmark(dt), terms(bar, grid, dt, lambda x, t: x), **options
    )
    run.nodal("velocity")[:, 0] = bar.velocity(grid.space.tabulate_dof_coordinates()[:, 0], 0.0)
    return run


def material_points(
    bar: Bar,
    mapping: mpm.Mapping,
    cell: float,
    dt: float,
    per_cell: int = 4,
    random: bool = False,
    *,
    more: list = (),
    **options,
) -> mpm.Simulation:
    """Material points, with room for the drift and two cells more where the ends are free.

    ``random``: support domains of random sizes; ``more`` terms; ``options`` of ``Simulation``.
    """
    room = 2 * bar.free
    grid = mpm.Grid.box(
        (-room * cell, 0),
        (length + (room + np.ceil(bar.drift * bar.period / cell)) * cell, height),
        (
            round(length / cell + 2 * room + np.ceil(bar.drift * bar.period / cell)),
            round(height / cell),
        ),
    )
    body = tiles(material(bar), cell / round(per_cell**0.5), jitter * random)
    body.velocity = np.zeros_like(body.x)
    body.velocity[:, 0] = bar.drift + bar.velocity(body.x[:, 0], 0.0)
    scene = [*terms(bar, grid, dt, bar.particle), *more]
    return mpm.Simulation(grid, body, mpm.Newmark(dt), scene, mapping, **options)


def tiles(soil, size: float, jitter: float) -> mpm.MaterialPoints:
    """Support domains that tile the bar, about ``size`` wide."""
    rng, lines = np.random.default_rng(0), []
    for extent in (length, height):
        edges = np.linspace(0.0, extent, round(extent / size) + 1)
        edges[1:-1] += rng.uniform(-jitter, jitter, len(edges) - 2) * size
        lines.append(edges)
    x, half = (
        np.stack(np.meshgrid(*parts), -1).reshape(-1, 2)
        for parts in ([(a[1:] + a[:-1]) / 2 for a in lines], [np.diff(a) / 2 for a in lines])
    )
    return mpm.MaterialPoints(soil, x, half, (2 * half).prod(axis=1))


class Watch:
    """Errors of a run against the bar: relative L2 over time and place of displacement, velocity
    and stress.

    Material points are asked where they are.  Elements are asked for displacement and velocity at
    the same places (four a cell), and for stress at the centres of cells, where theirs is most
    accurate.
    """

    NAMES = ("displacement", "velocity", "stress")

    def __init__(self, run, bar: Bar):
        self.run, self.bar = run, bar
        self.wrong, self.known = np.zeros(3), np.zeros(3)
        self.largest = young * (bar.stretch(np.linspace(0, length, 201), bar.period / 4) - 1).max()
        if run.bodies:
            self.X = self.at = run.bodies[0].x[:, 0].copy()
            self.weight = run.bodies[0].mass.copy()
        else:
            grid = run.grid
            places = mpm.MaterialPoints.fill(grid, run.material, 4)
            self.X, self.at = places.x[:, 0], run.sampler("stress")[0][:, 0]
            self.stencil = Stencil(grid, len(places), support=False)
            self.stencil.place(places.x, None, grid.find(places.x))
            self.weight = np.ones(len(places))

    def __call__(self) -> float:
        """Look; returns the largest stress found over the largest of the exact bar."""
        run, t = self.run, self.run.time
        if run.bodies:
            body = run.bodies[0]
            u, v = body.x[:, 0] - self.X - self.bar.drift * t, body.velocity[:, 0] - self.bar.drift
            stress, weights = body.stress[:, 0], self.weight
        else:
            u, v = (
                self.stencil.at_points(run.motion.nodal(f))[:, 0]
                for f in (run.displacement, run.motion.v)
            )
            stress, weights = run.stress(np.arange(len(self.at)))[:, 0], np.ones(len(self.at))
        exact = (
            self.bar.displacement(self.X, t),
            self.bar.velocity(self.X, t),
            self.bar.stress(self.at, t),
        )
        for k, (found, known, w) in enumerate(
            zip((u, v, stress), exact, (self.weight, self.weight, weights), strict=True)
        ):
            self.wrong[k] += w @ (found - known) ** 2
            self.known[k] += w @ known**2
        return float(np.abs(stress).max() / self.largest)

    def errors(self) -> dict[str, float]:
        """What was found."""
        return {
            f"error_{name}": float(e)
            for name, e in zip(self.NAMES, np.sqrt(self.wrong / self.known), strict=True)
        }
