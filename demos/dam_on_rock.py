"""A dam on rock
=============

An earthquake comes up obliquely through rock and shakes a concrete dam, which sends waves out.

The rock is a half-space, of which a box is modelled: it takes the SV wave in at its base and its
sides, through an absorbing layer or through dashpots, and lets out what differs from it.  Without
the dam the exact answer is known, and the surface has to move by it; with the dam the box is
compared with one three times as large.  Built in ``mpm_fenicsx.scenes.dam_on_rock``: the dam is of
material points cut along its faces, the rock an elastic far field.  Units: m, s, kg, Pa.

Run it by::

    python demos/dam_on_rock.py            some minutes
    python demos/dam_on_rock.py --quick    on cells of 5 m
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
    from rich.table import Table
except ImportError as error:
    raise ImportError(
        f"{error}: demos take matplotlib and rich, pip install 'mpm_fenicsx[demo]'"
    ) from error

from mpm_fenicsx.scenes.dam_on_rock import DamOnRock, Watch

RESULTS = Path(__file__).parents[1] / "results"
LOOKS = {  # colour, line and width
    "larger box": ("0.25", "-", 2.6),
    "layer": ("#0072B2", "--", 1.5),
    "dashpots": ("#D55E00", "-", 1.0),
}


def watched(run, scene: DamOnRock) -> Watch:
    """What a run does until the end."""
    watch = run.record(Watch(scene))
    run.until(scene.end)
    return watch


def relative(found: np.ndarray, known: np.ndarray) -> float:
    """L2 error of one history relative to another."""
    return float(np.linalg.norm(found - known) / np.linalg.norm(known))


def exact_surface(scene: DamOnRock, watch: Watch) -> np.ndarray:
    """Velocity of the surface without the dam (steps, places, 2), m/s."""
    waves, x = scene.exact(), np.stack([watch.x, np.zeros(len(watch.x))], axis=1)
    return np.array([waves.velocity(t, x) for t in watch.times])


def figure(scene, alone, exact, found, path):
    """The surface without the dam, the crest, and peaks along the surface."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(3, 1, figsize=(7.5, 9.0), layout="constrained")
    watch = alone["layer"]
    place = int(np.argmin(np.abs(watch.x - 0.75 * scene.half)))
    for i in range(2):
        axes[0].plot(watch.times, exact[:, place, i], color="0.25", lw=2.6, alpha=0.6)
        for kind, one in alone.items():
            colour, line, width = LOOKS[kind]
            axes[0].plot(one.times, one.surface[:, place, i], color=colour, ls=line, lw=width)
    handles = [plt.Line2D([], [], color="0.25", lw=2.6, alpha=0.6, label="exact")]
    handles += [
        plt.Line2D([], [], color=LOOKS[kind][0], ls=LOOKS[kind][1], label=kind) for kind in alone
    ]
    axes[0].legend(handles=handles, loc="upper left")
    axes[0].set_title(
        f"without the dam, surface at x = {watch.x[place]:g} m: horizontal, and smaller, vertical"
    )
    for kind, one in found.items():
        colour, line, width = LOOKS[kind]
        look = {"color": colour, "ls": line, "lw": width, "label": kind}
        axes[1].plot(one.times, one.crest[:, 0], **look)
        peaks = np.abs(one.surface[:, :, 0]).max(axis=0) / scene.peak
        right = int((one.x < 0.0).sum())
        axes[2].plot(np.insert(one.x, right, 0.0), np.insert(peaks, right, np.nan), ".", **look)
    axes[1].set_title("crest of the dam, horizontal")
    axes[1].legend(loc="upper right")
    known = abs(scene.amplification[0])
    axes[2].axhline(known, color="#009E73", lw=1.2, label="exact without the dam")
    axes[2].set(
        ylim=(1.2, 2.3),
        title="largest horizontal velocity of the surface beside the dam",
        xlabel="x (m)",
        ylabel="over that of the wave (-)",
    )
    axes[2].legend(loc="upper center", ncols=2)
    for axis in axes[:2]:
        axis.set(xlabel="time (s)", ylabel="velocity (m/s)", xlim=(0.15, scene.end))
    for axis in axes:
        axis.grid(alpha=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def main(arguments=None) -> dict:
    """Run the scenes, print the table, write results/dam_on_rock.json and .png."""
    parser = argparse.ArgumentParser(description="A dam on rock")
    parser.add_argument("--angle", type=float, default=15.0, help="from the vertical (default: 15)")
    parser.add_argument("--quick", action="store_true", help="on cells of 5 m instead of 2.5")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen, console = parser.parse_args(arguments), Console()
    large = 2.0 if chosen.quick else 3.0
    layer = DamOnRock("layer", angle=chosen.angle, cell=5.0 if chosen.quick else 2.5)
    scenes = {"layer": layer, "dashpots": replace(layer, boundary="viscous")}
    alone = {kind: watched(scene.rock_alone(), scene) for kind, scene in scenes.items()}
    scenes = {"larger box": replace(layer, half=large * layer.half), **scenes}
    found = {kind: watched(scene.simulation(), scene) for kind, scene in scenes.items()}
    exact = exact_surface(layer, alone["layer"])
    known = found["larger box"]
    rows = {
        kind: {
            "surface_without_dam": relative(alone[kind].surface, exact),
            "crest": relative(found[kind].crest, known.crest),
            "heel": relative(found[kind].heel, known.heel),
        }
        for kind in alone
    }
    table = Table(title=f"Differences (L2 over time), SV wave at {chosen.angle:g}°")
    for heading in ("boundary", "surface without dam, of exact", "crest", "heel, of larger box"):
        table.add_column(heading)
    for kind, row in rows.items():
        table.add_row(kind, *(f"{100 * value:.1f} %" for value in row.values()))
    console.print(table)
    peaks = [float(np.abs(values[:, 0]).max() / layer.peak) for values in (known.crest, known.heel)]
    console.print(f"crest moves {peaks[0]:.2f}, heel {peaks[1]:.2f} times as fast as the wave")
    result = {"angle": chosen.angle, "rows": rows, "crest_peak": peaks[0], "heel_peak": peaks[1]}
    chosen.results.mkdir(parents=True, exist_ok=True)
    (chosen.results / "dam_on_rock.json").write_text(json.dumps(result, indent=1) + "\n")
    figure(layer, alone, exact, found, chosen.results / "dam_on_rock.png")
    return result


if __name__ == "__main__":
    main()
