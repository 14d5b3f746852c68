"""A cavity that is blown up, and a tunnel that gives way
======================================================

The stress around a cylindrical cavity in Mohr-Coulomb soil, as its pressure rises and as it falls,
against the exact answer.

A quarter of it is computed on a grid of squares that the wall cuts, and by finite elements on a
mesh in polar coordinates; built in ``mpm_fenicsx.scenes.cavity``.  φ = ψ = 20°, c = 10 kPa, at rest
under 100 kPa from all sides; the pressure rises to 400 kPa, or falls to 20 kPa.  Soil flows out to
the radius R, and the wall moves; the far edges bear what unbounded soil bears there.  Where soil
flows the stress of single points scatters around the answer, most in the cells that the wall cuts;
the displacement and the stress outside do not show it.
Units: m, s, kg, Pa.

Run it by::

    python demos/cavity.py             some ten seconds
    python demos/cavity.py --cells 20  twice as fine
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

from mpm_fenicsx.scenes.cavity import Cavity

RESULTS = Path(__file__).parents[1] / "results"
SCENES = {
    "expansion": Cavity(400e3, 20.0, 20.0),
    "contraction": Cavity(20e3, 20.0, 20.0),
}
METHODS = {"FE": Cavity.finite_elements, "DM-GC": Cavity.material_points}
LOOKS = {"radial": "#0072B2", "hoop": "#D55E00"}


def figure(found, scenes, path):
    """Radial and hoop stress against the distance, one picture a scene."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(1, 2, figsize=(9.5, 3.9), layout="constrained")
    for (name, scene), axis in zip(scenes.items(), axes, strict=True):
        exact, end = scene.exact(), 1.5 * scene.exact().plastic_radius
        r = np.linspace(1.0, end, 400)
        for stress, colour, known in zip(LOOKS, LOOKS.values(), exact.stress(r), strict=False):
            at = 1 + list(LOOKS).index(stress)
            axis.plot(r, known / 1e3, color=colour, lw=1.2, label=f"{stress}, exact")
            for method, marker, size in (("FE", "o", 9), ("DM-GC", ".", 3)):
                rows = found[name, method]
                some = np.flatnonzero(rows[0] < end)
                some = some[:: max(1, len(some) // 400)]
                face = "none" if marker == "o" else colour
                axis.scatter(
                    rows[0][some],
                    rows[at][some] / 1e3,
                    size,
                    marker=marker,
                    facecolors=face,
                    edgecolors=colour,
                    linewidths=0.4,
                    label=f"{stress}, {method}",
                )
        axis.axvline(exact.plastic_radius, color="0.5", lw=0.8, ls=":")
        axis.set(
            xlabel="distance from the centre (m)", title=f"{name} to {scene.pressure / 1e3:g} kPa"
        )
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("pressure (kPa)")
    axes[0].legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def main(arguments=None) -> list[dict]:
    """Run the scenes, print a line each, write results/cavity.json and .png."""
    parser = argparse.ArgumentParser(description="A cavity in Mohr-Coulomb soil")
    parser.add_argument("--cells", type=int, default=10, help="a radius (default: 10)")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen, console = parser.parse_args(arguments), Console()
    scenes = {name: replace(scene, cells=chosen.cells) for name, scene in SCENES.items()}
    rows, found = [], {}
    for name, scene in scenes.items():
        for method, make in METHODS.items():
            run = make(scene)
            run.until(1.0)
            found[name, method] = scene.stresses(run)
            rows.append({"scene": name, "method": method, **scene.errors(run)})
            wall, radius = (100 * rows[-1][what] for what in ("displacement", "plastic_radius"))
            console.print(
                f"{name:12} {method:6} wall {wall:+.2f} %, plastic radius {radius:+.2f} %"
            )
    chosen.results.mkdir(parents=True, exist_ok=True)
    (chosen.results / "cavity.json").write_text(json.dumps(rows, indent=1) + "\n")
    figure(found, scenes, chosen.results / "cavity.png")
    return rows


if __name__ == "__main__":
    main()
