"""What generalised α's dissipation does: the column's error and ringing, and disturbances that grow
without it.

- the paper's column (scenes.column, fixed base) under its pulse, and under a small pressure that
  comes suddenly, which no grid follows without ringing: L2 errors, and how much more the pressure
  at mid-height goes up and down than the exact one (its total variation over the exact one's, less
  1);
- a bar under stress that crosses 0.3 cells a step at Courant 5, disturbed by 1 %, and a free block
  of 4 by 3 cells that vibrates at Courant 0.5 (tests/validation/test_crossing.py, test_rigid.py),
  with DM-GC as the paper has it too: what is left after 2,000 and 1,000 steps.

    python studies/dissipation.py            some minutes
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import report
from amplification import PAPERS, across
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpm_fenicsx import DM_G, DM_GC, GIMP, MPM, Energy, GeneralizedAlpha, RunError
from mpm_fenicsx.scenes import column
from mpm_fenicsx.scenes.block import block, h, soil, step_of, stressed_bar

RADII = (1.0, 0.9, 0.8, 0.5)
END = 1.0  # s: the sudden load's wave goes up and down the column six times


def sudden(t, load):
    """The load at once, and for good; half of it at t = 0, between before and after."""
    return load * np.heaviside(t, 0.5)


def measure_column(
    mapping, ρ: float, w: float, load: float, dt: float, pulse: Callable = column.pulse
) -> dict:
    """Errors and ringing on a fixed base; the curve of the sudden load."""
    run = column.material_points(
        "fixed", load, mapping, history=pulse, stepping=GeneralizedAlpha(dt, ρ, w)
    )
    watch = column.Watch(run, "fixed", load, pulse, END)
    run.until(END)
    errors, (found, p) = watch.errors(), watch.pairs()["pressure_mid"]
    row = {
        "error_pressure": errors["error_pressure_mid"],
        "error_displacement": errors["error_displacement_mid"],
        "ringing": np.abs(np.diff(found)).sum() / np.abs(np.diff(p)).sum() - 1,
        "largest": found.max() / p.max(),
    }
    return row | ({"curve": (found[::2] / load).round(4).tolist()} if pulse is sudden else {})


def measure_crossing(mapping, ρ: float, steps: int = 2000) -> dict:
    """Largest relative error of the uniform stress in the last 500 steps."""
    stress, stepping = 100e3, GeneralizedAlpha(step_of(5.0).dt, ρ)
    run = stressed_bar(mapping, stepping, stress, steps, disturbed=0.01)
    (body,), error = run.bodies, []
    try:
        for _ in range(steps):
            run.step()
            error.append(np.abs(body.stress[:, 0] / stress + 1).max())
    except RunError:
        error.append(np.inf)
    return {"error_of_stress": float(max(error[-500:])), "steps": run.steps}


def measure_block(mapping, ρ: float, steps: int = 1000) -> dict:
    """Largest energy over that at the start, and that at the end, of a vibration along the longer
    side."""
    run = block(mapping, GeneralizedAlpha(step_of(0.5).dt, ρ))
    if mapping == PAPERS:
        across(run)
    (body,) = run.bodies
    body.velocity[:, 0] = 1e-5 * soil.p_speed * np.cos(np.pi * body.x[:, 0] / (4 * h))
    energy = run.record(Energy())
    for _ in range(steps):
        run.step()
    return {
        "largest_energy": float(energy.left.max() / energy.left[0]),
        "energy_left": float(energy.left[-1] / energy.left[0]),
    }


def cases() -> Iterator[tuple[dict, Callable[[], dict]]]:
    """What is run: a row's labels, and how to get the rest of it."""
    for mapping in (MPM, DM_GC):
        for ρ, w in (*((ρ, 0.0) for ρ in RADII), (1.0, 1.0), (0.8, 0.8)):
            labels = {"mapping": str(mapping), "radius": ρ, "start": w}
            for load in (column.peak, column.small):
                yield (
                    {"case": f"pulse of {load / 1e3:g} kPa, Δt = 1 ms", **labels},
                    lambda m=mapping, ρ=ρ, w=w, load=load: measure_column(m, ρ, w, load, column.dt),
                )
            for dt in (column.dt, 4 * column.dt):
                yield (
                    {"case": f"sudden 0.3 kPa, Δt = {1e3 * dt:g} ms", **labels, "dt": dt},
                    lambda m=mapping, ρ=ρ, w=w, dt=dt: measure_column(
                        m, ρ, w, column.small, dt, sudden
                    ),
                )
    for ρ in RADII:
        for mapping in (GIMP, DM_G, DM_GC):
            labels = {"mapping": str(mapping), "radius": ρ, "start": 0.0}
            yield (
                {"case": "bar crossing cells, Courant 5", **labels},
                lambda m=mapping, ρ=ρ: measure_crossing(m, ρ),
            )
            yield (
                {"case": "free block, Courant 0.5", **labels},
                lambda m=mapping, ρ=ρ: measure_block(m, ρ),
            )
        labels = {"mapping": "DM-GC, the paper's", "radius": ρ, "start": 0.0}
        yield {"case": "free block, Courant 0.5", **labels}, lambda ρ=ρ: measure_block(PAPERS, ρ)


