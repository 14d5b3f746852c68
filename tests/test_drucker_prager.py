"""Drucker-Prager: where it is Mohr-Coulomb, the equations of the return, its tangent, and what is
refused."""

import math
from itertools import pairwise

import numpy as np
import pytest
from laws import deviatoric, plastic_strain, random_states, tangent_errors, turned
from scipy.spatial.transform import Rotation
from single_point import drive

from mpm_fenicsx import Curve, DruckerPrager, LinearElastic, MatchedTo, VonMises, tensors

SOIL = LinearElastic(young=20e6, poisson=0.3, density=1800.0)
C = 10e3
FALLING = Curve([0.0, 0.02, 0.05], [10e3, 12e3, 4e3])
MOBILISED = Curve([0.0, 0.01, 0.05], [25.0, 33.0, 28.0])
FADING = Curve([0.0, 0.05], [10.0, 0.0])
LAWS = {
    "dilatant": DruckerPrager(SOIL, C, 30.0, 10.0),
    "isochoric": DruckerPrager(SOIL, C, 30.0, 0.0, MatchedTo.EXTENSION),
    "associated": DruckerPrager(SOIL, C, 30.0, 30.0, MatchedTo.PLANE_STRAIN),
    "cut off": DruckerPrager(SOIL, C, 30.0, 10.0, MatchedTo.PLANE_STRAIN, tensile_strength=5e3),
    "dry sand": DruckerPrager(SOIL, 0.0, 35.0, 5.0),
    "no friction": DruckerPrager(SOIL, C, 0.0, tensile_strength=2e3),
    **{
        f"following, {matched.name}": DruckerPrager(
            SOIL, FALLING, MOBILISED, FADING, matched, tensile
        )
        for matched, tensile in zip(MatchedTo, (None, 3e3, 3e3), strict=True)
    },
}
EVERY = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
BOTH = pytest.mark.parametrize("count", [4, 6])


def states(law, count, n=2000, seed=0):
    strain, stress, history = random_states(law, count, n, seed, kappa=0.06)
    if law.perfect:
        history[:, 0] = 0.0
    return strain, stress, history


def at(law, name, kappa):
    value = getattr(law, name)
    return value(kappa) if isinstance(value, Curve) else np.full(len(kappa), value)


def cone(law, kappa):
    """η, k and T (n,) at κ, written down anew."""
    sine, tangent = (f(np.radians(at(law, "friction_angle", kappa))) for f in (np.sin, np.tan))
    flow = np.sin(np.radians(at(law, "dilation_angle", kappa)))
    if law.matched_to is MatchedTo.PLANE_STRAIN:
        own = flow / np.sqrt(1 + flow**2 / 3)
        η = sine / (np.sqrt(1 - own**2 / 3) + own * sine / 3)
    else:
        η = (
            6
            * sine
            / np.sqrt(3)
            / (3 + (1 if law.matched_to is MatchedTo.EXTENSION else -1) * sine)
        )
    c = at(law, "cohesion", kappa)
    with np.errstate(divide="ignore", invalid="ignore"):
        k = np.where(sine > 0.0, η * c / tangent, c * 2 / np.sqrt(3))
        T = np.minimum(np.inf if law.tensile_strength is None else law.tensile_strength, k / η)
    return η, k, T


