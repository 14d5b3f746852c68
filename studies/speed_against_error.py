"""Speed against error: what a digit costs with each mapping and with finite elements, and at which
orders errors fall.

The paper's column at two loads on two bases, and manufactured bars (``scenes.bar``), over
mapping, cell size, time step, points a cell and tolerance of the linear solver.  A row has the
relative L2 errors of displacement, velocity and stress, the seconds of the steps alone, on the wall
and of the CPU (least of up to three turns, methods in turn about), memory, and, where a run goes
unstable, the step.  Writes speed_against_error.json after every run, and .png.  What is in the file
for this DOLFINx and number of threads is not run again.

    export OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1
    python studies/speed_against_error.py --fresh  # everything, 20 minutes
    python studies/speed_against_error.py --quick  # coarse cells, one turn
"""

from __future__ import annotations

import json
import os
import platform
from datetime import UTC, datetime
from pathlib import Path

import numba
import numpy as np
import report
from rich.console import Console
from speed_against_error_cases import METHODS, MORE, SCENES, Case, cases, measure
from speed_against_error_figures import distances, figure, orders, tables

LONG = (np.inf, 4.0, 1.0)  # s: the longest runs of each turn


def surroundings() -> dict:
    """What timings depend on; the first two tell rows that may not be mixed."""
    return {
        "dolfinx": report.dolfinx(),
        "threads": os.environ.get("OMP_NUM_THREADS", "not set"),
        "numba_threads": numba.get_num_threads(),
        "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        "commit": report.commit("rev-parse", "--short", "HEAD"),
    }


class Book:
    """Rows by case, kept in a file: those of other surroundings stay as they are."""

    def __init__(self, path: Path, fresh: bool = False):
        self.path, self.here = path, surroundings()
        known = json.loads(path.read_text())["rows"] if path.exists() else []
        mine = [
            row
            for row in known
            if all(row[name] == self.here[name] for name in ("dolfinx", "threads"))
        ]
        self.others = [row for row in known if row not in mine]
        self.rows = {} if fresh else {Case.of(row): row for row in mine}

    def due(self, case: Case, turn: int) -> bool:
        """Whether a case is to be run in this turn (0, 1, 2): a failed one again, a short one in
        every turn."""
        row = self.rows.get(case)
        if row is None or row["failed"]:
            return turn == 0
        return len(row["seconds_each"]) <= turn and row["seconds"] < LONG[turn]

    def run(self, case: Case) -> None:
        """Run a case and write down the row, the least seconds of its turns; a failure is written
        down, too."""
        try:
            row = {**measure(case), "failed": None}
        except Exception as error:
            row = {**vars(case), "failed": f"{type(error).__name__}: {error}"}
        before = self.rows.get(case, {})
        if not row["failed"]:
            row["seconds_each"] = [*before.get("seconds_each", []), round(row["seconds"], 4)]
            for name in ("seconds", "cpu_seconds", "ms_per_step", "set_up_seconds"):
                row[name] = min(row[name], before.get(name, row[name]))
        here = {name: self.here[name] for name in ("dolfinx", "threads", "commit")}
        self.rows[case] = {
            **row,
            **here,
            "at": datetime.now(UTC).isoformat(timespec="seconds"),
            "load": round(os.getloadavg()[0], 2),
        }
        self.write()

    def write(self, **more) -> None:
        """Write the file anew, or leave it as it was; ``more`` to go before the rows."""
        whole = {"about": self.here, **more, "rows": [*self.rows.values(), *self.others]}
        report.write(self.path, report.rounded(whole, 6, Case.__dataclass_fields__))


def run(todo: list[Case], turns: int, book: Book, console: Console) -> None:
    """Run what is due, short cases in every turn; an interrupt ends it early and loses nothing."""
    try:
        with report.progress(console, 52) as progress:
            for turn in range(turns):
                due = [case for case in todo if book.due(case, turn)]
                task = progress.add_task("", total=len(due))
                for case in due:
                    progress.update(
                        task,
                        description=f"turn {turn + 1}: {case.scene}, {case.method}, "
                        f"{case.cell:g} m",
                    )
                    book.run(case)
                    progress.advance(task)
    except KeyboardInterrupt:
        console.print(
            "[bold]interrupted[/]: what is done is kept, the same command goes on from there"
        )


def main(arguments=None) -> list[dict]:
    """Run what is asked for and not there yet, write the rows and the figure, print the tables."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="coarse cells, one turn")
    parser.add_argument("--all", action="store_true", help="CMPM, DM, DM-C and FE reassembled, too")
    parser.add_argument("--scene", nargs="+", choices=SCENES, default=list(SCENES), metavar="SCENE")
    parser.add_argument("--method", nargs="+", choices=METHODS + MORE, metavar="METHOD")
    parser.add_argument(
        "--turns", type=int, choices=(1, 2, 3), help="how often short runs are timed, at most"
    )
    parser.add_argument(
        "--fresh", action="store_true", help="forget what was run before with this DOLFINx"
    )
    chosen = report.chosen(parser, arguments)
    console = Console()
    book = Book(chosen.results / "speed_against_error.json", chosen.fresh)
    todo = cases(chosen.scene, chosen.method or METHODS + MORE * chosen.all, chosen.quick)
    run(todo, chosen.turns or (1 if chosen.quick else len(LONG)), book, console)
    rows = list(book.rows.values())
    if rows:
        book.write(orders=orders(rows), distances=distances(rows))
        figure(rows, book.path.with_suffix(".png"))
        for table in tables(rows):
            Console(width=130).print(table, "")
    console.print(f"figure: {book.path.with_suffix('.png')}, rows: {book.path}")
    return rows


if __name__ == "__main__":
    main()
