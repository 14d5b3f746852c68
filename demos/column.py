"""A column under a pulse
======================

A pressure pulse runs down an elastic column: fixed, viscous and viscoelastic base against the exact
answer.

The one-dimensional test of Do, Vardon, González Acosta & Hicks (2023), section 4.1, built in
``mpm_fenicsx.scenes.column``.  Units: m, s, kg, Pa.

Run it by::

    python demos/column.py          what the figure needs, about a minute
    python demos/column.py --all    every mapping
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

try:
    import matplotlib
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.table import Table
except ImportError as error:
    raise ImportError(
        f"{error}: demos take matplotlib and rich, pip install 'mpm_fenicsx[demo]'"
    ) from error

from mpm_fenicsx import DM_GC, GIMP, MAPPINGS, MPM, PAPER, Energy, RunError
from mpm_fenicsx.scenes.column import (
    BASES,
    Watch,
    answer,
    dt,
    end,
    finite_elements,
    height,
    material_points,
    peak,
    small,
)

PRESET = "DM-GC, the paper's step"
RESULTS = Path(__file__).parents[1] / "results"
FIGURES = (
    "max_pressure_mid_kpa",
    "max_pressure_base_kpa",
    "max_displacement_mid_m",
    "error_pressure_mid",
    "error_pressure_base",
    "error_displacement_mid",
    "error_displacement_top",
    "energy_left",
)


def measure(run, base, load, until=None, progress=None):
    """Run, and compare with the exact column: a row of figures, and curves of time, pressure,
    displacement."""
    watch, energy = Watch(run, base, load), run.record(Energy())
    row = {"mapping": run.name, "base": base, "load_kpa": load / 1e3, **dict.fromkeys(FIGURES)}
    row["unstable_at_step"] = None
    began = time.perf_counter()
    try:
        run.until(end if until is None else until, progress)
    except RunError as error:
        row["unstable_at_step"], row["reason"] = run.steps + 1, str(error)
    row["steps"], row["seconds"] = run.steps, round(time.perf_counter() - began, 3)
    wild = np.flatnonzero(energy.left > 1.5 * np.maximum.accumulate(energy["work"]).max())
    if len(wild) and row["unstable_at_step"] is None:
        row["unstable_at_step"], row["reason"] = (
            int(wild[0]),
            "more energy in the body than work was done on it",
        )
    t, pairs = watch.times, watch.pairs()
    if row["unstable_at_step"] is None:
        row.update(watch.errors())
        row["max_pressure_mid_kpa"] = float(pairs["pressure_mid"][0].max() / 1e3)
        row["max_pressure_base_kpa"] = float(pairs["pressure_base"][0].max() / 1e3)
        row["max_displacement_mid_m"] = float(pairs["displacement_mid"][0].max())
        late = min(round(1.2 / run.stepping.dt), len(t) - 1)
        row["energy_left"] = float((energy.left / energy["work"][late])[late])
    return row, (t, pairs["pressure_mid"][0], pairs["displacement_mid"][0])


def scenes(everything):
    """What is run: name, base, load and how to make it."""
    mappings = MAPPINGS if everything else (MPM, GIMP, DM_GC)
    for base in BASES:
        yield "FE", base, peak, lambda base=base: finite_elements(base, peak)
        for mapping in mappings:
            yield (
                mapping.name,
                base,
                peak,
                lambda base=base, mapping=mapping: material_points(base, peak, mapping),
            )
        if everything:
            yield PRESET, base, peak, lambda base=base: material_points(base, peak, **PAPER)
        yield "FE", base, small, lambda base=base: finite_elements(base, small)
        yield "DM-GC", base, small, lambda base=base: material_points(base, small)
        if everything:
            yield PRESET, base, small, lambda base=base: material_points(base, small, **PAPER)


def table(rows):
    """The rows as a table for the terminal."""
    shown = Table(
        box=None,
        padding=(0, 1, 0, 0),
        title="Largest values, and L2 errors against the exact column",
    )
    for name in (
        "",
        "p mid\nkPa",
        "base\nkPa",
        "u mid\nmm",
        "error\np mid",
        "%\nbase",
        "%\nu mid",
        "%\nu top",
        "energy\nleft",
        "time\ns",
    ):
        shown.add_column(name, justify="right" if name else "left", no_wrap=True)
    for load in (peak, small):
        for base in BASES:
            shown.add_row()
            shown.add_row(f"[bold]{base}", f"[bold]{load / 1e3:g}", "[bold]kPa")
            for row in (
                row for row in rows if row["base"] == base and row["load_kpa"] == load / 1e3
            ):
                if row["unstable_at_step"] is None:
                    maxima = [
                        f"{row['max_pressure_mid_kpa']:.4g}",
                        f"{row['max_pressure_base_kpa']:.4g}",
                        f"{1e3 * row['max_displacement_mid_m']:.4g}",
                    ]
                    errors = [
                        f"{100 * row[name]:.2f}" for name in FIGURES if name.startswith("error")
                    ]
                    figures = [*maxima, *errors, f"{row['energy_left']:.0e}"]
                else:
                    figures = ["unstable", "from step", str(row["unstable_at_step"]), *[""] * 5]
                shown.add_row(row["mapping"], *figures, f"{row['seconds']:.1f}")
    return shown


def figure(curves, path):
    """The paper's Figure 2: stress and displacement at mid-height, one column of axes a base."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    styles = {
        "MPM": ("#CC79A7", "-", 1.0),
        "FE": ("#E69F00", "-", 2.4),
        "DM-GC": ("#0072B2", (0, (4, 3)), 1.3),
    }
    fig, axes = plt.subplots(
        2, 3, figsize=(11, 5.6), sharex=True, sharey="row", layout="constrained"
    )
    t = np.linspace(0.0, end, 1501)
    for base, (above, below) in zip(BASES, axes.T, strict=True):
        column = answer(base, peak)
        known = -column.pressure(height / 2, t) / 1e3, -column.displacement(height / 2, t)
        for axis, curve in zip((above, below), known, strict=True):
            axis.plot(t, curve, color="0.75", lw=4.5, label="exact, small strain")
        for name, (color, line, width) in styles.items():
            if (name, base) in curves and (name != "MPM" or base == "fixed"):
                time_, pressure, displacement = curves[name, base]
                above.plot(time_, -pressure / 1e3, color=color, ls=line, lw=width, label=name)
                below.plot(time_, -displacement, color=color, ls=line, lw=width, label=name)
        above.set_title(f"{base} base")
        below.set_xlabel("time (s)")
        for axis in (above, below):
            axis.grid(alpha=0.3)
            axis.set_xlim(0, end)
    axes[0, 0].set_ylabel("vertical stress (kPa)")
    axes[1, 0].set_ylabel("vertical displacement (m)")
    fig.legend(
        *axes[0, 0].get_legend_handles_labels(),
        fontsize=9,
        ncols=4,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
    )
    fig.suptitle(
        "Column under a 300 kPa pulse, at mid-height (h = 0.25 m, Δt = 1 ms, 4 points a cell)"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150, bbox_inches="tight")  # with the legend, below the figure
    plt.close(fig)


