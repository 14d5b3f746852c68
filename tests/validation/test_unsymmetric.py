"""A flow rule that is not associated: with its whole tangent Newton needs fewer solves than with
half of it mirrored, and converges at second order.

A strip on weightless soil that yields at q + 1.2 p = 10 kPa and flows without change of volume, on
the half plane of 24 × 18 cells, loaded to one and a half times what yields first in 50 steps.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import inside
import numpy as np
import pytest

import mpm_fenicsx as mpm

sys.path.insert(0, str(Path(__file__).parents[2] / "demos" / "extensions"))
from drucker_prager import DruckerPrager

pytestmark = pytest.mark.validation
SOIL = mpm.LinearElastic(young=20e6, poisson=0.3, density=1800.0)
LAW = DruckerPrager(SOIL, friction=1.2, dilation=0.0, cohesion=10e3)
H = 0.25


@dataclass(frozen=True)
class Mirrored(DruckerPrager):
    """The upper triangle of its tangent in place of the lower one."""

    symmetric = True

    def tangent(self, strain, stress, history, given=None):
        new, history, D = super().tangent(strain, stress, history, given)
        upper = np.triu(D)
        return new, history, upper + np.triu(D, 1).transpose(0, 2, 1)


def strip(law, mapping, load, tolerance):
    """A run of 50 steps up to ``load`` (Pa)."""
    grid = mpm.Grid.box((0.0, 0.0), (24 * H, 18 * H), (24, 18))
    body = mpm.MaterialPoints.fill(grid, law, 4)
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom")),
        mpm.Traction(body.surface("top", where=lambda x: x[0] < 4 * H), lambda t: (0.0, -load * t)),
    ]
    return mpm.Simulation(
        grid, body, mpm.QuasiStatic(50), terms, mapping, mpm.Solver(newton=mpm.Newton(tolerance))
    )


def first_yield(mapping):
    """The load (Pa) at which the elastic strip first comes to yield."""
    run = strip(SOIL, mapping, 1.0, 1e-6)
    run.step()
    stress = 50.0 * run.bodies[0].stress
    mean = stress[:, :3].mean(axis=1)
    s = stress.copy()
    s[:, :3] -= mean[:, None]
    q = np.sqrt(1.5 * (s[:, :3] ** 2).sum(axis=1) + 3.0 * s[:, 3] ** 2)
    return LAW.cohesion / (q + LAW.friction * mean).max()


def solves(law, mapping, load):
    """Solves a step."""
    run = strip(law, mapping, load, 1e-6)
    run.until(1.0)
    return run.solves / 50


def residuals(mapping, load):
    """The last three residuals (N) of the last step of those that take the most solves."""
    run = strip(LAW, mapping, load, 1e-8)
    norms, most = inside.residuals(run), []
    for _ in range(50):
        norms.clear()
        run.step()
        if len(norms) >= len(most):
            most = norms.copy()
    return most


@pytest.mark.parametrize(("mapping", "share"), [(mpm.DM_GC, 0.8), (mpm.MPM, 0.7)], ids=str)
def test_the_whole_tangent_needs_fewer_solves(mapping, share, monkeypatch):
    load = 1.5 * first_yield(mapping)
    whole = solves(LAW, mapping, load)
    mirrored = solves(Mirrored(SOIL, 1.2, 0.0, 10e3), mapping, load)
    left = residuals(mapping, load)
    print(f"{mapping}: {load:.0f} Pa, {whole} solves a step, mirrored {mirrored}; {left}")
    assert whole <= share * mirrored
    a, b, c = np.log(left[-3:])
    assert (c - b) / (b - a) > 1.7
