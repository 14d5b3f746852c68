"""Von Mises with linear softening: the return map, its tangent and its energy, against independent
answers."""

import math

import numpy as np
import pytest
from scipy.optimize import root

from mpm_fenicsx.common import tensors
from mpm_fenicsx.common.compiled import jit
from mpm_fenicsx.materials import LinearElastic, VonMises
from mpm_fenicsx.materials.von_mises import respond_point, tangent_point

SOIL = LinearElastic(young=1e6, poisson=0.3, density=2000.0)
LAW = VonMises(SOIL, peak=10e3, residual=4e3, softening=60e3)
G = SOIL.lame[1]
CORNER = (LAW.peak - LAW.residual) / LAW.softening
ROOT3 = math.sqrt(3.0)
BRANCHES = ("softening", "residual", "corner", "across")


def cohesion(kappa, law=LAW):
    return np.maximum(law.residual, law.peak - law.softening * kappa)


def deviator(stress):
    out = stress.copy()
    out[..., :3] -= stress[..., :3].sum(axis=-1, keepdims=True) / 3
    return out


def q_of(stress):
    """√(3 J₂) in complex-safe arithmetic."""
    s = deviator(stress)
    return np.sqrt(1.5 * (s[..., :3] ** 2).sum(axis=-1) + 3.0 * (s[..., 3:] ** 2).sum(axis=-1))


def states(branch, count, n=40, seed=0):
    """Random points inside or on the yield surface, and increments that make them flow on
    ``branch``."""
    rng = np.random.default_rng(seed)
    kappa = {
        "softening": rng.uniform(0, 0.3 * CORNER, n),
        "residual": rng.uniform(1.1, 3, n) * CORNER,
        "corner": np.full(n, CORNER),
        "across": rng.uniform(0.9, 0.99, n) * CORNER,
    }[branch]
    stress = deviator(rng.normal(size=(n, count)))
    stress *= (rng.uniform(0.2, 1, n) * ROOT3 * cohesion(kappa) / q_of(stress))[:, None]
    stress[:, :3] += rng.uniform(-50e3, 50e3, (n, 1))
    strain = rng.normal(size=(n, count))
    target = rng.uniform(1.05, 1.5, n) * ROOT3 * cohesion(kappa)
    if branch == "across":
        target += 3 * G * 0.2 * CORNER
    for p in range(n):  # as large as brings the trial to the target
        low, high = 0.0, 1.0
        for _ in range(60):
            mid = 0.5 * (low + high)
            low, high = (
                (mid, high)
                if q_of(SOIL.update(mid * strain[p : p + 1], stress[p : p + 1]))[0] < target[p]
                else (low, mid)
            )
        strain[p] *= high
    return strain, stress, kappa[:, None]


def reference(strain, stress, kappa, soft):
    """The return map of one row in NumPy, for complex strains, on a branch that is given."""
    λ, μ = SOIL.lame
    trial = stress.astype(strain.dtype)
    trial[:3] += 2 * μ * strain[:3] + λ * strain[:3].sum()
    trial[3:] += μ * strain[3:]
    q = q_of(trial)
    if soft:
        gamma = (q - ROOT3 * (LAW.peak - LAW.softening * kappa)) / (3 * μ - ROOT3 * LAW.softening)
    else:
        gamma = (q - ROOT3 * LAW.residual) / (3 * μ)
    return trial - 3 * μ * gamma * deviator(trial) / q, kappa + gamma


def derivative(strain, stress, kappa, soft):
    """∂σ/∂ε by the complex step."""
    columns = [
        reference(strain + 1e-30j * unit, stress, kappa, soft)[0].imag / 1e-30
        for unit in np.eye(len(strain))
    ]
    return np.array(columns).T


