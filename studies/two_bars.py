"""Two bars that meet: what contact makes of stress, velocities and energy, against d'Alembert.

The bars of ``mpm_fenicsx.scenes.two_bars``, on a line of the grid or 0.3 cells off it.

Writes results/two_bars.json and .png.

    python studies/two_bars.py              a minute
    python studies/two_bars.py --quick      seconds
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import report
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpm_fenicsx import DM_G, DM_GC, GIMP, MPM, Contact
from mpm_fenicsx.scenes.two_bars import CASES, LENGTH, SOIL, SPEED, C, bars

MAPPINGS = (MPM, GIMP, DM_G, DM_GC)


def history(
    run: Contact, n: int, travels: float = 3.0, speed: float = SPEED
) -> dict[str, np.ndarray]:
    """After each step: time over L/c, stress at the faces over ρ c v, velocities over v, distance
    over v L/c, momentum lost over that of one bar, energy over that at the start."""
    v, h = speed * C, LENGTH / n
    faces = [patch.points for one in run.runs for patch in one.scene.patches]
    momentum = [sum(body.mass @ body.velocity[:, 0] for body in run.bodies)]
    energy = [sum(run.energy().values())]
    found: dict[str, list] = {
        name: [] for name in ("time", "stress", "left", "right", "distance", "lost", "energy")
    }
    while run.time < travels * LENGTH / C:
        run.step()
        momentum.append(sum(body.mass @ body.velocity[:, 0] for body in run.bodies))
        left, right = (body.mass @ body.velocity[:, 0] / body.mass.sum() / v for body in run.bodies)
        values = (
            run.time * C / LENGTH,
            run.forces[0, 0] / (h * SOIL.density * C * v),
            left,
            right,
            (faces[1].x[:, 0].min() - faces[0].x[:, 0].max()) / (v * LENGTH / C),
            (momentum[-1] - momentum[0]) / (run.bodies[0].mass.sum() * v),
            sum(run.energy().values()) / energy[0],
        )
        for series, value in zip(found.values(), values, strict=True):
            series.append(value)
    return {name: np.array(series) for name, series in found.items()}


def figures(case: str, found: dict[str, np.ndarray]) -> dict[str, float]:
    """What is reported: error of the velocities exchanged, over their difference before; duration
    over L/c; scatter of the stress while it lasts and error of its mean from a quarter to three
    quarters; largest pull and momentum lost; energy at last and at most."""
    _, before, after = CASES[case]
    t, stress = found["time"], found["stress"]
    pressed, during, middle = np.flatnonzero(stress < -0.05), t <= 2.0, (t > 0.5) & (t < 1.5)
    return {
        "velocity": abs(found["right"][-1] - found["left"][-1] - (after[1] - after[0]))
        / (before[0] - before[1]),
        "duration": float(t[pressed[-1]]),
        "scatter": float(np.sqrt(np.mean((stress[during] + 1.0) ** 2))),
        "middle": float(abs(stress[middle].mean() + 1.0)),
        "pull": float(max(stress.max(), 0.0)),
        "momentum": float(np.abs(found["lost"]).max()),
        "energy": float(found["energy"][-1]),
        "most": float(found["energy"].max()),
    }


def cases(quick: bool):
    """Settings of the runs."""
    for case in CASES:
        for n in (10,) if quick else (10, 20, 40):
            for courant in (0.5,) if quick else (0.5, 2.0):
                for places in (0.0,) if quick else (0.0, 0.3):
                    for mapping in (DM_GC,) if quick else MAPPINGS:
                        yield dict(
                            case=case,
                            mapping=mapping,
                            n=n,
                            courant=courant,
                            places=places,
                            radius=None,
                        )
    for radius in () if quick else (0.8, 0.5):
        yield dict(case="equal", mapping=DM_GC, n=20, courant=0.5, places=0.0, radius=radius)


def figure(shown: dict[tuple, dict], path: Path) -> None:
    """Stress at the faces and mean velocities in time."""
    colors = {10: "#e69f00", 20: "#0072b2", 40: "#009e73"}
    fig, axes = report.subplots(2, 2, figsize=(10, 6.0), sharex=True)
    for column, (case, (_, before, after)) in enumerate(CASES.items()):
        stress, velocity = axes[:, column]
        for (name, n), found in shown.items():
            if name == case:
                stress.plot(
                    found["time"], found["stress"], color=colors[n], lw=1.2, label=f"DM-GC, L/{n}"
                )
                for bar, line in (("left", "-"), ("right", "--")):
                    velocity.plot(
                        found["time"],
                        found[bar],
                        line,
                        color=colors[n],
                        lw=1.2,
                        label=f"{bar} bar, L/{n}",
                    )
        t = np.array([0.0, 2.0, 3.0])
        stress.plot([0, 0, 2, 2, 3], [0, -1, -1, 0, 0], color="0.0", lw=1.0, ls=":", label="exact")
        for k, (v0, v1) in enumerate(zip(before, after, strict=True)):
            velocity.plot(
                t, [v0, v1, v1], color="0.0", lw=1.0, ls=":", label="exact" if k == 0 else None
            )
        stress.set(ylabel="stress at the faces / ρcv (-)", title=f"{case} bars", xlim=(0, 3))
        velocity.set(ylabel="mean velocity / v (-)", xlabel="time / (L/c) (-)")
        for axis in (stress, velocity):
            axis.grid(alpha=0.3)
            axis.legend(fontsize=7)
    fig.suptitle("Two bars that meet, Courant ½, cells of L/10, L/20, L/40")
    report.save(fig, path)


def main(arguments=None) -> list[dict]:
    """Run all cases, print a table, write results/two_bars.json and .png."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="ten cells, DM-GC, Courant ½")
    chosen = report.chosen(parser, arguments)
    rows, shown = [], {}
    for setting in track(list(cases(chosen.quick)), "bars"):
        found = history(bars(**setting), setting["n"])
        rows.append(
            {**setting, "mapping": str(setting["mapping"]), **figures(setting["case"], found)}
        )
        if setting["mapping"] is DM_GC and (
            setting["courant"],
            setting["places"],
            setting["radius"],
        ) == (0.5, 0, None):
            shown[setting["case"], setting["n"]] = found
    report.write(chosen.results / "two_bars.json", report.rounded(rows, 5))
    figure(shown, chosen.results / "two_bars.png")
    table = Table(
        "bars",
        "mapping",
        "cells",
        "Courant",
        "off lines",
        "ρ∞",
        "velocities, %",
        "duration c/L",
        "scatter",
        "stress, %",
        "momentum",
        "energy",
        "at most",
        box=None,
    )
    for row in rows:
        table.add_row(
            row["case"],
            row["mapping"],
            str(row["n"]),
            f"{row['courant']:g}",
            f"{row['places']:g}",
            str(row["radius"] or ""),
            f"{100 * row['velocity']:.2f}",
            f"{row['duration']:.3f}",
            f"{row['scatter']:.2f}",
            f"{100 * row['middle']:.2f}",
            f"{row['momentum']:.0e}",
            f"{row['energy']:.3f}",
            f"{row['most']:.3f}",
        )
    Console(width=120).print(table)
    return rows


if __name__ == "__main__":
    main()
