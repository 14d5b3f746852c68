"""Case 20: a smooth rigid strip on soil with friction bears c N_c, or p N_q."""

import pytest
from methods import over

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.strip import cohesive_strip, surcharged_strip

pytestmark = pytest.mark.validation


def collapse(strip, mapping):
    """The load's error at the end, and how much it grew over the last quarter of the way."""
    run = strip.finite_elements() if mapping is None else strip.material_points(mapping)
    loads = []
    while run.steps < strip.steps:
        run.step()
        loads.append(strip.load(run))
    before = loads[round(strip.steps * 0.75**0.5) - 1]
    return loads[-1] / strip.capacity - 1.0, loads[-1] / before - 1.0


@pytest.mark.parametrize("h", [0.1, 0.05, 0.025])
@over(None, mpm.DM_GC)
def test_cohesion(mapping, h, record):
    error, growth = collapse(cohesive_strip(20.0, 20.0, cell=h), mapping)
    record(f"20 strip, N_c, φ = ψ = 20°, h = {h:g} m: load", mapping, error)
    assert 0.0 < error < {0.1: 0.03, 0.05: 0.015, 0.025: 0.01}[h]
    assert growth < 0.01


@pytest.mark.parametrize("h", [0.1, 0.05])
@over(None, mpm.DM_GC)
def test_surcharge(mapping, h, record):
    error, growth = collapse(surcharged_strip(20.0, 20.0, cell=h), mapping)
    record(f"20 strip, N_q, φ = ψ = 20°, h = {h:g} m: load", mapping, error)
    assert 0.0 < error < {0.1: 0.03, 0.05: 0.015}[h]
    assert growth < 0.01