# -- where it is Mohr-Coulomb ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("φ", "ψ", "c"), [(30, 0, 10e3), (30, 10, 10e3), (20, 20, 5e3), (0, 0, 5e3)]
)
@pytest.mark.parametrize("matched", [MatchedTo.COMPRESSION, MatchedTo.EXTENSION])
def test_triaxial_paths(matched, φ, ψ, c):
    """Shortened, or drawn out, along y by 4 %, under a held pressure of 100 kPa at the sides."""
    p0, sign = 100e3, 1 if matched is MatchedTo.EXTENSION else -1
    strain = np.array([0, 0.04 * sign, 0, 0, 0, 0])
    law = DruckerPrager(SOIL, c, φ, ψ, matched)
    path = drive(law, strain, 20, (0, 2), [-p0, -p0, -p0, 0, 0, 0])
    Kp = math.tan(math.pi / 4 + math.radians(φ) / 2) ** 2
    q = p0 * (Kp - 1) + 2 * c * math.sqrt(Kp)
    if sign == 1:  # the axial stress is now the smallest pressure
        q = p0 * (1 - 1 / Kp) + 2 * c / math.sqrt(Kp)
    assert sign * (path.stress[-1, 1] - path.stress[-1, 0]) == pytest.approx(q, rel=1e-10)
    np.testing.assert_allclose(path.stress[-1, [0, 2]], -p0, rtol=1e-10)
    late, sine = path.strain[-1] - path.strain[-5], math.sin(math.radians(ψ))
    dilation = late[:3].sum() / late[1]
    exact = 2 * sine / (1 + sine) if sign == 1 else -2 * sine / (1 - sine)
    assert dilation == pytest.approx(exact, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize(("φ", "ψ"), [(30, 0), (30, 10), (20, 20), (0, 0)])
def test_plane_strain_comes_to_rest_on_the_planes_of_mohr_and_coulomb(φ, ψ):
    law = DruckerPrager(SOIL, C, φ, ψ, MatchedTo.PLANE_STRAIN)
    path = drive(law, [0.0, -0.3, 0.0, 0.0], 400, (0,), [-100e3, -100e3, -100e3, 0.0])
    Kp = math.tan(math.pi / 4 + math.radians(φ) / 2) ** 2
    q = 100e3 * (Kp - 1) + 2 * C * math.sqrt(Kp)
    assert path.stress[-1, 0] - path.stress[-1, 1] == pytest.approx(q, rel=1e-10)
    late, sine = path.strain[-1] - path.strain[-5], math.sin(math.radians(ψ))
    assert late[:3].sum() / late[1] == pytest.approx(-2 * sine / (1 - sine), rel=1e-8, abs=1e-8)


@BOTH
@pytest.mark.parametrize("ψ", [0.0, 30.0])
def test_isotropic_tension_ends_at_the_apex_or_the_limit(count, ψ):
    apex = C / math.tan(math.radians(30.0))
    strain = np.zeros(count)
    strain[:3] = 0.01
    for tension, exact in ((None, apex), (5e3, 5e3), (1e6, apex)):
        law = DruckerPrager(SOIL, C, 30.0, ψ, tensile_strength=tension)
        path = drive(law, strain, 3)
        np.testing.assert_allclose(path.stress[-1, :3], exact, rtol=1e-12)
        bulk = SOIL.lame[0] + 2 / 3 * SOIL.lame[1]
        assert path.history[-1, 1] == pytest.approx(exact * (0.03 - exact / bulk), rel=1e-10)


@pytest.mark.parametrize("steps", [1, 13])
def test_without_friction_it_is_von_mises(steps):
    """Matched in compression, q = 2 c = √3 of von Mises's cohesion; softening included."""
    curve = Curve([0.0, 0.1], [10e3, 4e3])
    law = DruckerPrager(SOIL, curve, 0.0)
    share = 2 / math.sqrt(3)
    other = VonMises(SOIL, share * 10e3, share * 4e3, share * 60e3)
    strain = np.array([0.02, -0.03, 0.0, 0.3, 0.01, -0.05])
    mine, its = drive(law, strain, steps), drive(other, strain, steps)
    np.testing.assert_allclose(mine.stress, its.stress, rtol=1e-10, atol=1e-6)
    np.testing.assert_allclose(mine.history[:, 0], its.history[:, 0], rtol=1e-10, atol=1e-13)


def test_curves_are_followed_to_first_order():
    law = LAWS["following, PLANE_STRAIN"]
    strain, start = np.array([0.03, -0.03, 0.0, 0.01]), np.array([-5e4, -5e4, -5e4, 0.0])
    ends = [drive(law, strain, steps, start=start).stress[-1] for steps in (40, 80, 160)]
    first, second = (np.linalg.norm(b - a) for a, b in pairwise(ends))
    assert 1.7 < first / second < 2.3


# -- the return ------------------------------------------------------------------------------------


@EVERY
@BOTH
def test_stress_after_flow_is_on_the_yield_surface(count, law):
    strain, stress, history = states(law, count)
    new, after = law.respond(strain, stress, history)
    flows = after[:, 1] != history[:, 1]
    assert 0.15 < flows.mean() < 0.9
    η, k, T = cone(law, after[:, 0])
    p, j = tensors.mean(new), tensors.von_mises(new) / math.sqrt(3)
    off = np.maximum(j + η * p - k, p - T) / (np.abs(p) + j + C)
    assert off.max() <= 1e-12
    assert np.abs(off[flows]).max() <= 1e-12


@EVERY
@BOTH
def test_tangent_is_the_derivative(count, law):
    strain, stress, history = states(law, count)
    error = tangent_errors(law, strain, stress, history)
    flows = law.respond(strain, stress, history)[1][:, 1] != history[:, 1]
    assert np.median(error[flows]) < 1e-9
    assert error.max() < 1e-6
    tangent = law.tangent(strain, stress, history)[2]
    askew = np.abs(tangent - tangent.transpose(0, 2, 1)).max() / SOIL.young
    assert law.symmetric == (askew < 1e-9)


@EVERY
def test_history_is_plastic_strain_and_work(law):
    strain, stress, history = states(law, 6)
    new, after = law.respond(strain, stress, history)
    plastic = plastic_strain(law, strain, stress, new)
    np.testing.assert_allclose(
        after[:, 0] - history[:, 0], deviatoric(plastic), rtol=1e-8, atol=1e-13
    )
    work = (new * plastic).sum(axis=1)
    np.testing.assert_allclose(after[:, 1] - history[:, 1], work, rtol=1e-8, atol=1e-8)


@EVERY
def test_flow_is_along_the_potential(law):
    """On the cone: deviator with s/2j, volume with η̄, of one multiplier."""
    strain, stress, history = states(law, 6)
    new, after = law.respond(strain, stress, history)
    plastic = plastic_strain(law, strain, stress, new)
    p, j = tensors.mean(new), tensors.von_mises(new) / math.sqrt(3)
    _, _, T = cone(law, after[:, 0])
    on = (after[:, 1] != history[:, 1]) & (p < T * (1 - 1e-9) - 1e-3) & (j > 1.0)
    assert on.any()
    multiplier = math.sqrt(3) * deviatoric(plastic)[on]
    sine = np.sin(np.radians(at(law, "dilation_angle", after[on, 0])))
    sign = 1 if law.matched_to is MatchedTo.EXTENSION else -1
    η_flow = 6 * sine / np.sqrt(3) / (3 + sign * sine)
    if law.matched_to is MatchedTo.PLANE_STRAIN:
        η_flow = 3 * sine / np.sqrt(9 + 3 * sine**2)
    np.testing.assert_allclose(
        plastic[on, :3].sum(axis=1), η_flow * multiplier, rtol=1e-7, atol=1e-12
    )
    s = new[on].copy()
    s[:, :3] -= p[on, None]
    shear = plastic[on, 3:] - (multiplier / j[on])[:, None] * s[:, 3:]
    assert np.abs(shear).max() < 1e-10


@EVERY
def test_directions_do_not_matter(law):
    strain, stress, history = states(law, 6, 500)
    rotation = Rotation.random(random_state=1).as_matrix()
    new, after = law.respond(strain, stress, history)
    again, too = law.respond(turned(strain, rotation, 0.5), turned(stress, rotation), history)
    np.testing.assert_allclose(again, turned(new, rotation), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(too, after, rtol=1e-8, atol=1e-10)


@EVERY
@BOTH
def test_yields_tells_the_pairs_that_flow(count, law):
    strain, stress, history = states(law, count)
    rng = np.random.default_rng(2)
    first, of = (rng.integers(0, len(strain), 3000).astype(np.int32) for _ in range(2))
    after = law.respond(strain[first], stress[of], history[of])[1]
    flows = np.flatnonzero((after != history[of]).any(axis=1))
    np.testing.assert_array_equal(law.yields(strain, stress, history, first, of), flows)


# -- parameters and refusals -----------------------------------------------------------------------


def test_values_point_by_point():
    law, n = LAWS["cut off"], 6
    strain, stress, history = states(law, 6, n)
    ratio = np.linspace(0.5, 1.5, n)
    base = {"cohesion": 10e3, "friction_angle": 30.0, "dilation_angle": 10.0}
    given = {key: value * ratio for key, value in base.items()}
    together = law.tangent(5 * strain, stress, history, given)
    for p, r in enumerate(ratio):
        own = DruckerPrager(
            SOIL, *(v * r for v in base.values()), MatchedTo.PLANE_STRAIN, tensile_strength=5e3
        )
        single = own.tangent(5 * strain[p : p + 1], stress[p : p + 1], history[p : p + 1])
        for one, many in zip(single, together, strict=True):
            np.testing.assert_allclose(many[p], one[0], rtol=1e-9, atol=1e-6)


def test_snap_back_is_refused():
    """In triaxial compression 3 G (ε - κ) = q = 2 c(κ), without friction in any state."""
    limit = 1.5 * SOIL.lame[1]
    DruckerPrager(SOIL, Curve([0.0, 1e-3], [2 * limit * 1e-3, 1.001 * limit * 1e-3]), 0.0)
    with pytest.raises(ValueError, match=r"cohesion must not fall by .* snaps back, got"):
        DruckerPrager(SOIL, Curve([0.0, 1e-3], [2 * limit * 1e-3, 0.999 * limit * 1e-3]), 0.0)


def test_a_name_is_no_matching():
    with pytest.raises(ValueError, match=r"matched_to must be a MatchedTo, .* got 'compression'"):
        DruckerPrager(SOIL, C, 30.0, matched_to="compression")


def test_initial_stress_outside_is_refused():
    with pytest.raises(ValueError, match=r"stress must lie inside the yield surface.* at point 0"):
        LAWS["dry sand"].initial_history(np.array([[1e3, 1e3, 1e3, 0.0]]))
