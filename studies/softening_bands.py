"""Bands of plastic strain under the strip foundation on two grids: by the local law, and softening
over a length.

The paper's Figure 4, at the load and softening where the maps look most like it (36 kPa, 100 kPa:
studies/foundation_load.py), between fixed edges and on dashpots.  The local law softens
by κ; the others by κ averaged over l = 0.125 m (``OverNonlocal``), with the same modulus and with
twice that: a band is wider now, and so softens more slowly.  All with the default B-bar, DM-GC and
the scene's own grids.  Writes results/softening_bands.json and .png.

    python studies/softening_bands.py
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import report
from rich.progress import track

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.foundation import (
    Foundation,
    axis,
    dt,
    elastic,
    end,
    height,
    peak,
    residual,
    strip,
    width,
)

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))

LOAD, LENGTH = 36e3, 0.125
CELLS = (0.125, 0.0625)
LAWS = {
    "local, 100 kPa": (100e3, None),
    "over 0.125 m, 100 kPa": (100e3, mpm.OverNonlocal(LENGTH)),
    "over 0.125 m, 200 kPa": (200e3, mpm.OverNonlocal(LENGTH)),
}
"""Softening (Pa) and averaging."""
BOUNDARIES = ("fixed", "viscous")
VISIBLE = 1e-3  # plastic strain: what a picture of a band shows


def scene(law: str, boundary: str, cell: float, step: float = dt) -> Foundation:
    """The foundation, of soil that softens by one of the ``LAWS``."""
    softening, averaging = LAWS[law]
    soil = mpm.VonMises(elastic, peak, residual, softening, averaging=averaging)
    return Foundation(boundary, LOAD, cell=cell, step=step, law=soil, b_bar=None)


def measure(law: str, boundary: str, cell: float, until: float = end) -> tuple[dict, tuple]:
    """Plastic work and settlement at the end of the pulses; the points' boxes and plastic
    strain."""
    run = scene(law, boundary, cell).material_points()
    probe = run.record(mpm.Probe("displacement", (axis, height)))
    energy, reason = run.record(mpm.Energy()), None
    began = time.process_time()
    try:
        run.until(until)
    except mpm.RunError as error:
        reason = str(error)
    (body,) = run.bodies
    row = {
        "law": law,
        "boundary": boundary,
        "cell_m": cell,
        "plastic_work_j": float(energy["plastic"][-1]),
        "settlement_m": float(-probe.values[-1, 1]),
        "depth_m": height - float(body.x[body.history[:, 0] > VISIBLE, 1].min(initial=height)),
        "largest_plastic_strain": float(body.history[:, 0].max()),
        "energy_lost": float(energy.lost[-1] / energy["work"][-1]),
        "solves": run.solves / max(run.steps, 1),
        "time_s": run.time,
        "cpu_s": time.process_time() - began,
        "reason": reason,
    }
    return row, (body.x - body.half, 2 * body.half, body.history[:, 0])


def figure(rows: list[dict], maps: list[tuple], path) -> None:
    """A row of maps a law, columns: boundary and grid."""
    from foundation_figures import name_axes, plastic_strain

    columns = [(boundary, cell) for boundary in BOUNDARIES for cell in CELLS]
    fig, axes = report.subplots(
        len(LAWS), len(columns), figsize=(4.3 * len(columns), 10), sharex=True, sharey=True
    )
    ends = [axis - strip / 2, axis + strip / 2]
    for row, boxes in zip(rows, maps, strict=True):
        ax = axes[list(LAWS).index(row["law"]), columns.index((row["boundary"], row["cell_m"]))]
        shown = plastic_strain(ax, boxes, (width, height), ends)
        stopped = f", stops at {row['time_s']:.2f} s" if row["reason"] else ""
        ax.set_title(
            f"{row['law']}, {row['boundary']}, h = {row['cell_m']:g} m\n"
            f"plastic work {row['plastic_work_j']:.0f} J/m, "
            f"{1e3 * row['settlement_m']:.0f} mm down{stopped}",
            fontsize=9,
        )
    name_axes(fig, axes, shown)
    fig.suptitle(
        f"Strip foundation under {LOAD / 1e3:g} kPa, softening by the local law and over a length, "
        f"after {end} s\npoints where they are then; blue: strip as it was",
        fontsize=11,
    )
    report.save(fig, path)


def main(arguments=None) -> list[dict]:
    """Run all, print, write."""
    parser = report.parser(__doc__)
    parser.add_argument("--until", type=float, default=end, help="time (s) at which runs end")
    chosen = report.chosen(parser, arguments)
    cases = [(law, b, cell) for b in BOUNDARIES for law in LAWS for cell in CELLS]
    rows, maps = zip(*(measure(*case, chosen.until) for case in track(cases)), strict=True)
    for row in rows:
        print(
            f"{row['law']:21} {row['boundary']:13} h {row['cell_m']:6.4f} m  plastic work "
            f"{row['plastic_work_j']:7.1f} J/m  settlement {1e3 * row['settlement_m']:6.2f} mm  "
            f"depth {row['depth_m']:.2f} m  {row['solves']:.2f} solves a step, "
            f"{row['cpu_s']:.0f} s  {row['reason'] or ''}"
        )
    report.write(chosen.results / "softening_bands.json", report.rounded(list(rows), 6))
    figure(list(rows), list(maps), chosen.results / "softening_bands.png")
    return list(rows)


if __name__ == "__main__":
    main()