def figure(rows: list[dict], path: Path) -> None:
    """Pressure at mid-height under the sudden load, over time."""
    colours = {1.0: "#000000", 0.9: "#56B4E9", 0.8: "#0072B2", 0.5: "#D55E00"}
    fig, axes = report.subplots(2, 2, figsize=(11, 6.5), sharex=True, sharey=True)
    for axis, (name, dt) in zip(
        axes.flat, [(n, k * column.dt) for n in ("MPM", "DM-GC") for k in (1, 4)], strict=True
    ):
        t = np.linspace(0.0, END, 4001)
        known = column.answer("fixed", 1.0, sudden, END)
        axis.plot(t, known.pressure(column.height / 2, t), color="0.75", lw=3.5, label="exact")
        for row in rows:
            if (row["mapping"], row.get("dt"), row["start"]) == (name, dt, 0.0) and row[
                "radius"
            ] in (1.0, 0.8, 0.5):
                curve = row["curve"]
                axis.plot(
                    2 * dt * np.arange(len(curve)),
                    curve,
                    color=colours[row["radius"]],
                    lw=0.9,
                    label=f"ρ = {row['radius']:g}",
                )
        axis.set_title(
            f"{name}, Δt = {1e3 * dt:g} ms (Courant {column.soil.p_speed * dt / 0.25:.1f})",
            fontsize=10,
        )
        axis.set(xlim=(0, END), ylim=(-0.6, 2.6))
        axis.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=8, ncols=4, loc="upper center")
    for axis in axes[1]:
        axis.set_xlabel("time (s)")
    for axis in axes[:, 0]:
        axis.set_ylabel("pressure at mid-height / load (-)")
    fig.suptitle(
        "Column of 20 m on a fixed base, h = 0.25 m, under 0.3 kPa that comes at once: generalised "
        "α, w = 0"
    )
    report.save(fig, path)


def table(rows: list[dict]) -> Table:
    """All figures but the curves."""
    found = Table("case", "mapping", "ρ", "w", "what was found")
    for row in sorted(
        rows, key=lambda row: (row["case"], row["mapping"], row["start"], -row["radius"])
    ):
        rest = {
            k: v
            for k, v in row.items()
            if k not in ("case", "mapping", "radius", "start", "curve", "dt")
        }
        found.add_row(
            row["case"],
            row["mapping"],
            f"{row['radius']:g}",
            f"{row['start']:g}",
            ", ".join(f"{k} {v:.4g}" for k, v in rest.items()),
        )
    return found


def main(arguments=None) -> list[dict]:
    """Run all cases, print the table, write results/dissipation.json and .png."""
    chosen = report.chosen(report.parser(__doc__), arguments)
    rows = []
    for labels, measure in track(list(cases()), "runs"):
        found = measure()
        rows.append(
            labels | {k: float(f"{v:.4g}") if isinstance(v, float) else v for k, v in found.items()}
        )
    report.write(chosen.results / "dissipation.json", rows)
    figure(rows, chosen.results / "dissipation.png")
    Console(width=150).print(table(rows))
    return rows


if __name__ == "__main__":
    main()
