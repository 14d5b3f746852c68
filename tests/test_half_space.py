"""The surface of a half-space under a strip load, against what must hold of it."""

from dataclasses import replace

import numpy as np
import pytest

from mpm_fenicsx import relative_error
from mpm_fenicsx.analytical.half_space import compliance, settlement_beside_a_strip
from mpm_fenicsx.analytical.waves import rayleigh_speed
from mpm_fenicsx.scenes.lamb import Lamb, Watch

POISSON, SLOW, DENSITY = 0.3, 2.0, 1.5
FAST = SLOW * np.sqrt((2 - 2 * POISSON) / (1 - 2 * POISSON))
GROUND = FAST, SLOW, DENSITY


def test_at_rest_it_settles_as_known_and_waves_have_the_speed_of_the_surface():
    k, μ = 0.7, DENSITY * SLOW**2
    assert compliance(k, 1e-4 * k * SLOW, *GROUND) == pytest.approx((1 - POISSON) / (μ * k))
    pole = k * SLOW * rayleigh_speed(POISSON)
    near, nearer = (1 / compliance(k, pole * (1 + d), *GROUND) for d in (1e-4, 1e-6))
    assert nearer == pytest.approx(1e-2 * near, rel=1e-3)


def test_before_the_edges_are_felt_it_sinks_as_a_column():
    """v = p/(ρ c_p); and nothing moves before the P wave has come."""
    t = np.linspace(0.0, 1.0, 401)
    load = np.clip(t / 0.05, 0.0, 1.0)
    under = settlement_beside_a_strip(0.0, 4.0, t, load, *GROUND)
    late = t > 0.1
    slope = np.polyfit(t[late], under[late], 1)[0]
    assert slope == pytest.approx(1 / (DENSITY * FAST), rel=1e-4)
    away = settlement_beside_a_strip(8.0, 4.0, t, load, *GROUND)
    assert np.abs(away[t < 4.0 / FAST - 0.02]).max() < 1e-3 * under.max()


def test_finite_elements_and_points_come_nearer_with_smaller_cells():
    """Waves of 10 and 20 cells; dispersion of bilinear elements is of second order."""
    scene = Lamb("large", cells=4, periods=2.5, symmetric=True)
    error = {}
    for make in (Lamb.finite_elements, Lamb.material_points):
        for finer in (1, 2) if make is Lamb.finite_elements else (1,):
            fine = replace(scene, cell=0.5 / finer, wave=10.0 * finer, cells=4 * finer, around=None)
            run = make(fine)
            watch = run.record(Watch(fine))
            run.until(fine.end)
            exact = fine.answer(1.5, watch.times)
            error[run.name, finer] = relative_error(watch.at((1.5, 0.0)), exact)
    assert error["FE", 2] < 0.4 * error["FE", 1]
    assert error["DM-GC", 1] < 0.5 * error["FE", 1]
