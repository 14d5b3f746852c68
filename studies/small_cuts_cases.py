"""The scenes of ``small_cuts.py``, each measured with and without a cure (a list of terms).  Units:
m, s, kg, Pa."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes import bar as bars
from mpm_fenicsx.scenes import column
from mpm_fenicsx.scenes.foundation import Foundation

soil = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
h, n, σ, miss = 0.25, 3, 100e3, 0.01  # m, cells of a block's edge, Pa, -


def alone(mapping: mpm.Mapping) -> mpm.Mapping:
    """The mapping without ties, which are a cure of their own."""
    return replace(mapping, hold_cut_cells=False)


# -- one step of a free body -----------------------------------------------------------------------


def body_of(shape: str, dim: int, cut: float, rng) -> tuple[mpm.Grid, mpm.MaterialPoints]:
    """A block, its upper corner ``cut`` of a cell over grid lines, or a ball anywhere, with room
    around."""
    grid = mpm.Grid.box([-2 * h] * dim, [(n + 2) * h] * dim, [n + 4] * dim)
    if shape == "block":
        points = mpm.MaterialPoints.fill(
            grid, soil, 2**dim, inside=lambda x: ((x > 0) & (x < n * h)).all(axis=0)
        )
        points.x += cut * h
    else:
        centre = 0.5 * n * h + rng.uniform(-0.5, 0.5, (dim, 1)) * h
        points = mpm.MaterialPoints.fill(
            grid, soil, 2**dim, inside=lambda x: ((x - centre) ** 2).sum(axis=0) < (1.3 * h) ** 2
        )
        points.x += cut * h * rng.uniform(-1.0, 1.0, dim)
    return grid, points


def condition(run) -> float:
    """Condition number of the run's matrix with unit diagonal, idle nodes left out."""
    start, column_, value = run.equilibrium.matrix.getValuesCSR()
    real = ~run.equilibrium.idle
    A = csr_matrix((value, column_, start)).toarray()[np.ix_(real, real)]
    found = np.linalg.eigvalsh(A / np.sqrt(np.outer(A.diagonal(), A.diagonal())))
    return float(found[-1] / found[0])


def released(
    shape: str, dim: int, cut: float, mapping, courant: float, cure: list, seed: int = 0
) -> dict:
    """Condition, and largest acceleration of the grid in σ/(ρ h), where a stress is set free."""
    grid, points = body_of(shape, dim, cut, np.random.default_rng(seed))
    points.stress[:, :dim] = σ
    run = mpm.Simulation(
        grid, points, mpm.Newmark(courant * h / soil.p_speed), cure, alone(mapping)
    )
    run.prepare(0.0, run.stepping.dt)
    run.predict()
    run.solve()
    return {
        "condition": condition(run),
        "iterations": run.equilibrium.iterations,
        "rescues": run.equilibrium.rescues,
        "acceleration": float(np.abs(run.motion.end()[1]).max() * soil.density * h / σ),
    }


# -- errors ----------------------------------------------------------------------------------------


def statics(cut: float, mapping, cure: list, cells: int = 4) -> float:
    """Error of stress and of the edge's displacement, relative to what the 1 % does."""
    grid = mpm.Grid.box((0, 0), [(cells + 2) * h] * 2, [cells + 2] * 2)
    points = mpm.MaterialPoints.fill(grid, soil, 4, inside=lambda x: (x < cells * h).all(axis=0))
    factor = 1 + cut / cells
    points = mpm.MaterialPoints(
        soil,
        factor * points.x,
        factor * points.half,
        factor**2 * points.volume,
        exposed=points.exposed,
    )
    points.stress[:, :3] = σ * np.array([1.0, 1.0, 2 * soil.poisson])
    sides = [points.surface(side) for side in ("right", "top")]
    before = [on.x.copy() for on in sides]
    terms = [mpm.Fixed(grid.facets("left"), "x"), mpm.Fixed(grid.facets("bottom"), "y")]
    terms += [mpm.Traction(on, tuple((1 + miss) * σ * on.normal[0])) for on in sides]
    mpm.Simulation(grid, points, mpm.QuasiStatic(1), terms + cure, alone(mapping)).until(1.0)
    moved = miss * σ / (2 * sum(soil.lame)) * cells * h
    far = max(np.abs(on.x - x).max() for on, x in zip(sides, before, strict=True))
    return float(
        max(abs(far / moved - 1), np.abs(points.stress[:, :2] / σ - 1 - miss).max() / miss)
    )


def bar(name: str, mapping, cure: list, cells: int = 20) -> dict:
    """Errors of the manufactured bar over one period."""
    chosen = bars.BARS[name]
    cell, dt = 1 / cells, chosen.period / (4 * cells)
    run = bars.material_points(chosen, alone(mapping), cell, dt, 4, name == "random", more=cure)
    watch = bars.Watch(run, chosen)
    while run.steps < 4 * cells:
        run.step()
        watch()
    return watch.errors()


def pulse(base: str, mapping, cure: list) -> dict:
    """Errors of the column at 0.3 kPa."""
    run = column.material_points(base, column.small, alone(mapping), more=cure)
    watch = column.Watch(run, base, column.small)
    run.until(column.end)
    return watch.errors()


def drift(cure: list, steps: int) -> dict:
    """The foundation between dashpots, which moves the points a hair into cells."""
    run = Foundation("viscous", cell=0.125, more=tuple(cure)).material_points(alone(mpm.DM_GC))
    run.step()  # what is compiled and allocated is not timed
    row, far, iterations, stopped, start = {}, 0.0, [], None, time.perf_counter()
    try:
        while run.steps < steps:
            run.step()
            far = max(far, float(np.abs(run.nodal("increment").ravel()).max()))
            iterations.append(run.equilibrium.iterations)
    except mpm.RunError as error:
        stopped = str(error)
    row.update(
        steps=run.steps,
        rescues=run.equilibrium.rescues,
        iterations=float(np.mean(iterations)),
        ms_a_step=1e3 * (time.perf_counter() - start) / max(len(iterations), 1),
        furthest_node_m=far,
        solves_a_step=run.solves / run.steps,
        stopped=stopped,
    )
    return row
