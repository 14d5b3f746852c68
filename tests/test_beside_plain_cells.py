"""Strain of points that lie beside a far field or a layer."""

import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.foundation import Foundation

PRESSURE = 100.0  # Pa


@pytest.mark.parametrize("ratio", [0.25, 1.0, 4.0])
def test_strain_jumps_where_the_far_field_is_of_another_stiffness(ratio):
    """All of a column bears the pressure on its top."""
    soil, ground = (mpm.LinearElastic(young, 0.3, 2000.0) for young in (20e6, ratio * 20e6))
    grid = mpm.Grid.box((0, 0), (2, 8.5), (4, 17))
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: (x[1] > 4) & (x[1] < 8))
    terms = [
        mpm.FarField(lambda x: x[1] < 4, ground),
        mpm.Fixed(grid.facets("bottom")),
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Traction(body.surface("top"), lambda t: (0.0, -PRESSURE * t)),
    ]
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(1), terms)
    run.until(1.0)
    assert np.abs(body.stress[:, 1] + PRESSURE).max() < 1e-8 * PRESSURE


@pytest.mark.parametrize("mapping", [mpm.DM_G, mpm.DM_GC], ids=str)
def test_points_beside_a_layer_neither_gain_nor_lose(mapping):
    """At a load so small that nothing drifts, what the first pulse does is found again."""
    scene = Foundation("layer", load=26.0, cell=0.25)
    run = scene.material_points(mapping)
    energy = run.record(mpm.Energy())
    run.until(0.45)
    assert abs(energy.lost[-1]) < 2e-3 * energy["work"][-1]
