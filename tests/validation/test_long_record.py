"""Case 25: a record of 40 s shakes the base of a column that is at rest under its weight.

Exact: the base moves as the record says, and ends with its velocity and displacement; before the
record begins nothing moves; the work of the base is what the column has and what it has lost.
"""

import numpy as np
import pytest
from methods import over

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.soil_column import soil, synthetic_record

pytestmark = pytest.mark.validation

SOIL = soil(150.0, 1800.0)
HEIGHT, CELLS, G, K0, STEP = 10.0, 5, 9.81, 0.5, 0.01
QUIET = 0.5  # s, before the record begins
RECORD = synthetic_record(39.5, peak=2.0, dt=STEP, seed=3).padded(before=QUIET)
DAMPING = mpm.RayleighDamping(beta=0.02 / np.pi)  # 2 % of critical at 1 Hz, and no drag of the base
SPEED = G * HEIGHT / SOIL.p_speed  # m/s, of a wave that takes all the weight off the base


def column(mapping):
    """The run, and the nodes of its base."""
    size = HEIGHT / CELLS
    room = mapping is not None
    grid = mpm.Grid.box((0.0, 0.0), (size, HEIGHT + room * size), (1, CELLS + room))
    base = grid.facets("bottom")
    terms = [
        mpm.Tied("left", "right"),
        mpm.Gravity((0.0, -G)),
        mpm.Fixed(base, "y"),
        mpm.Fixed(base, "x", acceleration=RECORD),
        DAMPING,
    ]
    at_base = np.abs(grid.space.tabulate_dof_coordinates()[:, 1]) < 1e-9
    if mapping is None:
        rest = mpm.GeostaticStress(SOIL, HEIGHT, K0, G)
        return mpm.FiniteElements(grid, SOIL, mpm.Newmark(STEP), terms, stress=rest), at_base
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: x[1] < HEIGHT)
    mpm.initial_stress(body, HEIGHT, K0, G)
    return mpm.Simulation(grid, body, mpm.Newmark(STEP), terms, mapping), at_base


def momentum(run):
    """Horizontal momentum (kg m/s) of the column."""
    if run.bodies:
        return sum(body.mass @ body.velocity[:, 0] for body in run.bodies)
    v, size = run.nodal("velocity")[:, 0], HEIGHT / CELLS
    y = run.grid.space.tabulate_dof_coordinates()[:, 1]
    share = np.where((y < 1e-9) | (y > HEIGHT - 1e-9), 0.25, 0.5)  # of a cell's mass
    return SOIL.density * size**2 * (share @ v)


@over(None, mpm.GIMP, mpm.DM_GC)
def test_the_base_moves_as_the_record_says_and_the_column_waits_for_it(mapping, record):
    """4,000 steps.  Displacement of the base is the sum of its increments, which is exact for the
    rule of the steps; the record's own is off by a(t) Δt²/12 from it, which is zero at the end."""
    run, base = column(mapping)
    energy = run.record(mpm.Energy())
    displacement, waiting, before = 0.0, 0.0, momentum(run)
    work = [0.0]
    while run.steps < round(RECORD.duration / STEP):
        run.step()
        moved = run.nodal("increment")[base, 0]
        displacement += moved[0]
        after = momentum(run)
        work.append(work[-1] + (after - before) / STEP * moved[0])
        before = after
        if run.time < QUIET - 0.5 * STEP:
            _, read = run.sampler("velocity")
            waiting = max(waiting, np.abs(read(slice(None))).max())
    lost = np.abs(energy.lost + np.array(work)).max() / max(work)
    run.step()  # the nodes of points have the velocity before a step
    v = run.nodal("velocity")[base, 0]
    off = abs(displacement - RECORD.displacement[-1]) / RECORD.peak_displacement
    slow = np.abs(v - RECORD.velocity[-1]).max() / RECORD.peak_velocity
    still = waiting / SPEED
    record("25 record of 40 s: residual displacement of the base", mapping, off)
    record("25 record of 40 s: residual velocity of the base", mapping, slow)
    record("25 record of 40 s: velocity at rest before it, of g L/c_p", mapping, still)
    record("25 record of 40 s: energy not found, of the work", mapping, lost)
    assert off < 1e-8
    assert slow < 1e-8
    assert still < 1e-9
    assert lost < 0.005
