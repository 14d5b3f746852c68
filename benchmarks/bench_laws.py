"""What laws for soil cost a point beside von Mises, where all points flow."""

import time

import numpy as np
import pytest

from mpm_fenicsx import Curve, DruckerPrager, LinearElastic, MohrCoulomb, Tresca, VonMises

SOIL = LinearElastic(young=20e6, poisson=0.3, density=1800.0)
FADING = Curve([0.0, 0.1], [10.0, 0.0])
LAWS = {
    "von Mises": VonMises(SOIL, 10e3, 10e3, 0.0),
    "Mohr-Coulomb": MohrCoulomb(SOIL, 10e3, 30.0, 10.0),
    "Mohr-Coulomb, cut off": MohrCoulomb(SOIL, 10e3, 30.0, 10.0, tensile_strength=5e3),
    "Tresca": Tresca(SOIL, 10e3),
    "Mohr-Coulomb, softening": MohrCoulomb(SOIL, Curve([0.0, 0.5], [10e3, 4e3]), 30.0, 10.0),
    "Mohr-Coulomb, all follow κ": MohrCoulomb(
        SOIL, Curve([0.0, 0.5], [10e3, 4e3]), Curve([0.0, 0.5], [30.0, 25.0]), FADING
    ),
    "Drucker-Prager": DruckerPrager(SOIL, 10e3, 30.0, 10.0),
}
UNBOUNDED = {"Mohr-Coulomb, all follow κ"}
"""What looks for κ by returning again and again."""
POINTS, ROUNDS = 20_000, 20


def flowing(law, count):
    """Strain increments, stress and history of points that all flow."""
    strain = np.random.default_rng(0).normal(size=(8 * POINTS, count)) * 3e-3
    if count == 4:
        strain[:, 2] = 0.0
    stress = np.zeros_like(strain)
    stress[:, :3] = -20e3
    history, rows = np.zeros((len(strain), len(law.history))), np.arange(len(strain))
    rows = rows.astype(np.int32)
    flow = law.yields(strain, stress, history, rows, rows)[:POINTS]
    assert len(flow) == POINTS
    return [array[flow].copy() for array in (strain, stress, history)]


@pytest.mark.parametrize(("count", "most"), [(4, 5.0), (6, 9.0)], ids=["plane strain", "3D"])
def test_tangents_beside_von_mises(count, most):
    states = {name: flowing(law, count) for name, law in LAWS.items()}
    best = dict.fromkeys(LAWS, np.inf)
    for _ in range(ROUNDS):
        for name, law in LAWS.items():
            start = time.process_time()
            law.tangent(*states[name])
            best[name] = min(best[name], time.process_time() - start)
    for name, seconds in best.items():
        ratio = seconds / best["von Mises"]
        print(f"{name}: {1e9 * seconds / POINTS:.0f} ns a point, {ratio:.2f} of von Mises's")
        assert ratio <= most or name in UNBOUNDED
