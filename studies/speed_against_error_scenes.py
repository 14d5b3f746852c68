"""Scenes with an exact answer that ``speed_against_error`` runs: the paper's column and
manufactured bars."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from mpm_fenicsx import DM_GCL, MAPPINGS, Probe
from mpm_fenicsx.analytical.waves import relative_error
from mpm_fenicsx.scenes import bar as bars
from mpm_fenicsx.scenes import column

MAPPING = {mapping.name: mapping for mapping in (*MAPPINGS, DM_GCL)}


class ColumnWatch:
    """Errors of a column: relative L2 over time, of stress at mid-height and base, the rest at
    mid-height and top."""

    def __init__(self, run, base: str, load: float):
        self.run, self.exact = run, column.answer(base, load)
        self.largest = 2 * load
        self.depths = {
            "displacement": (0.5, 0.0),
            "velocity": (0.5, 0.0),
            "stress": (0.5, 1.0),
        }  # over the height
        self.probes = [
            Probe(name, (0.5, (1 - depth) * column.height))
            for name, depths in self.depths.items()
            for depth in depths
        ]
        for probe in self.probes:
            probe.attach(run)
        places, self.stress = run.sampler("stress")
        self.all = np.arange(len(places))

    def __call__(self) -> float:
        """Look; returns the largest stress found over that at a fixed base."""
        for probe in self.probes:
            probe(self.run)
        return np.abs(self.stress(self.all)).max() / self.largest

    def errors(self) -> dict[str, float]:
        """What was found."""
        known = {
            "displacement": self.exact.displacement,
            "velocity": self.exact.velocity,
            "stress": self.exact.pressure,
        }
        found, t = {}, self.probes[0].times
        for name, depths in self.depths.items():
            mine = [-probe.values[:, 1] for probe in self.probes if probe.field == name]
            exact = [known[name](depth * column.height, t) for depth in depths]
            found[f"error_{name}"] = relative_error(np.concatenate(mine), np.concatenate(exact))
        return found


@dataclass(frozen=True)
class Scene:
    """A scene that can be run with any cell and time step: ``cells`` (m) from coarse to fine, wave
    ``speed`` (m/s), the time to run (s), how to make and watch it, and whether other settings are
    varied, too."""

    cells: tuple[float, ...]
    speed: float
    end: float
    make: Callable
    watch: Callable
    thorough: bool = False

    def step(self, cell: float, courant: float) -> float:
        """The time step (s) nearest to a Courant number that divides the time to run."""
        return self.end / round(self.end * self.speed / (courant * cell))


def _column(base, load, method, cell, dt, per_cell, **options):
    if method.startswith("FE"):
        return column.finite_elements(base, load, cell, dt, **options)
    return column.material_points(base, load, MAPPING[method], cell, dt, per_cell, **options)


def _bar(name, method, cell, dt, per_cell, **options):
    bar = bars.BARS[name]
    if method.startswith("FE"):
        return bars.finite_elements(bar, cell, dt, **options)
    return bars.material_points(
        bar, MAPPING[method], cell, dt, per_cell, name == "random", **options
    )


SCENES = {
    f"column, {base}, {load / 1e3:g} kPa": Scene(
        (0.5, 0.25, 0.125),
        125.0,
        column.end,
        partial(_column, base, load),  # 126.5 m/s: even time steps
        lambda run, base=base, load=load: ColumnWatch(run, base, load),
        (base, load) == ("fixed", column.small),
    )
    for load in (column.small, column.peak)
    for base in ("fixed", "viscous")
}
SCENES |= {
    f"bar, {name}": Scene(
        tuple(bars.length / n for n in (10, 20, 40, 80)),
        bar.speed,
        bar.period,
        partial(_bar, name),
        lambda run, bar=bar: bars.Watch(run, bar),
        name in ("standing", "moving"),
    )
    for name, bar in bars.BARS.items()
}
