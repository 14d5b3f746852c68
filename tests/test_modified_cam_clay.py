"""Modified Cam-Clay against the closed forms of the critical state, and in an oedometer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.materials.law_checks import check_law

λ, κ, M, V = 0.2, 0.04, 1.0, 2.0
PART = 1 - κ / λ  # Λ
P0 = 100e3
NUMBERS = {
    "compression_index": λ,
    "swelling_index": κ,
    "critical_state_ratio": M,
    "specific_volume": V,
    "density": 1800.0,
}
CLAY = mpm.ModifiedCamClay(**NUMBERS, poisson=0.3)
STIFF = mpm.ModifiedCamClay(**NUMBERS, shear_modulus=3e6)
BOTH = pytest.mark.parametrize("law", [CLAY, STIFF], ids=["poisson", "shear_modulus"])
K0, ETA = 0.722156, 0.341008


def pressure(stress):
    return -tensors.mean(stress)


def isotropic(p, n=1, dim=3):
    stress = np.zeros((n, tensors.components(dim)))
    stress[:, :3] = -p
    return stress


def path(law, strains, stress, history):
    """Stress after each of the increments (steps, components), and the history at the end."""
    found = []
    for strain in strains:
        stress, history = law.respond(strain[None], stress, history)
        found.append(stress[0])
    return np.array(found), history


def off_the_surface(stress, history):
    """The yield function over p p_c (n,)."""
    p, q, p_c = pressure(stress), tensors.von_mises(stress), history[:, 0]
    return (q**2 / M**2 + p * (p - p_c)) / (p * p_c)


@BOTH
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("ratio", [1.0, 1.5, 8.0])
def test_the_tangent_is_the_derivative_and_stress_stays_within_the_surface(law, dim, ratio):
    rng, count = np.random.default_rng(0), tensors.components(dim)
    for size in (1e-3, 1e-2, 5e-2):
        strain, stress = size * rng.normal(size=(200, count)), rng.normal(size=(200, count)) * 20e3
        stress[:, :3] -= rng.uniform(80e3, 150e3, (200, 1))
        history = law.initial_history(stress, {"overconsolidation_ratio": np.full(200, ratio)})
        new, after, D = law.tangent(strain, stress, history)
        assert off_the_surface(new, after).max() < 1e-12
        flows = after[:, 1] > 0
        assert np.abs(off_the_surface(new, after)[flows]).max(initial=0.0) < 1e-12
        assert (after[:, 2] >= 0).all()
        by_differences = np.empty_like(D)
        for k in range(count):
            move = 1e-5 * size * np.eye(count)[k]
            up, down = (law.respond(strain + s * move, stress, history)[0] for s in (1, -1))
            by_differences[:, :, k] = (up - down) / (2e-5 * size)
        wrong = np.abs(D - by_differences).max(axis=(1, 2)) / np.abs(D).max(axis=(1, 2))
        assert np.median(wrong) < 1e-9 and np.quantile(wrong, 0.98) < 1e-6


@BOTH
@pytest.mark.parametrize("steps", [1, 7])
def test_compression_and_swelling_lines_whatever_the_steps(law, steps):
    """v falls by λ ln p, and by κ ln p where it swells."""
    stress = isotropic(P0)
    strain = np.tile(-np.array([1.0, 1, 1, 0, 0, 0]) * 0.06 / 3 / steps, (steps, 1))
    loaded, history = path(law, strain, stress, law.initial_history(stress))
    assert pressure(loaded)[-1] == pytest.approx(P0 * np.exp(V * 0.06 / λ), rel=1e-12)
    assert history[0, 0] == pytest.approx(pressure(loaded)[-1], rel=1e-12)
    swollen, same = path(law, -0.2 * strain, loaded[-1:], history)
    assert pressure(swollen)[-1] == pytest.approx(
        pressure(loaded)[-1] * np.exp(-V * 0.012 / κ), rel=1e-12
    )
    np.testing.assert_array_equal(same, history)


def test_an_oedometer_ends_at_k0_and_on_a_line_of_slope_λ():
    stress = isotropic(P0)
    steps = np.tile([0.0, -5e-5, 0, 0, 0, 0], (8000, 1))
    stress, _ = path(CLAY, steps, stress, CLAY.initial_history(stress))
    p, q = pressure(stress), tensors.von_mises(stress)
    assert stress[-1, 0] / stress[-1, 1] == pytest.approx(K0, rel=1e-4)
    assert q[-1] / p[-1] == pytest.approx(ETA, rel=1e-4)
    slope = V * 100 * 5e-5 / np.log(p[-1] / p[-101])
    assert slope == pytest.approx(λ, rel=1e-4)


@BOTH
@pytest.mark.parametrize("steps", [4, 40])
@pytest.mark.parametrize("way", [(0.5, -1.0, 0.5, 0), (1.0, -1.0, 0, 0), (0, 0, 0, 1.5)])
def test_undrained_path_and_critical_state_whatever_the_steps(law, steps, way):
    """p'/p₀ = [(M² + η₀²)/(M² + η²)]^Λ; at the end p' = p₀ (R/2)^Λ and q = M p'."""
    start = np.array([[-90e3, -120e3, -90e3, 0.0]])
    p0, η0 = pressure(start)[0], tensors.von_mises(start)[0] / pressure(start)[0]
    strain = np.tile(np.array(way) * 0.2 / steps, (steps, 1))
    stress, _ = path(law, strain, start, law.initial_history(start))
    p = pressure(stress)
    η = tensors.von_mises(stress) / p
    np.testing.assert_allclose(p / p0, ((M**2 + η0**2) / (M**2 + η**2)) ** PART, rtol=1e-11)
    assert η.max() > 0.9 * M
    for ratio, exact in ((1.0, 57434.92), (1.5, 79441.79)):
        stress = isotropic(P0, dim=2)
        history = law.initial_history(stress, {"overconsolidation_ratio": np.array([ratio])})
        stress, _ = path(law, 10 * strain, stress, history)
        assert pressure(stress)[-1] == pytest.approx(exact, rel=1e-6)
        assert tensors.von_mises(stress)[-1] == pytest.approx(M * exact, rel=1e-6)


