"""Cases 7 and 8: what grows with Newmark's γ = ½ decays with generalised α, at every Courant
number.

With equation (7), or strain from composite patches, the step's matrix is not the derivative of its
force, and modes that the step does not resolve may grow (studies/amplification.py); to take of
those is what dissipation is for.
"""

import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.crossing import SOIL, H, bar

pytestmark = pytest.mark.validation

RADIUS = {mpm.DM_GC: 0.8, mpm.DM_GCL: 0.8, mpm.DM_G: 0.5, mpm.GIMP: 0.5}
GROWS = "a disturbance grows at Courant 2; generalised α stops it"
MAPPED = pytest.mark.parametrize("mapping", list(RADIUS), ids=str)


@MAPPED
def test_a_disturbance_grows_at_courant_2_where_points_cross_cells(mapping, record):
    error = bar(mapping, 2.0, 1000, disturbance=0.01)
    case = "8 crossing cells, bar disturbed by 1 %, Courant 2, last 250 of 1,000 steps"
    record(case, mapping, error[-250:].max(), GROWS)
    assert error[-250:].max() > 5 * error[:250].max()


@pytest.mark.parametrize("courant", [0.5, 2.0, 5.0])
@MAPPED
def test_with_dissipation_it_does_not_grow_over_2000_steps(mapping, courant, record):
    """It never is above the 1 % of the disturbance; what round-off and dissipation leave in turn is
    below 0.1 %."""
    radius = RADIUS[mapping]
    error = bar(
        mapping, courant, 2000, disturbance=0.01, law=lambda dt: mpm.GeneralizedAlpha(dt, radius)
    )
    quarter = [part.max() for part in np.array_split(error, 4)]
    case = "8 crossing cells, bar disturbed by 1 %, spectral radius 0.8 (GIMP, DM-G: 0.5)"
    case += f", Courant {courant:g}, last 500 of 2,000 steps"
    record(case, mapping, quarter[-1])
    assert max(quarter) < 0.0105
    assert quarter[-1] < max(quarter[1], 1e-3)


@pytest.mark.parametrize("cells", [(4, 3), (12, 8)], ids=str)
@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.DM_GCL], ids=str)
def test_with_dissipation_a_free_block_gains_no_energy(mapping, cells, record):
    """Set off by cos πx/L, at rest as a whole, 0 and 0.3 cells off the grid lines."""
    gain = (
        max(
            late_energy(mapping, courant, cells, offset, lambda dt: mpm.GeneralizedAlpha(dt, 0.9))
            for offset in (0.0, 0.3)
            for courant in (0.5, 2.0, 5.0)
        )
        - 1.0
    )
    record(
        f"7 free block, {cells[0]} × {cells[1]} cells, Courant 0.5 to 5, spectral radius 0.9: gain "
        "of energy",
        mapping,
        max(gain, 0.0),
    )
    assert gain < 0.0


def test_without_it_dm_gcl_does():
    assert late_energy(mpm.DM_GCL, 2.0, (4, 3), 0.3, mpm.Newmark) > 10.0


def late_energy(mapping, courant, cells, offset, law):
    """Largest energy in the last quarter of 600 steps over that at the start."""
    size = np.array(cells) * H
    grid = mpm.Grid.box((-2 * H, -2 * H), size + 3 * H, np.array(cells) + 5)
    body = mpm.MaterialPoints.fill(
        grid, SOIL, 4, inside=lambda x: (x.T > 0).all(axis=1) & (x.T < size).all(axis=1)
    )
    body.velocity = np.zeros_like(body.x)
    body.velocity[:, 0] = 1e-5 * SOIL.p_speed * np.cos(np.pi * body.x[:, 0] / size[0])
    body.x += offset * H
    run = mpm.Simulation(grid, body, law(courant * H / SOIL.p_speed), [], mapping)
    energy = run.record(mpm.Energy())
    for _ in range(600):
        run.step()
    return energy.left[-150:].max() / energy.left[0]