def test_elastic_below_yield():
    strain, stress, history = states("softening", 6)
    small = 1e-3 * strain
    stress *= 0.9
    new, after, tangent = LAW.tangent(small, stress, history)
    np.testing.assert_allclose(new, SOIL.update(small, stress), rtol=1e-13, atol=1e-9)
    np.testing.assert_array_equal(after, history)
    np.testing.assert_allclose(
        tangent, SOIL.tangent(small, stress, history)[2], rtol=1e-14, atol=1e-9
    )
    np.testing.assert_array_equal(LAW.dissipation(history, after), 0.0)


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("count", [4, 6])
def test_state_after_flow_lies_on_the_yield_surface(branch, count):
    strain, stress, history = states(branch, count, n=500)
    new, after = LAW.respond(strain, stress, history)
    q = tensors.von_mises(new)
    assert (after > history).all()
    assert (np.abs(q - ROOT3 * cohesion(after[:, 0])) <= 1e-12 * q).all()
    np.testing.assert_allclose(LAW.strength(after), q, rtol=1e-12)
    soft = after[:, 0] < CORNER
    assert soft.all() if branch == "softening" else not soft.any()


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("count", [4, 6])
def test_tangent_is_the_derivative_of_the_return_map(branch, count):
    strain, stress, history = states(branch, count)
    new, after, tangent = LAW.tangent(strain, stress, history)
    for got, again in zip((new, after), LAW.respond(strain, stress, history), strict=True):
        np.testing.assert_array_equal(got, again)
    np.testing.assert_allclose(tangent, tangent.transpose(0, 2, 1), rtol=0, atol=1e-12 * G)
    step = 1e-7
    for k in range(count):
        move = step * np.eye(count)[k]
        central = (
            LAW.respond(strain + move, stress, history)[0]
            - LAW.respond(strain - move, stress, history)[0]
        )
        np.testing.assert_allclose(tangent[:, :, k], central / (2 * step), rtol=0, atol=1e-7 * G)
    for p in range(len(strain)):
        exact = derivative(strain[p], stress[p], history[p, 0], branch == "softening")
        np.testing.assert_allclose(tangent[p], exact, rtol=0, atol=1e-10 * np.abs(exact).max())


def test_landing_on_the_corner():
    """Where c reaches residual at the end of the increment the tangent is one of its two one-sided
    limits."""
    strain, stress, history = np.zeros((1, 6)), np.zeros((1, 6)), np.array([[0.5 * CORNER]])
    strain[0, 3] = (ROOT3 * LAW.residual + 3 * G * 0.5 * CORNER) / ROOT3 / G
    new, after, tangent = LAW.tangent(strain, stress, history)
    assert tensors.von_mises(new)[0] == pytest.approx(ROOT3 * LAW.residual, rel=1e-12)
    assert after[0, 0] == pytest.approx(CORNER, rel=1e-12)
    limits = [derivative(strain[0], stress[0], history[0, 0], soft) for soft in (True, False)]
    assert min(np.abs(tangent[0] - limit).max() for limit in limits) <= 1e-10 * G


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("count", [4, 6])
def test_return_map_solves_the_backward_euler_equations(branch, count):
    strain, stress, history = states(branch, count, n=20, seed=3)
    new, after = LAW.respond(strain, stress, history)
    inner = np.r_[np.ones(3), 2 * np.ones(count - 3)]
    for p in range(len(strain)):

        def residual(x, p=p):
            s, dκ = 1e4 * x[:-1], 1e-2 * x[-1]
            plastic = 1.5 * dκ * deviator(s) / q_of(s) * inner
            elastic = SOIL.update((strain[p] - plastic)[None], stress[p : p + 1])[0]
            return np.r_[
                (s - elastic) / 1e4, (q_of(s) - ROOT3 * cohesion(history[p, 0] + dκ)) / 1e4
            ]

        start = SOIL.update(strain[p : p + 1], stress[p : p + 1])[0]
        found = root(residual, np.r_[start / 1e4, 0.0], tol=1e-14)
        assert np.abs(found.fun).max() < 1e-11
        np.testing.assert_allclose(
            new[p], 1e4 * found.x[:-1], rtol=0, atol=1e-10 * np.abs(new[p]).max()
        )
        assert after[p, 0] == pytest.approx(history[p, 0] + 1e-2 * found.x[-1], rel=1e-10)


