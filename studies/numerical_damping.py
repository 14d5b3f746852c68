"""What a wave loses that nothing damps, what grows that should not, and what a step costs: variants
of the step.

A standing wave in an undamped elastic body keeps its energy, and the trapezoidal rule takes nothing
off a linear system whatever its step: finite elements show it.  Material points lose in every step
what the deposit of velocities smooths, and what their own force and that of the step's matrix, eq.
(7), differ by.  Measured, for each of ``VARIANTS``:

    damping   equivalent damping ratio ζ = -(d ln E/dt) T/4π (%) of P and S waves along an axis and
              on the diagonal (``Wave``; fit in ``damping_ratio``), over Poisson's ratio, cells a
              wavelength and Courant number
    far       the same far from walls, whose share falls with the length of the body
    at rest   largest |λ| - 1 a step, free bars and blocks on grid lines and off them
              (``amplification_map.py``)
    crossing  the same while points cross 0.3 cells a step
    cost      a step over that of the default, in turns, on 96 × 64 cells with 24,576 points

Writes results/numerical_damping.json now and then, and .png; what is in the file for this DOLFINx
is not measured again, but for the cost.  To try another step, add a line to ``VARIANTS``.

    export OMP_NUM_THREADS=1
    python studies/numerical_damping.py  # everything, 20 minutes
    python studies/numerical_damping.py --again "DM-GC, b_bar"  # that variant anew
    python studies/numerical_damping.py --quick  # four variants, a minute
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import report
from amplification import across
from numerical_damping_cases import (
    as_it_is,
    cost,
    damping,
    damping_far,
    growth_at_rest,
    growth_crossing,
)
from rich.console import Console
from rich.progress import track

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.wave import Wave

OFF, LUMPED = mpm.AccelerationCorrection.OFF, mpm.AccelerationCorrection.LUMPED
EXACT, DEFAULT = "finite elements", "DM-GC"
VARIANTS: dict[str, mpm.Mapping | None] = {
    EXACT: None,
    "MPM": mpm.MPM,
    "GIMP": mpm.GIMP,
    "CMPM": mpm.CMPM,
    "DM": mpm.DM,
    "DM-G": mpm.DM_G,
    "DM-C": mpm.DM_C,
    DEFAULT: mpm.DM_GC,
    "DM-GCL": mpm.DM_GCL,
    "the paper's": mpm.PAPER["mapping"],
    "DM-GC, uncorrected": replace(mpm.DM_GC, sweeps=1, correction=OFF),
    "DM-GC, lumped": replace(mpm.DM_GC, sweeps=1, correction=LUMPED),
    "DM-GC, 1 sweep": replace(mpm.DM_GC, sweeps=1),
    "DM-GC, 2 sweeps": replace(mpm.DM_GC, sweeps=2),
    "DM-GC, 3 sweeps": replace(mpm.DM_GC, sweeps=3),
    "DM-G, uncorrected": replace(mpm.DM_G, sweeps=1, correction=OFF),
    "DM-GC, b_bar": replace(mpm.DM_GC, b_bar=True),
}
CHANGES = {
    "the paper's": across
}  # what is done to a variant's runs once they are built: its polynomials
QUICK = (EXACT, "DM-G", DEFAULT, "the paper's")
POISSON, CELLS, COURANT = (0.25, 0.41, 0.48), (6, 10, 20, 40), (0.25, 0.5, 1.0, 2.0, 3.5, 5.0)
USUAL = {"cells": 10, "courant": 0.5}
OFFSETS, GROWING, CROSSING = (0.0, 0.15, 0.3), (0.5, 1.0, 2.0, 3.5, 5.0, 10.0), (0.5, 1.0, 2.0, 5.0)
NUMBERS = (
    "damping",
    "growth",
    "ratio",
    "seconds",
    "iterations",
    "cells_exact",
    "failed",
    "commit",
    "dolfinx",
)


# -- what is measured ------------------------------------------------------------------------------


def cases(name: str, quick: bool) -> Iterator[tuple[dict, object]]:
    """Labels of a variant's rows, but those of cost, and how to get the rest of them."""
    mapping, change = VARIANTS[name], CHANGES.get(name, as_it_is)
    ratios = POISSON[:2] if quick else POISSON
    at = [(n, USUAL["courant"]) for n in CELLS] + [
        (USUAL["cells"], C) for C in COURANT if C != USUAL["courant"]
    ]
    for kind in "PS":
        for direction in ("axis", "diagonal"):
            for poisson in ratios:
                for cells, courant in [tuple(USUAL.values())] if quick else at:
                    wave = Wave(kind, direction, poisson, cells, courant)
                    labels = {
                        "variant": name,
                        "kind": kind,
                        "direction": direction,
                        "poisson": poisson,
                        "cells": cells,
                        "courant": courant,
                    }
                    yield (
                        {"measure": "damping", **labels},
                        lambda w=wave: damping(w, mapping, change),
                    )
                    if cells == USUAL["cells"] and courant in (0.5, 1.0) and not quick:
                        yield (
                            {"measure": "far", **labels},
                            lambda w=wave: damping_far(w, mapping, change),
                        )
    if mapping is None:
        return
    for poisson in ratios[:1] if quick else ratios:
        for courant in CROSSING[2:3] if quick else CROSSING:
            yield (
                {"measure": "crossing", "variant": name, "poisson": poisson, "courant": courant},
                lambda ν=poisson, C=courant: growth_crossing(
                    ν, C, mapping, change, cells=4 if quick else 8
                ),
            )
        for courant in GROWING[1:2] if quick else GROWING:
            for offset in OFFSETS[:1] if quick else OFFSETS:
                for scene in ("bar", "block"):
                    labels = {
                        "measure": "at rest",
                        "variant": name,
                        "scene": scene,
                        "offset": offset,
                        "poisson": poisson,
                        "courant": courant,
                    }
                    yield (
                        labels,
                        lambda s=scene, ν=poisson, C=courant, o=offset: growth_at_rest(
                            s, ν, C, o, mapping, change
                        ),
                    )


