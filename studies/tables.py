"""Tables of the documentation, from the results of studies and demos.

In a page a table follows its mark, ``<!-- table: column -->``.  Called as a program, it renews all
of them; ``tests/test_tables.py`` holds that they are those of results/.

    python studies/tables.py
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path

HOME = Path(__file__).parents[1]
RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
MARK = re.compile(r"(<!-- table: (\w+) -->\n\n)((?:\|[^\n]*\n)*)")


def rows(name: str) -> list[dict]:
    """What a study has written into results/."""
    return json.loads((HOME / "results" / f"{name}.json").read_text())


def markdown(heads: Iterable[str], body: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    heads = list(heads)
    lines = [heads, ["---"] * len(heads), *body]
    return "".join(
        "| " + " | ".join(line) + " |\n" if line[0] != "---" else "|---" * len(line) + "|\n"
        for line in map(list, lines)
    )


def column() -> str:
    """The paper's column: errors and milliseconds a step."""
    wanted = (
        ("pressure at mid-height", "error_pressure_mid", ".2f"),
        ("pressure at the base", "error_pressure_base", ".2f"),
        ("displacement at mid-height", "error_displacement_mid", ".3f"),
    )
    body = []
    for row in rows("column"):
        broken = row["unstable_at_step"]
        errors = (
            [f"unstable from step {broken}", "", ""]
            if broken is not None
            else [f"{100 * row[key]:{form}} %" for _, key, form in wanted]
        )
        ms = 1e3 * row["seconds"] / row["steps"]
        head = [row["base"], f"{row['load_kpa']:g}", row["mapping"].replace(" (", ", ")]
        body.append([*head[:2], head[2].removesuffix(")"), *errors, f"{ms:.1f}"])
    heads = ("base", "load, kPa", "method", *(name for name, _, _ in wanted), "ms a step")
    return markdown(heads, body)


def foundation() -> str:
    """The strip foundation at 26 kPa: largest q, when, solves a step."""
    found = {(r["method"], r["boundary"]): r for r in rows("foundation") if r["load_kpa"] == 26.0}
    body = []
    for boundary in ("fixed", "viscous", "viscoelastic"):
        ours, twin = (found[method, boundary] for method in ("DM-GC", "FE"))
        largest = f"{ours['max_deviatoric_kpa']:.2f} ({twin['max_deviatoric_kpa']:.2f}) kPa"
        note = ", the yield plateau" if boundary == "fixed" else ""
        when = f"{ours['time_of_max_s']:.2f} s"
        body.append([boundary, largest + note, when, f"{ours['newton_per_step']:.2f}"])
    return markdown(("boundary", "largest q at point 2, DM-GC (FE)", "at", "solves a step"), body)


def foundation_ground() -> str:
    """The strip foundation with a far field, a layer, and in wide ground."""
    body = [
        [
            row["ground"],
            f"{row['max_deviatoric_kpa']:.2f} kPa",
            f"{100 * row['q_apart']:.2f} %",
            f"{1e3 * row['settlement_m']:.1f} mm",
        ]
        for row in rows("foundation_ground")
    ]
    heads = ("ground", "largest q at point 2", "q(t) apart from all points (L2)")
    return markdown((*heads, "settlement at 0.925 s"), body)


def nonlinear() -> str:
    """Ways through a non-linear step: solves, and the change of settlement with the step."""
    ways = {
        "DM-GC, mapped response": "mapped response, DM-GC: the default",
        "DM-G, mapped response": "mapped response, DM-G",
        "DM-GC, mapped, 1e-3": "DM-GC to 1e-3 instead of 1e-6: `Newton(tolerance=1e-3)`",
        "DM-GC, one solve": "DM-GC, one solve a step: `Newton(tolerance=None)`",
        "DM-GC, modified Newton": "modified Newton with (7), equilibrium at the points; not kept",
        "MPM, point tangent": "point tangent, MPM: of mappings that sum stiffness at the points",
        "GIMP, point tangent": "point tangent, GIMP: not quite the derivative",
        "FE": "finite elements",
    }
    found = {row["way"]: row for row in rows("nonlinear_step") if row["dt"] == 0.005}
    body = (
        [text, f"{found[way]['solves']:.1f}", f"{100 * found[way]['self']:.2f} %"]
        for way, text in ways.items()
    )
    return markdown(("way", "solves a step", "change"), body)


