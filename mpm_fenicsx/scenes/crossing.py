"""A body under uniform stress crosses cells, 0.3 of one a step; its stress stays uniform.

Exact: support domains that tile the body give Σ_p V_p σ ∇S_ip = σ ∮ N_i n dA, whatever the grid,
and faces cut at the grid's lines (``mapping.surface_faces``) give the integral.  Units: m, s, Pa.

    wrong = block(DM_GC, courant=0.5, steps=100)[0].max()
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
STRESS, H = 100e3, 0.25
TENSION = np.array([1.0, 1.0, 0.5])


def errors(run: mpm.Simulation, stress, steps: int) -> np.ndarray:
    """Largest error of stress (steps,), relative; the last is infinite where the run breaks
    down."""
    found, (body,) = [], run.bodies
    try:
        for _ in range(steps):
            run.step()
            found.append(np.abs(body.stress[:, : len(stress)] - stress).max() / STRESS)
    except mpm.RunError:
        found.append(np.inf)
    return np.array(found)


def bar(
    mapping: mpm.Mapping,
    courant: float,
    steps: int,
    sweeps: int = 1,
    disturbance: float = 0.0,
    law: type = mpm.Newmark,
) -> np.ndarray:
    """A bar of 20 cells between rollers under pressure; its velocity disturbed by a cosine of a
    stress of that part."""
    stepping = law(courant * H / SOIL.p_speed)
    cells, length = int(0.3 * steps) + 26, 20 * H
    grid = mpm.Grid.box((-2 * H, 0), ((cells - 2) * H, H), (cells, 1))
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: (x[0] > 0) & (x[0] < length))
    body.stress[:, :3] = -STRESS * np.array([1.0, 1 / 3, 1 / 3])  # ν = 1/4: no strain across
    body.velocity = np.tile([0.3 * H / stepping.dt, 0.0], (len(body), 1))
    wave = np.cos(3 * np.pi * body.x[:, 0] / length)
    body.velocity[:, 0] += disturbance * STRESS / (SOIL.density * SOIL.p_speed) * wave
    terms = [mpm.Fixed(grid.facets("bottom", "top"), "y")]
    terms += [
        mpm.Traction(body.surface(side), (push, 0.0))
        for side, push in (("left", STRESS), ("right", -STRESS))
    ]
    return errors(
        mpm.Simulation(grid, body, stepping, terms, replace(mapping, sweeps=sweeps)),
        [-STRESS],
        steps,
    )


def block(
    mapping: mpm.Mapping,
    courant: float,
    steps: int,
    law: mpm.Law = SOIL,
    disturbance: float = 0.0,
) -> tuple[np.ndarray, mpm.MaterialPoints]:
    """A free block of 6 by 6 cells under tension on all sides (a dead pressure would let it topple)
    goes aslant.

    Returns errors and body; ``disturbance`` of the velocity, by waves of a stress of that part.
    """
    stepping, way, n = mpm.Newmark(courant * H / SOIL.p_speed), np.array([0.3, 0.17]), 6
    cells = (way * steps).astype(int) + n + 6
    grid = mpm.Grid.box((-2 * H, -2 * H), (cells - 2) * H, cells)
    body = mpm.MaterialPoints.fill(
        grid, law, 4, inside=lambda x: ((x > 0) & (x < n * H)).all(axis=0)
    )
    body.stress[:, :3] = STRESS * TENSION
    waves = np.cos(3 * np.pi * body.x / (n * H)) * np.sin(
        0.7 + 2 * np.pi * body.x[:, ::-1] / (n * H)
    )
    body.velocity = (
        way * H / stepping.dt + disturbance * STRESS / (SOIL.density * SOIL.p_speed) * waves
    )
    sides = [body.surface(side) for side in ("left", "right", "bottom", "top")]
    terms = [mpm.Traction(surface, tuple(STRESS * surface.normal[0])) for surface in sides]
    return errors(
        mpm.Simulation(grid, body, stepping, terms, mapping), STRESS * TENSION, steps
    ), body