def labels_of(row: dict) -> tuple:
    """What tells a row from others."""
    return tuple(sorted((key, value) for key, value in row.items() if key not in NUMBERS))


class Book:
    """Rows of this DOLFINx by their labels, kept in a file; those of another stay as they are."""

    def __init__(self, path: Path, again: list[str]):
        self.path = path
        known = json.loads(path.read_text())["rows"] if path.exists() else []
        self.others = [row for row in known if row["dolfinx"] != report.dolfinx()]
        self.rows = {
            labels_of(row): row
            for row in known
            if row not in self.others and row["variant"] not in again
        }
        self.commit = report.commit("describe", "--always", "--dirty")

    def measure(self, labels: dict, how) -> None:
        """Write down a row, with what went wrong if it did."""
        try:
            found = how()
        except mpm.RunError as error:
            found = {"failed": str(error)}
        self.add(labels, found)

    def add(self, labels: dict, found: dict) -> None:
        """Write down what was found, to four digits."""
        row = {
            **labels,
            **report.rounded(found, 4),
            "dolfinx": report.dolfinx(),
            "commit": self.commit,
        }
        self.rows[labels_of(row)] = row

    def write(self) -> None:
        """Write the file anew, or leave it as it was."""
        units = {"damping": "%", "growth": "largest |λ| - 1 a step"}
        report.write(self.path, units | {"rows": [*self.rows.values(), *self.others]})


# -- what is shown ---------------------------------------------------------------------------------


def values(rows: list[dict], number: str, **wanted) -> list[float]:
    """A number of all rows that are as wanted; of those that failed infinity."""
    chosen = [row for row in rows if all(row.get(key) == value for key, value in wanted.items())]
    return [np.inf if row.get(number) is None else row[number] for row in chosen]


def worst(rows: list[dict], number: str, **wanted) -> float | None:
    """The one of largest size among rows as wanted, with its sign."""
    return max(values(rows, number, **wanted), key=abs, default=None)


def largest(rows: list[dict], **wanted) -> float | None:
    """The largest growth; what is no more than round-off is none."""
    found = max(values(rows, "growth", **wanted), default=None)
    return found if found is None or found > 1e-9 else 0.0


def text(value: float | None, style: str = ".2g") -> str:
    """A cell of a table."""
    if value is None:
        return "–"
    if abs(value) < 1e-9:
        return "0"
    return format(value, style).replace("-", "−") if np.isfinite(value) else "failed"


def markdown(heads: list[str], lines: list[list[str]]) -> str:
    """A table."""
    return "\n".join(f"| {' | '.join(line)} |" for line in [heads, ["---"] * len(heads), *lines])