def drive(strains, law=LAW):
    """Stresses and κ along a path of total strains (steps, components), from rest."""
    stress, history = np.zeros((1, strains.shape[1])), np.zeros((1, 1))
    path = []
    for increment in np.diff(strains, axis=0, prepend=0.0):
        stress, history = law.respond(increment[None], stress, history)
        path.append((stress[0], history[0, 0]))
    return np.array([s for s, _ in path]), np.array([k for _, k in path])


@pytest.mark.parametrize("count", [4, 6])
def test_simple_shear_follows_the_exact_curve(count):
    γ = np.linspace(0, 0.4, 701)[1:]
    first, h = LAW.peak / G, LAW.softening
    slope = -h / (ROOT3 - h / G)
    exact = np.where(γ < first, G * γ, np.maximum(LAW.residual, LAW.peak + slope * (γ - first)))
    strains = np.zeros((len(γ), count))
    strains[:, 3] = γ
    stress, kappa = drive(strains)
    np.testing.assert_allclose(stress[:, 3], exact, rtol=1e-10)
    np.testing.assert_allclose(tensors.von_mises(stress), ROOT3 * exact, rtol=1e-10)
    np.testing.assert_allclose(kappa, (γ - exact / G) / ROOT3, rtol=1e-9, atol=1e-13)
    assert exact[-1] == LAW.residual


def test_uniaxial_stress_follows_the_exact_curve():
    """ε = σ/E + κ along the bar, -ν σ/E - κ/2 across it: q falls by √3 h E / (E - √3 h) per
    strain."""
    E, ν = SOIL.young, SOIL.poisson
    kappa = np.linspace(0, 2 * CORNER, 301)
    σ = ROOT3 * cohesion(kappa)
    strains = np.zeros((len(kappa), 6))
    strains[:, 0] = σ / E + kappa
    strains[:, 1] = strains[:, 2] = -ν * σ / E - kappa / 2
    stress, found = drive(strains)
    np.testing.assert_allclose(stress[:, 0], σ, rtol=1e-9)
    np.testing.assert_allclose(stress[:, 1:], 0.0, atol=1e-8 * LAW.peak)
    np.testing.assert_allclose(found, kappa, rtol=1e-9, atol=1e-13)
    slope = (stress[100, 0] - stress[0, 0]) / (strains[100, 0] - strains[0, 0])
    assert slope == pytest.approx(
        -ROOT3 * LAW.softening * E / (E - ROOT3 * LAW.softening), rel=1e-9
    )


@pytest.mark.parametrize("branch", BRANCHES)
def test_plane_strain_equals_3d(branch):
    strain, stress, history = states(branch, 4)
    strain[:, 2] = 0.0
    pad = np.zeros((len(strain), 2))
    plane = LAW.tangent(strain, stress, history)
    solid = LAW.tangent(np.hstack([strain, pad]), np.hstack([stress, pad]), history)
    np.testing.assert_allclose(solid[0][:, :4], plane[0], rtol=1e-14)
    np.testing.assert_array_equal(solid[0][:, 4:], 0.0)
    np.testing.assert_allclose(solid[1], plane[1], rtol=1e-14)
    np.testing.assert_allclose(solid[2][:, :4, :4], plane[2], rtol=1e-13, atol=1e-9 * G)


def rotate(rows, Q, shear):
    """Rows (n, 6) of tensors turned by Q; ``shear``: 1 for stress, 2 for engineering strain."""
    full = np.zeros((len(rows), 3, 3))
    for i in range(3):
        full[:, i, i] = rows[:, i]
    for k, (i, j) in enumerate(tensors.SHEAR[3]):
        full[:, i, j] = full[:, j, i] = rows[:, 3 + k] / shear
    full = Q @ full @ Q.T
    return np.stack(
        [full[:, i, i] for i in range(3)] + [shear * full[:, i, j] for i, j in tensors.SHEAR[3]],
        axis=1,
    )


@pytest.mark.parametrize("branch", BRANCHES)
def test_turning_the_frame_turns_the_answer(branch):
    strain, stress, history = states(branch, 6)
    Q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    new, after = LAW.respond(strain, stress, history)
    turned, same = LAW.respond(rotate(strain, Q, 2), rotate(stress, Q, 1), history)
    np.testing.assert_allclose(turned, rotate(new, Q, 1), rtol=0, atol=1e-11 * np.abs(new).max())
    np.testing.assert_allclose(same, after, rtol=1e-11)


