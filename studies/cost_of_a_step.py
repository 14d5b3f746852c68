"""The bill of one elastic dynamic step, piece by piece, for material points and for the finite
element twins.

    bill    every method and size: seconds a step and of each piece, iterations, memory; a process
            each
    ratio   all methods on one grid, taking turns in one process, so that what else the machine does
            cancels
    empty   the same body on a grid with four times the cells, the added ones empty; taking turns
    start   from nothing to the first step of the demo's column: with empty caches, then as any
            later run

Seconds are those of blocks of four steps, after a warm-up: the median block and the least.  Rows
are kept in results/cost_of_a_step.json, which a broken run goes on from; the figure is beside it.

    OMP_NUM_THREADS=1 python studies/cost_of_a_step.py [--quick] [--again]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np
import report
from cost_pieces import Bill, middle, peak, resident, total
from cost_scenes import CELLS, MAPPINGS, METHODS, TWINS, scene
from rich.console import Console
from rich.progress import track

from mpm_fenicsx.scenes.pressed_block import COURANT, counts

BLOCK, WARM = 4, 2  # steps in a block; blocks before the clock counts
PATIENCE = 60.0  # s of blocks, after which the ones there are must do
KEYS = ("kind", "method", "dim", "cell_m", "caches")


def size(dim: int, cell: float) -> dict:
    """What a grid holds; finite elements have the points of their twins."""
    cells = int(np.prod(counts(dim, cell)))
    return {"dim": dim, "cell_m": cell, "cells": cells, "points": cells * 2**dim}


def blocks_at(points: int) -> int:
    """How many blocks are measured."""
    return 12 if points < 50_000 else 6 if points < 200_000 else 4


def bill(method: str, dim: int, cell: float) -> dict:
    """Seconds, iterations and memory of one run; memory is counted from after a run on a tiny
    grid."""
    scene(method, dim, 0.5).step()
    row, before, began = size(dim, cell), resident(), time.perf_counter()
    accounts = Bill(scene(method, dim, cell))
    accounts.run.step()
    row["first_step_s"] = time.perf_counter() - began
    blocks = [accounts.block(BLOCK)]  # the first is no measure
    while (
        len(blocks) < WARM + blocks_at(row["points"]) and sum(map(total, blocks)) * BLOCK < PATIENCE
    ):
        blocks.append(accounts.block(BLOCK))
    blocks = blocks[min(WARM, len(blocks) - 1) :]
    grown, pieces = peak() - before, middle(blocks)
    return {
        **row,
        "seconds": total(pieces),
        "seconds_min": min(map(total, blocks)),
        "pieces": pieces,
        "iterations": accounts.run.equilibrium.iterations,
        "steps": BLOCK * len(blocks),
        "bytes": grown,
        "bytes_a_point": grown / row["points"],
    }


def taking_turns(bills: dict[str, Bill], rounds: int) -> dict[str, np.ndarray]:
    """Seconds a step (rounds,) of several runs that take turns, a block at a time."""
    found = {name: [] for name in bills}
    for number in range(WARM + rounds):
        for name, accounts in bills.items():
            seconds = total(accounts.block(BLOCK))
            if number >= WARM:
                found[name].append(seconds)
    return {name: np.array(seconds) for name, seconds in found.items()}


def spread(ratios: np.ndarray) -> list[float]:
    """Median and quartiles."""
    return np.percentile(ratios, (50, 25, 75)).tolist()


def ratio(dim: int, cell: float) -> dict:
    """Step of each mapping over that of each twin: median over the rounds, and quartiles."""
    row = size(dim, cell)
    seconds = taking_turns(
        {name: Bill(scene(name, dim, cell)) for name in METHODS}, blocks_at(row["points"])
    )
    return {
        **row,
        "seconds": {name: float(np.median(s)) for name, s in seconds.items()},
        "ratios": {
            f"{m} / {twin}": spread(seconds[m] / seconds[twin]) for m in MAPPINGS for twin in TWINS
        },
    }


def empty(method: str, dim: int, cell: float) -> dict:
    """Step on a grid with four times the cells over that on the body's own, both with a row of
    room."""
    row, rows = size(dim, cell), counts(dim, cell)[1]
    bills = {
        "own": Bill(scene(method, dim, cell)),
        "wide": Bill(scene(method, dim, cell, 1 + 3 * rows)),
    }
    seconds = taking_turns(bills, blocks_at(row["points"]))
    return {**row, "ratio": spread(seconds["wide"] / seconds["own"])}


FIRST_STEP = """
import json, sys, time
started = float(sys.argv[1])
sys.path.insert(0, sys.argv[2])
import column
imported = time.time()
run = column.material_points(sys.argv[3], column.peak)
built = time.time()
run.step()
now = time.time()
print(json.dumps({"import": imported - started, "build": built - imported, "step": now - built,
                  "seconds": now - started}))
