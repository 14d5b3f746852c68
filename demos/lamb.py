"""A blow on open ground
=====================

Lamb's problem in a box of 24 × 12 cells: dashpots, dashpots with springs and an absorbing layer
beside the same ground on a mesh so wide that nothing comes back.

Built in ``mpm_fenicsx.scenes.lamb``.  A strip of 1 m on the surface is struck by Ricker's wavelet,
with S waves of 5 m, ten cells, at the peak of its spectrum.  A surface wave and body
waves run off and reach the edges at every angle: dashpots, which absorb what comes along their
normal, leave the motion of the box a fifth off, with and without springs, and the layer, seven
cells around the box without points, one hundredth.
The error is that of all nodes of the box, by finite elements against finite elements and by
material points against material points, so that only what the edge does is in it; how far the cells
themselves are off, in displacement at ten of them a wave, is seen beside the exact curve of the
surface.  Units: m, s, kg, Pa.

Run it by::

    python demos/lamb.py              about half a minute
    python demos/lamb.py --wave 16    longer waves
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

from mpm_fenicsx.scenes.lamb import BOUNDARIES, Lamb, Watch

RESULTS = Path(__file__).parents[1] / "results"
METHODS = {"FE": Lamb.finite_elements, "DM-GC": Lamb.material_points}
EDGES = tuple(name for name in BOUNDARIES if name != "large")
PLACES = (0.25, 0.75)  # on the surface, of half the width
LOOKS = {  # colour, line, width
    "large": ("0.75", "-", 4.5),
    "viscous": ("#E69F00", "-", 1.6),
    "viscoelastic": ("#009E73", (0, (5, 2)), 1.6),
    "layer": ("#0072B2", (0, (3, 2)), 1.4),
}


def measure(make, scene, progress=None):
    """Run: what the box did, and a row of what it cost."""
    began = time.perf_counter()
    run = make(scene)
    watch = run.record(Watch(scene))
    ready = time.perf_counter()
    run.until(scene.end, progress)
    done = time.perf_counter()
    row = {
        "method": run.name,
        "boundary": scene.boundary,
        "wave_cells": scene.wave,
        "cells": run.grid.cells,
        "steps": run.steps,
        "seconds_to_set_up": round(ready - began, 3),
        "ms_per_step": round(1e3 * (done - ready) / run.steps, 3),
    }
    return watch, row


def table(rows):
    """The rows as a table for the terminal."""
    shown = Table(
        box=None,
        padding=(0, 1, 0, 0),
        title="L2 error of the displacements of the box, in space and time",
    )
    for name in ("", "", "cells", "error\n%", "largest\nat a time", "ms\na step"):
        shown.add_column(name, justify="right" if name else "left", no_wrap=True)
    before = None
    for row in rows:
        if row["method"] != before:
            shown.add_row()
        before = row["method"]
        errors = (row["error"], row["largest_error"])
        shown.add_row(
            row["method"],
            row["boundary"],
            str(row["cells"]),
            *("" if error is None else f"{100 * error:.2f}" for error in errors),
            f"{row['ms_per_step']:.1f}",
        )
    return shown


def figure(found, scene, path):
    """Displacement of the surface at two places, and the error, over time; a column a method."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    half, methods = scene.cells * scene.cell, list(dict.fromkeys(key[0] for key in found))
    fig, axes = plt.subplots(
        3,
        len(methods),
        figsize=(1.5 + 4.0 * len(methods), 8.0),
        sharex=True,
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    for method, column in zip(methods, axes.T, strict=True):
        known = found[method, "large"]
        for name, (colour, line, width) in LOOKS.items():
            watch = found[method, name]
            look = {"color": colour, "ls": line, "lw": width}
            label = "large mesh" if name == "large" else name
            for axis, share in zip(column, PLACES, strict=False):
                axis.plot(watch.times, 1e6 * watch.at((share * half, 0.0)), label=label, **look)
            if name != "large":
                column[2].semilogy(watch.times[1:], 100 * watch.errors(known)[1:], **look)
        for axis, share in zip(column, PLACES, strict=False):
            exact = 1e6 * scene.answer(share * half, known.times)
            axis.plot(known.times, exact, label="exact", color="0.2", lw=0.8)
            axis.set_title(f"{method}, surface, {share * half:g} m from the load")
        column[2].set_title(f"{method}, all nodes of the box")
        column[2].set(xlabel="time (s)", ylim=(1e-3, 100.0), xlim=(0.0, known.times[-1]))
        for axis in column:
            axis.grid(alpha=0.3)
    for axis in axes[:2, 0]:
        axis.set_ylabel("downward displacement (µm)")
    axes[2, 0].set_ylabel("error (% of the largest L2)")
    fig.legend(
        *axes[0, 0].get_legend_handles_labels(),
        fontsize=9,
        ncols=len(LOOKS) + 1,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
    )
    fig.suptitle(
        f"Lamb's problem: {scene.load / 1e3:g} kPa at most on 1 m of the surface of a box of "
        f"{2 * half:g} m × {half:g} m\n(h = {scene.cell:g} m, S waves of {scene.wave:g} cells, "
        "Courant number ½, 4 points a cell)",
        fontsize=11,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150, bbox_inches="tight")  # with the legend, below the figure
    plt.close(fig)


def main(arguments=None) -> list[dict]:
    """Run the scenes, print the table, write results/lamb.json and results/lamb.png."""
    parser = argparse.ArgumentParser(description="A blow on open ground")
    parser.add_argument("--wave", type=float, default=10.0, help="cells an S wave (default: 10)")
    parser.add_argument("--cells", type=int, default=12, help="half the box (default: 12)")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen = parser.parse_args(arguments)
    scenes = {name: Lamb(name, wave=chosen.wave, cells=chosen.cells) for name in ("large", *EDGES)}
    rows, found, console = [], {}, Console()
    steps = round(scenes["large"].end / scenes["large"].step)
    columns = (
        TextColumn("{task.description:32}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("", total=len(chosen.methods) * len(scenes) * steps)
        for method in chosen.methods:
            for name, scene in scenes.items():
                progress.update(task, description=f"{method}, {name}")
                before = len(rows) * steps

                def advance(step, done=before):
                    progress.update(task, completed=done + step)

                found[method, name], row = measure(METHODS[method], scene, advance)
                watch, known = found[method, name], found[method, "large"]
                off = name != "large"
                row["error"] = watch.error(known) if off else None
                row["largest_error"] = float(np.max(watch.errors(known))) if off else None
                rows.append(row)
    chosen.results.mkdir(parents=True, exist_ok=True)
    (chosen.results / "lamb.json").write_text(json.dumps(rows, indent=1) + "\n")
    figure(found, scenes["large"], chosen.results / "lamb.png")
    console.print(table(rows))
    console.print(f"figure: {chosen.results / 'lamb.png'}, rows: {chosen.results / 'lamb.json'}")
    return rows


if __name__ == "__main__":
    main()