@BOTH
def test_drained_triaxial_compression_ends_at_the_critical_state(law):
    """q = 3 (p − p₀) meets q = M p, where p_c = 2p: compression in all follows."""
    stress, history = isotropic(P0), law.initial_history(isotropic(P0))
    total = 0.0
    for _ in range(400):
        strain = np.array([[1e-3, -5e-3, 1e-3, 0.0, 0, 0]])
        for _ in range(30):  # until the cell pressure is what it was
            new, after, D = law.tangent(strain, stress, history)
            off = -P0 - new[0, 0]
            if abs(off) < 1e-8 * P0:
                break
            strain[0, [0, 2]] += off / (D[0, 0, 0] + D[0, 0, 2])
        assert abs(off) < 1e-8 * P0
        stress, history, total = new, after, total - strain[0, :3].sum()
    p = 3 * P0 / (3 - M)
    assert pressure(stress)[0] == pytest.approx(p, rel=1e-6)
    assert tensors.von_mises(stress)[0] == pytest.approx(M * p, rel=1e-6)
    exact = (κ * np.log(p / P0) + (λ - κ) * np.log(2 * p / P0)) / V
    assert total == pytest.approx(exact, rel=1e-5)


@BOTH
@pytest.mark.parametrize("ratio", [1.0, 100.0])
def test_absurd_increments_give_numbers_on_the_surface(law, ratio):
    rng = np.random.default_rng(1)
    strain = np.concatenate([s * rng.normal(size=(100, 6)) for s in (0.1, 0.3, 1.0)])
    stress = isotropic(P0, 300)
    history = law.initial_history(stress, {"overconsolidation_ratio": np.full(300, ratio)})
    new, after, D = law.tangent(strain, stress, history)
    assert all(np.isfinite(a).all() for a in (new, after, D))
    assert (pressure(new) > 0).all() and off_the_surface(new, after)[:100].max() < 1e-8


def test_with_a_constant_shear_modulus_what_is_stored_comes_back_and_work_is_found():
    """Around a closed path of strain inside the surface; and along one that flows."""
    rng = np.random.default_rng(2)
    legs = rng.normal(size=(4, 6)) * 2e-4
    legs = np.concatenate((legs, -legs.sum(axis=0, keepdims=True)))

    def walked(law, scale, steps, ratio):
        stress = isotropic(P0)
        history = law.initial_history(stress, {"overconsolidation_ratio": np.array([ratio])})
        before, work = law.energy(stress, history)[0], 0.0
        for strain in np.repeat(scale * legs / steps, steps, axis=0):
            new, history = law.respond(strain[None], stress, history)
            work += 0.5 * (stress + new)[0] @ strain
            stress = new
        return stress, work, law.energy(stress, history)[0] - before, history[0, 2]

    stress, work, stored, plastic = walked(STIFF, 1.0, 100, 8.0)
    np.testing.assert_allclose(stress, isotropic(P0), atol=1e-6 * P0)
    assert plastic == 0.0 and abs(stored) < 1e-9 and abs(work) < 1e-5 * P0 * 1e-4
    lost = []
    for steps in (40, 80):
        _, work, stored, plastic = walked(STIFF, 30.0, steps, 1.0)
        assert plastic > 0.5 * work
        lost.append(abs(work - stored - plastic) / work)
    assert lost[1] < 0.6 * lost[0] and lost[1] < 0.01  # backward Euler: first order