def tables(rows: list[dict]) -> list[str]:
    """Damping by direction and Poisson's ratio; the worst of all, growth and cost."""
    names = [name for name in VARIANTS if any(row["variant"] == name for row in rows)]
    ratios = [ν for ν in POISSON if values(rows, "damping", poisson=ν)]
    columns = [(kind, direction) for kind in "SP" for direction in ("axis", "diagonal")]
    lines = [
        [
            name,
            *(
                " / ".join(
                    text(
                        worst(
                            rows,
                            "damping",
                            measure="damping",
                            variant=name,
                            kind=kind,
                            direction=direction,
                            poisson=ν,
                            **USUAL,
                        )
                    )
                    for ν in ratios
                )
                for kind, direction in columns
            ),
        ]
        for name in names
    ]
    heads = [
        f"{kind}, {'along an axis' if direction == 'axis' else 'diagonal'}"
        for kind, direction in columns
    ]
    first = markdown(["", *heads], lines)
    lines = []
    for name in names:
        mine = [row for row in rows if row["variant"] == name]
        line = [name]
        for measure in ("damping", "far"):
            line += [
                text(worst(mine, "damping", measure=measure, cells=USUAL["cells"], courant=C))
                for C in (0.5, 1.0)
            ]
        far = values(mine, "damping", measure="far")
        line += [text(min(far)) if far and min(far) < -1e-9 else "–" if not far else "0"]
        line += [
            text(largest(mine, measure="at rest", scene=scene), ".1e") for scene in ("bar", "block")
        ]
        line += [text(largest(mine, measure="crossing", courant=C), ".1e") for C in (1.0, 2.0)]
        ratio = next((row["ratio"] for row in mine if row["measure"] == "cost"), None)
        line += ["–" if ratio is None else "{:.2f} ({:.2f}-{:.2f})".format(*ratio)]
        lines.append(line)
    heads = [
        "",
        "worst ζ, %, Courant 0.5",
        "1",
        "far from walls, 0.5",
        "1",
        "least far",
        "growth at rest, bar",
        "block",
        "crossing cells, Courant 1",
        "2",
        "step (quartiles)",
    ]
    ratios = " / ".join(f"{ν:g}" for ν in ratios)
    return [
        f"Damping ratio ζ (%), {USUAL['cells']} cells a wavelength, Courant {USUAL['courant']:g}; "
        f"ν = {ratios}",
        first,
        "Worst of P and S, axis and diagonal, all ν, 10 cells a wavelength; growth a step, largest "
        "over ν, Courant numbers and offsets; step over that of the default",
        markdown(heads, lines),
    ]


COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8B5A2B", "#7F7F7F")
MARKS = "sD^vP*X<>"  # as many as are coprime to the colours


