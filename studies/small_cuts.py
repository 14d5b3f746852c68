"""Small cuts: what a body does that lies a hair over grid lines, left alone and with
``GhostPenalty``.

    condition     of the matrix with unit diagonal, nodes without material left out: a corner of a
                  free block lies a part of a cell over grid lines in every direction, and balls lie
                  anywhere
    acceleration  largest of the grid, in σ/(ρ h), when a stress σ in the block is set free
    statics       a block in tension, σ, under a traction of 1.01 σ: error of its stress and of how
                  far its edge moves, relative to what the 1 % does; exact but for the strain of the
                  sliver, which is worth cut/4
    accuracy      manufactured bar that drifts (``scenes.bar``), the column at 0.3 kPa
                  (``scenes.column``)
    foundation    ``scenes.foundation``, 26 kPa, absorbing sides, cells of 0.125 m: rescues of the
                  linear solver, iterations and ms a step, and how far the grid's nodes go in a step

Writes results/small_cuts.json and .png.

    python studies/small_cuts.py                  some minutes
    python studies/small_cuts.py --steps 0        without the foundation
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import report
from rich.console import Console
from rich.progress import track
from rich.table import Table
from small_cuts_cases import bar, drift, pulse, released, statics

from mpm_fenicsx import DM_GC, GIMP, MPM, GhostPenalty

MAPPINGS, CURES = (MPM, GIMP, DM_GC), {"none": [], "ghost penalty": [GhostPenalty()]}
CUTS, COURANT = 10.0 ** -np.arange(1.0, 8.5), (0.05, 0.5, 5.0)


def cases(steps: int, quick: bool = False):
    """What is measured: kind, settings, and how."""
    both = [(mapping, name) for mapping in MAPPINGS for name in CURES]
    cuts, courants, dims = (CUTS[::3], COURANT[1:2], (2,)) if quick else (CUTS, COURANT, (2, 3))
    for mapping, name in both:
        cure = CURES[name]
        for dim in dims:
            for courant in courants:
                for shape, seed in [("block", 0)] + [
                    ("ball", seed) for seed in range(1 if quick or dim == 3 else 3)
                ]:
                    for cut in cuts:
                        yield (
                            "released",
                            dict(
                                mapping=str(mapping),
                                cure=name,
                                dim=dim,
                                courant=courant,
                                shape=shape,
                                seed=seed,
                                cut=float(cut),
                            ),
                            lambda chosen=(shape, dim, cut, mapping, courant, cure, seed): released(
                                *chosen
                            ),
                        )
        if (
            mapping is MPM
        ):  # a point alone in a cell is no body: of it the matrix alone is of interest
            continue
        for cut in cuts:
            yield (
                "statics",
                dict(mapping=str(mapping), cure=name, cut=float(cut)),
                lambda chosen=(cut, mapping, cure): {"error": statics(*chosen)},
            )
        for scene in () if quick else ("moving", "random"):
            for cells in (10, 20, 40):
                yield (
                    "bar",
                    dict(mapping=str(mapping), cure=name, scene=scene, cells=cells),
                    lambda chosen=(scene, mapping, cure, cells): bar(*chosen),
                )
        for base in () if quick else ("fixed", "viscous"):
            yield (
                "column",
                dict(mapping=str(mapping), cure=name, scene=base),
                lambda chosen=(base, mapping, cure): pulse(*chosen),
            )
    for name in CURES if steps else ():
        yield (
            "foundation",
            dict(mapping="DM-GC", cure=name),
            lambda name=name: drift(CURES[name], steps),
        )


# -- what is shown ---------------------------------------------------------------------------------


def figure(rows: list[dict], path: Path) -> None:
    """Condition, acceleration and error in statics against the cut."""
    styles = {
        ("GIMP", "none"): ("#d55e00", "-", "o"),
        ("GIMP", "ghost penalty"): ("#e69f00", "--", "s"),
        ("DM-GC", "none"): ("#0072b2", "-", "^"),
        ("DM-GC", "ghost penalty"): ("#009e73", "--", "v"),
    }
    released_ = [row for row in rows if row["kind"] == "released" and row["shape"] == "block"]
    courant = min(row["courant"] for row in released_)
    fig, axes = report.subplots(1, 3, figsize=(12, 4.0))
    for (mapping, cure), (color, line, mark) in styles.items():

        def curve(found, name, mapping=mapping, cure=cure):
            mine = [row for row in found if (row["mapping"], row["cure"]) == (mapping, cure)]
            return [row["cut"] for row in mine], [row[name] for row in mine]

        kept = [row for row in released_ if row["courant"] == courant and row["dim"] == 2]
        label = f"{mapping}, {'with' if cure != 'none' else 'without'} ghost penalty"
        for axis, name in zip(axes, ("condition", "acceleration"), strict=False):
            axis.loglog(*curve(kept, name), color=color, ls=line, marker=mark, ms=4, label=label)
        axes[2].loglog(
            *curve([row for row in rows if row["kind"] == "statics"], "error"),
            color=color,
            ls=line,
            marker=mark,
            ms=4,
            label=label,
        )
    axes[2].loglog(CUTS, CUTS / 4, color="0.5", lw=1.0, label="strain of the sliver, cut/4")
    axes[0].set(
        ylabel="condition number, unit diagonal (-)",
        ylim=(1.0, 1e2),
        title="Matrix of a free block",
    )
    axes[1].set(ylabel="largest nodal acceleration / (σ/ρh) (-)", title="Stress σ set free")
    axes[2].set(ylabel="error / what 1 % of traction does (-)", title="Statics")
    for axis in axes:
        axis.set_xlabel("cut, part of a cell (-)")
        axis.grid(alpha=0.3)
        axis.invert_xaxis()
    axes[2].legend(fontsize=8)
    fig.suptitle(f"A corner a little over grid lines, 2D; in dynamics Courant {courant:g}")
    report.save(fig, path)


def tables(rows: list[dict]) -> list[Table]:
    """Worst over cuts and shapes; errors; the foundation."""
    worst = Table(
        "mapping",
        "cure",
        "dim",
        "Courant",
        "condition",
        "acceleration",
        "iterations",
        box=None,
        title="Worst over cuts of 0.1 … 1e-8 and shapes",
    )
    groups: dict[tuple, list[dict]] = {}
    for row in rows:
        if row["kind"] == "released":
            groups.setdefault((row["mapping"], row["cure"], row["dim"], row["courant"]), []).append(
                row
            )
    for key, found in groups.items():
        most = [
            max(row[name] for row in found) for name in ("condition", "acceleration", "iterations")
        ]
        worst.add_row(*map(str, key), f"{most[0]:.3g}", f"{most[1]:.2g}", f"{most[2]}")
    errors = Table("", "mapping", "cure", "scene", "cells", "errors, %", box=None, title="Accuracy")
    for row in rows:
        if row["kind"] in ("bar", "column"):
            found = ", ".join(
                f"{name[6:]} {100 * e:.3f}" for name, e in row.items() if name.startswith("error_")
            )
            errors.add_row(
                row["kind"],
                row["mapping"],
                row["cure"],
                row["scene"],
                str(row.get("cells", "")),
                found,
            )
    sliding = Table(
        "cure",
        "steps",
        "rescues",
        "iterations",
        "solves a step",
        "ms a step",
        "furthest node, m",
        box=None,
        title="Foundation between dashpots, 26 kPa, 0.125 m",
    )
    for row in rows:
        if row["kind"] == "foundation":
            sliding.add_row(
                row["cure"],
                str(row["steps"]),
                str(row["rescues"]),
                f"{row['iterations']:.1f}",
                f"{row['solves_a_step']:.2f}",
                f"{row['ms_a_step']:.1f}",
                f"{row['furthest_node_m']:.2g}",
            )
    return [worst, errors, sliding]


def main(arguments=None) -> list[dict]:
    """Run all cases, print tables, write results/small_cuts.json and .png."""
    parser = report.parser(__doc__)
    parser.add_argument("--steps", type=int, default=2000, help="of the foundation")
    parser.add_argument("--quick", action="store_true", help="few cuts in 2D, no bar, no column")
    chosen = report.chosen(parser, arguments)
    rows = [
        {"kind": kind, **settings, **measure()}
        for kind, settings, measure in track(list(cases(chosen.steps, chosen.quick)), "cuts")
    ]
    report.write(chosen.results / "small_cuts.json", report.rounded(rows, 5))
    figure(rows, chosen.results / "small_cuts.png")
    for shown in tables(rows):
        Console(width=120).print(shown)
    return rows


if __name__ == "__main__":
    main()