@pytest.mark.parametrize("branch", BRANCHES)
def test_mean_stress_is_elastic(branch):
    strain, stress, history = states(branch, 6)
    new, _ = LAW.respond(strain, stress, history)
    bulk = SOIL.lame[0] + 2 / 3 * G
    exact = tensors.mean(stress) + bulk * strain[:, :3].sum(axis=1)
    np.testing.assert_allclose(tensors.mean(new), exact, rtol=0, atol=1e-12 * np.abs(stress).max())


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("count", [4, 6])
def test_work_of_one_increment(branch, count):
    """Backward Euler: σ₁:Δε = ΔE + ½ Δσ:C⁻¹:Δσ + σ₁:Δεᵖ, to rounding."""
    strain, stress, history = states(branch, count)
    new, after = LAW.respond(strain, stress, history)
    work = (new * strain).sum(axis=1)
    plastic = LAW.dissipation(history, after)
    stored = LAW.energy(new) - LAW.energy(stress) + LAW.energy(new - stress)
    np.testing.assert_allclose(stored + plastic, work, rtol=0, atol=1e-12 * LAW.energy(new).max())
    flow = (
        1.5
        * (after - history)
        * deviator(new)
        / q_of(new)[:, None]
        * np.r_[np.ones(3), 2 * np.ones(count - 3)]
    )
    np.testing.assert_allclose(plastic, (new * flow).sum(axis=1), rtol=1e-11)
    assert (plastic > 0).all()


def test_energy_is_balanced_to_first_order():
    """On a path that turns, ∫ σ:dε (trapezoidal) less stored and dissipated energy halves with the
    increment."""

    def gap(steps):
        t = np.linspace(0, 1, steps + 1)[:, None]
        turn = np.array([0.02, -0.03, 0.01, 0.05, 0.0, -0.02])
        strains = t * np.array([-0.02, 0.06, 0.0, 0.16, 0.06, 0.02]) + 2 * np.sin(2 * t) * turn
        stress, kappa = drive(strains[1:])
        path = np.vstack([np.zeros(6), stress])
        work = (0.5 * (path[1:] + path[:-1]) * np.diff(strains, axis=0)).sum()
        history = np.r_[0.0, kappa][:, None]
        lost = LAW.dissipation(history[:-1], history[1:]).sum()
        assert kappa[-1] > CORNER
        return abs(work - LAW.energy(stress[-1:])[0] - lost) / work

    gaps = [gap(n) for n in (500, 1000, 2000)]
    assert gaps[-1] < 2e-3
    assert np.log2(gaps[0] / gaps[1]) > 0.9 and np.log2(gaps[1] / gaps[2]) > 0.9


def sheared_to_residual(law, size, steps):
    """Dissipation per volume until the cohesion has just reached residual."""
    given = {"size": np.array([size])}
    h = law.modulus(given)[0]
    kappa = np.linspace(0, (law.peak - law.residual) / h, steps + 1)
    strain = np.zeros((1, 4))
    stress, history, lost, γ = np.zeros((1, 4)), np.zeros((1, 1)), 0.0, 0.0
    for k in kappa:
        strain[0, 3] = (law.peak - h * k) / G + ROOT3 * k - γ
        γ += strain[0, 3]
        stress, after = law.respond(strain, stress, history, given)
        lost += law.dissipation(history, after, given)[0]
        history = after
    return lost


def test_dissipation_converges_to_the_area_under_the_curve():
    law = VonMises(SOIL, 10e3, 4e3, 60e3, length=0.5)
    exact = ROOT3 * (law.peak**2 - law.residual**2) / (2 * law.softening)
    errors = [abs(sheared_to_residual(law, 0.5, n) / exact - 1) for n in (50, 100, 200)]
    assert errors[-1] < 3e-3
    assert np.log2(errors[0] / errors[1]) > 0.9 and np.log2(errors[1] / errors[2]) > 0.9