def figure(rows: list[dict], path: Path) -> None:
    """Worst damping over cells a wavelength (mappings, variants) and Courant number, and against
    growth."""
    names = [
        name for name in VARIANTS if name != EXACT and any(row["variant"] == name for row in rows)
    ]
    plain = [name for name in names if name == VARIANTS[name].name]
    others = [name for name in names if name not in plain]
    changed = [DEFAULT, *others]
    style = {
        name: dict(color=COLOURS[n % 8], marker=MARKS[n % 9], ls="-")
        for n, name in enumerate(plain)
    }
    style |= {
        name: dict(color=COLOURS[n % 8], marker=MARKS[n % 9], ls="--", mfc="none")
        for n, name in enumerate(others)
    }
    style[DEFAULT] = dict(color="#000000", marker="o", ls="-", lw=2.2)
    fig, axes = report.subplots(2, 2, figsize=(13, 10))

    def curves(axis, chosen, label, **usual):
        number = "courant" if "cells" in usual else "cells"
        for name in chosen:
            at = sorted(
                {
                    row[number]
                    for row in rows
                    if row["measure"] == "damping"
                    and all(row[key] == value for key, value in usual.items())
                }
            )
            ζ = [
                worst(rows, "damping", measure="damping", variant=name, **{number: x}, **usual)
                for x in at
            ]
            axis.plot(
                at, np.abs(np.array(ζ, float)), **{"lw": 1.3, "ms": 5, **style[name]}, label=name
            )
        axis.axhline(0.0, color="0.45", lw=3.0, zorder=0, label="exact, and finite elements: 0")
        axis.set(xscale="log", xlabel=label, ylabel="largest |ζ| over P, S, axis, diagonal, ν (%)")
        axis.set_yscale("symlog", linthresh=1e-3, linscale=0.4)
        axis.set_ylim(-2e-4, 50.0)
        axis.set_xticks(at, [f"{x:g}" for x in at])
        axis.minorticks_off()
        axis.grid(alpha=0.3)

    curves(axes[0, 0], plain, "cells a wavelength (-)", courant=USUAL["courant"])
    curves(axes[0, 1], changed, "cells a wavelength (-)", courant=USUAL["courant"])
    curves(axes[1, 0], changed, "Courant number of the P wave (-)", cells=USUAL["cells"])
    axes[0, 0].set_title(f"mappings, Courant {USUAL['courant']:g}", fontsize=10)
    axes[0, 1].set_title(f"steps, Courant {USUAL['courant']:g}", fontsize=10)
    axes[1, 0].set_title(f"steps, {USUAL['cells']} cells a wavelength", fontsize=10)
    for axis in axes.flat[:2]:
        axis.legend(fontsize=8, loc="upper right")
    axis = axes[1, 1]
    for name in names:
        ζ = worst(rows, "damping", measure="damping", variant=name, **USUAL)
        grown = largest(rows, measure="crossing", variant=name)
        if ζ is not None and grown is not None and np.isfinite([ζ, grown]).all():
            axis.plot(abs(ζ), grown, **style[name] | {"ls": "", "ms": 9, "mew": 1.8})
    axis.plot(
        0.0, 0.0, "x", color="0.45", ms=12, mew=3.0, label="exact: 0, 0", clip_on=False, zorder=5
    )
    axis.set_xscale("symlog", linthresh=1e-2, linscale=0.4)
    axis.set_yscale("symlog", linthresh=1e-4, linscale=0.4)
    axis.set(
        xlabel=f"largest |ζ|, {USUAL['cells']} cells a wavelength, Courant {USUAL['courant']:g} "
        "(%)",
        ylabel="largest growth crossing cells, |λ| - 1 a step (-)",
        xlim=(0.0, None),
        ylim=(0.0, None),
    )
    axis.set_title("damping against growth at 0.3 cells a step, Courant 0.5 to 5", fontsize=10)
    axis.legend(
        fontsize=8,
        loc=(0.03, 0.3),
        title="filled: mappings; open: steps; marks as above",
        title_fontsize=8,
    )
    axis.grid(alpha=0.3)
    fig.suptitle("Equivalent damping ratio ζ of standing waves that nothing damps: exact 0")
    report.save(fig, path)


def main(arguments=None) -> list[dict]:
    """Measure what is not there yet, write results/numerical_damping.json and .png, print the
    tables."""
    parser = report.parser(__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="four variants, few waves, a small grid for the cost"
    )
    parser.add_argument(
        "--again", nargs="*", metavar="VARIANT", help="measure these anew; without a name all"
    )
    chosen = report.chosen(parser, arguments)
    again = [] if chosen.again is None else chosen.again or list(VARIANTS)
    book = Book(chosen.results / "numerical_damping.json", again)
    names = [name for name in VARIANTS if name in QUICK or not chosen.quick]
    todo = [
        case
        for name in names
        for case in cases(name, chosen.quick)
        if labels_of(case[0]) not in book.rows
    ]
    todo.sort(
        key=lambda case: (case[0]["measure"] == "far", case[0].get("cells", 0))
    )  # the long ones last
    try:
        for number, (labels, how) in enumerate(track(todo, "waves and growth")):
            book.measure(labels, how)
            if number % 100 == 99:
                book.write()
    finally:
        book.write()
    points = {name: VARIANTS[name] for name in names if VARIANTS[name] is not None}
    cell, rounds = (0.25, 2) if chosen.quick else (0.0625, 12)
    for name, found in cost(points, CHANGES, DEFAULT, cell, rounds).items():
        book.add({"measure": "cost", "variant": name}, found)
    book.write()
    rows = [row for row in book.rows.values() if row["variant"] in VARIANTS]
    figure(rows, chosen.results / "numerical_damping.png")
    for part in tables(rows):
        print(part, end="\n\n")
    commits = sorted({row["commit"] for row in rows})
    Console().print(f"DOLFINx {report.dolfinx()}; commits {', '.join(commits)}")
    return rows


if __name__ == "__main__":
    main()
