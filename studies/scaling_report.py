"""Tables and figure of ``scaling``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import report
from cost_report import BLUE, GREEN, GREY, ORANGE, RED, SKY
from rich.table import Table
from scaling_model import CLUSTER, largest

KINDS = ("strong", "weak", "moving")
PARTS = {"own work": BLUE, "edges": ORANGE, "sums": RED}


def of_blocks(rows: list[dict]) -> list[dict]:
    """The largest row of each kind and dimension."""
    there = {(row["kind"], row["dim"]) for row in rows if row["kind"] in KINDS}
    return [largest(rows, kind, dim) for kind in KINDS for dim in (2, 3) if (kind, dim) in there]


def one(rows: list[dict], kind: str) -> dict:
    """The row of a kind that has one."""
    return next(row for row in rows if row["kind"] == kind)


def several(row: dict) -> list[str]:
    """Names of the runs on more than one rank."""
    return list(row["ratios"])


def gain(row: dict, name: str) -> float:
    """What a step takes on one rank over that on several, for as many points; of "weak", whose
    points grow with the ranks, times the ranks."""
    return row["ratios"][name][0] * (int(name) if row["kind"] == "weak" else 1)


def sent(volume: dict) -> float:
    """Bytes a step of the rank that sends most."""
    return sum(volume[name] for name in ("fields", "matrix", "solver", "points"))


def tables(rows: list[dict]) -> Iterator[Table]:
    """Ratios, pieces, volume, balance and where the model leads to."""
    options = {"box": None, "padding": (0, 2, 0, 0)}
    ratio = Table(
        *("case", "points", "ranks", "ms", "CPU ms", "÷ own best", "quartiles", "÷ Jacobi"),
        *("iterations", "MB a rank", "division, steps"),
        title="A step",
        **options,
    )
    for row in of_blocks(rows):
        for name, run in row["runs"].items():
            quartiles = row["ratios"].get(name)
            ratio.add_row(
                f"{row['kind']} {row['dim']}D",
                f"{sum(run['points'])}",
                name + (" *" if name == row["best"] else ""),
                f"{1e3 * run['wall']:.1f}",
                f"{1e3 * run['cpu']:.1f}",
                f"{quartiles[0]:.2f}" if quartiles else "",
                f"{quartiles[1]:.2f}-{quartiles[2]:.2f}" if quartiles else "",
                f"{row['ratios_jacobi'][name][0]:.2f}" if quartiles else "",
                f"{run['iterations']}",
                f"{max(run['bytes']) / 1e6:.0f}",
                f"{run['division']['wall'] / run['wall']:.0f}" if "division" in run else "",
            )
    yield ratio
    names = list(of_blocks(rows)[0]["runs"]["1"]["pieces"])
    pieces = Table("case", "ranks", *names, title="Milliseconds, slowest rank", **options)
    for row in of_blocks(rows):
        for name, run in row["runs"].items():
            of = [f"{1e3 * run['pieces'][piece]:.1f}" for piece in names]
            pieces.add_row(f"{row['kind']} {row['dim']}D", name, *of)
    yield pieces
    volume = Table(
        *("case", "ranks", "edge nodes", "fields kB", "matrix", "solver", "points", "B a node"),
        *("sums", "of solver", "imbalance", "gone %"),
        title="What the rank sends in a step that sends most",
        **options,
    )
    for row in of_blocks(rows):
        for name in several(row):
            run, v = row["runs"][name], row["runs"][name]["volume"]
            volume.add_row(
                f"{row['kind']} {row['dim']}D",
                name,
                f"{v['boundary_nodes']}",
                *(f"{v[key] / 1e3:.1f}" for key in ("fields", "matrix", "solver", "points")),
                f"{sent(v) / v['boundary_nodes']:.0f}",
                f"{v['other_sums']:.0f}",
                f"{v['solver_sums']:.0f}",
                f"{run['imbalance']:.2f}",
                f"{100 * run['gone']:.2f}",
            )
    yield volume
    rest, row, model = (
        Table("what", "", title="Repartition and model", **options),
        *(one(rows, kind) for kind in ("balance", "model")),
    )
    rest.add_row("collapse, slowest rank without, ms", f"{1e3 * row['cpu']['without']:.1f}")
    rest.add_row("with", f"{1e3 * row['cpu']['with']:.1f}")
    rest.add_row("divisions", ", ".join(f"{d['step']}" for d in row["divisions"]))
    rest.add_row("a division, steps", f"{row['division_steps']}")
    rest.add_row("pays after steps", f"{row['pays_after_steps']}")
    rest.add_row("whole run, with over without", f"{row['whole']}")
    for of in model["constants"]:
        for name, value in of.items():
            rest.add_row(f"{of['dim']}D {name}", f"{value:.3g}")
    for name in (
        "modelled_over_measured",
        "parts",
        "efficiency",
        "bytes_a_point",
        "bytes_a_rank",
        "least_ranks",
    ):
        rest.add_row(name, f"{model[name]}")
    yield rest


def figure(rows: list[dict], path: Path) -> None:
    """Gains on several ranks; imbalance over time; a step on a cluster."""
    fig, axes = report.subplots(1, 3, figsize=(13, 4.8))
    _gains(axes[0], rows)
    _imbalance(axes[1], one(rows, "balance"))
    _projection(axes[2], one(rows, "model"))
    report.save(fig, path)


def _gains(ax, rows: list[dict]) -> None:
    style = {"strong": (BLUE, "o"), "weak": (ORANGE, "s"), "moving": (GREEN, "^")}
    most = 2
    for row in of_blocks(rows):
        ranks = [1, *map(int, several(row))]
        most = max(most, *ranks)
        colour, mark = style[row["kind"]]
        low, high = (
            [0.0, *(row["ratios"][n][k] * gain(row, n) / row["ratios"][n][0] for n in several(row))]
            for k in (1, 2)
        )
        y = [1.0, *(gain(row, n) for n in several(row))]
        low[0] = high[0] = 1.0
        ax.errorbar(
            np.array(ranks) * (1.0 + 0.008 * (row["dim"] == 3)),
            y,
            yerr=[np.subtract(y, low), np.subtract(high, y)],
            color=colour,
            marker=mark,
            markerfacecolor=colour if row["dim"] == 2 else "white",
            linestyle="-" if row["dim"] == 2 else "--",
            capsize=3,
            label=f"{row['kind']}, {row['dim']}D, {row['points']:,} points"
            + (" a rank" if row["kind"] == "weak" else ""),
        )
    ax.plot([1, most], [1, most], color=GREY, linestyle=":", label="ideal")
    ax.set(
        xlabel="ranks", ylabel="work in a second, over one rank's best", xticks=range(1, most + 1)
    )
    ax.set_ylim(bottom=0.0)
    ax.set_title("Steps on several ranks")
    ax.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)


def _imbalance(ax, row: dict) -> None:
    style = {"without": (RED, "--"), "with": (BLUE, "-")}
    for name, series in row["series"].items():
        colour, line = style[name]
        t = [at["time"] for at in series]
        label = f"{name} Repartition, {1e3 * row['cpu'][name]:.0f} ms a step"
        ax.plot(t, [at["imbalance"] for at in series], color=colour, linestyle=line, label=label)
    step = row["series"]["with"][0]["time"] / (row["steps"] / len(row["series"]["with"]))
    for number, one_ in enumerate(row["divisions"]):
        label = None if number else "divided anew"
        ax.plot(step * one_["step"], 1.0, "^", color=SKY, clip_on=False, label=label)
    ax.set(xlabel="time, s", ylabel="imbalance: fullest rank over mean", ylim=(1.0, None))
    ax.set_title(f"A collapse on {max(row['ranks'])} ranks")
    ax.legend(fontsize=7)


def _projection(ax, model: dict) -> None:
    ranks = np.array([at["ranks"] for at in model["steps"]])
    whole = sum(np.array([at[part] for at in model["steps"]]) for part in PARTS)
    ax.loglog(ranks, whole, color="black", linewidth=2, label="a step")
    for (part, colour), line in zip(PARTS.items(), ("--", "-.", ":"), strict=True):
        ax.loglog(
            ranks, [at[part] for at in model["steps"]], color=colour, linestyle=line, label=part
        )
    least = model["least_ranks"]
    ax.axvspan(ranks[0], least, color=GREY, alpha=0.25, linewidth=0)
    ax.text(
        np.sqrt(ranks[0] * least),
        whole.min() / 30,
        f"more than\n{CLUSTER['memory_bytes'] / 1e9:.0f} GB a rank",
        ha="center",
        fontsize=7,
    )
    ax.set(
        xlabel="ranks",
        ylabel="time of a step, s",
        xlim=(ranks[0], ranks[-1]),
        ylim=(whole.min() / 100, None),
    )
    ax.set_title("Model: 10⁹ points in 3D on a cluster")
    ax.legend(fontsize=7, loc="upper right")