def cost() -> str:
    """Milliseconds a step of DM-GC and of finite elements; ratios of runs that took turns, where
    there are such."""
    found = rows("cost_of_a_step")
    bills = {
        (row["dim"], row["points"], row["method"]): row["seconds"]
        for row in found
        if row["kind"] == "bill" and "seconds" in row
    }
    paired = {(row["dim"], row["points"]): row["ratios"] for row in found if row["kind"] == "ratio"}
    methods = ("DM-GC", "DM-GC, reuse", "FE", "FE, Cholesky", "FE, frozen")
    body = []
    for dim, points in ((2, 24_576), (2, 98_304), (2, 393_216), (3, 65_536)):
        times = [bills[dim, points, method] for method in methods]
        turns = paired.get((dim, points), {})

        def over(ours: int, twin: int, times=times, turns=turns) -> float:
            between = f"{methods[ours]} / {methods[twin]}"
            return turns[between][0] if between in turns else times[ours] / times[twin]

        body.append(
            [
                f"{points:,} in {dim}D",
                *(f"{1e3 * t:.{1 if t < 0.01 else 0}f}" for t in times),
                f"{over(0, 2):.1f} ({over(1, 2):.1f})",
                f"{over(0, 3):.2f} ({over(1, 3):.2f})",
            ]
        )
    heads = ("points", "DM-GC, ms", "the same, `reuse=1e-3`", "FE, reassembled", "FE, Cholesky")
    more = ("FE, factor kept", "DM-GC (reuse) ÷ FE", "÷ FE, Cholesky")
    return markdown((*heads, *more), body)


def far_field() -> str:
    """The strip foundation with points in a box alone: a step over one of all points."""
    found = rows("far_field")
    body = []
    for name in found[0]["ratios"]:
        ratios = [row["ratios"][name] for row in found]
        points = found[0]["points"][name]
        cells = [f"{median:.2f} ({low:.2f} to {high:.2f})" for median, low, high in ratios]
        body.append([name, f"{points:,}" if points else "none", *cells])
    heads = ("strip foundation", "points", *(f"{row['law']}, of all points' step" for row in found))
    return markdown(heads, body)


def peers() -> str:
    """DM-GC beside Kratos, in turns."""
    body = []
    found = {(row["case"], row["method"]): row for row in rows("peers")}
    for case in dict.fromkeys(row["case"] for row in rows("peers")):
        ours, newton, once = (
            found[case, method] for method in ("DM-GC", "Kratos, Newton", "Kratos, one solve")
        )
        ratios = [f"{row['over_dm_gc']:.1f}" for row in (newton, once)]
        errors = [f"{100 * row['error_pressure']:.2g} %" for row in (newton, ours)]
        body.append([case, *ratios, *errors])
    heads = ("scene", "Kratos with its Newton ÷ DM-GC", "with one solve a step ÷ DM-GC")
    return markdown((*heads, "error of the pressure, Kratos", "DM-GC"), body)


def of_ranks() -> list[tuple[str, dict]]:
    """Names and rows of the blocks that ``scaling`` has run on one rank and on several."""
    names = {
        "strong": "as many points",
        "weak": "as many points a rank",
        "moving": "the same, sliding",
    }
    found = rows("scaling")
    return [
        (f"{name}, {row['dim']}D", row)
        for kind, name in names.items()
        for row in found
        if row["kind"] == kind
    ]


def ranks() -> str:
    """A step on one rank, with its better solver, and on several, in turns."""
    body = []
    for name, row in of_ranks():
        alone = row["runs"][row["best"]]
        for n, (ratio, *_) in row["ratios"].items():
            run = row["runs"][n]
            more = int(n) if row["kind"] == "weak" else 1
            gains = [more * ratio, more * row["ratios_jacobi"][n][0]]
            body.append(
                [
                    name,
                    f"{sum(run['points']):,}",
                    n,
                    *(
                        f"{1e3 * at['wall']:.{1 if at['wall'] < 0.1 else 0}f}"
                        for at in (alone, run)
                    ),
                    *(f"{gain:.2f}" for gain in gains),
                    f"{row['runs']['1']['iterations']}, {row['runs']['1, Jacobi']['iterations']}",
                    f"{run['iterations']}",
                    f"{100 * run['pieces']['migrate'] / run['wall']:.1f} %",
                ]
            )
    heads = (
        "scene",
        "points",
        "ranks",
        "one rank, ms",
        "several, ms",
        "gain",
        "over Jacobi on one",
    )
    more = ("iterations, ICC and Jacobi on one", "several", "migration, of the step")
    return markdown((*heads, *more), body)


