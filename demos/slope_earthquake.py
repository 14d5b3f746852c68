"""A slope in an earthquake
========================

A slope of sensitive clay stands, is shaken, fails and runs out over level ground.

Built in ``mpm_fenicsx.scenes.shaken_slope``.  The weight is applied first, between rollers; then
dashpots bear what these bore, the earthquake comes up through the rock below, and a free field on
each side, of its own height and state at rest, says what the ground does there.  The clay loses
most of its strength as it yields; the same slope of clay that keeps it stands beside, and Newmark's
sliding block.  Nothing may move before the earthquake does, and energy has to balance.  Units: m,
s, kg, Pa.

Run it by::

    python demos/slope_earthquake.py             two or three minutes
    python demos/slope_earthquake.py --quick     in a smaller box and longer steps
    python demos/slope_earthquake.py --animate   writes results/slope_earthquake.gif, too
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

try:
    import matplotlib
    from rich.console import Console
except ImportError as error:
    raise ImportError(
        f"{error}: demos take matplotlib and rich, pip install 'mpm_fenicsx[demo]'"
    ) from error

from mpm_fenicsx import Energy, Newton, Probe, Solver
from mpm_fenicsx.scenes.shaken_slope import START, ShakenSlope, sliding_block

RESULTS = Path(__file__).parents[1] / "results"


class Film:
    """Recorder of places and plastic strains of all points, about so many seconds apart, and of the
    largest speed before the earthquake begins."""

    def __init__(self, every: float):
        self.every, self.frames, self.before = every, [], 0.0

    def attach(self, run) -> None:
        """The state at rest."""
        self(run)

    def __call__(self, run) -> None:
        """Look at the step."""
        if run.time < START:
            speeds = [np.abs(body.velocity).max() for body in run.bodies]
            self.before = max(self.before, *speeds)
        if run.time >= len(self.frames) * self.every - 1e-9:
            x = np.concatenate([body.x for body in run.bodies])
            strain = np.concatenate([body.history[:, 0] for body in run.bodies])
            self.frames.append((run.time, x.copy(), strain.copy()))


def shake(slope: ShakenSlope, end: float, every: float, dt: float | None) -> dict:
    """What a slope does until the end (s), in steps of dt (s)."""
    run = slope.start(dt, solver=Solver(newton=Newton(1e-4)))
    near = 0.25 * slope.cell
    at = {
        "crest": ("displacement", (slope.behind - near, slope.crest - near)),
        "toe": ("displacement", (slope.toe + near, slope.foreland - near)),
        "far": ("displacement", (near, slope.crest - near)),
        "level": ("velocity", (near, 0.5 * (slope.crest + slope.foreland))),
    }
    seen = {name: run.record(Probe(*what)) for name, what in at.items()}
    energy, film = run.record(Energy()), run.record(Film(every))
    while run.time < end - 1e-9:
        run.step()
    return {"slope": slope, "run": run, "energy": energy, "film": film, **seen}


def relative(seen: dict, name: str) -> np.ndarray:
    """Displacement (steps, 2), m, of a place less that of the level ground far behind."""
    return np.array(seen[name].values) - np.array(seen["far"].values)


def newmark(seen: dict) -> tuple[float, np.ndarray]:
    """Yield acceleration (m/s²) of the slope at its first strength, and how far the block slides
    (steps,), m, on what the level ground does half-way up the slope."""
    slope, times = seen["slope"], np.array(seen["level"].times)
    least = slope.yield_acceleration(slope.strength)
    a = np.gradient(np.array(seen["level"].values)[:, 0], times)
    return least, sliding_block(a, times[1] - times[0], least)


def draw(axis, slope: ShakenSlope, frame) -> object:
    """Points, coloured by plastic strain, and the slope as it was."""
    time, x, strain = frame
    edge = [[0.0, slope.crest], [slope.behind, slope.crest], [slope.toe, slope.foreland]]
    edge = np.array([*edge, [slope.width, slope.foreland]])
    dots = axis.scatter(
        *x.T, 9 * slope.cell, c=strain, cmap="cividis", vmin=0.0, vmax=1.0, marker="s", lw=0
    )
    axis.plot(*edge.T, color="0.2", lw=0.8, ls="--")
    axis.set(title=f"t = {time:.1f} s", ylabel="y (m)", aspect="equal")
    axis.set(xlim=(0.0, slope.width), ylim=(0.0, 1.1 * slope.crest))
    return dots


def figure(fails: dict, keeps: dict, path: Path) -> None:
    """The earthquake, displacements over time, and the slope before, in and after it."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    slope, film = fails["slope"], fails["film"]
    fig, axes = plt.subplots(5, 1, figsize=(8.0, 11.5), layout="constrained")
    t = np.array(fails["crest"].times)
    axes[0].plot(t, slope.motion(t), color="0.25", lw=1.2)
    axes[0].set(ylabel="up-going wave (m/s²)", xlabel="time (s)", xlim=(0.0, t[-1]))
    for name, colour in (("crest", "#0072B2"), ("toe", "#D55E00")):
        for seen, line, clay in ((fails, "-", "sensitive"), (keeps, "--", "keeps its strength")):
            moved = np.linalg.norm(relative(seen, name), axis=1)
            axes[1].semilogy(
                t, np.maximum(moved, 1e-5), line, color=colour, label=f"{name}, {clay}"
            )
    block = newmark(keeps)[1]
    axes[1].semilogy(t, np.maximum(block, 1e-5), color="0.25", lw=2.0, alpha=0.6, label="Newmark")
    axes[1].set(xlabel="time (s)", ylabel="displacement (m)", xlim=(0.0, t[-1]))
    axes[1].set_title("relative to the level ground behind")
    axes[1].legend(loc="upper left", fontsize=8)
    for axis in axes[:2]:
        axis.grid(alpha=0.3)
    share = np.linspace(0.0, len(film.frames) - 1, 4).round().astype(int)[1:]
    for axis, i in zip(axes[2:], share, strict=True):
        dots = draw(axis, slope, film.frames[i])
    axes[-1].set_xlabel("x (m)")
    fig.colorbar(dots, ax=axes[2:], label="plastic strain (-)", extend="max")
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def animate(seen: dict, path: Path) -> None:
    """The slope over time, as a GIF."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation, PillowWriter

    fig, axis = plt.subplots(figsize=(7.0, 2.6), layout="constrained")
    frames = seen["film"].frames

    def show(i):
        axis.clear()
        draw(axis, seen["slope"], frames[i])
        axis.set_xlabel("x (m)")

    FuncAnimation(fig, show, frames=len(frames)).save(path, PillowWriter(fps=10), dpi=80)
    plt.close(fig)


def main(arguments=None) -> dict:
    """Run both slopes, print what they did, write results/slope_earthquake.json and .png."""
    parser = argparse.ArgumentParser(description="A slope in an earthquake")
    parser.add_argument("--cell", type=float, default=1.0, help="m (default: 1)")
    parser.add_argument("--end", type=float, default=6.6, help="s (default: 6.6)")
    parser.add_argument("--quick", action="store_true", help="a smaller box, until 5.5 s")
    parser.add_argument("--animate", action="store_true", help="write a GIF, too")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen, console = parser.parse_args(arguments), Console()
    cell, end, dt = (1.0, 5.5, 0.036) if chosen.quick else (chosen.cell, chosen.end, None)
    box = {"behind": 8.0, "before": 10.0} if chosen.quick else {}
    slope = ShakenSlope(cell=cell, **box)
    fails = shake(slope, end, 0.1, dt)
    keeps = shake(replace(slope, residual=slope.strength), end, 0.1, dt)
    points, film = fails["run"].bodies[0], fails["film"]
    start = film.frames[0][1][: len(points)]
    least, block = newmark(keeps)
    found = {
        "speed_before": film.before,
        "crest": float(np.linalg.norm(relative(fails, "crest")[-1])),
        "toe": float(np.linalg.norm(relative(fails, "toe")[-1])),
        "crest_that_keeps": float(np.linalg.norm(relative(keeps, "crest")[-1])),
        "yield_acceleration": least,
        "newmark": float(block[-1]),
        "farthest": float((points.x - start)[:, 0].max()),
        "run_out": slope.run_out(points),
        "energy_not_found": float(fails["energy"].lost[-1] / np.abs(fails["energy"]["work"]).max()),
    }
    console.print(f"before the earthquake nothing moves faster than {film.before:.1e} m/s")
    console.print(
        f"after {end:g} s the crest has moved {found['crest']:.2f} m; where the clay keeps its "
        f"strength {found['crest_that_keeps']:.3f} m; Newmark's block, from {least:.2f} m/s² on, "
        f"{found['newmark']:.3f} m"
    )
    console.print(
        f"clay has run out {found['run_out']:.1f} m ({found['run_out'] / cell:.0f} cells) beyond "
        f"the toe; energy not found {100 * found['energy_not_found']:.1f} % of the work"
    )
    chosen.results.mkdir(parents=True, exist_ok=True)
    (chosen.results / "slope_earthquake.json").write_text(json.dumps(found, indent=1) + "\n")
    figure(fails, keeps, chosen.results / "slope_earthquake.png")
    if chosen.animate:
        animate(fails, chosen.results / "slope_earthquake.gif")
    return found


if __name__ == "__main__":
    main()
