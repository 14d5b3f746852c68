"""Prandtl's strip: does the load on weightless cohesive soil level off at (2 + π) c, whatever
Poisson's ratio?

The strip of ``mpm_fenicsx.scenes.strip``, whose load is exact, runs with ``b_bar`` and without.
Writes results/prandtl.json and .png.

    python studies/prandtl.py
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import report
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpm_fenicsx import DM_G, DM_GC, GIMP, MPM, RunError
from mpm_fenicsx.scenes.strip import EXACT, Strip

TOP = 10.0  # of the figure, in c
POISSON = (0.3, 0.49, 0.499)
METHODS = ("FE", DM_G, DM_GC)
cell, young, settlement, steps = Strip.cell, Strip.young, Strip.settlement, Strip.steps


def measure(method, poisson: float, b_bar: bool, h: float = cell) -> dict:
    """Load (in c) against settlement (mm); its end, and how much it still grew over the last
    quarter of it (%).

    A run that Newton cannot finish says so by "stopped" and keeps what it has.
    """
    strip = Strip(poisson, h, young=young, settlement=settlement, steps=steps)
    run = (
        strip.finite_elements(b_bar=b_bar)
        if method == "FE"
        else strip.material_points(replace(method, b_bar=b_bar))
    )
    start, curve, stopped = time.perf_counter(), [0.0], None
    try:
        while run.steps < steps:
            run.step()
            curve.append(strip.load(run) / strip.cohesion)
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
        "solves_a_step": run.solves / run.steps,
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
    styles = {
        "FE": ("#0072b2", 4.0, (0, (6, 2))),
        "DM-G": ("#e69f00", 2.4, (0, (3, 2))),
        "DM-GC": ("#000000", 0.9, (0, (1, 1.2))),
    }  # colour, width where all agree, dashes where they do not
    fig, axes = report.subplots(1, len(POISSON), figsize=(11, 4.0), sharex=True, sharey=True)
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
        f"Strip of {2 * Strip.half:g} m on weightless cohesive soil, E = 10⁵ c, cells from "
        f"{cell:g} m at its edge"
    )
    report.save(fig, path)


def main(arguments=None) -> list[dict]:
    """Run all cases, print the table, write results/prandtl.json and .png."""
    chosen = report.chosen(report.parser(__doc__), arguments)
    rows = [case() for case in track(cases(), "strips")]
    rounded = [
        {
            key: np.round(value, 4).tolist() if isinstance(value, (list, float)) else value
            for key, value in row.items()
        }
        for row in rows
    ]
    report.write(chosen.results / "prandtl.json", rounded)
    figure(rows, chosen.results / "prandtl.png")
    Console(width=120).print(table(rows))
    return rows


if __name__ == "__main__":
    main()
