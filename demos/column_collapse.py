"""Columns that collapse
=====================

Dry grains and clay are let go and run out on a rough base: how far, against what experiments found.

Built in ``mpm_fenicsx.scenes.column_collapse``.  Grains of φ = 35° and ψ = 0, which come to rest at
slopes of up to 30°, 1 m wide and 0.5, 1 and 1.5 m high; the run-out is that of 99 % of the mass.
Experiments in channels found it in proportion to the aspect ratio: 1.2 a (Lube et al. 2005) and
1.0 a (Lajeunesse et al. 2005).  Clay of c = 5 kPa, 2 m × 4 m, has no such law: what it shows is an
energy that balances.  Both go further on finer grids: by 17 % (grains, a = 1) and 8 % (clay) when
cells are halved.  Units: m, s, kg, Pa.

Run it by::

    python demos/column_collapse.py                  some minutes
    python demos/column_collapse.py --aspects 0.5 --no-clay  half a minute
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

try:
    import matplotlib
    from rich.console import Console
except ImportError as error:
    raise ImportError(
        f"{error}: demos take matplotlib and rich, pip install 'mpm_fenicsx[demo]'"
    ) from error

from mpm_fenicsx import Energy
from mpm_fenicsx.scenes.column_collapse import clay, granular, lajeunesse, lube

RESULTS = Path(__file__).parents[1] / "results"


def collapse(column) -> tuple[dict, tuple]:
    """A row of what became of a column, and where its points are."""
    run = column.material_points()
    (points,), energy = run.bodies, run.record(Energy())
    run.until(column.end)
    work = energy["work"][-1]
    row = {
        "width_m": column.width,
        "height_m": column.height,
        "cell_m": column.cell,
        "run_out": column.run_out(run),
        "stray_points": column.strays(run),
        "energy_not_found": float(energy.lost[-1] / work),
        "kinetic": float(energy["kinetic"][-1] / work),
    }
    return row, (points.x.copy(), points.history[:, 0].copy())


def figure(found, path):
    """Deposits, a picture each, with the run-outs of the experiments."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    tall = [column.height / column.width + 0.5 for _, column, _, _ in found]
    fig, axes = plt.subplots(
        len(found),
        1,
        figsize=(8.5, 1.6 * sum(tall)),
        squeeze=False,
        layout="constrained",
        height_ratios=tall,
    )
    far = max(x[:, 0].max() / column.width for _, column, _, (x, _) in found)
    for (name, column, row, (x, strain)), axis in zip(found, axes[:, 0], strict=True):
        aspect = column.height / column.width
        places = (x / column.width).T
        dots = axis.scatter(*places, 3, c=strain, cmap="cividis", vmin=0.0, vmax=3.0)
        axis.plot(
            [0.0, 1.0, 1.0],
            [aspect, aspect, 0.0],
            color="0.3",
            lw=0.8,
            ls="--",
            label="at the start",
        )
        if name.startswith("grains"):
            for law, line in ((lajeunesse, ":"), (lube, "-")):
                reach, label = 1.0 + law(aspect), law.__name__.title()
                axis.axvline(reach, color="#D55E00", lw=1.2, ls=line, label=label)
        axis.set(ylabel="y/d₀ (-)", aspect="equal", xlim=(0.0, 1.4 * far))
        axis.set_anchor("W")
        axis.set_title(f"{name}: run-out {row['run_out']:.2f} of the width", fontsize=10)
        axis.legend(fontsize=7, loc="upper right")
    axes[-1, 0].set_xlabel("x/d₀ (-)")
    fig.colorbar(dots, ax=axes[:, 0], label="plastic strain (-)", extend="max")
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def main(arguments=None) -> list[dict]:
    """Run the columns, print a line each, write results/column_collapse.json and .png."""
    parser = argparse.ArgumentParser(description="Columns that collapse")
    parser.add_argument("--aspects", type=float, nargs="+", default=[0.5, 1.0, 1.5])
    parser.add_argument("--no-clay", action="store_true", help="grains alone")
    parser.add_argument("--cell", type=float, default=0.125, help="of the grains, m")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen, console = parser.parse_args(arguments), Console()
    columns = {f"grains, a = {a:g}": granular(a, cell=chosen.cell) for a in chosen.aspects}
    if not chosen.no_clay:
        columns["clay"] = clay()
    found = []
    for name, column in columns.items():
        row, places = collapse(column)
        found.append((name, column, {"column": name, **row}, places))
        text = f"{name:16} run-out {row['run_out']:.2f}"
        if name != "clay":
            a = column.height / column.width
            text += f", experiments {lajeunesse(a):.2f} to {lube(a):.2f}"
        lost = 100 * row["energy_not_found"]
        console.print(f"{text}; stray points {row['stray_points']}; energy not found {lost:.1f} %")
    chosen.results.mkdir(parents=True, exist_ok=True)
    rows = [row for _, _, row, _ in found]
    (chosen.results / "column_collapse.json").write_text(json.dumps(rows, indent=1) + "\n")
    figure(found, chosen.results / "column_collapse.png")
    return rows


if __name__ == "__main__":
    main()
