"""Prandtl's strip: does the load on weightless cohesive soil level off at (2 + π) c, whatever
Poisson's ratio?

A smooth rigid strip is pressed by a given displacement into von Mises soil without softening: in
plane strain it flows at a shear stress of q/√3 = c, and the strip carries (2 + π) c.  One symmetric
half; rollers at the sides, base fixed.  The soil is stiff on purpose (E = 10⁵ c): the strip
collapses within 0.8 mm of settlement on 1 m of half-width, so that the exact answer, which knows no
change of geometry, holds for points that move.

The load is read off the stresses by virtual work: w = y/H is zero at the base and 1 at the top,
where only the strip pushes, so that it carries ∫ σ_yy dV / H.  Every case runs with ``b_bar`` and
without.  Writes results/prandtl.json and .png.

    python studies/prandtl.py
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpm_fenicsx import (
    DM_G,
    DM_GC,
    GIMP,
    MPM,
    FiniteElements,
    Fixed,
    Grid,
    LinearElastic,
    MaterialPoints,
    QuasiStatic,
    RunError,
    Simulation,
    VonMises,
)

RESULTS = Path(__file__).parents[1] / "results"
EXACT = 2.0 + np.pi
TOP = 10.0  # of the figure, in c
POISSON = (0.3, 0.49, 0.499)
METHODS = ("FE", DM_G, DM_GC)
cohesion, young = 10e3, 1e9  # Pa
strip, width, depth = 1.0, 5.0, 3.0  # m: half the strip, half the body
settlement, steps, cell, growth = (
    0.8e-3,
    30,
    0.05,
    1.15,
)  # m, -, m beside the strip's edge, - from cell to cell


def away(length: float, first: float) -> np.ndarray:
    """Grid lines from 0 to ``length``, cells growing from about ``first``."""
    count = int(np.ceil(np.log1p(length * (growth - 1.0) / first) / np.log(growth)))
    lines = np.append(0.0, np.cumsum(growth ** np.arange(count)))
    return length * lines / lines[-1]


def soil(poisson: float) -> VonMises:
    """Soil of constant cohesion."""
    return VonMises(
        LinearElastic(young, poisson, 2000.0), peak=cohesion, residual=cohesion, softening=0.0
    )


def scene(method, poisson: float, b_bar: bool, h: float = cell):
    """The run, and a function that reads the load on the strip (Pa, mean)."""
    x = np.append(strip - away(strip, h)[::-1], strip + away(width - strip, h)[1:])
    y = depth - away(depth, h)[::-1]
    grid = Grid.rectilinear(
        [x, y], {"strip": lambda p: (p[1] > depth - 1e-9) & (p[0] < strip + 1e-9)}
    )
    terms = [
        Fixed(grid.facets("left", "right"), "x"),
        Fixed(grid.facets("bottom")),
        Fixed(grid.facets("strip"), "y", lambda t: -settlement * t**2),
    ]
    if method == "FE":
        run = FiniteElements(grid, soil(poisson), QuasiStatic(steps), terms, b_bar=b_bar)
        cells = np.arange(grid.cells)
        return run, lambda: -(grid.lattice.volume @ run.stress(cells)[:, 1]) / (depth * strip)
    points = MaterialPoints.fill(grid, soil(poisson), per_cell=4)
    run = Simulation(grid, points, QuasiStatic(steps), terms, method, b_bar=b_bar)
    return run, lambda: -(points.volume @ points.stress[:, 1]) / (depth * strip)


def measure(method, poisson: float, b_bar: bool, h: float = cell) -> dict:
    """Load (in c) against settlement (mm); its end, and how much it still grew over the last
    quarter of it (%).

    A run that Newton cannot finish says so by "stopped" and keeps what it has.
    """
    run, load = scene(method, poisson, b_bar, h)
    start, curve, stopped = time.perf_counter(), [0.0], None
    try:
        while run.steps < steps:
            run.step()
            curve.append(load() / cohesion)
    except RunError as error:
        stopped = str(error)
    settled = 1e3 * settlement * np.linspace(0.0, 1.0, steps + 1)[: len(curve)] ** 2
    before = np.interp(0.75 * settled[-1], settled, curve)
    return {
        "method": str(method),
        "poisson": poisson,
        "b_bar": b_bar,
        "cell_m": h,
        "cells": run.grid.cells,
        "load_over_c": curve[-1],
        "error_percent": 100 * (curve[-1] / EXACT - 1),
        "growth_percent": 100 * (curve[-1] / before - 1),
        "solves_a_step": run.equilibrium.solves / run.steps,
        "stopped": stopped,
        "seconds": time.perf_counter() - start,
        "settlement_mm": settled.tolist(),
        "curve": curve,
    }


def cases() -> list[Callable[[], dict]]:
    """With the cure and without, then without for mappings that cannot have it, then finer and
    coarser cells."""
    todo = [(m, ν, b) for ν in POISSON for m in METHODS for b in (True, False)]
    todo += [(m, ν, False) for ν in POISSON for m in (MPM, GIMP)]
    todo += [(m, 0.499, True, h) for m in METHODS for h in (4 * cell, 2 * cell, cell / 2)]
    return [lambda case=case: measure(*case) for case in todo]


def table(rows: list[dict]) -> Table:
    """Load at the end and its growth."""
    found = Table(
        "method",
        "ν",
        "cell (m)",
        "b_bar",
        "load (c)",
        "error (%)",
        "last quarter (%)",
        "solves a step",
        "s",
        title=f"exact {EXACT:.4f} c;  * stopped before the end",
    )
    for row in rows:
        load = f"{row['load_over_c']:.3f}{' *' if row['stopped'] else ''}"
        found.add_row(
            row["method"],
            f"{row['poisson']}",
            f"{row['cell_m']}",
            "yes" if row["b_bar"] else "no",
            load,
            f"{row['error_percent']:+.1f}",
            f"{row['growth_percent']:+.2f}",
            f"{row['solves_a_step']:.1f}",
            f"{row['seconds']:.1f}",
        )
    return found


def figure(rows: list[dict], path: Path) -> None:
    """Load against settlement, one panel a Poisson's ratio."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    styles = {
        "FE": ("#0072b2", 4.0, (0, (6, 2))),
        "DM-G": ("#e69f00", 2.4, (0, (3, 2))),
        "DM-GC": ("#000000", 0.9, (0, (1, 1.2))),
    }  # colour, width where all agree, dashes where they do not
    fig, axes = plt.subplots(
        1, len(POISSON), figsize=(11, 4.0), sharex=True, sharey=True, layout="constrained"
    )
    for axis, ν in zip(axes, POISSON, strict=True):
        beyond = []
        for row in rows:
            if row["poisson"] != ν or row["cell_m"] != cell or row["method"] not in styles:
                continue
            color, line, dashes = styles[row["method"]]
            line, dashes = (line, "-") if row["b_bar"] else (1.8, dashes)
            axis.plot(
                row["settlement_mm"],
                row["curve"],
                color=color,
                lw=line,
                ls=dashes,
                label=f"{row['method']}, {'B-bar' if row['b_bar'] else 'plain'}",
            )
            if row["curve"][-1] > TOP:
                beyond.append(f"plain {row['method']} goes on to {row['curve'][-1]:.0f}")
        axis.text(
            0.97,
            0.97,
            "\n".join(beyond),
            ha="right",
            va="top",
            transform=axis.transAxes,
            fontsize=9,
        )
        axis.axhline(EXACT, color="#d55e00", lw=1.2, label="exact, 2 + π")
        axis.set(
            title=f"ν = {ν}",
            xlabel="settlement of the strip (mm)",
            xlim=(0, 1e3 * settlement),
            ylim=(0, TOP),
        )
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("mean pressure on the strip / cohesion (-)")
    axes[0].legend(fontsize=9, loc="lower right")
    fig.suptitle(
        f"Strip of {2 * strip:g} m on weightless cohesive soil, E = 10⁵ c, cells from {cell:g} m "
        "at its edge"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def main(arguments=None) -> list[dict]:
    """Run all cases, print the table, write results/prandtl.json and .png."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen = parser.parse_args(arguments)
    chosen.results.mkdir(parents=True, exist_ok=True)
    rows = [case() for case in track(cases(), "strips")]
    rounded = [
        {
            key: np.round(value, 4).tolist() if isinstance(value, (list, float)) else value
            for key, value in row.items()
        }
        for row in rows
    ]
    (chosen.results / "prandtl.json").write_text(json.dumps(rounded) + "\n")
    figure(rows, chosen.results / "prandtl.png")
    Console(width=120).print(table(rows))
    return rows


if __name__ == "__main__":
    main()
