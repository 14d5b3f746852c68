"""Case 14: points exactly on grid lines and nodes, a grid far off the origin, one point a cell,
points strewn at random and one 1e-18 m outside.

Exact: a body without stress moves as it is told; a bar whose stress its ends hold keeps it.
"""

import numpy as np
import pytest
from methods import LOST, MAPPED

import mpm_fenicsx as mpm

pytestmark = pytest.mark.validation

SOIL, H, STRESS = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0), 0.25, 100e3
UNSTABLE = "composite strain on linear weights: round-off grows"
HOURGLASS = (
    "one point in the middle of a cell gives its hourglass modes neither mass nor stiffness: a "
    "singular matrix"
)
SUMS = (
    "a sum over random points is not the integral: the bar's internal force is not that of its "
    "stress"
)
GAPS = (
    "support domains around random points overlap and leave gaps: the bar's internal force is not "
    "that of its stress"
)


@MAPPED
@pytest.mark.parametrize("dim", [2, 3])
def test_a_body_that_steps_from_node_to_node(dim, mapping, record):
    """Points lie on nodes, or in the middle of edges, before and after every step; the grid starts
    at 1,000 m."""
    origin, cells = np.array([1000.1, -7.3, 0.7])[:dim], [12, 12, 8][:dim]
    grid = mpm.Grid.box(origin, origin + np.array(cells) * H, cells)
    body = mpm.MaterialPoints.fill(
        grid,
        SOIL,
        2**dim,
        inside=lambda x: (np.abs((x - origin[:, None]) / H - 2.5) < 1.5).all(axis=0),
    )
    body.x -= H / 4
    on = (body.x - origin) / (H / 2)
    assert np.abs(on - on.round()).max() < 1e-9
    stepping, start = mpm.Newmark(0.5 * H / SOIL.p_speed), body.x.copy()
    body.velocity = np.full_like(body.x, 0.5 * H / stepping.dt)
    run = mpm.Simulation(grid, body, stepping, [], mapping)
    try:
        for _ in range(6):
            run.step()
        error = max(
            np.abs(body.stress).max() / SOIL.young, np.abs(body.x - start - 3 * H).max() / H
        )
    except mpm.RunError:
        error = np.inf
    reason = UNSTABLE if mapping is mpm.CMPM else ""
    record(f"14 points on nodes and edges, {dim}D: stress/E, path", mapping, error, reason)
    if reason:
        assert error > 0.2
    else:
        assert error < 1e-8


@MAPPED
def test_a_point_a_hair_outside_stays_in_the_run(mapping, record):
    """The grid's last cell takes what round-off puts beyond its edge; 1e-18 m, and 1e-11 of a
    cell."""
    found = []
    for hair in (1e-18, 1e-11 * H):
        grid = mpm.Grid.box((0, 0), (8 * H, 4 * H), (8, 4))
        body = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: x[0] < 2 * H)
        body.x[body.x[:, 0] < H / 2, 0] = -hair
        start, stepping = body.x.copy(), mpm.Newmark(0.5 * H / SOIL.p_speed)
        body.velocity = np.tile([0.3 * H / stepping.dt, 0.0], (len(body), 1))
        run = mpm.Simulation(grid, body, stepping, [], mapping)
        for _ in range(10):
            run.step()
        found += [
            np.abs(body.stress).max() / SOIL.young,
            np.abs(body.x - start - [3 * H, 0.0]).max() / H,
        ]
    record("14 a point 1e-18 m outside the grid: stress/E, path", mapping, max(found))
    assert max(found) < 1e-8


def bar(mapping, pace, per_cell=4, jitter=0.0, seed=1, shift=0.0, origin=0.0, steps=100):
    """Errors of stress, relative, of a bar of 12 cells that moves by ``pace`` cells a step; ∞ where
    the run stops."""
    cells = int(abs(pace) * steps) + 18
    grid = mpm.Grid.box((origin, 0), (origin + cells * H, H), (cells, 1))
    body = mpm.MaterialPoints.fill(
        grid,
        SOIL,
        per_cell,
        inside=lambda x: np.abs((x[0] - origin) / H - 8) < 6,
        jitter=jitter,
        seed=seed,
    )
    stepping = mpm.Newmark(0.5 * H / SOIL.p_speed)
    for places in (body.x, body.seat) if jitter else (body.x,):
        places[:, 0] += shift * H
    body.stress[:, :3] = -STRESS * np.array([1.0, 1 / 3, 1 / 3])
    body.velocity = np.tile([pace * H / stepping.dt, 0.0], (len(body), 1))
    terms = [mpm.Fixed(grid.facets("bottom", "top"), "y")]
    terms += [
        mpm.Traction(body.surface(side), (push, 0.0))
        for side, push in (("left", STRESS), ("right", -STRESS))
    ]
    run, error = mpm.Simulation(grid, body, stepping, terms, mapping), []
    try:
        for _ in range(steps):
            run.step()
            error.append(np.abs(body.stress[:, 0] + STRESS).max() / STRESS)
    except mpm.RunError:
        error.append(np.inf)
    return np.array(error)


@MAPPED
@pytest.mark.parametrize(
    "name, scene",
    [
        ("points on grid lines, half a cell a step", {"pace": 0.5, "shift": 0.25}),
        ("one point a cell, 0.3 cells a step", {"pace": 0.3, "per_cell": 1}),
        ("a grid 1,000 m off, 0.3 cells a step", {"pace": 0.3, "origin": 1000.1}),
        ("nine points a cell, 0.3 cells a step", {"pace": 0.3, "per_cell": 9}),
    ],
    ids=lambda value: str(value)[:12],
)
def test_a_bar_keeps_its_stress(mapping, name, scene, record):
    """Without domains a quarter of it is lost where the four points of a cell are spaced evenly
    over grid lines: 1.4 times it, were light nodes not tied."""
    error = bar(mapping, **scene).max()
    hourglass = scene.get("per_cell") == 1 and mapping in (mpm.MPM, mpm.CMPM)
    record(
        f"14 bar under stress, {name}",
        mapping,
        error,
        "" if mapping.support else HOURGLASS if hourglass else LOST,
    )
    if mapping.support:
        assert error < 1e-9 * (1e3 if "origin" in scene else 1)  # 1,000 m have 1e-13 m of round-off
    elif hourglass:
        assert error == np.inf
    else:
        least, most = (0.2, 0.27) if "origin" in scene else (0.55, 0.85)
        assert least < error < (4.3 if scene["pace"] == 0.5 else most)


@MAPPED
def test_points_strewn_at_random_do_not_hold_a_stress(mapping, record):
    """At rest, off by up to 0.3 of their spacing, drawn twice: an error of that size and more.

    With composite strain over support domains it grows in 1,000 steps of the first draw, to 1.66
    with DM-GCL and to 2.44 with DM-GC, whose correction of accelerations has a part in that: 2.01
    without.  Of four draws it grows in two.
    """
    errors = {draw: bar(mapping, 0.0, jitter=0.3, seed=draw, steps=1000) for draw in (1, 2)}
    most = max(error.max() for error in errors.values())
    case = "14 bar under stress, random points at rest, 1,000 steps"
    record(case, mapping, most, GAPS if mapping.support else SUMS)
    assert most < (2.7 if mapping is mpm.DM_GC else 1.8 if mapping.support else 0.55)
    for draw, error in errors.items():
        grows = mapping.support and mapping.composite and draw == 1
        assert 0.25 < error.max()
        assert (error[750:].max() < 1.05 * error[:250].max()) != grows