def main(arguments=None) -> list[dict]:
    """Run the scenes, print the table, write results/column.json and results/column.png."""
    parser = argparse.ArgumentParser(description="A column under a pulse, against the exact answer")
    parser.add_argument(
        "--all", action="store_true", help="run every mapping, not only those of the figure"
    )
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen = parser.parse_args(arguments)
    chosen.results.mkdir(parents=True, exist_ok=True)
    console, rows, curves = Console(), [], {}
    todo = list(scenes(chosen.all))
    columns = (
        TextColumn("{task.description:32}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("", total=len(todo) * round(end / dt))
        for number, (name, base, load, make) in enumerate(todo):
            progress.update(task, description=f"{name}, {base}, {load / 1e3:g} kPa")
            done = number * round(end / dt)

            def advance(step, done=done):
                progress.update(task, completed=done + step)

            row, curve = measure(make(), base, load, progress=advance)
            progress.update(task, completed=done + round(end / dt))
            rows.append({**row, "mapping": name})
            if load == peak:
                curves[name, base] = curve
            (chosen.results / "column.json").write_text(json.dumps(rows, indent=1) + "\n")
    figure(curves, chosen.results / "column.png")
    console.print(table(rows))
    console.print(
        f"figure: {chosen.results / 'column.png'}, rows: {chosen.results / 'column.json'}"
    )
    return rows


if __name__ == "__main__":
    main()
