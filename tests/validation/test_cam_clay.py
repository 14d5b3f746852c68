"""Case 21: blocks of modified Cam-Clay follow the compression line at K₀, and the undrained path.

Both paths are the same for clay a thousand times as stiff, at strains a thousand times as small:
sides of a grid stay where they are, and points that leave them would change the scene.
"""

import numpy as np
import pytest
from methods import over
from scipy.optimize import brentq

import mpm_fenicsx as mpm

pytestmark = pytest.mark.validation

SMALL = 1e-3
CLAY = mpm.ModifiedCamClay(
    compression_index=0.2 * SMALL,
    swelling_index=0.04 * SMALL,
    critical_state_ratio=1.0,
    specific_volume=2.0,
    density=1700.0,
    poisson=0.3,
)
P0 = 100e3  # Pa
Λ = 1.0 - CLAY.swelling_index / CLAY.compression_index
SIDES = {"left": "x", "right": "x", "bottom": "y", "top": "y"}


def ratio_at_rest():
    """η of one-dimensional compression on the line: dε_q/dε_v = 2/3, elastic strain included."""
    ν, M = CLAY.poisson, CLAY.critical_state_ratio
    elastic = 2.0 * (1.0 + ν) * (1.0 - Λ) / (9.0 * (1.0 - 2.0 * ν))
    return brentq(lambda η: 2.0 * η * Λ / (M**2 - η**2) + η * elastic - 2.0 / 3.0, 1e-6, 0.99 * M)


def block(mapping, law, start, moves, steps):
    """Four by four cells of 1 m², its sides moved as told (m), which makes the strain even."""
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (4, 4))
    by = {side: moves.get(side, 0.0) for side in SIDES}
    terms = [
        mpm.Fixed(grid.facets(side), axis, lambda t, side=side: by[side] * t)
        for side, axis in SIDES.items()
    ]
    stress = {"stress": lambda x: np.tile(start, (x.shape[1], 1))}
    if mapping is None:
        return mpm.FiniteElements(grid, law, mpm.QuasiStatic(steps), terms, **stress)
    points = mpm.MaterialPoints.fill(grid, law, 4, **stress)
    return mpm.Simulation(grid, points, mpm.QuasiStatic(steps), terms, mapping)


def stresses(run):
    return run.bodies[0].stress if run.bodies else run.stress(np.arange(run.grid.cells))


@over(None, mpm.DM_G, mpm.DM_GC)
def test_one_dimensional_compression(mapping, record):
    η = ratio_at_rest()
    q = η * P0
    start = [-P0 + q / 3.0, -P0 - 2.0 * q / 3.0, -P0 + q / 3.0, 0.0]
    strain, steps = 0.02 * SMALL, 40
    run = block(mapping, CLAY, start, {"top": -strain}, steps)
    run.until(1.0)
    grown = np.exp(strain * CLAY.specific_volume / CLAY.compression_index)
    found = stresses(run)
    lateral = found[:, 0] / found[:, 1]
    K0 = (3.0 - η) / (3.0 + 2.0 * η)
    errors = {
        "mean pressure": np.abs(-found[:, :3].mean(axis=1) / P0 / grown - 1.0).max(),
        "K₀": np.abs(lateral / K0 - 1.0).max(),
    }
    for name, error in errors.items():
        record(f"21 Cam-Clay, one-dimensional compression: {name}", mapping, error)
        assert error < 1e-4


@over(None, mpm.DM_G, mpm.DM_GC)
def test_undrained_shear(mapping, record):
    """p'/p₀ = (M²/(M² + η²))^Λ of all invariants q and p', in plane strain as well."""
    law = mpm.Undrained(CLAY, bulk_modulus=5e9 / SMALL)
    strain, steps = 0.01 * SMALL, 200
    run = block(mapping, law, [-P0, -P0, -P0, 0.0], {"top": -strain, "right": strain}, steps)
    run.until(1.0)
    history = run.bodies[0].history if run.bodies else run.gauss_history()
    if run.bodies:
        effective = law.effective(stresses(run), history)
    else:
        effective = law.effective(stresses(run), history.reshape(run.grid.cells, -1, 4)[:, 0])
    p, q = -mpm.tensors.mean(effective), mpm.tensors.von_mises(effective)
    η = q / p
    exact = P0 * (1.0 + (η / CLAY.critical_state_ratio) ** 2) ** -Λ
    error = np.abs(p / exact - 1.0).max()
    record("21 Cam-Clay, undrained shear: effective pressure", mapping, error)
    assert η.min() > 0.5
    assert error < 1e-6
