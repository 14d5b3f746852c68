"""What a strip bears
==================

The load of a smooth rigid strip on soil with friction, against the bearing capacities of Prandtl
and Reissner.

Half of a strip of 2 m is pushed into weightless Mohr-Coulomb soil, φ = ψ = 20°, by finite elements
and by material points; built in ``mpm_fenicsx.scenes.strip``.  With cohesion alone it bears c N_c,
N_c = 14.83; beside a surcharge p, without cohesion, p N_q, N_q = 6.40.  Where flow is associated
these are exact.  B-bar is chosen for such soil by itself; the load still ends above the answer, by
what the cells at the strip's edge cannot follow, and creeps up by a few tenths of a per cent.
Units: m, s, kg, Pa.

Run it by::

    python demos/strip_load.py              about half a minute
    python demos/strip_load.py --cell 0.05  finer at the edge of the strip
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

from mpm_fenicsx.scenes.strip import Strip, cohesive_strip, surcharged_strip

RESULTS = Path(__file__).parents[1] / "results"
SCENES = {"cohesion": cohesive_strip, "surcharge": surcharged_strip}
METHODS = {"FE": Strip.finite_elements, "DM-GC": Strip.material_points}
LOOKS = {"FE": ("#E69F00", "-", 2.6), "DM-GC": ("#0072B2", (0, (4, 2)), 1.6)}


def press(strip, make) -> tuple[np.ndarray, np.ndarray]:
    """Settlement (m) and load over the capacity, step by step."""
    run, load = make(strip), [0.0]
    start = strip.load(run) / strip.capacity
    while run.steps < strip.steps:
        run.step()
        load.append(strip.load(run) / strip.capacity)
    load[0] = start
    return strip.settlement * (np.arange(len(load)) / strip.steps) ** 2, np.array(load)


def figure(curves, strips, path):
    """Load against settlement, one picture a scene."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(1, 2, figsize=(9.0, 3.8), sharey=True, layout="constrained")
    for (name, strip), axis in zip(strips.items(), axes, strict=True):
        for method, (colour, line, width) in LOOKS.items():
            settled, load = curves[name, method]
            axis.plot(1e3 * settled, load, color=colour, ls=line, lw=width, label=method)
        axis.axhline(1.0, color="0.3", lw=1.0, label="exact")
        axis.set(xlabel="settlement (mm)", title=f"{name}: {strip.capacity / 1e3:.1f} kPa exact")
        axis.grid(alpha=0.3)
    axes[0].set(ylabel="load over the exact capacity (-)", ylim=(0.0, 1.15))
    axes[0].legend(loc="lower right")
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def main(arguments=None) -> list[dict]:
    """Run the scenes, print a line each, write results/strip_load.json and .png."""
    parser = argparse.ArgumentParser(description="What a strip bears")
    parser.add_argument("--cell", type=float, default=0.1, help="at the strip's edge, m")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen, console = parser.parse_args(arguments), Console()
    strips = {name: make(20.0, 20.0, cell=chosen.cell) for name, make in SCENES.items()}
    rows, curves = [], {}
    for name, strip in strips.items():
        for method, make in METHODS.items():
            curves[name, method] = press(strip, make)
            error = float(curves[name, method][1][-1] - 1.0)
            rows.append({"scene": name, "method": method, "cell_m": strip.cell, "error": error})
            console.print(f"{name:10} {method:6} {100 * error:+.2f} % at the end")
    chosen.results.mkdir(parents=True, exist_ok=True)
    (chosen.results / "strip_load.json").write_text(json.dumps(rows, indent=1) + "\n")
    figure(curves, strips, chosen.results / "strip_load.png")
    return rows


if __name__ == "__main__":
    main()
