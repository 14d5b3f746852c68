"""Four ways through a non-linear step, on speed against error.

The strip foundation (h = 0.125 m, fixed sides and base) under one half-sine of 40 kPa, which yields
and softens.

    mapped response   equilibrium at the Gauss points, the points' law double-mapped: Newton to 1e-6
                      (the default)
    one solve         the same, one linear solve a step
    modified Newton   equilibrium summed at the points, tangent as for the mapped response's elastic
                      part only
    point tangent     equilibrium and tangent at the points (GIMP and MPM)

Each is compared at three time steps with the FE twin at the smallest and with itself there.  Writes
results/nonlinear_step.json and .png.

    python studies/nonlinear_step.py [--quick]
"""

from __future__ import annotations

import time

import numpy as np
import report
from rich.progress import track

from mpm_fenicsx import DM_G, DM_GC, GIMP, MPM, Newton, Probe, RunError, Simulation, Solver
from mpm_fenicsx.response.small_strain_at_points import YieldingAtPoints
from mpm_fenicsx.scenes.foundation import Foundation, axis, height

end = 0.3  # s


class ModifiedNewton(Simulation):
    """Equilibrium at the points, with the double-mapped elastic stiffness of eq. (7) as tangent."""

    def _can_yield(self):
        law = YieldingAtPoints(self.motion, self.bodies, self.stencils, self._recover)
        law.stiffness = 0
        return law


def half_sine(t, load):
    """Pressure (Pa) of one pulse."""
    return load * max(0.0, np.sin(np.pi * t / 0.2)) * (t < 0.2)


def strip(dt, cell=0.125, law=None):
    """The fixed box under its pulse, with steps of dt (s)."""
    return Foundation("fixed", 40e3, cell=cell, step=dt, history=half_sine, law=law)


def elements(scene, newton):
    """The FE twin."""
    return scene.finite_elements(solver=Solver(newton=newton))


def points(scene, newton, mapping, kind=Simulation):
    """Material points, with room for heave."""
    grid = scene.grid(room=4 * scene.cell)
    return scene.material_points(mapping, grid, kind=kind, solver=Solver(newton=newton))


WAYS = {
    "FE": lambda scene: elements(scene, Newton()),
    "DM-GC, mapped response": lambda scene: points(scene, Newton(), DM_GC),
    "DM-G, mapped response": lambda scene: points(scene, Newton(), DM_G),
    "DM-GC, mapped, 1e-3": lambda scene: points(scene, Newton(tolerance=1e-3), DM_GC),
    "DM-GC, one solve": lambda scene: points(scene, Newton(tolerance=None), DM_GC),
    "DM-GC, modified Newton": lambda scene: points(
        scene, Newton(iterations=40, cuts=0), DM_GC, ModifiedNewton
    ),
    "GIMP, point tangent": lambda scene: points(scene, Newton(iterations=40), GIMP),
    "MPM, point tangent": lambda scene: points(scene, Newton(), MPM),
}


def measure(name, dt):
    """One run: settlement curve at the steps of the largest dt, solves and seconds a step."""
    run = WAYS[name](strip(dt))
    probe = run.record(Probe("displacement", (axis, height)))
    began, reason = time.perf_counter(), None
    try:
        run.until(end)
    except RunError as error:
        reason = str(error)
    steps = max(run.steps, 1)
    return {
        "way": name,
        "dt": dt,
        "steps": run.steps,
        "reason": reason,
        "solves": run.solves / steps,
        "ms": 1e3 * (time.perf_counter() - began) / steps,
        "settlement": (-probe.values[:, 1]).tolist(),
    }


def figure(rows, path):
    """Difference from the FE twin at the smallest step, against seconds a run."""
    fig, axis = report.subplots(figsize=(7, 4.6))
    colours = [
        "#000000",
        "#0072B2",
        "#56B4E9",
        "#009E73",
        "#E69F00",
        "#D55E00",
        "#CC79A7",
        "#999999",
    ]
    for (name, colour), marker in zip(zip(WAYS, colours, strict=True), "osD^v<>p", strict=True):
        mine = [row for row in rows if row["way"] == name and row["self"] and not row["reason"]]
        if mine:
            axis.loglog(
                [row["ms"] * row["steps"] / 1e3 for row in mine],
                [100 * row["self"] for row in mine],
                color=colour,
                marker=marker,
                label=name,
            )
    axis.set_xlabel("time of the run (s)")
    axis.set_ylabel("difference from itself at the smallest step (%)")
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize=8)
    fig.suptitle("Strip foundation yielding under 40 kPa: settlement over 0.3 s")
    report.save(fig, path)


def main(arguments=None) -> list[dict]:
    """Run all ways at all steps, print a table, write results."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="two time steps only")
    chosen = report.chosen(parser, arguments)
    steps = (10e-3, 5e-3) if chosen.quick else (10e-3, 5e-3, 2.5e-3, 1.25e-3)
    for name in WAYS:
        measure(name, steps[0])  # what is compiled or loaded once is no time of a run
    rows = [measure(name, dt) for name, dt in track([(name, dt) for name in WAYS for dt in steps])]
    finest = {row["way"]: row for row in rows if row["dt"] == steps[-1] and not row["reason"]}
    for row in rows:
        row["self"] = row["fe"] = None
        every = round(row["dt"] / steps[-1])
        for key, way in (("self", row["way"]), ("fe", "FE")):
            if row["reason"] is None and way in finest and row is not finest[way]:
                known = np.array(finest[way]["settlement"])[::every]
                mine = np.array(row["settlement"])
                row[key] = float(np.linalg.norm(mine - known) / np.linalg.norm(known))
        shown = [
            f"{100 * row[key]:6.2f} %" if row[key] is not None else "       -"
            for key in ("self", "fe")
        ]
        print(
            f"{row['way']:24} dt {1e3 * row['dt']:5.2f} ms  solves {row['solves']:5.2f}  "
            f"{row['ms']:6.1f} ms a step  from itself {shown[0]}  from FE {shown[1]}  "
            f"{row['reason'] or ''}"
        )
    for row in rows:
        row["settlement"] = row["settlement"][-1]
    report.write(chosen.results / "nonlinear_step.json", rows)
    figure(rows, chosen.results / "nonlinear_step.png")
    return rows


if __name__ == "__main__":
    main()
