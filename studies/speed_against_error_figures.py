"""What the rows of ``speed_against_error`` come to: orders, distance from finite elements, figure
and tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import report
from matplotlib.ticker import NullFormatter
from rich.table import Table
from speed_against_error_cases import (
    ERRORS,
    METHODS,
    MORE,
    SCENES,
    Case,
    in_space,
    in_time,
    together,
)

COLOURS = dict(
    zip(
        METHODS + MORE,
        (
            "#000000",
            "#CC79A7",
            "#E69F00",
            "#009E73",
            "#0072B2",
            "#D55E00",
            "#999999",
            "#F0E442",
            "#56B4E9",
            "#E69F00",
        ),
        strict=True,
    )
)
MARKERS = dict(zip(METHODS + MORE, "sv^DoPsv^D", strict=True))
# of the steps: on one thread the time of a quiet machine, whoever else is at work on this one
CLOCK = "cpu_seconds"
SWEEPS = {"h and Δt": (together, 0), "h": (in_space, 0), "Δt": (in_time, 1)}


def sweep(rows: list[dict], scene: str, method: str, settings: Callable) -> list[dict]:
    """Stable rows of a scene and method along a sweep, from coarse to fine."""
    known = {
        Case.of(row): row for row in rows if not row["failed"] and row["unstable_at_step"] is None
    }
    per_cell = None if method.startswith("FE") else 4
    found = (known.get(Case(scene, method, h, dt, per_cell)) for h, dt in settings(scene))
    return [row for row in found if row]


def orders(rows: list[dict]) -> list[dict]:
    """Observed orders from one row of a sweep to the next, in cell size or time step."""
    found = []
    for scene, method in _pairs(rows):
        for name, (settings, which) in SWEEPS.items():
            line = sweep(rows, scene, method, settings)
            sizes = [(row["cell"], row["dt"])[which] for row in line]
            if len(line) > 1 and (name == "h and Δt" or SCENES[scene].thorough):
                found.append(
                    {
                        "scene": scene,
                        "method": method,
                        "in": name,
                        "sizes": sizes,
                        **{
                            error: [
                                float(np.log(a[error] / b[error]) / np.log(p / q))
                                for a, b, p, q in zip(
                                    line, line[1:], sizes, sizes[1:], strict=False
                                )
                            ]
                            for error in ERRORS
                        },
                    }
                )
    return found


def front(rows: list[dict], scene: str, method: str, error: str) -> list[dict]:
    """The rows of a scene and method that no faster one outdoes, from fast to slow: whatever the
    cell and time step, with four points a cell and the solver as it is."""
    mine = [
        row
        for row in rows
        if (row["scene"], row["method"], row["tolerance"]) == (scene, method, None)
        and row["per_cell"] in (4, None)
        and not row["failed"]
        and row["unstable_at_step"] is None
    ]
    found = []
    for row in sorted(mine, key=lambda row: row[CLOCK]):
        if not found or row[error] < found[-1][error]:
            found.append(row)
    return found


def distances(rows: list[dict]) -> list[dict]:
    """CPU seconds of a method over those of another at the smallest error that both reach, fronts
    read log-log; and seconds and errors over one another at Courant number 1 in the finest cells
    that both have."""
    found = []
    for scene, method in _pairs(rows):
        for other in METHODS:
            pairs = [
                (a, b)
                for a in sweep(rows, scene, method, together)
                for b in sweep(rows, scene, other, together)
                if a["cell"] == b["cell"]
            ]
            if method not in METHODS or method == other or not pairs:
                continue
            a, b = pairs[-1]
            row = {
                "scene": scene,
                "method": method,
                "over": other,
                "cell": a["cell"],
                "dt": a["dt"],
                "seconds": a[CLOCK] / b[CLOCK],
                **{error: a[error] / b[error] for error in ERRORS},
            }
            for error in ERRORS:
                lines = [front(rows, scene, name, error) for name in (method, other)]
                least = max(line[-1][error] for line in lines)
                row[f"seconds_at_equal_{error}"] = float(
                    np.exp(
                        np.subtract(
                            *(
                                np.interp(
                                    np.log(least),
                                    np.log([r[error] for r in line[::-1]]),
                                    np.log([r[CLOCK] for r in line[::-1]]),
                                )
                                for line in lines
                            )
                        )
                    )
                )
            found.append(row)
    return found


def _pairs(rows: list[dict]) -> list[tuple[str, str]]:
    """Scenes and methods among the rows, in the order of the study."""
    there = {(row["scene"], row["method"]) for row in rows}
    return [
        (scene, method) for scene in SCENES for method in METHODS + MORE if (scene, method) in there
    ]


def figure(rows: list[dict], path: Path) -> None:
    """Error against seconds, the front of each method; what is behind it as pale dots."""
    there = [scene for scene in SCENES if any(row["scene"] == scene for row in rows)]
    across = min(4, len(there))
    blocks = [there[first : first + across] for first in range(0, len(there), across)]
    fig, axes = report.subplots(
        2 * len(blocks),
        across,
        figsize=(1.5 + 3.1 * across, 0.6 + 6.2 * len(blocks)),
        squeeze=False,
    )
    for axis in axes.flat:
        axis.set_visible(False)
    for block, scenes in enumerate(blocks):
        for part, error in enumerate(("error_displacement", "error_stress")):
            for axis, scene in zip(axes[2 * block + part], scenes, strict=False):
                axis.set_visible(True)
                _panel(axis, rows, scene, error)
                if part == 0:
                    axis.set_title(scene + ("\n(small-strain answer)" if "300" in scene else ""))
                axis.set_xlabel("CPU time of the steps (s)")
            axes[2 * block + part, 0].set_ylabel(f"error of {error.split('_')[1]} (%)")
    handles = {
        label: handle
        for axis in axes.flat
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    fig.legend(
        handles.values(),
        handles.keys(),
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        ncols=len(handles),
    )
    about = rows[0]
    fig.suptitle(
        "Speed against error: the best of all cells and time steps (pale: the others, and other "
        "points a cell "
        f"and tolerances)\nrelative L2 errors; DOLFINx {about['dolfinx']}, {about['threads']} "
        "thread"
    )
    report.save(fig, path, dpi=130, bbox_inches="tight")


def _panel(axis, rows: list[dict], scene: str, error: str) -> None:
    for method in METHODS + MORE:
        style = {"color": COLOURS[method], "marker": MARKERS[method]}
        line = front(rows, scene, method, error)
        others = [
            row
            for row in rows
            if row["scene"] == scene
            and row["method"] == method
            and not row["failed"]
            and row["unstable_at_step"] is None
            and row not in line
        ]
        if others:
            axis.plot(
                [row[CLOCK] for row in others],
                [100 * row[error] for row in others],
                ls="",
                ms=3,
                alpha=0.35,
                mec="none",
                **style,
            )
        if line:
            axis.plot(
                [row[CLOCK] for row in line],
                [100 * row[error] for row in line],
                ms=5,
                lw=1.4,
                label=method,
                **style,
            )
    axis.set(xscale="log", yscale="log")
    if not axis.lines:
        return
    axis.set_ylim(top=min(axis.get_ylim()[1], 300.0))
    for one, ends in ((axis.xaxis, axis.get_xlim()), (axis.yaxis, axis.get_ylim())):
        one.set_minor_formatter(NullFormatter())  # whole decades have room for their labels
        decades = np.log10(ends)
        one.axes.set(
            **{f"{one.axis_name}lim": (10.0 ** np.floor(decades[0]), 10.0 ** np.ceil(decades[1]))}
        )
    axis.grid(alpha=0.3)


def tables(rows: list[dict]) -> list[Table]:
    """Orders, the distance from finite elements, and what went wrong."""
    order = Table(
        title="Observed orders of displacement, velocity, stress (from the finest two rows; "
        "in Δt from Courant 16 and 8, or the largest)",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for name in ("scene", "method", *(f"in {name}" for name in SWEEPS)):
        order.add_column(name)
    every = orders(rows)
    for scene, method in _pairs(rows):
        cells = []
        for name in SWEEPS:
            pick = next(
                (o for o in every if (o["scene"], o["method"], o["in"]) == (scene, method, name)),
                None,
            )
            at = 0 if name == "Δt" else -1
            cells.append("  ".join(f"{pick[error][at]:5.2f}" for error in ERRORS) if pick else "")
        order.add_row(scene, method, *cells)
    far = Table(
        title="DM-GC over others: seconds at the smallest error that both reach; seconds and "
        "errors at Courant "
        "1 in the finest cells",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for name in (
        "scene",
        "over",
        "s, equal u",
        "s, equal σ",
        "cell (m)",
        "seconds",
        "error u",
        "error σ",
    ):
        far.add_column(name, justify="left" if name in ("scene", "over") else "right")
    keys = (
        "seconds_at_equal_error_displacement",
        "seconds_at_equal_error_stress",
        "cell",
        "seconds",
        "error_displacement",
        "error_stress",
    )
    for row in distances(rows):
        if row["method"] == "DM-GC":
            far.add_row(row["scene"], row["over"], *(f"{row[key]:.3g}" for key in keys))
    wrong = Table(title="Unstable or failed", box=None, padding=(0, 2, 0, 0))
    for name in ("scene", "method", "cell (m)", "Δt (ms)", "points", "tolerance", "step", "reason"):
        wrong.add_column(name)
    for row in rows:
        reason = row["failed"] or row["reason"]
        if reason:
            wrong.add_row(
                row["scene"],
                row["method"],
                f"{row['cell']:g}",
                f"{1e3 * row['dt']:.3g}",
                str(row["per_cell"]),
                str(row["tolerance"]),
                str(row.get("unstable_at_step")),
                reason[:70],
            )
    return [order, far, *([wrong] if wrong.rows else [])]
