"""A slope that fails
==================

How much less strength a slope of 1:2 would stand, by strength reduction, and where it runs to when
it has half of it.

The first example of Griffiths and Lane (1999), 10 m high; built in
``mpm_fenicsx.scenes.failing_slope``.  The weight is applied in static runs with c/F and tan φ/F.
The movement grows slowly up to F = 1.4 and tenfold beyond, where no equilibrium is near the slope
as it was: the factor of safety is that of the paper, 1.4.  Then strength drops to half, and the
slope slides at finite strain.  No answer is known for that; its energy has to balance.  Units: m,
s, kg, Pa.

Run it by::

    python demos/slope_failure.py          a minute or two
    python demos/slope_failure.py --end 6  until it has nearly come to rest
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

try:
    import matplotlib
    from rich.console import Console
except ImportError as error:
    raise ImportError(
        f"{error}: demos take matplotlib and rich, pip install 'mpm_fenicsx[demo]'"
    ) from error

from mpm_fenicsx import Energy, Newton, Solver
from mpm_fenicsx.scenes.failing_slope import FACTOR, FailingSlope

RESULTS = Path(__file__).parents[1] / "results"
FACTORS = (1.0, 1.2, 1.3, 1.35, 1.4, 1.45)
HALF = 2.0  # the factor of the run-out


def figure(movement, slides, slope, path):
    """Movement against the factor, and the slope while it slides."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(
        1 + len(slides), 1, figsize=(8.0, 2.6 + 2.0 * len(slides)), layout="constrained"
    )
    axes[0].semilogy(FACTORS, movement, "o-", color="#0072B2", lw=1.4, label="DM-GC")
    axes[0].axvline(FACTOR, color="0.3", lw=1.0, label="Griffiths and Lane: fails")
    axes[0].set(xlabel="strength reduced by F (-)", ylabel="movement E d/γH² (-)")
    axes[0].grid(alpha=0.3, which="both")
    axes[0].legend(loc="upper left")
    edge = np.array([[0.0, slope.height], [0.375 * slope.toe, slope.height], [slope.toe, 0.0]])
    for axis, (time, x, strain) in zip(axes[1:], slides, strict=True):
        dots = axis.scatter(*x.T, 5, c=strain, cmap="cividis", vmin=0.0, vmax=1.0)
        axis.plot(*edge.T, color="0.3", lw=0.8, ls="--")
        axis.set(title=f"half the strength, t = {time:g} s", ylabel="y (m)", aspect="equal")
        axis.set(xlim=(0.0, 1.4 * slope.toe), ylim=(0.0, 1.15 * slope.height))
    axes[-1].set_xlabel("x (m)")
    fig.colorbar(dots, ax=axes[1:], label="plastic strain (-)", extend="max")
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def main(arguments=None) -> dict:
    """Run both parts, print what they found, write results/slope_failure.json and .png."""
    parser = argparse.ArgumentParser(description="A slope that fails")
    parser.add_argument("--cell", type=float, default=1.0, help="m (default: 1)")
    parser.add_argument("--end", type=float, default=4.0, help="of the slide, s (default: 4)")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen, console = parser.parse_args(arguments), Console()
    slope = FailingSlope(cell=chosen.cell)
    movement = [slope.movement(factor) for factor in FACTORS]
    for factor, moved in zip(FACTORS, movement, strict=True):
        console.print(f"strength / {factor:<5g} E d/γH² = {moved:.3f}")
    run = slope.collapse(HALF, dt=0.02 * chosen.cell, solver=Solver(newton=Newton(1e-4)))
    (points,), energy, slides = run.bodies, run.record(Energy()), []
    for time in (0.5 * chosen.end, chosen.end):
        run.until(time)
        slides.append((time, points.x.copy(), points.history[:, 0].copy()))
    found = {
        "factors": FACTORS,
        "movement": movement,
        "end_s": chosen.end,
        "run_out_m": slope.run_out(points),
        "energy_not_found": float(energy.lost[-1] / energy["work"][-1]),
        "kinetic": float(energy["kinetic"][-1] / energy["work"][-1]),
    }
    console.print(
        f"after {chosen.end:g} s {found['run_out_m']:.1f} m beyond the toe; energy not found "
        f"{100 * found['energy_not_found']:.1f} % of the work"
    )
    chosen.results.mkdir(parents=True, exist_ok=True)
    (chosen.results / "slope_failure.json").write_text(json.dumps(found, indent=1) + "\n")
    figure(movement, slides, slope, chosen.results / "slope_failure.png")
    return found


if __name__ == "__main__":
    main()
