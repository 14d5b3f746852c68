"""A pressure pulse runs down an elastic column on a fixed, viscous or viscoelastic base.

The one-dimensional test of Do, Vardon, González Acosta & Hicks (2023), section 4.1; exact is
d'Alembert's answer (``analytical.column``).  Units: m, s, kg, Pa.

    run = column.material_points("viscous", column.peak)
    watch = column.Watch(run, "viscous", column.peak)
    run.until(column.end)
    watch.errors()
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import mpm_fenicsx as mpm

from ..analytical.column import Column
from ..analytical.waves import relative_error

BASES = ("fixed", "viscous", "viscoelastic")

soil = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
height, radius = 20.0, 20.0  # of the column; to the source, for the springs
# the paper's pressure, and one at which strains are as small as the exact answer assumes
peak, small = 300e3, 0.3e3
end, dt = 1.5, 1e-3


def pulse(t, load):
    """Triangle of half a second: pressure (Pa) at times t (s), ``load`` at most."""
    return load * np.maximum(0.0, 1.0 - np.abs(t - 0.25) / 0.25)


def terms(base, load, surface, grid, history=pulse):
    """The scene; ``surface`` gives facets to finite elements and surface points to material
    points; ``history`` (t, load) the pressure (Pa)."""
    foot = {
        "fixed": lambda: mpm.Fixed(grid.facets("bottom"), "y"),
        "viscous": lambda: mpm.ViscousBoundary(surface("bottom"), soil),
        "viscoelastic": lambda: mpm.ViscoelasticBoundary(surface("bottom"), soil, radius),
    }
    return [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Traction(surface("top"), lambda t: (0.0, -history(t, load))),
        foot[base](),
    ]


def finite_elements(base, load, cell=0.25, step=dt, **options) -> mpm.FiniteElements:
    """The twin: facets of the mesh bear the load and the dashpots; ``options`` of
    ``FiniteElements``."""
    grid = mpm.Grid.box((0, 0), (1, height), cells=(round(1 / cell), round(height / cell)))
    return mpm.FiniteElements(
        grid, soil, mpm.Newmark(step), terms(base, load, grid.facets, grid), **options
    )


def material_points(
    base: str,
    load: float,
    mapping: mpm.Mapping = mpm.DM_GC,
    cell: float = 0.25,
    step: float = dt,
    per_cell: int = 4,
    *,
    history: Callable = pulse,
    stepping: mpm.Newmark | None = None,
    more: list = (),
    **options,
) -> mpm.Simulation:
    """Material points: the column on a grid with room at the top, and for an absorbing base to
    drift.

    ``stepping`` instead of Newmark's with ``step`` (s); ``more`` terms; ``options`` of
    ``Simulation``.
    """
    bottom = 0 if base == "fixed" else -1
    grid = mpm.Grid.box(
        (0, bottom), (1, height + 1), cells=(round(1 / cell), round((height + 1 - bottom) / cell))
    )
    points = mpm.MaterialPoints.fill(
        grid, soil, per_cell, inside=lambda x: (x[1] > 0) & (x[1] < height)
    )
    scene = [*terms(base, load, points.surface, grid, history), *more]
    return mpm.Simulation(grid, points, stepping or mpm.Newmark(step), scene, mapping, **options)


def answer(base: str, load: float, history: Callable = pulse, until: float = end) -> Column:
    """The exact column, at small strain, up to a time (s)."""
    spring = 2 * soil.lame[1] / radius if base == "viscoelastic" else 0.0
    return Column(
        height,
        soil.p_speed,
        soil.density,
        lambda t: history(t, load),
        until,
        base == "fixed",
        spring,
    )


PLACES = {
    "pressure_mid": ("stress", height / 2),
    "pressure_base": ("stress", height),
    "displacement_mid": ("displacement", height / 2),
    "displacement_top": ("displacement", 0.0),
}
"""Field and depth (m)."""


class Watch:
    """Pressure (Pa) and downward displacement (m) of a run at mid-height, base and top, beside the
    exact ones."""

    def __init__(self, run, base: str, load: float, history: Callable = pulse, until: float = end):
        self.exact = answer(base, load, history, until)
        self.probes = {
            name: run.record(mpm.Probe(field, (0.5, height - depth)))
            for name, (field, depth) in PLACES.items()
        }

    @property
    def times(self) -> np.ndarray:
        """When it looked (s): at the start and after each step."""
        return self.probes["pressure_mid"].times

    def pairs(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """What was found and what is known, at all times."""
        known = {"stress": self.exact.pressure, "displacement": self.exact.displacement}
        return {
            name: (-self.probes[name].values[:, 1], known[field](depth, self.times))
            for name, (field, depth) in PLACES.items()
        }

    def errors(self) -> dict[str, float]:
        """Relative L2 over time."""
        return {f"error_{name}": relative_error(*pair) for name, pair in self.pairs().items()}
