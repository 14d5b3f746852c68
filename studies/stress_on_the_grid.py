"""The internal force summed at the points, or from their stress double-mapped to the grid: which is
better?

``replace(DM_GC, stress=DOUBLE_MAPPED)`` takes the force from the double-mapped stress as eq. (7)
takes the stiffness.  Measured beside the default, and GIMP:

    column      viscous base, 300 kPa: error of the pressure at mid-height (relative L2)
    waves       standing waves of shear and of pressure on the diagonal of a square between smooth
                walls, 10 and 20 cells a side: error of stress (relative L2 over a period)
    crossing    a free block under uniform tension goes aslant, 0.3 and 0.17 of a cell a step:
                largest error of stress in 100 steps
    foundation  cells of 0.25 and 0.125 m, fixed and viscous edges: error of q(t) at point 2
                (relative L2) against finite elements with cells of 0.03125 m

Writes results/stress_on_the_grid.json and .png.

    python studies/stress_on_the_grid.py
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import report
from composite_across import wave
from rich.console import Console
from rich.table import Table

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes import column, crossing, foundation

WAYS = {
    "DM-GC, at the points": mpm.DM_GC,
    "DM-GC, from the grid": replace(mpm.DM_GC, stress=mpm.DOUBLE_MAPPED),
    "GIMP": mpm.GIMP,
}
FINE = 0.03125  # m, of the finite elements that the foundation is compared with


def pressure(mapping: mpm.Mapping) -> tuple[float, int]:
    """Error of the column, and its steps."""
    run = column.material_points("viscous", load=300e3, mapping=mapping)
    watch = column.Watch(run, "viscous", load=300e3)
    run.until(column.end)
    return watch.errors()["error_pressure_mid"], run.steps


def standing(mapping: mpm.Mapping, kind: str, cells: int) -> tuple[float, int]:
    """Error of stress of a standing wave, and its steps."""
    run = []

    def made(*scene) -> mpm.Simulation:
        run.append(mpm.Simulation(*scene, mapping))
        return run[0]

    error = wave(made, kind, cells)["error_stress"]
    return error, run[0].steps


def crossed(mapping: mpm.Mapping, courant: float) -> tuple[float, int]:
    """Largest error of stress of a block that crosses cells, and its steps."""
    found, _ = crossing.block(mapping, courant, 100)
    return found.max(), len(found)


class Deviator:
    """q (Pa) at the foundation's second point, in time."""

    def __init__(self, run):
        self.probe = run.record(mpm.Probe("stress", foundation.point_2))
        run.until(foundation.end)
        self.q = mpm.tensors.von_mises(self.probe.values)


def pressed(
    mapping: mpm.Mapping, boundary: str, cell: float, fine: dict[str, np.ndarray]
) -> tuple[float, int]:
    """Error of q at point 2, and steps."""
    run = foundation.Foundation(boundary, cell=cell).material_points(mapping)
    q = Deviator(run).q
    return float(np.linalg.norm(q - fine[boundary]) / np.linalg.norm(fine[boundary])), run.steps


def row(scene: str, way: str, job: Callable, *of) -> dict:
    """One run with its cost, ms of CPU time a step, the set-up included."""
    start = time.process_time()
    error, steps = job(WAYS[way], *of)
    ms = 1e3 * (time.process_time() - start) / max(steps, 1)
    return {"scene": scene, "way": way, "error": error, "steps": steps, "ms": ms}


def draw(rows: list[dict], path) -> None:
    """A line a scene: errors, and CPU time a step as a part of the default's."""
    scenes = list(dict.fromkeys(one["scene"] for one in rows))
    figure, (left, right) = report.subplots(1, 2, figsize=(9, 4.2), sharey=True)
    for way, marker, colour in zip(WAYS, "os^", ("#0072B2", "#D55E00", "#009E73"), strict=True):
        mine = [one for one in rows if one["way"] == way]
        usual = [one["ms"] for one in rows if one["way"] == next(iter(WAYS))]
        style = dict(marker=marker, color=colour, linestyle="", alpha=0.8, label=way)
        left.plot([one["error"] for one in mine], range(len(scenes)), **style)
        part = [one["ms"] / ms for one, ms in zip(mine, usual, strict=True)]
        right.plot(part, range(len(scenes)), **style)
    left.set(xscale="log", xlabel="error (-)", yticks=range(len(scenes)), yticklabels=scenes)
    left.invert_yaxis()
    right.set(xlabel="CPU time a step, of the default's (-)")
    for ax in (left, right):
        ax.grid(alpha=0.3)
    left.legend(fontsize=8)
    report.save(figure, path)


def main(arguments=None) -> list[dict]:
    """Run all, print the table, write the results."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="waves and crossing alone")
    chosen, console = report.chosen(parser, arguments), Console(width=120)
    jobs = [
        (f"wave, {kind}, {cells} cells", standing, kind, cells)
        for kind in ("shear", "pressure")
        for cells in (10, 20)
    ]
    jobs += [(f"crossing, Courant {courant:g}", crossed, courant) for courant in (0.5, 5.0)]
    if not chosen.quick:
        fine = {
            boundary: Deviator(foundation.Foundation(boundary, cell=FINE).finite_elements()).q
            for boundary in ("fixed", "viscous")
        }
        jobs.append(("column, viscous, 300 kPa", pressure))
        jobs += [
            (f"foundation, {boundary}, {cell:g} m", pressed, boundary, cell, fine)
            for boundary in fine
            for cell in (0.25, 0.125)
        ]
    for mapping in WAYS.values():
        standing(mapping, "shear", 4)  # what is compiled is not to be timed
    rows = []
    with report.progress(console, 30) as bar:
        task = bar.add_task("", total=len(jobs) * len(WAYS))
        for scene, job, *of in jobs:
            for way in WAYS:
                bar.update(task, description=scene)
                rows.append(row(scene, way, job, *of))
                bar.advance(task)
    shown = Table(title="Internal force from the points or from the grid", box=None)
    for name in ("scene", *WAYS, "ms a step"):
        shown.add_column(name)
    for k in range(0, len(rows), len(WAYS)):
        of = rows[k : k + len(WAYS)]
        shown.add_row(
            of[0]["scene"],
            *(f"{one['error']:.2e}" for one in of),
            " ".join(f"{one['ms']:.2f}" for one in of),
        )
    console.print(shown)
    report.write(
        chosen.results / "stress_on_the_grid.json",
        report.rounded([{**one, "dolfinx": report.dolfinx()} for one in rows], 4),
    )
    draw(rows, chosen.results / "stress_on_the_grid.png")
    return rows


if __name__ == "__main__":
    main()
