"""A basin that shakes in three dimensions
=======================================

Soft soil in a round basin of 80 m, a vertical shear wave from below, and how far the column that
every site response takes is from what happens.

Built in ``mpm_fenicsx.scenes.basin``.  The wave comes in through dashpots at the base, and the
sides bear the free field of rock.  The answer of level layers is exact, and the middle of the basin
follows it as long as nothing has come from the edges.  Then it fails: the edges make waves of their
own, which run along the basin and meet in the middle.  That moves 1.6 times as much as the column
says, 12 m beside it, across the motion, 1.8 times, and goes on when the column has come to rest.
Just inside the edge, along the motion, the ground moves less than the column says, but also up and
down, which no column does in a vertical shear wave.  On rock, 8 m beside the soil, the column's
answer, twice the incoming wave, is good for the peak.
Finite elements, elastic, with 3 % of Rayleigh damping in the soil.  Units: m, s, kg, Pa.

Run it by::

    python demos/basin.py             about two minutes
    python demos/basin.py --quick     cells of 4 m across, half the steps: seconds
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

from mpm_fenicsx.scenes.basin import Basin, Surface

RESULTS = Path(__file__).parents[1] / "results"
COMPUTED, EXACT = "#0072B2", "#E69F00"


def places(scene):
    """Places (m) on the surface at which motion is shown, by name."""
    beside = scene.radius - 0.5 * scene.edge - scene.cell[0]
    return {
        "middle": (0.0, 0.0),
        "inside the edge": (beside, 0.0),
        "rock": (scene.radius + 8.0, 0.0),
    }


def compare(scene, watch):
    """A row a place: peaks over that of bare rock, and how far level layers are off."""
    rows = []
    for name, (x, z) in places(scene).items():
        v, times = watch.at(x, z), watch.times
        exact = scene.level(float(scene.thickness(x, z)), times)
        early = times < scene.arrival(x, z)
        largest = np.abs(exact).max()
        rows.append(
            {
                "place": name,
                "x_m": x,
                "soil_m": float(scene.thickness(x, z)),
                "peak": float(np.abs(v[:, 0]).max() / scene.outcrop),
                "peak_level": float(largest / scene.outcrop),
                "peak_up": float(np.abs(v[:, 1]).max() / scene.outcrop),
                "off": float(np.linalg.norm(v[:, 0] - exact) / np.linalg.norm(exact)),
                "off_before_edges": float(np.abs((v[:, 0] - exact)[early]).max() / largest),
            }
        )
    return rows


def table(rows):
    """The rows for the terminal."""
    shown = Table(box=None, padding=(0, 1, 0, 0), title="Largest velocity over that of bare rock")
    for name in ("", "soil\nm", "along x", "level\nlayers", "up", "level layers\noff, % L2"):
        shown.add_column(name, justify="right" if name else "left", no_wrap=True)
    for row in rows:
        numbers = (row["peak"], row["peak_level"], row["peak_up"])
        shown.add_row(
            row["place"],
            f"{row['soil_m']:g}",
            *(f"{number:.2f}" for number in numbers),
            f"{100 * row['off']:.0f}",
        )
    return shown


def figure(scene, watch, path):
    """A map of the largest velocity, and the motion of three places beside that of level layers."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig = plt.figure(figsize=(11.5, 5.6), layout="constrained")
    grid = fig.add_gridspec(3, 2, width_ratios=(1.15, 1.0))
    ground, spots = fig.add_subplot(grid[:, 0]), places(scene)
    x, z, peaks = watch.on_lattice(watch.peaks() / scene.outcrop)
    image = ground.contourf(x, z, peaks, levels=np.arange(0.0, peaks.max() + 0.25, 0.25))
    fig.colorbar(
        image,
        ax=ground,
        ticks=np.arange(0.0, peaks.max() + 0.5, 0.5),
        label="largest velocity along x / that of bare rock (-)",
    )
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    for radius, line in ((scene.radius, "-"), (scene.radius - scene.edge, ":")):
        ground.plot(radius * np.cos(angle), radius * np.sin(angle), "w", ls=line, lw=1.2)
    for name, (at, across) in spots.items():
        ground.plot(at, across, "o", ms=5, mfc="w", mec="k")
        ground.annotate(
            name, (at, across), (0, -14), textcoords="offset points", ha="center", color="w",
            fontsize=8,
        )  # fmt: skip
    ground.set(aspect="equal", xlabel="x, the wave's motion (m)", ylabel="z (m)")
    ground.set_title("edge of the soil (line) and of its level bottom (dots)", fontsize=9)
    upper, size = None, np.abs(watch.values[:, :, 0]).max()
    for row, (name, (at, across)) in enumerate(spots.items()):
        axis = upper = fig.add_subplot(grid[row, 1], sharex=upper, sharey=upper)
        thick = float(scene.thickness(at, across))
        exact = scene.level(thick, watch.times)
        axis.plot(watch.times, exact, color=EXACT, lw=2.6, label="level layers, exact")
        axis.plot(watch.times, watch.at(at, across)[:, 0], color=COMPUTED, lw=1.3, label="basin")
        if thick == scene.depth:
            axis.axvline(scene.arrival(at, across), color="0.4", lw=0.8, ls="--")
            axis.text(
                scene.arrival(at, across), -0.95 * size, " edges are felt from here", fontsize=8
            )
        axis.set_title(f"{name}: {thick:g} m of soil, x = {at:g} m", fontsize=9)
        axis.set(ylabel="v$_x$ (m/s)", ylim=(-1.1 * size, 1.1 * size))
        axis.grid(alpha=0.3)
        axis.tick_params(labelbottom=row == len(spots) - 1)
    upper.set(xlabel="time (s)", xlim=(0.0, watch.times[-1]))
    upper.legend(fontsize=8, loc="upper right")
    fig.suptitle(
        f"Basin of {2 * scene.radius:g} m × {scene.depth:g} m, vertical SV wave of "
        f"{scene.frequency:.2f} Hz: surface velocity",
        fontsize=11,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def main(arguments=None) -> list[dict]:
    """Run the basin, print the table, write results/basin.json and results/basin.png."""
    parser = argparse.ArgumentParser(description="A basin that shakes in three dimensions")
    parser.add_argument("--quick", action="store_true", help="cells of 4 m across, longer steps")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen = parser.parse_args(arguments)
    scene = Basin(cell=(4.0, 2.0), steps=20, periods=4.0) if chosen.quick else Basin()
    console = Console()
    columns = (TextColumn("basin"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    began = time.perf_counter()
    run = scene.finite_elements()
    watch = run.record(Surface(scene))
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("", total=round(scene.end / scene.step))
        run.until(scene.end, lambda step: progress.update(task, completed=step))
    rows = compare(scene, watch)
    rows[0] |= {"cells": run.grid.cells, "steps": run.steps}
    rows[0]["seconds"] = round(time.perf_counter() - began, 1)
    chosen.results.mkdir(parents=True, exist_ok=True)
    (chosen.results / "basin.json").write_text(json.dumps(rows, indent=1) + "\n")
    figure(scene, watch, chosen.results / "basin.png")
    console.print(table(rows))
    console.print(f"figure: {chosen.results / 'basin.png'}, rows: {chosen.results / 'basin.json'}")
    return rows


if __name__ == "__main__":
    main()
