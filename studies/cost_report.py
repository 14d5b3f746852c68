"""Tables and figure of ``cost_of_a_step``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import report
from cost_pieces import PIECES, POINTS
from cost_scenes import METHODS
from rich.table import Table

BLUE, SKY, GREEN, ORANGE, RED, YELLOW, PURPLE, GREY = (
    "#0072B2",
    "#56B4E9",
    "#009E73",
    "#E69F00",
    "#D55E00",
    "#F0E442",
    "#CC79A7",
    "#999999",
)
BARS = {  # pieces that share a bar, its colour and hatch: points' work blue, the grid's warm
    "locate": (("locate",), SKY, ""),
    "project": (("project",), BLUE, ""),
    "recover": (("recover",), SKY, "////"),
    "carry": (("carry",), BLUE, "////"),
    "predict": (("predict",), PURPLE, ""),
    "force": (("force",), ORANGE, ""),
    "assemble": (("assemble",), RED, ""),
    "factor": (("factor",), YELLOW, ""),
    "solve": (("solve",), GREEN, ""),
    "correct": (("correct",), GREEN, "////"),
    "load, record, other": (("load", "record", "other"), GREY, ""),
}
LINES = {
    "MPM": (PURPLE, "s"),
    "DM-G": (SKY, "^"),
    "DM-GC": (BLUE, "o"),
    "DM-GC, reuse": (GREY, "P"),
    "FE": (RED, "D"),
    "FE, Cholesky": (ORANGE, "v"),
    "FE, frozen": (GREEN, "x"),
}


def bills(rows: list[dict], method: str, dim: int) -> list[dict]:
    """Bills of a method, small grids first."""
    found = [
        row
        for row in rows
        if row["kind"] == "bill"
        and row["method"] == method
        and row["dim"] == dim
        and "failed" not in row
    ]
    return sorted(found, key=lambda row: row["points"])


def share(row: dict) -> float:
    """Of the step, what is the points' own work."""
    return sum(row["pieces"][piece] for piece in POINTS) / row["seconds"]


def exponent(found: list[dict], name: str = "seconds", least: int = 0) -> float | None:
    """Slope of log time over log points, from ``least`` points on."""
    found = [row for row in found if row["points"] >= least]
    if len(found) < 2:
        return None
    return float(
        np.polyfit(
            np.log([row["points"] for row in found]), np.log([row[name] for row in found]), 1
        )[0]
    )


def growth(found: list[dict]) -> float | None:
    """Bytes a point between the two largest grids, where what every process has cancels."""
    if len(found) < 2:
        return None
    return (found[-1]["bytes"] - found[-2]["bytes"]) / (found[-1]["points"] - found[-2]["points"])


def shown(value: float | None, form: str) -> str:
    """A figure, or nothing."""
    return "" if value is None else format(value, form)


def milliseconds(seconds: float) -> str:
    """Three digits, two of them after the point at most."""
    ms = 1e3 * seconds
    return f"{ms:.{2 if ms < 9.995 else 1 if ms < 99.95 else 0}f}"


