"""What a step of the strip foundation costs where only a box under the strip is material points.

24,576 points on cells of 0.0625 m between dashpots, elastic and von Mises, against points in 2 m ×
2 m and 3 m × 2.5 m in a far field of finite elements; with a layer in place of the dashpots; and
finite elements all over.  All take turns in one process, a few steps at a time from the first
pulse on; ratios are of the process's own time, so that what else the machine does counts little.

Rows, with the median ratio over the rounds, its quartiles, and each run's pieces (by the clock on
the wall) in its median block, are kept in results/far_field.json.

    OMP_NUM_THREADS=1 python studies/far_field_cost.py [--quick]
"""

from __future__ import annotations

import time

import numpy as np
import report
from cost_of_a_step import spread
from cost_pieces import PIECES, Bill, middle
from rich.console import Console
from rich.table import Table

from mpm_fenicsx.scenes.foundation import LAYER, Foundation, elastic

ALL = "all points, dashpots"
BOXES = {
    "points in 2 m × 2 m, dashpots": ("viscous", (2.0, 2.0)),
    "points in 3 m × 2.5 m, dashpots": ("viscous", (3.0, 2.5)),
    "points in 2 m × 2 m, layer": (LAYER, (2.0, 2.0)),
}
TWIN = "finite elements, dashpots"
LAWS = {"elastic": elastic, "von Mises": None}
BEFORE = 0.25  # s: the first pulse has begun
BLOCK, WARM = 5, 2  # steps in a block; blocks before the clock counts


def runs(law: str, cell: float) -> dict:
    """What takes turns, by name."""

    def scene(boundary: str, box=None) -> Foundation:
        return Foundation(boundary, cell=cell, law=LAWS[law], box=box)

    return {
        ALL: scene("viscous").material_points(),
        **{name: scene(*at).material_points() for name, at in BOXES.items()},
        TWIN: scene("viscous").finite_elements(),
    }


def measure(law: str, cell: float, rounds: int) -> dict:
    """The row of one law."""
    made = runs(law, cell)
    for run in made.values():
        run.until(BEFORE)
    bills = {name: Bill(run) for name, run in made.items()}
    blocks, seconds = ({name: [] for name in bills} for _ in range(2))
    for number in range(WARM + rounds):
        for name, accounts in bills.items():
            began = time.process_time()
            block = accounts.block(BLOCK)
            spent = time.process_time() - began
            if number >= WARM:
                blocks[name].append(block)
                seconds[name].append(spent / BLOCK)
    seconds = {name: np.array(each) for name, each in seconds.items()}
    return {
        "law": law,
        "cell_m": cell,
        "rounds": rounds,
        "points": {name: sum(map(len, run.bodies)) for name, run in made.items()},
        "seconds": {name: float(np.median(each)) for name, each in seconds.items()},
        "ratios": {
            name: spread(each / seconds[ALL]) for name, each in seconds.items() if name != ALL
        },
        "pieces": {name: middle(each) for name, each in blocks.items()},
        "iterations": {name: run.equilibrium.iterations for name, run in made.items()},
        "dolfinx": report.dolfinx(),
    }


def tables(rows: list[dict]):
    """Ratios, and milliseconds of each piece, for the terminal."""
    for row in rows:
        found = Table(box=None, title=f"{row['law']}, cells of {row['cell_m']:g} m")
        for head in ("", "points", "of all points'", "ms", *PIECES):
            found.add_column(head, justify="right" if head else "left", no_wrap=not head)
        for name, seconds in row["seconds"].items():
            median, low, high = row["ratios"].get(name, (1.0, 1.0, 1.0))
            pieces = (f"{1e3 * row['pieces'][name][piece]:.2f}" for piece in PIECES)
            ratio = f"{median:.3f} ({low:.3f} to {high:.3f})"
            found.add_row(name, f"{row['points'][name]:,}", ratio, f"{1e3 * seconds:.1f}", *pieces)
        yield found


def main(arguments=None) -> list[dict]:
    """Measure, print, write the rows."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="cells of 0.25 m, three rounds")
    chosen = report.chosen(parser, arguments)
    cell, rounds = (0.25, 3) if chosen.quick else (0.0625, 15)
    rows = [measure(law, cell, rounds) for law in LAWS]
    report.write(chosen.results / "far_field.json", report.rounded(rows, 4))
    for table in tables(rows):
        Console(width=200).print(table)
    return rows


if __name__ == "__main__":
    main()
