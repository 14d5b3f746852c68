"""Does a step of the material point method let disturbances grow?  Spectra of its amplification
matrix.

Equation (7) is not the derivative of the internal force that points take once strain is recovered
by averages (DM-G) or composite patches (DM-GC), so that no theorem says that Newmark's step keeps
what it should.  Here the matrix of one step is made of real steps (``amplification_map``) and its
eigenvalues are looked at, at Courant numbers 0.1 to 50:

- at rest, for bars between rollers and free blocks, over sweeps of the deposit and the points'
  places in the cell;
- with generalised α in place of Newmark;
- with DM-GC as the paper has it, and with its strain changed in other ways, which shows where
  growth comes from;
- while points cross cells at 0.3 cells a step: the product of ten steps.

What was found is in ``FOUND``, which goes into results/amplification.json.

    python studies/amplification.py          five minutes, a quarter of an hour on a busy machine
    python studies/amplification.py --quick  the smallest cases
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import report
from amplification_map import StepMap, crossing, growth
from composite_across import TensorProduct
from rich.console import Console
from rich.progress import track
from rich.table import Table

import mpm_fenicsx as mpm
from mpm_fenicsx.mapping.projection import DOUBLE_MAPPED
from mpm_fenicsx.scenes.block import bar, block, h, soil, step_of

MAPPINGS = (mpm.MPM, mpm.GIMP, mpm.DM_G, mpm.DM_GC, mpm.DM_GCL)
COURANT = (0.1, 0.25, 0.5, 1.0, 2.0, 3.5, 5.0, 10.0, 50.0)
OFFSETS = (0.0, 0.15, 0.3)  # of the seats at rest, in cells: 0 full cells, else cut ones
FOUND = [
    "At rest MPM, GIMP and DM-G let nothing grow, in any scene, at any Courant number, with 0, 1 "
    "or 2 sweeps. With dashpots on one side, or at Courant 10 and above, nothing grows in any "
    "method with Newmark's step.",
    "DM-GC as the paper has it lets a free block of 4 by 3 cells grow below Courant 2, by up to "
    "7e-3 a step: a flutter, at a rate that stays as Δt falls (0.03 c/h at Courant 0.1, 0.05 at "
    "0.01). Its cause is the polynomials across a direction, not its mass; linear across, as the "
    "package has it, the block rests.",
    "DM-GC as it is: full blocks let nothing grow. In cut cells they do at Courant 0.1, by 1e-4 to "
    "4e-4 a step (8 by 8: 1.4e-3), with 2 sweeps by up to 5e-3 below 5; stress linear over domains "
    "(DM-GCL) grows there by up to 3e-3 below Courant 3.5 (8 by 8: below 10). A free bar of 12 "
    "cells grows by 1e-6 (Courant 0.1) to 7e-5 (1 to 5), one that is held at one end by 5e-9.",
    "What grows is slow, ωh/c from 0.13 to 2.1 (the grid goes to 3.5 and beyond): modes of the "
    "body. So dissipation of high frequencies cannot stop it where the Courant number is small.",
    "The bar's cause: points take more force from u than the matrix of (7) has, 0.07 % in its "
    "first mode, 0.3 % in the second, 3 % in the last; growth a step with the square of the "
    "Courant number. Sweeps uncover it; without them the averaging of velocities outweighs it, as "
    "it does with half of DM-G's strain and half the excess.",
    "Generalised α with w = 0 stops that (ρ = 0.9 from Courant 0.5 up, 0.8 from 0.25) and only "
    "slows the flutter (ρ = 0.5: half at Courant 0.1, a fifth at 0.5; ρ = 0 stops it). Chung & "
    "Hulbert's w = ρ carries on the imbalance that points have at the start of each step: w = ρ = "
    "1 grows at every Courant number, by a tenth a step at 50.",
    "While points cross cells at 0.3 cells a step every mapping grows between Courant 0.5 and 5, "
    "most at 2 to 3.5: MPM by 5e-2, GIMP and DM-G by 1.6e-2, DM-GC by 4e-3 a step, nearly without "
    "swinging. There ρ = 0.8 leaves a sixth to a quarter of GIMP's growth and less than a tenth of "
    "DM-GC's, ρ = 0.5 at most 1e-6 and 3e-6 (DM-GC at Courant 0.5 and 1: 1e-4).",
]


def large(mapping, stepping, **where) -> mpm.Simulation:
    """A block of 8 by 8 cells."""
    return block(mapping, stepping, (8, 8), **where)


SCENES: dict[str, Callable[..., mpm.Simulation]] = {
    "bar, one end fixed": lambda *scene, **where: bar(*scene, fixed=True, **where),
    "bar, free": bar,
    "bar, dashpots": lambda *scene, **where: bar(*scene, viscous=True, **where),
    "block 4×3, free": block,
    "block 8×8, free": large,
    "block 4×3, dashpots": lambda *scene, **where: block(*scene, viscous=True, **where),
}


def interior(run: mpm.Simulation) -> mpm.Simulation:
    """DM-GC with its patch only where that has material on both sides, else GIMP's gradient."""
    return _changed(run, lambda extent: (np.ptp(extent, axis=2) == 0).all(axis=1).astype(float))