def messages() -> str:
    """What the rank that sends most sends in a step."""
    body = []
    for name, row in of_ranks():
        for n in row["ratios"]:
            volume = row["runs"][n]["volume"]
            sent = [volume[what] for what in ("fields", "matrix", "solver", "points")]
            nodes = volume["boundary_nodes"]
            body.append(
                [
                    name,
                    n,
                    f"{nodes:.0f}",
                    *(f"{one / 1e3:.1f}" for one in sent),
                    f"{sum(sent) / nodes / 1e3:.1f}",
                    f"{volume['other_sums']:.0f} + {volume['solver_sums']:.0f}",
                    f"{row['runs'][n]['imbalance']:.2f}",
                ]
            )
    heads = ("scene", "ranks", "nodes on its edge", "fields, kB", "matrix", "solver", "points")
    return markdown((*heads, "a node, kB", "sums, others + solver's", "imbalance"), body)


def balance() -> str:
    """The collapse with and without ``Repartition``."""
    row = next(row for row in rows("scaling") if row["kind"] == "balance")
    body = []
    for name, series in row["series"].items():
        uneven = [at["imbalance"] for at in series]
        divided = row["divisions"] if name == "with" else []
        times = ", ".join(f"{1 + one['step']}" for one in divided)
        body.append(
            [
                f"{name} `Repartition`",
                f"{sum(uneven) / len(uneven):.2f}",
                f"{max(uneven):.2f}",
                f"{1e3 * row['cpu'][name]:.0f}",
                f"{len(divided)}" + (f" (before step {times})" if divided else ""),
            ]
        )
    return markdown(("run", "mean imbalance", "largest", "CPU ms a step", "divisions"), body)


def pays() -> str:
    """What a division costs, and when it is worth that."""
    found = [
        [f"block, {name}", f"{run['division']['wall'] / run['wall']:.0f}", "even"]
        for name, row in of_ranks()
        for n, run in row["runs"].items()
        if n == "2" and row["kind"] != "moving"
    ]
    row = next(row for row in rows("scaling") if row["kind"] == "balance")
    steps = [row["division_steps"], row["pays_after_steps"]]
    body = ["collapse", *("-" if one is None else f"{one:.0f}" for one in steps)]
    return markdown(("scene", "a division, steps", "pays after steps"), [body, *found])


def projection() -> str:
    """What the model says of a step on a cluster."""
    model = next(row for row in rows("scaling") if row["kind"] == "model")
    parts, bytes_ = model["parts"], model["bytes_a_point"]
    names = {"own work": "own work", "edges": "edges of ranks", "sums": "sums over all ranks"}
    body = [[f"{names[name]}, s", f"{parts[name]:.2g}"] for name in names]
    body += [
        ["the step, s", f"{sum(parts.values()):.2g}"],
        ["of 1,000 times one rank", f"{100 * model['efficiency']:.0f} %"],
        ["memory a point, 2D and 3D, kB", f"{bytes_['2'] / 1e3:.1f}, {bytes_['3'] / 1e3:.1f}"],
        ["memory a rank, GB", f"{model['bytes_a_rank'] / 1e9:.1f}"],
        ["ranks of 4 GB that are needed", f"{model['least_ranks']:.0f}"],
    ]
    points = "10" + str(round(math.log10(model["points"]))).translate(RAISED)
    return markdown((f"{points} points in 3D on {model['ranks']:,} ranks", ""), body)


def open_boundaries() -> str:
    """A box that is struck: error, and cost of a step, by what is done at its sides."""

    def percent(error: float) -> str:
        return f"{100 * error:.2g} %" if error > 1e-4 else "< 0.01 %"

    found = {
        (row["method"], row["boundary"]): row
        for row in rows("open_boundaries")
        if row["kind"] == "lamb"
    }
    body = []
    for boundary in (name for method, name in found if method == "FE"):
        row, points = found["FE", boundary], found.get(("DM-GC", boundary))
        line = [boundary, f"{row['cells']:,}", percent(row["error_early"]), percent(row["error"])]
        line.append(f"{row['cost'][0]:.1f}")
        line += [percent(points["error"]), f"{points['cost'][0]:.1f}"] if points else ["", ""]
        body.append(line)
    heads = ("at the sides of the box", "cells", "FE: error until 40 h/c_s", "until 120")
    return markdown((*heads, "cost of a step", "DM-GC: error until 120", "cost"), body)


TABLES: dict[str, Callable[[], str]] = {
    made.__name__: made
    for made in (
        *(column, foundation, foundation_ground, nonlinear, cost, far_field, peers),
        *(ranks, messages, balance, pays, projection),
        open_boundaries,
    )
}


def renewed(page: str) -> str:
    """A page's text with its tables anew."""
    return MARK.sub(lambda found: found[1] + TABLES[found[2]](), page)


def pages() -> list[Path]:
    """Pages that have such tables."""
    kept = (HOME / "docs").rglob("*.md")
    return sorted(page for page in kept if MARK.search(page.read_text()))


if __name__ == "__main__":
    for page in pages():
        page.write_text(renewed(page.read_text()))
        print(page.relative_to(HOME))
