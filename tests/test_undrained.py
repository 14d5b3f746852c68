"""Undrained soil: pore pressures of closed form, the undrained path of Cam-Clay, a water table."""

from __future__ import annotations

import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.materials.law_checks import check_law

WATER = 5.5e9
SOIL = mpm.LinearElastic(young=20e6, poisson=0.3, density=2000.0)
MISES = mpm.VonMises(SOIL, peak=10e3, residual=10e3, softening=0.0)
CLAY = mpm.ModifiedCamClay(0.2, 0.04, 1.0, 2.0, 1800.0, poisson=0.3)


def triaxial(law, start, pore_pressure, axial, cell_pressure=0.0):
    """Total stress rows and histories along axial strains, the cell's pressure growing by steps
    ``cell_pressure`` (Pa)."""
    stress = np.array([[*start, 0.0, 0, 0]])
    history = law.initial_history(stress, {"pore_pressure": np.array([pore_pressure])})
    rows, states = [stress[0]], [history[0]]
    for n, step in enumerate(axial):
        strain, wanted = np.array([[0.0, step, 0, 0, 0, 0]]), start[0] - (n + 1) * cell_pressure
        for _ in range(40):
            new, after, D = law.tangent(strain, stress, history)
            off = wanted - new[0, 0]
            if abs(off) < 1e-7 * abs(wanted) + 1e-7:
                break
            strain[0, [0, 2]] += off / (D[0, 0, 0] + D[0, 0, 2])
        assert abs(off) < 1e-6 * abs(wanted) + 1e-6
        stress, history = new, after
        rows.append(stress[0])
        states.append(history[0])
    return np.array(rows), np.array(states)


@pytest.mark.parametrize("law", [SOIL, MISES], ids=["elastic", "von Mises"])
def test_pore_pressures_of_skempton(law):
    """Δu = B (Δσ₃ + A (Δσ₁ − Δσ₃)) with A = 1/3 and B = 1/(1 + K/K_w), flowing or not."""
    soil = mpm.Undrained(law, WATER)
    λ, μ = law.lame
    B = 1 / (1 + (λ + 2 * μ / 3) / WATER)
    stress, history = triaxial(
        soil, (-100e3, -100e3, -100e3), 40e3, np.full(20, -1e-4), cell_pressure=1e3
    )
    σ3, σ1, u = -(stress - stress[0])[:, 0], -(stress - stress[0])[:, 1], history[:, -1]
    np.testing.assert_allclose(u - 40e3, B * (σ3 + (σ1 - σ3) / 3), atol=1e-4)
    assert B > 0.99 and u[0] == 40e3
    if law is MISES:
        assert history[-1, 0] > 1e-4
        assert σ1[-1] - σ3[-1] == pytest.approx(np.sqrt(3) * 10e3, rel=1e-6)


@pytest.mark.parametrize("ratio", [1.0, 1.5])
def test_cam_clay_takes_its_undrained_path_when_water_holds_the_volume(ratio):
    """p'/p₀ = [(M² + η₀²)/(M² + η²)]^Λ once it flows, where K_w is large; the drop of p' and the
    rise of p are the pore pressure."""
    law = mpm.Undrained(
        mpm.ModifiedCamClay(
            0.2, 0.04, 1.0, 2.0, 1800.0, poisson=0.3, overconsolidation_ratio=ratio
        ),
        1e12,
    )
    stress, history = triaxial(law, (-150e3,) * 3, 50e3, np.full(150, -1e-3))
    effective = law.effective(stress, history)
    p, q = -tensors.mean(effective), tensors.von_mises(effective)
    assert p[0] == pytest.approx(100e3)
    flows = history[:, 1] > 0
    first = 100e3 * (ratio / (1 + (q[flows] / p[flows]) ** 2)) ** 0.8
    np.testing.assert_allclose(p[flows], first, rtol=1e-4)
    assert p[-1] == pytest.approx({1.0: 57434.92, 1.5: 79441.79}[ratio], rel=1e-4)
    np.testing.assert_allclose(history[:, -1], -tensors.mean(stress) - p, rtol=1e-12)
    np.testing.assert_allclose(-tensors.mean(stress), 150e3 + q / 3, rtol=1e-9)


