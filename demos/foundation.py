"""A strip on soil that softens
============================

Fixed, viscous and viscoelastic boundaries under the same pulses; beside them, what the paper has
not: points in a box under the strip alone, in a far field of finite elements, and a layer that
absorbs at its edges.

The foundation of Do, Vardon, González Acosta & Hicks (2023), section 4.2, built in
``mpm_fenicsx.scenes.foundation``, which says what is assumed.  Units: m, s, kg, Pa.

Run it by::

    python demos/foundation.py            the paper's grid, a few minutes
    python demos/foundation.py --quick    cells of 0.125 m, less than a minute
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

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

from mpm_fenicsx import Energy, Grid, Probe, RunError
from mpm_fenicsx.scenes.foundation import (
    ASSUMED,
    BOUNDARIES,
    LAYER,
    Foundation,
    axis,
    dt,
    end,
    height,
    load,
    plateau,
    point_1,
    point_2,
    pulses,
    softening,
    strip,
    width,
)

HOME = Path(__file__).parents[1]
CELLS = {0.0625: "", 0.125: "_coarse"}  # m: endings of the names in meshes/
maps_load, maps_softening = (
    36e3,
    100e3,
)  # where the maps look most like the paper's: studies/foundation_load.py

BOX = (2.0, 2.0)  # m, of the points in a far field
WIDE = "wide mesh of finite elements"  # from which nothing comes back
GROUND = {  # names of figure and table; boundary, box
    "all points, dashpots": ("viscous", None),
    "points in 2 m × 2 m, dashpots": ("viscous", BOX),
    "points in 2 m × 2 m, layer": (LAYER, BOX),
}

YIELDED = 1e-4  # plastic strain
DEPARTURES = {
    "departs_from_viscous_s": 0.02,
    "departs_by_5_percent_s": 0.05,
}  # of the largest q with fixed edges
FIGURES = {  # of a row, with the scale and the form in which the table shows them
    "max_deviatoric_kpa": (1, ".2f"),
    "time_of_max_s": (1, ".3f"),
    "departs_from_viscous_s": (1, ".3f"),
    "departs_by_5_percent_s": (1, ".3f"),
    "plastic_area_m2": (1, ".2f"),
    "settlement_m": (1e3, ".1f"),
    "newton_per_step": (1, ".2f"),
    "seconds_per_step": (1e3, ".0f"),
    "energy_error": (100, ".2f"),
}


def material_points(scene):
    """Material points on a grid of ``meshes/``: with room for heave, and around sides and base
    where they drift; on the scene's own grid where ``meshes/`` has none."""
    if scene.box or scene.boundary == LAYER:
        return scene.material_points()
    kind = "fixed" if scene.boundary == "fixed" else "absorbing"
    grid = Grid.read(HOME / "meshes" / f"foundation_{kind}{CELLS[scene.cell]}.vtu")
    return scene.material_points(grid=grid)


METHODS = {"DM-GC": material_points, "FE": Foundation.finite_elements}


def deviatoric(stress):
    """q = √(3/2 s:s) of stress rows (n, 4)."""
    s = stress[:, :3] - stress[:, :3].mean(axis=1, keepdims=True)
    return np.sqrt(1.5 * (s**2).sum(axis=1) + 3 * stress[:, 3] ** 2)


def plastic_map(run):
    """Lower corners and sizes (n, 2) of the boxes around the run's samples, their plastic strain,
    their volumes."""
    if run.bodies:
        body = run.bodies[0]
        return body.x - body.half, 2 * body.half, body.history[:, 0], body.volume
    gauss, lattice = run.yielding.gauss, run.grid.lattice
    size = np.repeat(0.5 * (lattice.upper - lattice.lower), gauss.digit.shape[1], axis=0)
    corner = np.repeat(lattice.lower, gauss.digit.shape[1], axis=0) + size * gauss.digit.reshape(
        size.shape
    )
    return corner, size, run.yielding.history[:, 0], gauss.volume