def tables(rows: list[dict]) -> Iterator[Table]:
    """The bill, how it grows, and what the issue asks for."""
    grow = Table(
        "method",
        "dim",
        "exponent (2D: from 25k points)",
        "of the least",
        "bytes a point, largest",
        title="Growth",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for dim in (2, 3):
        bill = Table(
            title=f"Milliseconds a step, {dim}D; share of the points' own work; bytes a point",
            box=None,
            padding=(0, 1, 0, 0),
        )
        for name in ("method", "points", *PIECES, "step", "least", "its", "own %", "bytes"):
            bill.add_column(name, justify="left" if name == "method" else "right", no_wrap=True)
        for method in METHODS:
            found = bills(rows, method, dim)
            for row in found:
                times = (*(row["pieces"][p] for p in PIECES), row["seconds"], row["seconds_min"])
                bill.add_row(
                    method,
                    f"{row['points']}",
                    *map(milliseconds, times),
                    f"{row['iterations']}",
                    f"{100 * share(row):.0f}",
                    f"{row['bytes_a_point']:.0f}",
                )
            least = 20_000 if dim == 2 else 0
            if len(found) > 1:
                grow.add_row(
                    method,
                    f"{dim}",
                    shown(exponent(found, least=least), ".2f"),
                    shown(exponent(found, "seconds_min", least), ".2f"),
                    shown(growth(found), ".0f"),
                )
        if bill.row_count:
            yield bill
    asked = Table(
        "asked for",
        "at most",
        "found",
        "",
        title="What issue 4 asks for, DM-GC",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for name, most, found in targets(rows):
        verdict = "" if found is None or most == np.inf else "met" if found <= most else "missed"
        asked.add_row(name, "" if most == np.inf else f"{most:g}", shown(found, ".3g"), verdict)
    failed = Table("what failed", "why", box=None)
    for row in rows:
        if "failed" in row:
            failed.add_row(
                f"{row['kind']} {row['method']} {row['dim']}D {row['cell_m']} m", row["failed"]
            )
    yield from (grow, asked, *([failed] if failed.row_count else []))


def targets(rows: list[dict]) -> Iterator[tuple[str, float, float | None]]:
    """Name, limit and figure of what is asked for, on the 96 × 64 grid or the largest there is
    below it."""
    plane = bills(rows, "DM-GC", 2)
    for kind, names in (
        ("ratio", (("FE", 1.0), ("FE, Cholesky", 0.6), ("FE, frozen", np.inf))),
        ("empty", ()),
    ):
        found = [
            row
            for row in rows
            if row["kind"] == kind
            and row["dim"] == 2
            and "failed" not in row
            and row["method"] in ("all", "DM-GC")
            and row["cell_m"] >= 0.0625
        ]
        row = min(found, key=lambda row: row["cell_m"], default=None)
        where = f"{row['points']} points" if row else "not measured"
        for twin, most in names:
            yield f"step / {twin} ({where})", most, row and row["ratios"][f"DM-GC / {twin}"][0]
        if kind == "empty":
            yield (
                f"four times the cells, empty: step / step ({where})",
                1.15,
                row and row["ratio"][0],
            )
    medium = next((row for row in plane[::-1] if row["points"] <= 25_000), None)
    where = f"{medium['points']} points" if medium else "not measured"
    yield f"recover, ms ({where})", 3.0, medium and 1e3 * medium["pieces"]["recover"]
    yield f"points' own work, share of the step ({where})", 0.25, medium and share(medium)
    yield "exponent of time in points, 25k to 393k", 1.1, exponent(plane, least=20_000)
    yield "bytes a point, 2D, largest grid", 1500.0, plane[-1]["bytes_a_point"] if plane else None
    for row in rows:
        if row["kind"] == "start" and "failed" not in row:
            yield f"start to first step, s ({row['method']} base)", 4.0, row["seconds"]


def figure(rows: list[dict], path: Path) -> None:
    """The bill on one grid as bars; time against points."""
    fig, (left, right) = report.subplots(1, 2, figsize=(12, 5.4))
    sizes = {
        row["points"]
        for row in rows
        if row["kind"] == "bill" and row["dim"] == 2 and "failed" not in row
    }
    at = max((n for n in sizes if n <= 25_000), default=None)
    chosen = {m: row for m in METHODS for row in bills(rows, m, 2) if row["points"] == at}
    start = np.zeros(len(chosen))
    for name, (pieces, colour, hatch) in BARS.items():
        ms = np.array([1e3 * sum(row["pieces"][p] for p in pieces) for row in chosen.values()])
        left.barh(
            list(chosen),
            ms,
            left=start,
            color=colour,
            hatch=hatch,
            edgecolor="white",
            lw=0.5,
            label=name,
        )
        start += ms
    for place, ms in enumerate(start):
        left.text(ms, place, f" {ms:.1f}", va="center")
    left.set(
        xlabel="time of a step (ms)",
        title=f"The bill on {at or 0:,} points, 2D",
        xlim=(0, 1.12 * max(start, default=1)),
    )
    left.invert_yaxis()
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.14), "fontsize": 8}
    left.legend(ncols=5, **below)
    for dim, line, fill in ((2, "-", "full"), (3, "--", "none")):
        for method, (colour, marker) in LINES.items():
            found = bills(rows, method, dim)
            if found:
                right.loglog(
                    [row["points"] for row in found],
                    [row["seconds"] for row in found],
                    line,
                    color=colour,
                    marker=marker,
                    fillstyle=fill,
                    label=f"{method}, {dim}D",
                )
    reference = bills(rows, "DM-GC", 2)
    if reference:
        n = np.array([reference[0]["points"], 4.0 * reference[-1]["points"]]) / 2.0
        right.loglog(
            n,
            0.5 * reference[0]["seconds"] * n / n[0] / 2.0,
            ":",
            color="0.5",
            label="proportional",
        )
    right.set(xlabel="material points (-)", ylabel="time of a step (s)", title="Growth")
    right.grid(alpha=0.3, which="both")
    right.legend(ncols=4, **below)
    fig.suptitle(
        "One elastic dynamic step under a strip, one core; FE with CG + ICC and K reassembled, "
        "unless said"
    )
    report.save(fig, path)