def test_energy_per_area_of_band_does_not_depend_on_the_cell():
    law = VonMises(SOIL, 10e3, 4e3, 60e3, length=0.5)
    energies = [size * sheared_to_residual(law, size, 40) for size in (0.1, 0.25, 0.5, 1.0, 3.0)]
    np.testing.assert_allclose(energies, energies[0], rtol=1e-10)


def test_size_acts_point_by_point_and_only_with_a_length():
    strain, stress, history = states("softening", 4, n=5)
    scaled = VonMises(SOIL, 10e3, 4e3, 60e3, length=2.0)
    size = np.array([0.5, 1.0, 2.0, 2.5, 3.0])
    together = scaled.tangent(strain, stress, history, {"size": size})
    for p, d in enumerate(size):
        own = VonMises(SOIL, 10e3, 4e3, 30e3 * d)
        single = own.tangent(strain[p : p + 1], stress[p : p + 1], history[p : p + 1])
        for one, many in zip(single, together, strict=True):
            np.testing.assert_allclose(many[p], one[0], rtol=1e-12, atol=1e-9)
    for got, same in zip(
        LAW.respond(strain, stress, history, {"size": size}),
        LAW.respond(strain, stress, history),
        strict=True,
    ):
        np.testing.assert_array_equal(got, same)
    with pytest.raises(ValueError, match=r"size is required.*2\.0"):
        scaled.respond(strain, stress, history)
    limit = ROOT3 * G * 2.0 / 60e3
    with pytest.raises(ValueError, match=f"size must stay below {limit}.*got {limit + 1}"):
        scaled.respond(strain, stress, history, {"size": np.array([1, 1, 1, 1, limit + 1])})
    with pytest.raises(ValueError, match=r"size must be positive, got -1\.0"):
        scaled.strength(history, {"size": np.array([-1.0])})


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("count", [4, 6])
def test_batch_equals_single_points(branch, count):
    strain, stress, history = states(branch, count)
    batch = LAW.tangent(strain, stress, history)
    parameters = LAW.lame, (LAW.peak, LAW.residual, LAW.softening)
    out, tangent = np.empty(count), np.empty((count, count))
    for p in range(len(strain)):
        kappa = tangent_point(strain[p], stress[p], history[p, 0], *parameters, out, tangent)
        for got, row in zip(
            (out, kappa, tangent), (batch[0][p], batch[1][p, 0], batch[2][p]), strict=True
        ):
            np.testing.assert_array_equal(got, row)
        same = stress[p].copy()
        assert respond_point(strain[p], same, history[p, 0], *parameters, same) == kappa
        np.testing.assert_array_equal(same, out)


def test_law_can_be_called_from_a_compiled_loop():
    @jit
    def shear(steps, lame, strength, strain, stress):
        kappa = 0.0
        for _ in range(steps):
            kappa = respond_point(strain, stress, kappa, lame, strength, stress)
        return kappa

    stress = np.zeros(4)
    strength = LAW.peak, LAW.residual, LAW.softening
    kappa = shear(400, LAW.lame, strength, np.array([0, 0, 0, 1e-3]), stress)
    assert stress[3] == pytest.approx(LAW.residual, rel=1e-12)
    assert kappa == pytest.approx((0.4 - LAW.residual / G) / ROOT3, rel=1e-10)


def test_point_at_rest_on_the_yield_surface_stays_as_it_is():
    strain, stress, history = states("softening", 6, n=300)
    stress, history = LAW.respond(strain, stress, history)
    new, after, tangent = LAW.tangent(np.zeros_like(strain), stress, history)
    np.testing.assert_array_equal(new, stress)
    np.testing.assert_array_equal(after, history)
    np.testing.assert_array_equal(tangent, LAW.tangent(0 * strain, 0 * stress, 0 * history)[2])


def test_perfect_plasticity_and_a_residual_of_zero():
    strain, stress, history = states("residual", 6)
    perfect = VonMises(SOIL, 4e3, 4e3, 0.0)
    for got, exact in zip(
        perfect.tangent(strain, stress, history), LAW.tangent(strain, stress, history), strict=True
    ):
        np.testing.assert_allclose(got, exact, rtol=1e-12, atol=1e-9)
    fluid = VonMises(SOIL, 4e3, 0.0, 60e3)
    new, after, tangent = fluid.tangent(strain, stress, history)
    assert np.isfinite(after).all()
    np.testing.assert_allclose(deviator(new), 0.0, atol=1e-9)
    bulk = np.zeros((6, 6))
    bulk[:3, :3] = SOIL.lame[0] + 2 / 3 * G
    np.testing.assert_allclose(tangent, np.broadcast_to(bulk, tangent.shape), rtol=1e-12, atol=1e-9)


