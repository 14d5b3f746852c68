"""A square footing in 3D
======================

A footing of 2 m × 2 m is loaded on a quarter of a block of soil, between fixed, viscous and
viscoelastic boundaries.

Built in ``mpm_fenicsx.scenes.footing_3d``.  Two things are checked first, at rest and elastic: what
a block of this size between fixed boundaries settles, against its exact series, by material points
and by finite elements on this grid and on one twice as fine.  Then the load comes within 20 ms and
stays.  Beside the three boundaries runs a finite element block 8 m larger each way, whose first
echo comes back after 0.2 s; the last line is a half-space at rest (Schleicher 1926).  Dashpots
alone hold no load that stays: with them the block sinks on.  What comes back at 0.13 s, 4 % of the
settlement, are oblique and surface waves, which dashpots absorb in part.  Units: m, s, kg, Pa.

Run it by::

    python demos/footing_3d.py                            about a minute
    python demos/footing_3d.py --soil clay --load 80      von Mises clay, c = 20 kPa
    python demos/footing_3d.py --cells 4                  cells of 0.25 m, ten times as long
    mpiexec -n 2 python -m mpi4py demos/footing_3d.py     the same numbers, from two ranks
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np

try:
    import matplotlib
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.table import Table
except ImportError as error:
    raise ImportError(
        f"{error}: demos take matplotlib and rich, pip install 'mpm_fenicsx[demo]'"
    ) from error

from mpm_fenicsx import Energy
from mpm_fenicsx.scenes.footing_3d import BOUNDARIES, SOILS, Footing, mean_settlement, soil

RESULTS = Path(__file__).parents[1] / "results"
end = 0.3  # s
far = 8.0  # m, more soil around
METHODS = {"FE": Footing.finite_elements, "DM-GC": Footing.material_points}


def at_rest(scene):
    """Settlement (m) of the elastic block between fixed boundaries: rows of method, cell, centre
    and mean with their distance from the exact series.  The load is so small that points stay."""
    scene = replace(scene, boundary="fixed", law=soil, load=1.0)
    area = float(np.prod(scene.half))
    rows = []
    for method, cell in (("FE", scene.cell), ("FE", scene.cell / 2), ("DM-GC", scene.cell)):
        now = replace(scene, cell=cell)
        run = METHODS[method](now, static=True)
        probe = run.record(now.settlement(run))
        run.step()
        run.settle(1e-8)
        probe(run)
        centre, mean = -float(probe.values[-1, 1]), mean_settlement(run, now.load, area)
        rows.append(
            {
                "method": method,
                "cell_m": cell,
                "centre_mm_per_kpa": 1e6 * centre,
                "mean_mm_per_kpa": 1e6 * mean,
                "centre_off": centre / now.at_rest(now.place(run)) - 1.0,
                "mean_off": mean / now.mean_at_rest - 1.0,
            }
        )
    return rows


class Section:
    """Recorder of a field in the layer of points beside the plane z = 0, when a time is reached:
    ``values`` (rows, columns) from the top down, NaN elsewhere than on the first rank."""

    def __init__(self, scene: Footing, read, at: float):
        self.scene, self.read, self.at, self.values = scene, read, at, None

    def attach(self, run) -> None:
        """Nothing to remember of the start."""

    def __call__(self, run) -> None:
        """Gather the layer at its time."""
        if abs(run.time - self.at) > 0.5 * run.stepping.dt:
            return
        (body,), spacing = run.bodies, 0.5 * self.scene.cell
        layer = body.x[:, 2] < spacing
        found = run.grid.comm.gather((body.x[layer, :2], self.read(body)[layer]))
        if found is not None:
            x, values = (np.concatenate(part) for part in zip(*found, strict=True))
            across, up = np.floor(x / spacing).astype(int).T
            shape = round(self.scene.depth / spacing) + 4, round(self.scene.width / spacing) + 4
            self.values = np.full(shape, np.nan)
            self.values[up + 2, across] = values  # a base that drifts has room below


def measure(run, scene, until=end, sections=(), progress=None):
    """Run: a row of figures, and the settlement (m) of the centre at all times.  The same on every
    rank, but for the seconds."""
    settlement, energy = run.record(scene.settlement(run)), run.record(Energy())
    for section in sections:
        run.record(section)
    began = time.perf_counter()
    run.until(until, progress)
    w = -settlement.values[:, 1]
    row = {
        "method": run.name,
        "boundary": scene.boundary,
        "far_m": scene.far,
        "load_kpa": scene.load / 1e3,
        "cell_m": scene.cell,
        "largest_mm": float(1e3 * w.max()),
        "at_end_mm": float(1e3 * w[-1]),
        "plastic_of_work": float(energy["plastic"][-1] / energy["work"][-1]),
        "energy_lost": float(energy.lost[-1] / energy["work"][-1]),
        "steps": run.steps,
        "seconds": round(time.perf_counter() - began, 3),
    }
    return row, (settlement.times, w)


def scenes(scene):
    """What is run: method and scene."""
    for boundary in BOUNDARIES:
        for method in METHODS:
            yield method, replace(scene, boundary=boundary)
    yield "FE", replace(scene, boundary="viscous", far=far)


def tables(still, rows):
    """What was found, for the terminal."""
    rest = Table(box=None, padding=(0, 1, 0, 0), title="Elastic, fixed, at rest: exact series")
    for name in ("", "h\nm", "centre\nmm/kPa", "off\n%", "mean\nmm/kPa", "off\n%"):
        rest.add_column(name, justify="right" if name else "left", no_wrap=True)
    for row in still:
        rest.add_row(
            row["method"],
            f"{row['cell_m']:g}",
            f"{row['centre_mm_per_kpa']:.5f}",
            f"{100 * row['centre_off']:+.2f}",
            f"{row['mean_mm_per_kpa']:.5f}",
            f"{100 * row['mean_off']:+.2f}",
        )
    moving = Table(box=None, padding=(0, 1, 0, 0), title="Settlement of the centre under the ramp")
    for name in ("", "", "most\nmm", "at end\nmm", "plastic\n% work", "lost\n% work", "time\ns"):
        moving.add_column(name, justify="right" if name else "left", no_wrap=True)
    for row in rows:
        moving.add_row(
            row["boundary"] + (f", {row['far_m']:g} m farther" if row["far_m"] else ""),
            row["method"],
            f"{row['largest_mm']:.3f}",
            f"{row['at_end_mm']:.3f}",
            f"{100 * row['plastic_of_work']:.1f}",
            f"{100 * row['energy_lost']:.2f}",
            f"{row['seconds']:.1f}",
        )
    return rest, moving


COLOURS = {"fixed": "#E69F00", "viscous": "#CC79A7", "viscoelastic": "#0072B2"}


def figure(curves, scene, sections, path):
    """Settlement over time, and two looks at the plane of symmetry."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, (left, *maps) = plt.subplots(
        1, 3, figsize=(13, 4.4), layout="constrained", width_ratios=(1.5, 1, 1)
    )
    for (method, boundary, beyond), (t, w) in curves.items():
        if beyond:
            left.plot(t, 1e3 * w, color="0.75", lw=4.5, zorder=0, label=f"FE, {far:g} m farther")
        else:
            line = "-" if method == "DM-GC" else (0, (2, 2))
            left.plot(
                t, 1e3 * w, color=COLOURS[boundary], ls=line, lw=1.5, label=f"{boundary}, {method}"
            )
    if scene.law.linear:
        left.axhline(1e3 * scene.on_a_half_space, color="k", ls=":", label="half-space, at rest")
    left.set_xlabel("time (s)")
    left.set_ylabel("settlement of the centre (mm)")
    left.set_ylim(bottom=0.0)
    left.set_xlim(0.0, max(t[-1] for t, _ in curves.values()))
    left.grid(alpha=0.3)
    left.legend(fontsize=8)
    spacing = 0.5 * scene.cell
    for axis, (section, label, colours) in zip(maps, sections, strict=True):
        if section.values is None:
            axis.set_axis_off()  # its time was not reached
            continue
        rows, columns = section.values.shape
        edges = spacing * np.arange(columns + 1), spacing * (np.arange(rows + 1) - 2)
        most = np.nanmax(np.abs(section.values))
        least = -most if colours == "PuOr" else 0.0
        image = axis.pcolormesh(*edges, section.values, cmap=colours, vmin=least, vmax=most)
        fig.colorbar(image, ax=axis, label=label)
        axis.plot([0.0, scene.half[0]], [scene.depth + spacing] * 2, color="k", lw=3)
        axis.set_aspect("equal")
        axis.set_xlim(0.0, scene.width)
        axis.set_ylim(-spacing, scene.depth + 1.5 * spacing)
        axis.set_title(f"z = 0, t = {section.at:g} s", fontsize=10)
        axis.set_xlabel("x (m)")
        axis.set_ylabel("y (m)")
    fig.suptitle(
        f"Square footing under {scene.load / 1e3:g} kPa; sections: viscoelastic, DM-GC "
        f"(h = {scene.cell:g} m, Δt = {1e3 * scene.step:g} ms, 8 points a cell)"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def looks(scene, until):
    """Sections: how fast soil moves down as the waves run out, and what stays at the end."""
    down = lambda body: -1e3 * body.velocity[:, 1]  # noqa: E731
    moving = Section(scene, down, 0.04), "downward velocity (mm/s)", "PuOr"
    if scene.law.linear:
        pressure = lambda body: -1e-3 * body.stress[:, 1]  # noqa: E731
        return moving, (Section(scene, pressure, until), "vertical pressure (kPa)", "cividis")
    strain = lambda body: 100 * body.history[:, 0]  # noqa: E731
    return moving, (Section(scene, strain, until), "plastic strain (%)", "cividis")


def main(arguments=None) -> dict[str, list[dict]]:
    """Run the scenes, print the tables, write results/footing_3d.json and results/footing_3d.png;
    of clay, footing_3d_clay."""
    parser = argparse.ArgumentParser(description="A square footing in 3D")
    parser.add_argument("--soil", choices=SOILS, default="elastic")
    parser.add_argument("--load", type=float, default=50.0, metavar="kPa", help="(default: 50)")
    parser.add_argument(
        "--ramp", type=float, default=0.02, metavar="S", help="0: at once (default: 0.02)"
    )
    parser.add_argument("--cells", type=int, default=2, help="cells a metre (default: 2)")
    parser.add_argument("--until", type=float, default=end, metavar="S", help="stop at this time")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen = parser.parse_args(arguments)
    scene = Footing(
        law=SOILS[chosen.soil],
        load=1e3 * chosen.load,
        ramp=chosen.ramp,
        cell=1.0 / chosen.cells,
        step=4e-3 / chosen.cells,
    )
    first = MPI.COMM_WORLD.rank == 0
    console, rows, curves, sections = Console(quiet=not first), [], {}, ()
    still, todo = at_rest(scene), list(scenes(scene))
    columns = (
        TextColumn("{task.description:32}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, disable=not first) as progress:
        steps = round(chosen.until / scene.step)
        task = progress.add_task("", total=len(todo) * steps)
        for number, (method, now) in enumerate(todo):
            progress.update(task, description=f"{method}, {now.boundary}")

            def advance(step, done=number * steps):
                progress.update(task, completed=done + step)

            looked = looks(now, chosen.until) if (method, now.boundary) == LOOKED_AT else ()
            row, curves[method, now.boundary, now.far] = measure(
                METHODS[method](now), now, chosen.until, [one for one, *_ in looked], advance
            )
            rows.append(row)
            sections = looked or sections
    name = "footing_3d" + ("" if chosen.soil == "elastic" else f"_{chosen.soil}")
    found = {"at_rest": still, "moving": rows}
    if first:
        chosen.results.mkdir(parents=True, exist_ok=True)
        (chosen.results / f"{name}.json").write_text(json.dumps(found, indent=1) + "\n")
        figure(curves, scene, sections, chosen.results / f"{name}.png")
    console.print(*tables(still, rows), sep="\n\n")
    console.print(f"figure: {chosen.results / name}.png, rows: {chosen.results / name}.json")
    return found


LOOKED_AT = "DM-GC", "viscoelastic"

if __name__ == "__main__":
    main()