def half(run: mpm.Simulation) -> mpm.Simulation:
    """The mean of DM-GC's and DM-G's strain."""
    return _changed(run, lambda extent: np.full(len(extent), 0.5))


def across(run: mpm.Simulation) -> mpm.Simulation:
    """Polynomials in every direction, as the paper has them."""
    run.composites = [TensorProduct(run.grid)]
    return run


def _changed(run: mpm.Simulation, weight: Callable[[np.ndarray], np.ndarray]) -> mpm.Simulation:
    (composite,), (stencil,) = run.composites, run.stencils
    patch = composite.gradient_at_points

    def gradient(x, cell, nodal):
        w = weight(composite.extent[cell])[:, None, None]
        return w * patch(x, cell, nodal) + (1 - w) * stencil.gradient_at_points(nodal)

    composite.gradient_at_points = gradient
    return run


def uncorrected(mapping: mpm.Mapping, sweeps: int = 1) -> mpm.Mapping:
    """The step that the rows are of: corrections are compared in numerical_damping.py."""
    return replace(mapping, sweeps=sweeps, correction=mpm.AccelerationCorrection.OFF)


PAPERS = uncorrected(replace(mpm.DM_GC, mass=DOUBLE_MAPPED))
CHANGES = {
    "as it is": (mpm.DM_GC, lambda run: run),
    "the paper's": (PAPERS, across),
    "polynomials across": (mpm.DM_GC, across),
    "mass by (7)": (PAPERS, lambda run: run),
    "patch in the interior only": (mpm.DM_GC, interior),
    "half DM-G's": (mpm.DM_GC, half),
}


def alpha(ρ: float, w: float) -> Callable[[float], mpm.GeneralizedAlpha]:
    """Generalised α at a Courant number."""
    return lambda courant: mpm.GeneralizedAlpha(step_of(courant).dt, ρ, w)