def test_no_points_are_no_trouble():
    stress, history, tangent = LAW.tangent(np.zeros((0, 4)), np.zeros((0, 4)), np.zeros((0, 1)))
    assert stress.shape == (0, 4) and history.shape == (0, 1) and tangent.shape == (0, 4, 4)


def test_both_laws_answer_to_the_same_names():
    assert SOIL.history == () and LAW.history == ("plastic_strain",)
    assert (LAW.density, LAW.lame) == (SOIL.density, SOIL.lame)
    assert (LAW.p_speed, LAW.s_speed) == (SOIL.p_speed, SOIL.s_speed)
    strain, stress, _ = states("softening", 4)
    none = np.zeros((len(strain), 0))
    new, after, tangent = SOIL.tangent(strain, stress, none)
    np.testing.assert_array_equal(new, SOIL.respond(strain, stress, none)[0])
    np.testing.assert_allclose(
        new, stress + np.einsum("pij,pj->pi", tangent, strain), rtol=1e-12, atol=1e-9
    )
    assert after.shape == none.shape
    assert (SOIL.strength(none) == np.inf).all() and (SOIL.dissipation(none, after) == 0).all()
    assert LAW.strength(np.zeros((1, 1)))[0] == pytest.approx(17.32e3, rel=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"elastic": 1.0}, "elastic .* 1.0"),
        ({"peak": 0.0}, "peak must be positive, got 0.0"),
        ({"peak": math.nan}, "peak must be finite, got nan"),
        ({"residual": -1.0}, "residual must not be negative, got -1.0"),
        ({"residual": 11e3}, "residual must not exceed peak = 10000.0, got 11000.0"),
        ({"softening": -5.0}, "softening must not be negative, got -5.0"),
        ({"softening": math.inf}, "softening must be finite, got inf"),
        ({"softening": "soft"}, "softening must be a number, got 'soft'"),
        (
            {"softening": 1.001 * ROOT3 * G},
            f"softening must stay below .*snaps back, got {1.001 * ROOT3 * G}",
        ),
        ({"length": 0.0}, "length must be positive, got 0.0"),
    ],
)
def test_refusals(change, message):
    with pytest.raises(ValueError, match=message):
        VonMises(**{"elastic": SOIL, "peak": 10e3, "residual": 4e3, "softening": 60e3, **change})


def test_just_below_snap_back_there_is_still_one_root():
    steep = VonMises(SOIL, 10e3, 4e3, 0.999 * ROOT3 * G)
    strain = np.array([[0, 0, 0, 1.0001 * steep.peak / G]])
    new, after = steep.respond(strain, np.zeros((1, 4)), np.zeros((1, 1)))
    assert tensors.von_mises(new)[0] == pytest.approx(
        ROOT3 * cohesion(after[0, 0], steep), rel=1e-12
    )


def test_shapes_are_checked_before_compiled_loops_run():
    strain, stress, history = states("softening", 4, n=5)
    with pytest.raises(ValueError, match=r"stress must have shape \(5, 4\), got \(4, 4\)"):
        LAW.respond(strain, stress[:4], history)
    with pytest.raises(ValueError, match=r"history must have shape \(5, 1\), got \(5, 2\)"):
        LAW.respond(strain, stress, np.zeros((5, 2)))
    with pytest.raises(ValueError, match=r"strain must have shape .*got \(5, 3\)"):
        LAW.respond(strain[:, :3], stress[:, :3], history)
    with pytest.raises(
        ValueError, match=r"size must be a number or have shape \(5,\), got shape \(3,\)"
    ):
        VonMises(SOIL, 10e3, 4e3, 60e3, length=1.0).respond(
            strain, stress, history, {"size": np.ones(3)}
        )