"""


def start(base: str, caches: str) -> dict:
    """Seconds to the first step of the column in a process of its own, by stages, the best of
    three; where ``caches`` are "emptied" after one that fills them, else with those of this
    machine."""
    emptied = caches == "emptied"
    with tempfile.TemporaryDirectory() as folder:
        where = dict(
            os.environ,
            PYTHONPATH=os.pathsep.join([str(report.HOME), os.environ.get("PYTHONPATH", "")]),
        )
        if emptied:
            where.update(XDG_CACHE_HOME=folder, NUMBA_CACHE_DIR=folder)
        command = [sys.executable, "-c", FIRST_STEP]
        found = [
            json.loads(
                subprocess.run(
                    [*command, str(time.time()), str(report.HOME / "demos"), base],
                    env=where,
                    check=True,
                    capture_output=True,
                    text=True,
                ).stdout.splitlines()[-1]
            )
            for _ in range(4)
        ]
    best = min(found[1:], key=lambda stages: stages["seconds"])
    return {
        "points": 1280,
        "first": found[0]["seconds"] if emptied else None,
        "seconds": best["seconds"],
        "stages": best,
    }


def cases(quick: bool) -> list[dict]:
    """What is measured, small grids first."""
    sizes = [(d, cell) for d in (2, 3) for cell in (CELLS[d][:1] if quick else CELLS[d])]
    turns = sizes[:1] if quick else [(2, CELLS[2][1]), (2, CELLS[2][2]), (3, CELLS[3][1])]
    wide = CELLS[2][0 if quick else 1]
    todo = [
        ("start", base, 2, 0.25, "kept" if quick else "emptied") for base in ("fixed", "viscous")
    ]
    todo += [("empty", name, 2, wide) for name in (("DM-GC",) if quick else MAPPINGS)]
    todo += [("ratio", "all", *at) for at in turns]
    todo += [
        ("bill", name, *at)
        for at in sorted(sizes, key=lambda at: size(*at)["points"])
        for name in METHODS
    ]
    return [dict(zip(KEYS, case, strict=False)) for case in todo]


def measure(case: dict) -> dict:
    """The row of one case."""
    kind, method, dim, cell = (case[key] for key in KEYS[:4])
    found = {
        "bill": lambda: bill(method, dim, cell),
        "ratio": lambda: ratio(dim, cell),
        "empty": lambda: empty(method, dim, cell),
        "start": lambda: start(method, case["caches"]),
    }[kind]()
    return {**case, **found, "courant": COURANT, "dolfinx": report.dolfinx()}


def in_its_own_process(case: dict) -> dict:
    """``measure`` where nothing has been run before; a case that fails keeps its last line."""
    done = subprocess.run(
        [sys.executable, __file__, "--case", json.dumps(case)], capture_output=True, text=True
    )
    if done.returncode:
        return {
            **case,
            "dolfinx": report.dolfinx(),
            "failed": (done.stderr.strip().splitlines() or ["no word"])[-1],
        }
    return json.loads(done.stdout.splitlines()[-1])


def same(row: dict, case: dict, version: str) -> bool:
    """Whether a row is that of a case."""
    return all(row.get(key) == value for key, value in {**case, "dolfinx": version}.items())


def main(arguments=None) -> list[dict]:
    """Measure what is not there yet, print the bill and what the issue asks for, draw the
    figure."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="smallest grids, under two minutes")
    parser.add_argument("--again", action="store_true", help="measure also what is there already")
    parser.add_argument("--case", type=json.loads, help=argparse.SUPPRESS)
    chosen = report.chosen(parser, arguments)
    if chosen.case:
        row = measure(chosen.case)
        print(json.dumps(row))
        return [row]
    import cost_report

    version = report.dolfinx()
    path = chosen.results / "cost_of_a_step.json"
    rows = json.loads(path.read_text()) if path.exists() else []
    todo = cases(chosen.quick)
    if chosen.again:
        rows = [row for row in rows if not any(same(row, case, version) for case in todo)]
    for case in track(todo, "cost of a step"):
        if any(same(row, case, version) and "failed" not in row for row in rows):
            continue
        rows = [row for row in rows if not same(row, case, version)] + [in_its_own_process(case)]
        report.write(path, report.rounded(rows, 4, KEYS))
    mine = [row for row in rows if row["dolfinx"] == version]
    cost_report.figure(mine, chosen.results / "cost_of_a_step.png")
    for table in cost_report.tables(mine):
        Console(width=140).print(table)
    return rows


if __name__ == "__main__":
    main()
