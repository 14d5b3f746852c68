"""Why stress converges at less than second order where points cross cells, shown by taking each cause away.

1. The internal force takes stress as constant over a support domain.  Where a grid line cuts the domain, its parts pull
   with the stress of the whole instead of their own: dipoles that move with the points and do not cancel where domains
   differ or the body ends, so that the stress is off by O(h).  Taken away: stress linear over the domain, its gradient
   from the means of the nodes around (exact for linear fields); parts of a cut domain pull with that of their centres.
2. Double-mapped mass sits too near the middle of a cell that is partly filled: the centroid of N_i/m_i is not where the
   points are.  Taken away: mass summed at the points, moduli double-mapped as before.

On the bars of ``manufactured`` at Courant number 0.5, in 2D; prototypes that reach into the simulation.  Writes
results/manufactured_causes.json.

    python studies/manufactured_causes.py
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import manufactured
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpm_fenicsx import DM_GC, GIMP, Simulation, tensors
from mpm_fenicsx.kernels import digits, jit
from mpm_fenicsx.projection import AT_POINTS, DOUBLE_MAPPED, Projection

RESULTS = Path(__file__).parents[1] / "results"


class LinearStress(Simulation):
    """Internal force of stress that is linear over each support domain."""

    def _internal_force(self) -> np.ndarray:
        self._internal[:] = 0.0
        lat = self.grid.lattice
        for body, stencil in zip(self.bodies, self.stencils, strict=True):
            slope = gradient(stencil, body.volume, body.x, body.stress, self.grid.nodes)
            pull(stencil.side, stencil.span, stencil.share, stencil.cell, lat.lower, lat.upper, lat.neighbour,
                 lat.nodes, body.x, body.volume, tensors.matrix(body.stress, 2),
                 np.stack([tensors.matrix(slope[..., d], 2) for d in range(2)], -1), self._internal)
        return self._internal.ravel()


class PointMass(Simulation):
    """Mass at the points, moduli double-mapped: for a mapping that integrates at the points."""

    def project(self) -> None:
        """Put the double-mapped moduli, bilinear in each cell, in place of those of the points."""
        super().project()
        mapped = Projection(self.grid, DOUBLE_MAPPED, 2)
        for body, stencil in zip(self.bodies, self.stencils, strict=True):
            mapped.add(stencil, body.volume[:, None] * np.array(body.material.lame))
        mapped.finish()
        corner, node = digits(2, 2), digits(3, 2)[:, None] / 2.0
        bilinear = np.where(corner, node, 1.0 - node).prod(axis=2)
        for field, moduli in zip(self.projection.fields[1:], mapped.fields, strict=True):
            field.x.array[self.projection.dofs] = moduli.x.array[mapped.dofs] @ bilinear.T


class Both(LinearStress, PointMass):
    """Neither cause."""


WAYS = {"as it is": Simulation, "linear stress": LinearStress, "point mass": PointMass, "both": Both}


def gradient(stencil, volume: np.ndarray, x: np.ndarray, stress: np.ndarray, nodes: int) -> np.ndarray:
    """Gradients (n, components, 2) of stress rows at the points, exact for a linear field.

    Nodes carry the means of stress and of place of the points around, σ̄_i and x̄_i: G Σ x̄_i ⊗ ∇S_i = Σ σ̄_i ⊗ ∇S_i.
    Zero where all points around lie in one line.
    """
    sums = np.zeros((nodes, 1 + stress.shape[1] + 2))
    stencil.deposit(volume[:, None] * np.hstack((np.ones((len(x), 1)), stress, x)), sums)
    mean = sums[:, 1:] / np.where(sums[:, :1] > 0.0, sums[:, :1], 1.0)
    found = np.einsum("nka,nkd->nad", mean[stencil.nodes], stencil.gradients)
    spread = found[:, -2:]
    known = np.linalg.det(spread) > 0.05
    slope = np.zeros_like(found[:, :-2])
    slope[known] = found[known, :-2] @ np.linalg.inv(spread[known])
    return slope


@jit
def pull(side, span, share, cell, lower, upper, neighbour, nodes, x, volume, stress, slope, out):
    """Add Σ_p Σ_k V_k (σ_p + G_p (x_k − x_p)) ∇N_i(x_k) over the parts k of cut support domains, x_k their centres."""
    for p in range(len(x)):
        for part in range(4):
            c, weight = cell[p], volume[p]
            for d in range(2):
                s = (part >> d) & 1
                weight *= share[p, d, s]
                if s == 1 and weight > 0.0:
                    c = neighbour[c, d, (side[p, d] + 1) // 2]
            if weight == 0.0:
                continue
            place, h, away = np.empty(2), np.empty(2), np.empty(2)
            for d in range(2):
                s = (part >> d) & 1
                place[d], h[d] = 0.5 * (span[p, d, s, 0] + span[p, d, s, 1]), upper[c, d] - lower[c, d]
                away[d] = lower[c, d] + place[d] * h[d] - x[p, d]
            for corner in range(4):
                i, j = corner & 1, corner >> 1
                across = place[0] if i else 1.0 - place[0], place[1] if j else 1.0 - place[1]
                g = (2 * i - 1) / h[0] * across[1], (2 * j - 1) / h[1] * across[0]
                for e in range(2):
                    for d in range(2):
                        σ = stress[p, e, d] + slope[p, e, d, 0] * away[0] + slope[p, e, d, 1] * away[1]
                        out[nodes[c, corner], e] += weight * σ * g[d]


def measure(scene: str, mapping, way: str, cells: int) -> dict:
    """Errors of a bar with one of the ways."""
    bar, kind = manufactured.BARS[scene], WAYS[way]
    used = replace(mapping, integrate=AT_POINTS) if issubclass(kind, PointMass) else mapping
    run = manufactured.points(bar, used, manufactured.length / cells, bar.period / (4 * cells), 4, scene == "random",
                              kind)
    watch = manufactured.Watch(run, bar)
    for _ in range(4 * cells):
        run.step()
        watch()
    return {"scene": scene, "mapping": mapping.name, "way": way, "cells": cells, **watch.errors()}


def main(arguments=None) -> list[dict]:
    """Run all ways, print the table, write results/manufactured_causes.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=(20, 40, 80), help="cells along the bar")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen = parser.parse_args(arguments)
    chosen.results.mkdir(parents=True, exist_ok=True)
    simple = [(mapping, way) for mapping in (GIMP, DM_GC) for way in ("as it is", "linear stress")]
    every = [*simple, (DM_GC, "point mass"), (DM_GC, "both")]
    ways = [(scene, *way) for scene in ("moving", "random") for way in every]
    ways += [("large", *way) for way in simple]  # its ends are held: no cell is partly filled
    rows = [measure(*way, cells) for way, cells in track([(way, n) for way in ways for n in chosen.cells], "bars")]
    shown = Table(title="Errors on the finest grid (%), and orders from the one before", box=None, padding=(0, 2, 0, 0))
    for name in ("bar", "mapping", "way", "displacement", "velocity", "stress"):
        shown.add_column(name)
    for first in range(0, len(rows), len(chosen.cells)):
        *_, before, last = rows[first : first + len(chosen.cells)]
        refined = np.log(last["cells"] / before["cells"])
        shown.add_row(last["scene"], last["mapping"], last["way"], *(
            f"{100 * last[name]:7.3f} {np.log(before[name] / last[name]) / refined:5.2f}"
            for name in ("error_displacement", "error_velocity", "error_stress")))
    (chosen.results / "manufactured_causes.json").write_text(json.dumps(rows, indent=1) + "\n")
    Console(width=120).print(shown)
    return rows


if __name__ == "__main__":
    main()
