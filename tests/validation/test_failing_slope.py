"""Case 22: the slope of Griffiths and Lane (1999) stands with its strength reduced by 1.35, and not
by 1.5; with half its strength it runs out, and its energy balances."""

import pytest
from methods import over

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.failing_slope import FACTOR, FailingSlope

pytestmark = pytest.mark.validation


@over(mpm.DM_G, mpm.DM_GC)
def test_factor_of_safety(mapping, record):
    stands, fails = FailingSlope().factor_of_safety(mapping=mapping)
    middle = 0.5 * (stands + fails)
    record(
        "22 slope of Griffiths and Lane, h = 1 m: factor of safety", mapping, middle / FACTOR - 1.0
    )
    assert 1.35 <= stands < fails <= 1.45 + 1e-9


def test_movement_before_failure():
    slope = FailingSlope()
    assert slope.movement(1.0) == pytest.approx(0.38, rel=0.02)  # nearly elastic
    assert slope.movement(1.3) == pytest.approx(0.46, rel=0.02)


def test_run_out(record):
    slope = FailingSlope()
    run = slope.collapse(2.0, dt=0.02, solver=mpm.Solver(newton=mpm.Newton(1e-4)))
    energy = run.record(mpm.Energy())
    run.until(2.0)
    lost = abs(energy.lost[-1]) / energy["work"][-1]
    record("22 slope at half its strength, 2 s: energy not found", mpm.DM_GC, lost)
    assert lost < 0.015
    assert slope.run_out(run.bodies[0]) < 0.0  # it has moved, and not yet passed its old toe
