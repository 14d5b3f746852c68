"""The hysteretic law against Masing's rules, the closed forms of the hyperbola, and in a column."""

from __future__ import annotations

import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.materials.backbone import Backbone
from mpm_fenicsx.materials.law_checks import check_law

SOIL = mpm.LinearElastic(young=80e6, poisson=0.3, density=1900.0)
G = SOIL.lame[1]
BACKBONE = mpm.Hyperbolic(1e-3)
LAW = mpm.Hysteretic(SOIL, BACKBONE)
STRAIN = np.array([1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2])
RATIO = np.array([1.0, 0.99, 0.97, 0.92, 0.78, 0.55, 0.29, 0.13, 0.05])
CURVE = mpm.ReductionCurve(STRAIN, RATIO)
MEASURED = mpm.Hysteretic(SOIL, CURVE, elements=9)


def sheared(law, strains, dim=3, way=None, start=0.0):
    """Shear stress (steps,), stress rows and histories along total shear strains (steps,), in
    simple shear or with the strain row ``way``."""
    count = tensors.components(dim)
    if way is None:
        way = np.eye(count)[3]
    dual = way / np.array([1.0] * 3 + [2.0] * (count - 3))
    stress = np.full((1, count), start)
    history = law.initial_history(stress)
    rows, states = [], []
    for step in np.diff(strains, prepend=0.0):
        stress, history = law.respond(step * way[None], stress, history)
        rows.append(stress[0])
        states.append(history[0])
    rows = np.array(rows)
    return (rows - start) @ dual / (dual @ (2 * np.r_[dual[:3] / 2, dual[3:]])), rows, states


def exact(law, γ):
    """τ of the backbone, odd."""
    return G * γ * law.backbone.reduction(γ)


@pytest.mark.parametrize("law", [LAW, MEASURED], ids=["hyperbola", "measured"])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_first_loading_meets_the_backbone_at_the_nodes(law, dim):
    τ, rows, _ = sheared(law, law.nodes, dim)
    np.testing.assert_allclose(τ, exact(law, law.nodes), rtol=1e-10)
    np.testing.assert_allclose(law.shear_stress(law.nodes), exact(law, law.nodes), rtol=1e-10)
    assert np.abs(np.delete(rows, 3, axis=1)).max() < 1e-6
    once = sheared(law, law.nodes[-2:-1], dim)[0]  # and in one step
    np.testing.assert_allclose(once, τ[-2], rtol=1e-10)
    assert law.chain[1].sum() == pytest.approx(G, rel=1e-12)
    assert sheared(law, [0.5 * law.chain[0][0]])[0][0] == pytest.approx(
        0.5 * G * law.chain[0][0], rel=1e-12
    )
    np.testing.assert_allclose(
        sheared(law, [9 * law.nodes[-1]])[0], exact(law, law.nodes[-1]), rtol=1e-10
    )


@pytest.mark.parametrize("law", [LAW, MEASURED], ids=["hyperbola", "measured"])
def test_unloading_and_reloading_are_the_backbone_twice_as_large(law):
    """Masing: τ = τ_a − 2 τ_b((γ_a − γ)/2), and back; the loop closes, again and again; a smaller
    loop inside is forgotten."""
    amplitude = law.nodes[-3]
    down = np.linspace(amplitude, -amplitude, 40)[1:]
    cycle = np.concatenate((down, -down))
    τ, _, states = sheared(law, np.concatenate(([amplitude], cycle, cycle)))
    top = exact(law, amplitude)
    branch = top - 2 * law.shear_stress((amplitude - down) / 2)
    np.testing.assert_allclose(τ[1:40], branch, atol=1e-10 * top)
    np.testing.assert_allclose(τ[40:79], -branch, atol=1e-10 * top)
    np.testing.assert_allclose(τ[79:], τ[1:79], atol=1e-10 * top)
    inner = np.concatenate(([amplitude, -0.2 * amplitude, 0.5 * amplitude], [-0.2 * amplitude]))
    τ_inner, _, after = sheared(law, np.append(inner, -amplitude))
    assert τ_inner[3] == pytest.approx(τ_inner[1], rel=1e-10)
    assert τ_inner[-1] == pytest.approx(-top, rel=1e-10)
    np.testing.assert_allclose(after[-1][2:], states[39][2:], atol=1e-10 * top)