def measure(run, scene, until=end, progress=None):
    """Run: a row of figures; curves of time, vertical stress at point 1, q at point 2, settlement;
    the plastic strain's map."""
    above, below = (run.record(Probe("stress", at)) for at in (point_1, point_2))
    surface, energy = run.record(Probe("displacement", (axis, height))), run.record(Energy())
    row = {
        "method": run.name,
        "boundary": scene.boundary,
        "load_kpa": scene.load / 1e3,
        "softening_kpa": scene.softening / 1e3,
        "cell_m": scene.cell,
        **dict.fromkeys(FIGURES),
    }
    began = time.perf_counter()
    try:
        run.until(until, progress)
    except RunError as error:
        row["reason"] = str(error)
    seconds, steps = time.perf_counter() - began, max(run.steps, 1)
    corner, size, strain, volume = plastic_map(run)
    t, q = below.times, deviatoric(below.values)
    row.update(
        max_deviatoric_kpa=float(q.max()) / 1e3,
        time_of_max_s=float(t[q.argmax()]),
        plastic_area_m2=float(volume[strain > YIELDED].sum()),
        settlement_m=-float(surface.values[-1, 1]),
        newton_per_step=run.solves / steps,
        seconds_per_step=seconds / steps,
        steps=run.steps,
    )
    if energy["work"][-1] > 0.0:
        row["energy_error"] = float(abs(energy.lost[-1]) / energy["work"][-1])
    down = -surface.values[:, 1]
    return row, (t, above.values[:, 1], q, down), (corner, size, strain)


def departure(fixed, viscous, share=0.02):
    """First time (s) at which two curves of q differ by a share of the first one's peak, or
    None."""
    n = min(len(fixed[0]), len(viscous[0]))
    apart = np.flatnonzero(np.abs(fixed[2][:n] - viscous[2][:n]) > share * fixed[2].max())
    return float(fixed[0][apart[0]]) if len(apart) else None


def scenes(settings, cell, twin):
    """What is run: method and scene."""
    for setting in settings:
        for boundary in BOUNDARIES:
            for method in METHODS if twin else ("DM-GC",):
                yield method, Foundation(boundary, *setting, cell)


def open_ground(load, softening, cell, whole, advance):
    """Rows of the ``GROUND`` and of a ``WIDE`` mesh, and time, q at point 2 and settlement of each
    by name.

    ``whole``: row and curve of all points between dashpots, which have been run; ``advance`` is
    told the steps.
    """
    rows, curves = [], {}
    for name, (boundary, box) in {**GROUND, WIDE: (LAYER, None)}.items():
        scene = Foundation(boundary, load, softening, cell, box=box)
        if boundary == "viscous" and box is None:
            row, curve = whole
        else:
            run = scene.wide_ground() if name == WIDE else material_points(scene)
            row, curve, _ = measure(run, scene, end, advance)
        t, _, q, down = curve
        n = min(len(q), len(whole[1][2]))
        every = whole[1][2][:n]
        apart = float(np.linalg.norm(q[:n] - every) / np.linalg.norm(every))
        rows.append({"ground": name, **row, "q_apart": apart})
        curves[name] = (t, q, down)
    return rows, curves


def table_of_ground(rows):
    """The same rows as a table for the terminal."""
    shown = Table(box=None, padding=(0, 1, 0, 0), title="Open ground, beside the paper")
    for name in ("", "q max\nkPa", "q(t) apart\n%", "down\nmm", "ms\na step"):
        shown.add_column(name, justify="right" if name else "left", no_wrap=not name)
    for row in rows:
        shown.add_row(
            row["ground"],
            f"{row['max_deviatoric_kpa']:.2f}",
            f"{100 * row['q_apart']:.2f}",
            f"{1e3 * row['settlement_m']:.1f}",
            f"{1e3 * row['seconds_per_step']:.0f}",
        )
    return shown


def table(rows):
    """The rows as a table for the terminal."""
    shown = Table(
        box=None, padding=(0, 1, 0, 0), title="Strip foundation: load, softening", caption=ASSUMED
    )
    for name in (
        "",
        "",
        "q max\nkPa",
        "at\ns",
        "leaves\nby 2 %",
        "visc.\nby 5 %",
        "yields\nm²",
        "down\nmm",
        "Newton\na step",
        "ms\na step",
        "energy\nerror %",
    ):
        shown.add_column(name, justify="right" if name else "left", no_wrap=not name)
    before = None
    for row in rows:
        setting = f"[bold]{row['load_kpa']:g}, {row['softening_kpa']:g} kPa"
        if setting != before:
            shown.add_row()
            shown.add_row(setting)
            before = setting
        values = [
            None if row[name] is None else scale * row[name] for name, (scale, _) in FIGURES.items()
        ]
        forms = [form for _, form in FIGURES.values()]
        shown.add_row(
            row["boundary"],
            row["method"],
            *("" if v is None else format(v, form) for v, form in zip(values, forms, strict=True)),
        )
        if "reason" in row:
            shown.add_row(f"[red]stopped: {row['reason']}")
    return shown


