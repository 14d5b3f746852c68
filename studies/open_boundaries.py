"""Open ground: what dashpots and absorbing layers send back at every angle, and what they cost.

    theory    energy that comes back of plane waves, exact for the grid (``analytical.reflection``)
              and for dashpots on a continuous ground (Lysmer & Kuhlemeyer 1969)
    packet    the same of packets of waves in finite elements, up to a minute of CPU time each
              (``open_boundaries_packets.py``)
    lamb      a box that is struck on its surface: error, and cost of a step
              (``open_boundaries_lamb.py``)

Writes results/open_boundaries.json and .png.  Rows of packets and of the box that are there are
kept, unless ``--afresh``.

    python studies/open_boundaries.py             about ten minutes
    python studies/open_boundaries.py --quick     a few angles, a few steps of the box
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import open_boundaries_lamb as struck
import report
from open_boundaries_packets import CELLS, layer, measured, soil_of
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpm_fenicsx.analytical.reflection import Dashpots, reflected_energy
from mpm_fenicsx.analytical.waves import dashpot_echo

WAVES, POISSON, LAYERS = ("P", "S"), (0.25, 0.41), (2, 3, 5)
ANGLES, STEPS_OF_ANGLE = (0, 20, 40, 60), 1.0  # degrees
STEEP = 70
"""Degrees, of packets on the layer alone: each takes a minute."""
LIMIT = 3e-5
"""What a layer of three absorbing cells may send back."""
PLACES = {
    ("FE", "dashpots"): ((8, -2), "left"),
    ("FE", "springs"): ((6, -10), "left"),
    ("FE", "layer, 3 cells"): ((0, -14), "right"),
    ("DM-GC", "dashpots"): ((6, 7), "left"),
    ("DM-GC", "layer, 3 cells"): ((-6, 8), "left"),
    ("DM-GC", "dashpots, 32 cells further"): ((8, -10), "left"),
}
"""Of names in the figure, points from their marks."""
LOWEST = 1e-8
"""Shown of the energy."""
COLOURS = {
    "dashpots": "#D55E00",
    "dashpots, continuous ground": "#000000",
    "layer, 2 cells": "#E69F00",
    "layer, 3 cells": "#0072B2",
    "layer, 5 cells": "#009E73",
    "springs": "#CC79A7",
}


def theory(wave: str, poisson: float, step: float) -> list[dict]:
    """Rows of what each boundary sends back, from 0 to 80 degrees."""
    soil, degrees = soil_of(poisson), np.arange(0.0, 80.1, step)
    boundaries = {"dashpots": Dashpots()}
    boundaries |= {f"layer, {n} cells": layer(soil, n) for n in LAYERS}
    energies = {
        name: [reflected_energy(soil, wave, θ, CELLS, boundary) for θ in np.radians(degrees)]
        for name, boundary in boundaries.items()
    }
    energies["dashpots, continuous ground"] = [
        dashpot_echo(θ, poisson, wave) for θ in np.radians(degrees)
    ]
    return [
        {
            "wave": wave,
            "poisson": poisson,
            "boundary": name,
            "degrees": degrees.tolist(),
            "energy": [float(share) for share in energy],
        }
        for name, energy in energies.items()
    ]


def cases(quick: bool) -> Iterator[tuple[str, dict, Callable[[], list[dict]]]]:
    """What is measured: kind, settings, and how."""
    for wave in WAVES:
        for poisson in POISSON:
            step = 10.0 if quick else STEPS_OF_ANGLE
            yield (
                "theory",
                dict(wave=wave, poisson=poisson),
                lambda chosen=(wave, poisson, step): theory(*chosen),
            )
    on = [(degrees, n) for degrees in ANGLES for n in (0, 3)] + [(STEEP, 3)]
    for wave in WAVES:
        for degrees, n in () if quick else on:
            name = f"layer, {n} cells" if n else "dashpots"
            yield (
                "packet",
                dict(wave=wave, degrees=degrees, boundary=name),
                lambda chosen=(wave, degrees, 0.25, n): [measured(*chosen)],
            )
    further = struck.FURTHER[:1] if quick else struck.FURTHER
    layers = struck.LAYERS[1:2] if quick else struck.LAYERS
    every = [struck.DASHPOTS, struck.SPRINGS, *layers, *further]
    few = [struck.DASHPOTS, struck.LAYERS[1], struck.FURTHER[2]]
    until = (24.0,) if quick else (120.0,)
    yield "lamb", dict(method="FE"), lambda: struck.lamb(every, False, *until)
    if not quick:
        yield "lamb", dict(method="DM-GC"), lambda: struck.lamb(few, True, *until)


def kept(path: Path) -> list[dict]:
    """Rows of an earlier run."""
    return json.loads(path.read_text()) if path.exists() else []


# -- what is shown ---------------------------------------------------------------------------------


def figure(rows: list[dict], path: Path) -> None:
    """Energy that comes back against the angle, of P and of S waves; error against cost."""
    fig, axes = report.subplots(1, 3, figsize=(13.5, 4.9), width_ratios=(1, 1, 1.15))
    for axis, wave in zip(axes, WAVES, strict=False):
        _angles(axis, [row for row in rows if row.get("wave") == wave])
        axis.set_title(f"{wave} waves, {CELLS} cells a wavelength")
    axes[0].set_ylabel("energy that comes back / energy that came (-)")
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.03, 0.0), ncols=4, fontsize=8)
    _cost(axes[2], [row for row in rows if row["kind"] == "lamb"])
    report.save(fig, path, bbox_inches="tight")


def _angles(axis, rows: list[dict]) -> None:
    for row in rows:
        if row["kind"] != "theory":
            continue
        first = row["poisson"] == POISSON[0]
        continuous = row["boundary"] not in ("dashpots",) and row["boundary"].startswith("dash")
        axis.semilogy(
            row["degrees"],
            row["energy"],
            color=COLOURS[row["boundary"]],
            ls=(":" if first else (0, (1, 3))) if continuous else ("-" if first else "--"),
            lw=1.0 if continuous else 1.6,
            label=row["boundary"] if first else None,
        )
    for boundary, mark in (("dashpots", "o"), ("layer, 3 cells", "s")):
        found = [r for r in rows if r["kind"] == "packet" and r["boundary"] == boundary]
        axis.semilogy(
            [row["degrees"] for row in found],
            [row["back"] for row in found],
            mark,
            mfc="white",
            mec=COLOURS[boundary],
            mew=1.5,
            ms=7,
            label=f"{boundary}: packets of waves, ν = 0.25",
        )
        axis.semilogy(
            [row["degrees"] for row in found],
            [row["expected"] for row in found],
            "x",
            color=COLOURS[boundary],
            ms=5,
            label=f"{boundary}: theory over the packets' spectra",
        )
    axis.axhline(LIMIT, color="0.4", lw=1.0, ls="-.", label="$3 · 10^{-5}$, the bound of the tests")
    if rows[0]["wave"] == "S":
        for poisson, style in zip(POISSON, ("-", "--"), strict=True):
            soil = soil_of(poisson)
            critical = np.degrees(np.arcsin(soil.s_speed / soil.p_speed))
            axis.axvline(critical, color="0.7", lw=0.8, ls=style, zorder=0)
            text = f"critical, ν = {poisson:g}"
            axis.text(
                critical, 1.5, text, rotation=90, va="top", ha="right", fontsize=7, color="0.3"
            )
    axis.plot([], [], "k-", lw=1.2, label="ν = 0.25")
    axis.plot([], [], "k--", lw=1.2, label="ν = 0.41")
    axis.set(xlabel="angle from the normal (degrees)", xlim=(-2, 81), ylim=(LOWEST, 2.0))
    axis.grid(alpha=0.3)


def _cost(axis, rows: list[dict]) -> None:
    for method, full in (("FE", True), ("DM-GC", False)):
        found = [row for row in rows if row["method"] == method]
        if full:
            line = [row for row in found if row["boundary"].startswith("dash")]
            axis.plot(
                [row["cost"][0] for row in line],
                [100 * row["error"] for row in line],
                color=COLOURS["dashpots"],
                lw=1.0,
            )
        for row in found:
            name = row["boundary"].split(", ")[0]
            colour = COLOURS[row["boundary"] if name == "layer" else name]
            x, y = row["cost"][0], 100 * row["error"]
            mark = {"dashpots": "o", "springs": "^", "layer": "s"}[name]
            axis.plot(x, y, mark, mec=colour, mfc=colour if full else "white", mew=1.5, ms=7)
            text = row["boundary"].replace("dashpots, ", "").replace(" further", "")
            text = text.replace("layer, ", "").replace(" cells", "")
            text = f"+{text}" if name == "dashpots" and text != "dashpots" else text
            text = f"layer {text}" if name == "layer" else text
            text = text if full else f"{text}, {method}"
            offset, side = PLACES.get((method, row["boundary"]), ((6, 4), "left"))
            axis.annotate(text, (x, y), offset, textcoords="offset points", fontsize=7.5, ha=side)
        axis.plot([], [], "ks", mfc="k" if full else "white", label=method)
    axis.set(
        xscale="log",
        yscale="log",
        xlabel="cost of a step / the same with dashpots at the box (-)",
        ylabel="error of displacement until 120 $h/c_s$ (%)",
        title="Box of 24 × 12 cells, struck on its surface",
    )
    axis.plot([], [], color=COLOURS["dashpots"], label="dashpots, so many cells further away")
    axis.set_xticks([1, 2, 3, 5, 10, 20], ["1", "2", "3", "5", "10", "20"], minor=False)
    axis.set_yticks([0.3, 1, 3, 10, 30], ["0.3", "1", "3", "10", "30"], minor=False)
    axis.minorticks_off()
    axis.set(xlim=(0.7, 24), ylim=(0.2, 30))
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7.5, loc="lower left")


def tables(rows: list[dict]) -> list[Table]:
    """Packets; error and cost."""
    packets = Table(
        *("wave", "degrees", "boundary", "back", "theory", "left", "CPU s"),
        box=None,
        title="Packets: energy that comes back",
    )
    lamb = Table(
        *("method", "boundary", "cells", "error, %", "until 40 h/c_s", "ms a step", "cost"),
        box=None,
        title="A box that is struck",
    )
    for row in rows:
        if row["kind"] == "packet":
            shares = [f"{row[name]:.3g}" for name in ("back", "expected", "left")]
            name, seconds = row["boundary"], f"{row['seconds']:.0f}"
            packets.add_row(row["wave"], str(row["degrees"]), name, *shares, seconds)
        if row["kind"] == "lamb":
            errors = [f"{100 * row[name]:.2f}" for name in ("error", "error_early")]
            cost = f"{row['cost'][0]:.2f} ({row['cost'][1]:.2f}-{row['cost'][2]:.2f})"
            lamb.add_row(
                row["method"],
                row["boundary"],
                str(row["cells"]),
                *errors,
                f"{row['ms_a_step']:.2f}",
                cost,
            )
    return [packets, lamb]


def main(arguments=None) -> list[dict]:
    """Run what is not there yet, print tables, write results/open_boundaries.json and .png."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="few angles, no packets, few steps")
    parser.add_argument("--afresh", action="store_true", help="keep no rows of an earlier run")
    chosen = report.chosen(parser, arguments)
    path = chosen.results / "open_boundaries.json"
    before, rows = [] if chosen.afresh or chosen.quick else kept(path), []
    for kind, settings, measure in track(list(cases(chosen.quick)), "open ground"):
        there = [row for row in before if {"kind": kind, **settings}.items() <= _plain(row).items()]
        if kind == "theory" or not there:
            there = report.rounded([{"kind": kind, **row} for row in measure()], 5)
        rows += there
        report.write(path, rows + [row for row in before if row not in rows])
    report.write(path, rows)
    figure(rows, chosen.results / "open_boundaries.png")
    for shown in tables(rows):
        Console(width=120).print(shown)
    return rows


def _plain(row: dict) -> dict:
    """Of a row what can be compared as settings."""
    return {name: value for name, value in row.items() if isinstance(value, str | int | float)}


if __name__ == "__main__":
    main()