@pytest.mark.parametrize("law", [SOIL, MISES, CLAY], ids=["elastic", "von Mises", "Cam-Clay"])
@pytest.mark.parametrize("dim", [2, 3])
def test_the_tangent_is_the_derivative(law, dim):
    soil = mpm.Undrained(law, 5e7)
    check_law(soil, dim)
    rng, count = np.random.default_rng(0), tensors.components(dim)
    strain, stress = 1e-3 * rng.normal(size=(60, count)), 5e3 * rng.normal(size=(60, count))
    stress[:, :3] -= 150e3
    history = soil.initial_history(stress, {"pore_pressure": rng.uniform(0, 60e3, 60)})
    D = soil.tangent(strain, stress, history)[2]
    by_differences = np.empty_like(D)
    for k in range(count):
        move = 1e-8 * np.eye(count)[k]
        up, down = (soil.respond(strain + s * move, stress, history)[0] for s in (1, -1))
        by_differences[:, :, k] = (up - down) / 2e-8
    wrong = np.abs(D - by_differences).max(axis=(1, 2)) / np.abs(D).max()
    assert np.median(wrong) < 1e-7 and np.quantile(wrong, 0.95) < 1e-6
    λ, μ = soil.lame
    assert (λ, μ) == (law.lame[0] + 5e7, law.lame[1])


def test_water_stores_what_is_done_to_it():
    """Elastic soil under any strain: the work is what soil and water have stored."""
    soil, rng = mpm.Undrained(SOIL, 5e7), np.random.default_rng(1)
    stress = rng.normal(size=(20, 6)) * 1e4
    history = soil.initial_history(stress, {"pore_pressure": rng.uniform(0, 1e5, 20)})
    strain = 1e-3 * rng.normal(size=(20, 6))
    new, after = soil.respond(strain, stress, history)
    work = (0.5 * (new + stress) * strain).sum(axis=1)
    stored = soil.energy(new, after) - soil.energy(stress, history)
    np.testing.assert_allclose(stored, work, rtol=1e-9, atol=1e-9)
    assert not soil.plastic_work(after).any()


@pytest.mark.parametrize("law", [SOIL, CLAY], ids=["elastic", "Cam-Clay"])
def test_ground_below_a_water_table_rests_and_water_takes_a_quick_load(law):
    """A column in total stresses under its saturated weight; then a load on its top, of which the
    water bears K_w/(K_w + M_oed) if the soil is elastic."""
    height, table, g, K0, load = 2.0, 1.5, 9.81, 0.6, 5e3
    soil = mpm.Undrained(law, WATER)
    grid = mpm.Grid.box((0.0, 0.0), (0.5, 2.5), (1, 5))
    points = mpm.MaterialPoints.fill(
        grid,
        soil,
        4,
        inside=lambda x: x[1] < height,
        parameters={"pore_pressure": mpm.hydrostatic(table)},
    )
    y = points.x[:, 1]
    u = 9810.0 * np.maximum(table - y, 0.0)
    vertical = -law.density * g * (height - y) - 20e3
    points.stress[:, 1] = vertical
    points.stress[:, 0] = points.stress[:, 2] = K0 * (vertical + u) - u
    np.testing.assert_array_equal(points.history[:, -1], u)
    top = points.surface("top")
    run = mpm.Simulation(
        grid,
        points,
        mpm.QuasiStatic(1),
        [
            mpm.Gravity((0.0, -g)),
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.Fixed(grid.facets("bottom"), "y"),
            mpm.Traction(top, lambda t: (0.0, -20e3 - load * t)),
        ],
    )
    before = soil.effective(points.stress, points.history)
    np.testing.assert_allclose(before[:, 0], K0 * before[:, 1])
    assert run.balance()[1] < 1e-12
    run.until(1.0)
    rise = points.history[:, -1] - u
    oedometer, close = (law.lame[0] + 2 * law.lame[1], 1e-6) if law is SOIL else (0.0, 2e-3)
    # Cam-Clay's is up to 1e-3 of the water's
    np.testing.assert_allclose(rise, load * WATER / (WATER + oedometer), rtol=close)
    if law is CLAY:
        p, q = -tensors.mean(before), tensors.von_mises(before)
        assert (points.history[:, 0] >= p + q**2 / p - 1e-6).all()


def test_what_does_not_fit_is_refused_by_name():
    hencky = mpm.Hencky(20e6, 0.3, 2000.0)
    for law in (hencky, mpm.VonMises(hencky, 10e3, 10e3, 0.0)):
        with pytest.raises(ValueError, match=r"law must be one of small strain, got .*Hencky"):
            mpm.Undrained(law, WATER)
    with pytest.raises(ValueError, match="bulk_modulus must be positive, got -1"):
        mpm.Undrained(SOIL, -1.0)
    with pytest.raises(ValueError, match="law must be drained"):
        mpm.Undrained(mpm.Undrained(SOIL, WATER), WATER)
    with pytest.raises(ValueError, match="law lacks"):
        mpm.Undrained(3.0, WATER)
    with pytest.raises(ValueError, match="water_table must be finite"):
        mpm.hydrostatic(np.inf)
    np.testing.assert_array_equal(
        mpm.hydrostatic(2.0, 1e4)(np.array([[0.0, 0.0], [0.5, 3.0]])), [15e3, 0.0]
    )