def cases(quick: bool) -> Iterator[tuple[dict, Callable[[], dict]]]:
    """What is run: a row's labels, and how to get the rest of it."""
    numbers = COURANT[::8] if quick else COURANT

    def at_rest(labels, scene, mapping, courant, step=step_of, change=None, offset=0.0, sweeps=1):
        row = {
            "motion": "at rest",
            "scene": scene,
            "mapping": str(mapping),
            "sweeps": sweeps,
            "offset": offset,
            "radius": 1.0,
            "start": 0.0,
            "strain": "as it is",
            "courant": courant,
        }

        def measure():
            run = SCENES[scene](uncorrected(mapping, sweeps), step(courant), offset=offset)
            return growth(StepMap(change(run) if change else run).matrix, courant)

        return row | labels, measure

    for courant in numbers:
        for mapping in MAPPINGS:
            for scene in (
                "bar, one end fixed",
                "bar, free",
                "bar, dashpots",
                "block 4×3, free",
                "block 4×3, dashpots",
            ):
                yield at_rest({}, scene, mapping, courant)
            for offset in OFFSETS:
                for sweeps in (0, 1, 2):
                    if not quick and (offset or sweeps != 1):
                        yield at_rest(
                            {}, "bar, free", mapping, courant, offset=offset, sweeps=sweeps
                        )
                        yield at_rest(
                            {}, "block 4×3, free", mapping, courant, offset=offset, sweeps=sweeps
                        )
        for mapping, offset in (
            ()
            if quick
            else ((mpm.GIMP, 0.0), (mpm.DM_GC, 0.0), (mpm.DM_GC, 0.3), (mpm.DM_GCL, 0.3))
        ):
            yield at_rest({}, "block 8×8, free", mapping, courant, offset=offset)
        for ρ, w in ((0.9, 0.0), (0.8, 0.0), (0.5, 0.0), (0.0, 0.0), (1.0, 1.0), (0.8, 0.8)):
            yield at_rest({"radius": ρ, "start": w}, "bar, free", mpm.DM_GC, courant, alpha(ρ, w))
            yield at_rest(
                {"radius": ρ, "start": w, "strain": "the paper's"},
                "block 4×3, free",
                PAPERS,
                courant,
                alpha(ρ, w),
                across,
            )
        for name, (mapping, change) in list(CHANGES.items())[1:]:
            for scene in ("bar, free", "block 4×3, free"):
                yield at_rest({"strain": name}, scene, mapping, courant, change=change)
        for mapping in MAPPINGS:
            for ρ in (
                (1.0, 0.9, 0.8, 0.5) if mapping in (mpm.GIMP, mpm.DM_GC) and not quick else (1.0,)
            ):
                row = {
                    "motion": "0.3 cells a step",
                    "scene": "bar, free",
                    "mapping": str(mapping),
                    "sweeps": 1,
                    "offset": 0.0,
                    "radius": ρ,
                    "start": 0.0,
                    "strain": "as it is",
                    "courant": courant,
                }
                yield (
                    row,
                    lambda m=mapping, ρ=ρ, courant=courant: growth(
                        crossing(uncorrected(m), alpha(ρ, 0.0)(courant), cells=4 if quick else 14),
                        courant,
                        10,
                    ),
                )


def table(rows: list[dict]) -> Table:
    """The largest growth over Courant numbers, scene by scene, and where."""
    found = Table(
        "motion",
        "scene",
        "mapping",
        "sweeps",
        "offset",
        "ρ, w",
        "strain",
        "growth a step",
        "Courant",
        "ωh/c",
        "grows at Courant",
    )
    groups: dict[tuple, list[dict]] = {}
    for row in rows:
        key = (
            *(row[k] for k in ("motion", "scene", "mapping", "sweeps", "offset")),
            f"{row['radius']:g}, {row['start']:g}",
            row["strain"],
        )
        groups.setdefault(key, []).append(row)
    for key, group in groups.items():
        most = max(group, key=lambda row: row["growth"])
        where = [f"{row['courant']:g}" for row in group if row["growth"] > 1e-9]
        found.add_row(
            *map(str, key),
            f"{most['growth']:+.1e}",
            f"{most['courant']:g}",
            f"{most['frequency']:.2f}",
            " ".join(where),
        )
    return found


STYLES = {
    "MPM": ("#CC79A7", "v"),
    "GIMP": ("#E69F00", "s"),
    "DM-G": ("#009E73", "^"),
    "DM-GC": ("#0072B2", "o"),
    "DM-GCL": ("#D55E00", "D"),
}
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#000000")