@pytest.mark.parametrize("dim", [2, 3])
def test_damping_of_a_loop_converges_to_that_of_the_hyperbola(dim):
    """ΔW is what flows take in a closed cycle; ξ = ΔW/4πW.  With 15 elements within 0.008, of the
    second order in the ratio of nodes."""
    strain = np.geomspace(1e-4, 1e-2, 15)
    x = strain / 1e-3
    closed = 2 / np.pi * (2 * (1 + x) * (x - np.log(1 + x)) / x**2 - 1)
    np.testing.assert_allclose(BACKBONE.damping_ratio(strain), closed, rtol=1e-9)
    np.testing.assert_allclose(Backbone.damping_ratio(BACKBONE, strain), closed, atol=1e-5)
    errors = []
    for elements in (15, 30, 60):
        law = mpm.Hysteretic(SOIL, BACKBONE, elements, range=(1e-5, 0.1))
        for γ in (strain[3], strain[11]):
            τ, _, states = sheared(law, [γ, -γ, γ], dim)
            loss = states[2][0] - states[0][0]
            assert loss / (2 * np.pi * γ * τ[0]) == pytest.approx(
                float(law.damping_ratio(γ)), rel=1e-9
            )
        errors.append(np.abs(law.damping_ratio(strain) - closed).max())
    assert errors[0] < 0.015 and errors[1] < 0.35 * errors[0] and errors[2] < 0.35 * errors[1]
    assert np.abs(LAW.damping_ratio(strain) - closed).max() < 0.008
    assert np.abs(LAW.reduction(strain) - BACKBONE.reduction(strain)).max() < 0.01


def test_the_damping_of_small_strains_is_not_below_zero():
    """It was -7e-17 at some, which an equivalent-linear ground refuses."""
    ratio = LAW.damping_ratio(np.geomspace(1e-7, 1e-4, 500))
    assert (ratio >= 0.0).all() and (ratio[:100] < 1e-15).all()


def test_a_measured_curve_is_met_at_its_points_and_damped_by_its_area():
    np.testing.assert_allclose(CURVE.reduction(STRAIN[1:]), RATIO[1:], rtol=1e-12)
    assert 0.99 < CURVE.reduction(STRAIN[0]) < 1.0
    fine = mpm.Hysteretic(SOIL, CURVE, elements=200)
    np.testing.assert_allclose(fine.reduction(STRAIN), RATIO, atol=5e-3)
    np.testing.assert_allclose(
        fine.damping_ratio(STRAIN[2:]), CURVE.damping_ratio(STRAIN[2:]), atol=2e-3
    )
    points = np.geomspace(1e-6, 1e-1, 26)
    sampled = mpm.ReductionCurve(points, BACKBONE.reduction(points))
    γ = np.geomspace(1e-5, 1e-2, 9)
    np.testing.assert_allclose(sampled.reduction(γ), BACKBONE.reduction(γ), rtol=1e-9)
    np.testing.assert_allclose(sampled.damping_ratio(γ), BACKBONE.damping_ratio(γ), atol=3e-3)


def test_shear_in_any_direction_is_simple_shear():
    """Strain γ (a⊗b + b⊗a)/2 in planes and directions at random; under any pressure."""
    rng = np.random.default_rng(3)
    path = 2e-3 * np.sin(np.linspace(0, 9, 60))
    τ = sheared(LAW, path)[0]
    for _ in range(5):
        a, b, _ = np.linalg.qr(rng.normal(size=(3, 3)))[0].T
        full = np.outer(a, b) + np.outer(b, a)
        way = np.array([*np.diag(full) / 2, full[0, 1], full[1, 2], full[0, 2]])
        stress, history = np.full((1, 6), 0.0), LAW.initial_history(np.zeros((1, 6)))
        stress[:, :3] = -80e3
        for n, step in enumerate(np.diff(path, prepend=0.0)):
            stress, history = LAW.respond(step * way[None], stress, history)
            σ = np.zeros((3, 3))
            σ[range(3), range(3)] = stress[0, :3]
            σ[[0, 1, 0], [1, 2, 2]] = σ[[1, 2, 2], [0, 1, 0]] = stress[0, 3:]
            np.testing.assert_allclose(σ, τ[n] * full - 80e3 * np.eye(3), atol=1e-5)


def states(law, dim, n=60):
    """Random increments, and states that random strains have left."""
    rng, count = np.random.default_rng(5), tensors.components(dim)
    stress = rng.normal(size=(n, count)) * 20e3
    history = law.initial_history(stress)
    for _ in range(3):
        strain = np.geomspace(1e-5, 1e-2, n)[:, None] * rng.normal(size=(n, count))
        stress, history = law.respond(strain, stress, history)
    return np.geomspace(1e-6, 1e-2, n)[::-1, None] * rng.normal(size=(n, count)), stress, history


