"""Why stress converged at less than second order where points cross cells, shown by putting each
cause back.

1. Mass double-mapped, as in eq. (7), sits too near the middle of a cell that is partly filled: the
  centroid of N_i/m_i
   is not where the points are.  The package sums mass at the points.
2. With stress constant over a support domain, the parts that a grid line cuts pull with the stress
  of the whole
   instead of their own: dipoles that move with the points and do not cancel where domains differ or
   the body ends. ``linear`` mappings (DM-GCL) let each part pull with its own.

On the bars of ``scenes.bar`` at Courant number 0.5, in 2D.  Writes
results/manufactured_causes.json.

    python studies/manufactured_causes.py
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import report
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpm_fenicsx import DM_GC, GIMP, Mapping
from mpm_fenicsx.mapping.projection import DOUBLE_MAPPED
from mpm_fenicsx.scenes import bar as bars

WAYS = {
    "as it is": {},
    "double-mapped mass": {"mass": DOUBLE_MAPPED},
    "linear stress": {"linear": True},
    "both": {"mass": DOUBLE_MAPPED, "linear": True},
}


def measure(scene: str, mapping: Mapping, way: str, cells: int) -> dict:
    """Errors of a bar with one of the ways."""
    bar = bars.BARS[scene]
    run = bars.material_points(
        bar,
        replace(mapping, **WAYS[way]),
        bars.length / cells,
        bar.period / (4 * cells),
        4,
        scene == "random",
    )
    watch = bars.Watch(run, bar)
    for _ in range(4 * cells):
        run.step()
        watch()
    return {"scene": scene, "mapping": mapping.name, "way": way, "cells": cells, **watch.errors()}


def main(arguments=None) -> list[dict]:
    """Run all ways, print the table, write results/manufactured_causes.json."""
    parser = report.parser(__doc__)
    parser.add_argument(
        "--cells", type=int, nargs="+", default=(20, 40, 80), help="cells along the bar"
    )
    chosen = report.chosen(parser, arguments)
    ways = [
        (scene, *way)
        for scene in ("moving", "random", "large")
        for way in ((GIMP, "as it is"), (GIMP, "linear stress"), *((DM_GC, way) for way in WAYS))
    ]
    rows = [
        measure(*way, cells)
        for way, cells in track([(way, n) for way in ways for n in chosen.cells], "bars")
    ]
    shown = Table(
        title="Errors on the finest grid (%), and orders from the one before",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for name in ("bar", "mapping", "way", "displacement", "velocity", "stress"):
        shown.add_column(name)
    for first in range(0, len(rows), len(chosen.cells)):
        *_, before, last = rows[first : first + len(chosen.cells)]
        refined = np.log(last["cells"] / before["cells"])
        shown.add_row(
            last["scene"],
            last["mapping"],
            last["way"],
            *(
                f"{100 * last[name]:7.3f} {np.log(before[name] / last[name]) / refined:5.2f}"
                for name in ("error_displacement", "error_velocity", "error_stress")
            ),
        )
    report.write(chosen.results / "manufactured_causes.json", rows)
    Console(width=120).print(shown)
    return rows


if __name__ == "__main__":
    main()