# -- in runs ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Buried(mpm.Law):
    """A law that counts stress from ``stress`` (xx, yy, zz), Pa: finite elements start unloaded."""

    law: mpm.ModifiedCamClay
    start: tuple

    history = mpm.ModifiedCamClay.history
    symmetric = False

    @property
    def density(self):
        return self.law.density

    @property
    def lame(self):
        return self.law.lame

    def _of(self, stress):
        stress = stress.copy()
        stress[:, :3] += self.start
        return stress

    def initial_history(self, stress, given=()):
        return self.law.initial_history(self._of(stress))

    def tangent(self, strain, stress, history, given=()):
        new, after, D = self.law.tangent(strain, self._of(stress), history)
        new[:, :3] -= self.start
        return new, after, D


@pytest.mark.parametrize("kind", ["FE", "DM-GC"])
def test_a_column_in_an_oedometer_goes_along_the_compression_line(kind):
    """From K₀ on, strain is λ/v ln(σ_v'/σ_v): of the height at rest in finite elements, and of the
    present one with points."""
    height, first, last, steps = 1.0, 100e3, 150e3, 25
    start = (-K0 * first, -first, -K0 * first)
    grid = mpm.Grid.box((0.0, 0.0), (0.5, height), (1, 4))
    held = [mpm.Fixed(grid.facets("left", "right"), "x"), mpm.Fixed(grid.facets("bottom"), "y")]
    if kind == "FE":
        law = Buried(CLAY, start)
        load = mpm.Traction(grid.facets("top"), lambda t: (0.0, -(last - first) * t))
        run = mpm.FiniteElements(grid, law, mpm.QuasiStatic(steps), [*held, load])
    else:
        body = mpm.MaterialPoints.fill(grid, CLAY, 4, inside=lambda x: x[1] < height)
        body.stress[:, :3] = start
        top = mpm.Traction(body.surface("top"), lambda t: (0.0, -first - (last - first) * t))
        run = mpm.Simulation(grid, body, mpm.QuasiStatic(steps), [*held, top])
        before = body.volume.sum()
    run.until(1.0)
    exact = λ / V * np.log(last / first)
    if kind == "FE":
        at, values = run.sampler("displacement")
        found = -values(np.arange(len(at)))[at[:, 1].argmax(), 1] / height
    else:
        found = np.log(before / body.volume.sum())
        assert (body.history[:, 0] > P0).all()
    assert found == pytest.approx(exact, rel=1e-3 if kind == "DM-GC" else 1e-6)


def test_a_run_without_initial_stress_is_refused_by_name():
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (1, 1))
    body = mpm.MaterialPoints.fill(grid, CLAY, 4)
    assert not body.history.any()
    with pytest.raises(ValueError, match="initial stress"):
        mpm.Simulation(grid, body, mpm.QuasiStatic(1), [mpm.Fixed(grid.facets("bottom"))]).step()
    with pytest.raises(ValueError, match="initial stress"):
        mpm.FiniteElements(grid, CLAY, mpm.QuasiStatic(1), [])
    pulled = isotropic(-1e3)
    with pytest.raises(
        ValueError, match=r"ModifiedCamClay.*got a mean of 1000.0 Pa: give an initial"
    ):
        CLAY.initial_history(pulled)
    with pytest.raises(ValueError, match=r"overconsolidation_ratio must be at least 1 .* got 0.5"):
        CLAY.initial_history(-pulled, {"overconsolidation_ratio": np.array([0.5])})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"compression_index": -1.0}, "compression_index must be positive, got -1"),
        ({"swelling_index": 0.3}, r"swelling_index must be less than compression_index = 0.2, got"),
        ({"specific_volume": 0.5}, "specific_volume must be at least 1.0, got 0.5"),
        ({"overconsolidation_ratio": 0.5}, "overconsolidation_ratio must be at least 1.0, got 0.5"),
        ({"shear_modulus": 1e6}, "poisson or shear_modulus must be given, one and not both"),
        ({"poisson": None}, "poisson or shear_modulus must be given, one and not both"),
        ({"poisson": 0.5}, "poisson must lie between"),
    ],
)
def test_numbers_out_of_range_are_refused_by_name(change, message):
    with pytest.raises(ValueError, match=message):
        mpm.ModifiedCamClay(**{**NUMBERS, "poisson": 0.3, **change})


@BOTH
def test_lame_is_that_of_the_reference_pressure(law):
    check_law(law, 2)
    check_law(law, 3)
    rest = isotropic(law.reference_pressure, dim=2)
    λ_, μ = law.lame
    assert λ_ + 2 * μ / 3 == pytest.approx(V * P0 / κ)
    D = law.tangent(np.full((1, 4), 1e-12), rest, law.initial_history(rest) * 2)[2][0]
    np.testing.assert_allclose(D, mpm.stiffness(law.lame, 2), rtol=1e-8, atol=1e-3)