def figure(rows: list[dict], path: Path) -> None:
    """Growth a step over the Courant number: mappings above, what changes DM-GC's below."""
    usual = {
        "motion": "at rest",
        "sweeps": 1,
        "offset": 0.0,
        "radius": 1.0,
        "start": 0.0,
        "strain": "as it is",
    }

    def curve(axis, label, color, marker, **wanted):
        wanted = usual | wanted
        chosen = [row for row in rows if all(row[k] == v for k, v in wanted.items())]
        if chosen:
            axis.plot(
                [row["courant"] for row in chosen],
                [row["growth"] for row in chosen],
                color=color,
                marker=marker,
                ms=4,
                lw=1.3,
                label=label,
            )

    fig, axes = report.subplots(2, 4, figsize=(14, 7), sharex=True, sharey=True)
    above = (
        ("at rest: bar, one end fixed", {"scene": "bar, one end fixed"}),
        ("at rest: bar, free", {"scene": "bar, free"}),
        ("at rest: block of 4 × 3 cells, free", {"scene": "block 4×3, free"}),
        ("bar of 14 cells, 0.3 cells a step", {"motion": "0.3 cells a step", "scene": "bar, free"}),
    )
    for axis, (title, wanted) in zip(axes[0], above, strict=True):
        axis.set_title(title, fontsize=10)
        for name, style in STYLES.items():
            curve(axis, name, *style, **wanted, mapping=name)
    gc, small = {"scene": "bar, free", "mapping": "DM-GC"}, {"scene": "block 4×3, free"}
    places = [
        (f"{o:g} cells, {s} sweeps", {"offset": o, "sweeps": s})
        for o in (0.0, 0.3)
        for s in (0, 1, 2)
    ]
    moving = {"scene": "bar, free", "motion": "0.3 cells a step"}
    names = ("as it is", "the paper's", "polynomials across", "mass by (7)", "half DM-G's")
    below = (
        ("DM-GC, free bar: offset, sweeps", places),
        (
            "DM-GC, free bar: generalised α",
            [
                (f"ρ = {ρ:g}, w = {w:g}", {"radius": ρ, "start": w})
                for ρ, w in ((1.0, 0.0), (0.9, 0.0), (0.8, 0.0), (0.5, 0.0), (0.8, 0.8), (1.0, 1.0))
            ],
        ),
        (
            "DM-GC, free block 4 × 3: variants",
            [
                *((name, small | {"strain": name}) for name in names),
                ("8 × 8, as it is", {"scene": "block 8×8, free"}),
            ],
        ),
        (
            "14 cells, 0.3 cells a step: generalised α",
            [
                (f"{name}, ρ = {ρ:g}", moving | {"mapping": name, "radius": ρ})
                for name in ("GIMP", "DM-GC")
                for ρ in (1.0, 0.8, 0.5)
            ],
        ),
    )
    for axis, (title, curves) in zip(axes[1], below, strict=True):
        axis.set_title(title, fontsize=10)
        for (label, wanted), color, marker in zip(curves, COLOURS, "os^vDx", strict=False):
            curve(axis, label, color, marker, **gc | wanted)
        axis.set_xlabel("Courant number (-)")
    for axis in axes.flat:
        axis.axhline(0.0, color="0.4", lw=2.0, zorder=0, label="exact, 0")
        axis.axhspan(0.0, 1.0, color="#D55E00", alpha=0.07, zorder=0)
        axis.set(xscale="log", ylim=(-1.0, 0.3))
        axis.set_yscale("symlog", linthresh=1e-6)
        axis.set_yticks([-1e-1, -1e-3, -1e-5, 0.0, 1e-5, 1e-3, 1e-1])
        axis.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=7, loc="lower left")
    for axis in axes[1]:
        axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    for axis in axes[:, 0]:
        axis.set_ylabel("largest |λ| - 1, a step (-)")
    fig.suptitle(
        "Growth of the fastest growing (or slowest decaying) mode in one step; shaded: it grows"
    )
    report.save(fig, path)


def main(arguments=None) -> list[dict]:
    """Run all cases, print the table, write results/amplification.json and .png."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="the smallest cases only")
    chosen = report.chosen(parser, arguments)
    rows = []
    for labels, measure in track(list(cases(chosen.quick)), "spectra"):
        rows.append(labels | report.rounded(measure(), 4))
    document = {"found": FOUND, "cell_m": h, "p_speed_m_s": soil.p_speed, "rows": rows}
    report.write(chosen.results / "amplification.json", document)
    figure(rows, chosen.results / "amplification.png")
    Console(width=150).print(table(rows))
    return rows


if __name__ == "__main__":
    main()