@pytest.mark.parametrize("dim", [2, 3])
def test_the_tangent_is_the_derivative_and_symmetric(dim):
    check_law(LAW, dim)
    strain, stress, history = states(LAW, dim)
    new, after, D = LAW.tangent(strain, stress, history)
    np.testing.assert_allclose(D, D.transpose(0, 2, 1), atol=1e-6)
    by_differences = np.empty_like(D)
    for k in range(strain.shape[1]):
        move = 1e-9 * np.eye(strain.shape[1])[k]
        up, down = (LAW.respond(strain + s * move, stress, history)[0] for s in (1, -1))
        by_differences[:, :, k] = (up - down) / 2e-9
    wrong = np.abs(D - by_differences).max(axis=(1, 2)) / LAW.lame[0]
    assert np.median(wrong) < 1e-7 and np.quantile(wrong, 0.95) < 1e-5
    every = np.arange(len(strain), dtype=np.int32)
    rows = LAW.yields(strain, stress, history, every, every)
    elastic = np.setdiff1d(every, rows)
    assert 0 < len(elastic) < len(strain)
    assert (after[elastic, 0] == history[elastic, 0]).all()
    assert (after[rows, 0] > history[rows, 0]).all()
    np.testing.assert_allclose(D[elastic] - mpm.stiffness(SOIL.lame, dim), 0.0, atol=1e-6)
    np.testing.assert_allclose(
        new[elastic], mpm.hooke(SOIL.lame, strain[elastic], stress[elastic]), atol=1e-6
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_work_is_stored_or_taken_by_flow(dim):
    """Along a winding path from an initial stress; σ after the step, in flow, so of first order,
    and exact in shear along one line."""
    rng, count = np.random.default_rng(6), tensors.components(dim)
    legs = rng.normal(size=(5, count)) * 2e-3
    legs[:, :3] -= legs[:, :3].mean(axis=1, keepdims=True) * 0.9
    lost = []
    for steps in (50, 100):
        stress = np.array([[-50e3, -90e3, -40e3, 7e3, 3e3, 1e3]])[:, :count]
        history = LAW.initial_history(stress)
        before, work = LAW.energy(stress, history), 0.0
        for strain in np.repeat(legs / steps, steps, axis=0):
            new, history = LAW.respond(strain[None], stress, history)
            work += 0.5 * (stress + new)[0] @ strain
            stress = new
        stored = (LAW.energy(stress, history) - before)[0]
        lost.append(abs(work - stored - history[0, 0]) / history[0, 0])
        assert history[0, 0] > 0.3 * abs(work)
    assert lost[0] < 0.02 and lost[1] < 0.6 * lost[0]


@pytest.mark.parametrize("kind", [None, mpm.DM_GC], ids=["FE", "DM-GC"])
def test_a_column_that_is_sheared_slowly_follows_the_loop(kind):
    """A cycle of its top, from a pressure that it has at the start."""
    law, amplitude, height, steps = mpm.Hysteretic(SOIL, BACKBONE, 6), 2e-3, 2.0, 20

    def strain(t):
        return amplitude * np.sin(2.5 * np.pi * t)

    grid = mpm.Grid.box((0.0, 0.0), (0.5, height), (1, 4))
    sides = [mpm.Fixed(grid.facets(side), "y") for side in ("left", "right", "bottom", "top")]
    terms = [
        *sides,
        mpm.Fixed(grid.facets("bottom"), "x"),
        mpm.Fixed(grid.facets("top"), "x", lambda t: height * strain(t)),
    ]
    stepping = mpm.QuasiStatic(steps)
    if kind is None:
        run = mpm.FiniteElements(grid, law, stepping, terms)
    else:
        body = mpm.MaterialPoints.fill(grid, law, 4)
        run = mpm.Simulation(grid, body, stepping, terms, kind)
    energy, found = run.record(mpm.Energy()), []
    for _ in range(steps):
        run.step()
        stress = run.stress(np.arange(4)) if kind is None else body.stress
        np.testing.assert_allclose(stress[:, 3], stress[0, 3], rtol=2e-4, atol=5.0)
        found.append(stress[:, 3].mean())
    τ, _, states = sheared(law, strain(np.arange(1, steps + 1) / steps), 2)
    np.testing.assert_allclose(found, τ, atol=1e-4 * τ.max())
    plastic = states[-1][0] * 0.5 * height
    assert energy["plastic"][-1] == pytest.approx(plastic, rel=1e-3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mpm.Hyperbolic(0.0), "reference_strain must be positive, got 0"),
        (
            lambda: mpm.Hysteretic(SOIL, BACKBONE, 1),
            "elements must be a whole number of at least 2",
        ),
        (lambda: mpm.Hysteretic(SOIL, 3.0), "backbone lacks reduction"),
        (lambda: mpm.Hysteretic(BACKBONE, BACKBONE), "elastic must be a LinearElastic"),
        (lambda: mpm.Hysteretic(SOIL, BACKBONE, range=(0.0, 1.0)), "range must be two strains"),
        (
            lambda: mpm.Hysteretic(mpm.Hencky(80e6, 0.3, 1900.0), BACKBONE),
            "elastic must be one of small strain",
        ),
        (lambda: mpm.ReductionCurve([1e-5, 1e-4], [0.9, 0.95]), "ratio must fall from at most 1"),
        (lambda: mpm.ReductionCurve([1e-4, 1e-5], [0.9, 0.8]), "strain must increase"),
        (lambda: mpm.ReductionCurve([1e-4, 2e-4], [0.9]), "ratio must be 2 numbers"),
        (lambda: mpm.ReductionCurve([1e-4, 2e-4], [0.9, 0.3]), "so fast that the stress does"),
        (
            lambda: mpm.Hysteretic(
                SOIL, mpm.ReductionCurve([1e-5, 1e-4, 2e-4, 1e-3], [0.9, 0.2, 0.19, 0.1]), 40
            ),
            "backbone must rise and get flatter",
        ),
    ],
)
def test_numbers_out_of_range_are_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()
