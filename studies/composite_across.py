"""Composite strain across a direction: linear between rows of nodes, or polynomials there too (a
tensor product).

The derivative along a direction comes from the polynomial through the patch's nodes on it.  Between
the rows of nodes it can be interpolated linearly, as the package does, or by the patch's
polynomials of the other directions.  Measured:

    accuracy   standing waves of shear and of pressure in a square between smooth walls, exact
               answer known: errors (relative L2 over a period) of displacement and stress
    stability  a free block set off in its lowest mode: energy after 1,000 steps over that at the
               start

Writes results/composite_across.json.

    python studies/composite_across.py
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import report
from rich.console import Console
from rich.progress import track
from rich.table import Table

import mpm_fenicsx as mpm
from mpm_fenicsx.mapping.composite_patches import Composite

soil = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)


class TensorProduct(Composite):
    """Polynomials in every direction; for bodies whose filled cells make a rectangle, so that
    patches are whole."""

    def gradient_at_points(self, x: np.ndarray, cell: np.ndarray, nodal: np.ndarray) -> np.ndarray:
        """Gradients (n, dim, dim) at points x (n, dim) in cells (n,) of nodal vectors (nodes,
        dim)."""
        lat, dim = self.grid.lattice, self.grid.dim
        h = (lat.upper - lat.lower)[cell]
        t, order = (x - lat.lower[cell]) / h, np.arange(4)
        power = self.power[cell]
        line = np.einsum("ndik,ndk->ndi", power, t[..., None] ** order)
        slope = (
            np.einsum("ndik,ndk->ndi", power, order * t[..., None] ** np.maximum(order - 1, 0))
            / h[..., None]
        )
        table = np.indices([4] * dim).reshape(dim, -1).T[:, ::-1]
        around = nodal[np.maximum(lat.patch[cell], 0)]
        weights = [
            np.prod([(slope if e == d else line)[:, e, table[:, e]] for e in range(dim)], axis=0)
            for d in range(dim)
        ]
        return np.einsum("dnk,nke->ned", weights, around)


ACROSS = {"linear": Composite, "tensor product": TensorProduct}


def run_of(across: str, *scene, **options) -> mpm.Simulation:
    """A simulation with one of the ways."""
    run = mpm.Simulation(*scene, mpm.DM_GC, **options)
    run.composites = [ACROSS[across](run.grid)]
    return run


def wave(make: Callable, kind: str, cells: int) -> dict:
    """Errors of a standing wave with one half-wave a side, over a period, at Courant number ¼;
    ``make`` a run of grid, body, stepping and walls."""
    k, speed = np.pi, soil.s_speed if kind == "shear" else soil.p_speed
    ω, steps = np.sqrt(2) * k * speed, round(4 * np.sqrt(2) * cells)
    grid, stepping = (
        mpm.Grid.box((0, 0), (1, 1), (cells, cells)),
        mpm.Newmark(2 * np.pi / ω / steps),
    )
    walls = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom", "top"), "y"),
    ]
    body = mpm.MaterialPoints.fill(grid, soil, 4)
    X, sign = body.x.copy(), -1.0 if kind == "shear" else 1.0
    sx, cx, sy, cy = (f(k * X[:, d]) for d in (0, 1) for f in (np.sin, np.cos))
    shape = np.stack((sx * cy, sign * cx * sy), axis=1)
    xx, yy, xy = k * cx * cy, sign * k * cx * cy, -(1 + sign) * k * sx * sy
    λ, μ = soil.lame
    stress = np.stack((λ * (xx + yy) + 2 * μ * xx, λ * (xx + yy) + 2 * μ * yy, μ * xy), axis=1)
    small = 1e-7
    body.velocity = small * ω * shape
    run, wrong, known = make(grid, body, stepping, walls), np.zeros(2), np.zeros(2)
    for _ in range(steps):
        run.step()
        now = small * np.sin(ω * run.time)
        for i, (found, exact) in enumerate(
            ((body.x - X, shape), (body.stress[:, [0, 1, 3]], stress))
        ):
            wrong[i] += ((found - now * exact) ** 2).sum()
            known[i] += ((now * exact) ** 2).sum()
    displacement, stress = np.sqrt(wrong / known)
    return {
        "scene": f"{kind} wave, {cells} cells",
        "error_displacement": displacement,
        "error_stress": stress,
    }


def block(
    make: Callable, cells: tuple[int, int], offset: float, courant: float, steps: int = 1000
) -> dict:
    """Energy left (-) in a free block, ``offset`` cells off the grid lines."""
    h, (nx, ny) = 0.25, cells
    grid = mpm.Grid.box((0, 0), (2 * nx * h, 2 * ny * h), (2 * nx, 2 * ny))
    stepping = mpm.Newmark(courant * h / soil.p_speed)
    body = mpm.MaterialPoints.fill(
        grid,
        soil,
        4,
        inside=lambda x: (x[0] > h) & (x[0] < (1 + nx) * h) & (x[1] > h) & (x[1] < (1 + ny) * h),
    )
    body.velocity = np.zeros_like(body.x)
    body.velocity[:, 0] = 1e-5 * soil.p_speed * np.cos(np.pi * (body.x[:, 0] / h - 1) / nx)
    body.x += offset * h
    run, left = make(grid, body, stepping, []), np.inf
    energy = run.record(mpm.Energy())
    try:
        for _ in range(steps):
            run.step()
        left = energy.left[-1] / energy.left[0]
    except mpm.RunError:
        pass
    return {
        "scene": f"free block of {nx} x {ny} cells, {offset:g} off, Courant {courant:g}",
        "energy_left": float(left),
    }


def main(arguments=None) -> list[dict]:
    """Run all, print the table, write results/composite_across.json."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="ten cells and a hundred steps")
    chosen = report.chosen(parser, arguments)
    sizes, steps = ((10,), 100) if chosen.quick else ((10, 20), 1000)
    jobs = [(wave, (kind, n)) for kind in ("shear", "pressure") for n in sizes]
    jobs += [
        (block, (cells, offset, courant, steps))
        for cells in ((4, 3), (8, 6))[: len(sizes)]
        for offset in (0.0, 0.3)
        for courant in (0.5, 2.0)
    ]
    rows = [
        {"across": across, **job(partial(run_of, across), *of)}
        for job, of in track(jobs, "scenes")
        for across in ACROSS
    ]
    shown = Table(title="Linear across, and a tensor product", box=None, padding=(0, 2, 0, 0))
    for name in ("scene", "measure", *ACROSS):
        shown.add_column(name)
    for pair in zip(rows[::2], rows[1::2], strict=True):
        for name in list(pair[0])[2:]:
            shown.add_row(pair[0]["scene"], name, *(f"{row[name]:.3g}" for row in pair))
    report.write(chosen.results / "composite_across.json", rows)
    Console(width=120).print(shown)
    return rows


if __name__ == "__main__":
    main()
