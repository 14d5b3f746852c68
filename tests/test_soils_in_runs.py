"""Mohr-Coulomb and Drucker-Prager in runs: Newton's order, the balance of energy, finite strain."""

import dense
import inside
import numpy as np
import plastic
import pytest
from plastic import ELASTIC, EXACT

import mpm_fenicsx as mpm

HENCKY = mpm.Hencky(young=20e6, poisson=0.3, density=1500.0)
FALLING = mpm.Curve([0.0, 0.02], [6e3, 3e3])
LAWS = {
    "Mohr-Coulomb": mpm.MohrCoulomb(ELASTIC, 6e3, 20.0, 0.0, tensile_strength=2e3),
    "softening": mpm.MohrCoulomb(ELASTIC, FALLING, 25.0, 5.0),
    "Drucker-Prager": mpm.DruckerPrager(ELASTIC, 6e3, 20.0, 0.0, mpm.MatchedTo.PLANE_STRAIN),
    "Mohr-Coulomb, finite strain": mpm.MohrCoulomb(HENCKY, 6e3, 20.0, 0.0),
    "Drucker-Prager, finite strain": mpm.DruckerPrager(HENCKY, FALLING, 20.0, 0.0),
}
PEAK = 140e3


def strip(grid):
    """Rollers at the sides, a base, and a pressure that falls from its peak to zero over the left
    half of the top."""
    return [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom")),
        mpm.Gravity(lambda t: (0.0, -9.81 * t)),
        mpm.Traction(
            grid.facets("top"),
            lambda t, x: -PEAK * t * np.maximum(0.0, 1.0 - 2.0 * x[:, :1]) * np.array([0.0, 1.0]),
        ),
    ]


EVERY = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())


def name(kind):
    return "FE" if kind is None else str(kind)


@EVERY
@pytest.mark.parametrize("kind", [None, mpm.DM_GC], ids=name)
def test_newton_converges_quadratically(kind, law):
    """Where flow is not associated; the block is pushed well beyond first yield."""
    grid = dense.uneven(2)
    run = plastic.run_of(kind, grid, mpm.QuasiStatic(1), strip(grid), law=law, solver=EXACT)
    norms = inside.residuals(run)
    run.step()
    history = run.bodies[0].history if run.bodies else run.gauss_history()
    flows = history[:, 1] > 0.0
    print(flows.mean())
    assert flows.mean() > 0.2
    norms = np.array(norms[1:])
    norms = norms[norms > 1e-11 * norms[0]]
    print(name(kind), norms)
    assert len(norms) >= 3
    assert np.log(norms[-1] / norms[-2]) / np.log(norms[-2] / norms[-3]) > 1.7


@EVERY
def test_work_is_strain_energy_and_plastic_work(law):
    """In finite elements, but for what backward Euler adds, which halves with the step."""
    left = []
    for steps in (8, 16):
        grid = dense.uneven(2)
        run = plastic.run_of(None, grid, mpm.QuasiStatic(steps), strip(grid), law=law, solver=EXACT)
        energy = run.record(mpm.Energy())
        run.until(1.0)
        taken = energy["strain"][-1] + energy["plastic"][-1]
        left.append(1.0 - energy["work"][-1] / taken)
    assert 0.0 < left[0] < 0.02
    assert 0.45 < left[1] / left[0] < 0.55


@pytest.mark.parametrize(
    "kind", [None, pytest.param(mpm.DM_GC, marks=pytest.mark.validation)], ids=name
)
def test_in_space_newton_converges_as_fast(kind):
    grid, law = dense.uneven(3), mpm.MohrCoulomb(ELASTIC, 6e3, 20.0, 0.0)
    held = {"left": "x", "right": "x", "bottom": "y", "top": "y"}
    terms = [
        *(mpm.Fixed(grid.facets(side), held[side]) for side in held),
        mpm.Fixed(grid.facets("back")),
        mpm.Traction(
            grid.facets("front"),
            lambda t, x: -PEAK * np.maximum(0.0, 1.0 - 2.0 * x[:, :1]) * np.array([0.0, 0.0, 1.0]),
        ),
    ]
    run = plastic.run_of(kind, grid, mpm.QuasiStatic(1), terms, law=law, solver=EXACT)
    norms = inside.residuals(run)
    run.step()
    norms = np.array(norms[1:])
    norms = norms[norms > 1e-11 * norms[0]]
    assert np.log(norms[-1] / norms[-2]) / np.log(norms[-2] / norms[-3]) > 1.7