def draw(curves, found, settings, cell, folder):
    """The paper's Figures 3 and 4."""
    matplotlib.use("Agg")
    import foundation_figures

    t = np.linspace(0.0, end, 2000)
    says = [
        f"{load / 1e3:g} kPa, softening {softening / 1e3:g} kPa" for load, softening in settings
    ]
    both = [curves.get(("DM-GC", boundary)) for boundary in ("fixed", "viscous")]
    apart = {share: departure(*both, share) for share in DEPARTURES.values()}
    foundation_figures.histories(
        curves,
        (t, pulses(t, settings[0][0])),
        plateau,
        apart,
        [height - y for _, y in (point_1, point_2)],
        f"Strip foundation, {says[0]} (h = {cell:g} m, Δt = {1e3 * dt:g} ms, 4 points a cell)",
        folder / "foundation.png",
    )
    foundation_figures.maps(
        found,
        BOUNDARIES,
        (width, height),
        (axis - strip / 2, axis + strip / 2),
        f"Plastic strain at t = {end:g} s under {says[-1]}, both assumed (h = {cell:g} m)",
        folder / "foundation_maps.png",
    )


def draw_ground(histories, setting, cell, folder):
    """What far field and layer change."""
    matplotlib.use("Agg")
    import foundation_figures

    load, softening = setting
    foundation_figures.ground(
        histories,
        height - point_2[1],
        f"Strip foundation in open ground, {load / 1e3:g} kPa, softening {softening / 1e3:g} kPa\n"
        f"(DM-GC, h = {cell:g} m, Δt = {1e3 * dt:g} ms, 4 points a cell)",
        folder / "foundation_ground.png",
    )


def main(arguments=None) -> list[dict]:
    """Run the scenes, print the tables, write foundation.json, foundation_ground.json and
    foundation.png, foundation_maps.png, foundation_ground.png; the rows of the first."""
    parser = argparse.ArgumentParser(description="A strip on soil that softens")
    parser.add_argument("--quick", action="store_true", help="cells of 0.125 m")
    parser.add_argument("--load", type=float, metavar="kPa", help="one load for curves and maps")
    parser.add_argument(
        "--softening", type=float, metavar="kPa", help="of cohesion, a unit of plastic strain"
    )
    parser.add_argument("--no-fe", action="store_true", help="leave the finite element twin out")
    parser.add_argument(
        "--results", type=Path, default=HOME / "results", help="folder for the results"
    )
    chosen = parser.parse_args(arguments)
    settings = [(load, softening), (maps_load, maps_softening)]
    if chosen.load is not None or chosen.softening is not None:
        settings = [
            tuple(
                known if given is None else 1e3 * given
                for given, known in ((chosen.load, load), (chosen.softening, softening))
            )
        ]
    cell = 0.125 if chosen.quick else 0.0625
    chosen.results.mkdir(parents=True, exist_ok=True)
    console, rows, curves, found = Console(), [], {}, {}
    todo = list(scenes(settings, cell, not chosen.no_fe))
    columns = (
        TextColumn("{task.description:32}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as progress:
        steps = round(end / dt)
        more = len(GROUND)  # less the first, and a wide mesh
        task = progress.add_task("", total=(len(todo) + more) * steps)
        for number, (method, scene) in enumerate(todo):
            boundary, setting = scene.boundary, (scene.load, scene.softening)
            progress.update(task, description=f"{method}, {boundary}, {scene.load / 1e3:g} kPa")

            def advance(step, done=number * steps):
                progress.update(task, completed=done + step)

            row, curve, strain = measure(METHODS[method](scene), scene, end, advance)
            progress.update(task, completed=(number + 1) * steps)
            rows.append(row)
            if setting == settings[0]:
                curves[method, boundary] = curve
                fixed = next(r for r in rows if r["method"] == method and r["boundary"] == "fixed")
                if boundary == "viscous":
                    for name, share in DEPARTURES.items():
                        fixed[name] = departure(curves[method, "fixed"], curve, share)
            if setting == settings[-1]:
                found[method, boundary] = strain
            (chosen.results / "foundation.json").write_text(json.dumps(rows, indent=1) + "\n")
        progress.update(task, description=f"far field, {settings[0][0] / 1e3:g} kPa")
        whole = next(r for r in rows if (r["method"], r["boundary"]) == ("DM-GC", "viscous"))
        ground, histories = open_ground(
            *settings[0],
            cell,
            (whole, curves["DM-GC", "viscous"]),
            lambda _: progress.advance(task),
        )
    (chosen.results / "foundation_ground.json").write_text(json.dumps(ground, indent=1) + "\n")
    draw(curves, found, settings, cell, chosen.results)
    draw_ground(histories, settings[0], cell, chosen.results)
    console.print(table(rows))
    console.print(table_of_ground(ground))
    for kind, names in {
        "figures": ("foundation.png", "foundation_maps.png", "foundation_ground.png"),
        "rows": ("foundation.json", "foundation_ground.json"),
    }.items():
        console.print(f"{kind}: {', '.join(str(chosen.results / name) for name in names)}")
    return rows


if __name__ == "__main__":
    main()
