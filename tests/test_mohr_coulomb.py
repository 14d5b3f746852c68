"""Mohr-Coulomb and Tresca: paths with exact answers, the equations of the return, its tangent, and
what is refused."""

import math
import warnings
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from laws import (
    deviatoric,
    full,
    plastic_strain,
    random_states,
    tangent_errors,
    turned,
)
from scipy.integrate import solve_ivp
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation
from single_point import drive

from mpm_fenicsx import Curve, LinearElastic, MohrCoulomb, OverNonlocal, Tresca, VonMises

SOIL = LinearElastic(young=20e6, poisson=0.3, density=1800.0)
C = 10e3
FALLING = Curve([0.0, 0.02, 0.05], [10e3, 12e3, 4e3])
MOBILISED = Curve([0.0, 0.01, 0.05], [25.0, 33.0, 28.0])
FADING = Curve([0.0, 0.05], [10.0, 0.0])
LAWS = {
    "dilatant": MohrCoulomb(SOIL, C, 30.0, 10.0),
    "isochoric": MohrCoulomb(SOIL, C, 30.0, 0.0),
    "associated": MohrCoulomb(SOIL, C, 30.0, 30.0),
    "cut off": MohrCoulomb(SOIL, C, 30.0, 10.0, tensile_strength=5e3),
    "no tension": MohrCoulomb(SOIL, C, 35.0, 5.0, tensile_strength=0.0),
    "dry sand": MohrCoulomb(SOIL, 0.0, 35.0, 5.0),
    "Tresca": Tresca(SOIL, C),
    "Tresca cut off": Tresca(SOIL, C, tensile_strength=2e3),
    "following": MohrCoulomb(SOIL, FALLING, MOBILISED, FADING),
    "following, cut off": MohrCoulomb(SOIL, FALLING, MOBILISED, FADING, tensile_strength=3e3),
    "falling": MohrCoulomb(SOIL, FALLING, 30.0, 10.0),
    "falling, cut off": MohrCoulomb(SOIL, FALLING, 30.0, 0.0, tensile_strength=12e3),
    "softening clay": Tresca(SOIL, Curve([0.0, 0.05], [10e3, 3e3])),
}
EVERY = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
BOTH = pytest.mark.parametrize("count", [4, 6])


def at(law, name, kappa):
    """A parameter at κ (n,)."""
    value = getattr(law, name)
    return value(kappa) if isinstance(value, Curve) else np.full(len(kappa), value)


def principal(stress):
    """σ_1 >= σ_2 >= σ_3 (n, 3), by NumPy."""
    if stress.shape[1] == 4:
        stress = np.hstack([stress, np.zeros((len(stress), 2))])
    return np.linalg.eigvalsh(full(stress))[:, ::-1]


def bounds(law, kappa):
    """sin φ, 2 c cos φ and T (n,) at κ."""
    φ = np.radians(at(law, "friction_angle", kappa))
    c = at(law, "cohesion", kappa)
    T = np.inf if law.tensile_strength is None else law.tensile_strength
    with np.errstate(divide="ignore"):
        apex = np.where(φ > 0.0, c / np.tan(φ), np.inf)
    return np.sin(φ), 2.0 * c * np.cos(φ), np.minimum(T, apex)


def excess(law, stress, kappa):
    """How far stress is beyond the yield surface (n,), Pa."""
    s = principal(stress)
    sine, shear, T = bounds(law, kappa)
    return np.maximum((1 + sine) * s[:, 0] - (1 - sine) * s[:, 2] - shear, s[:, 0] - T)


def states(law, count, n=2000, seed=0):
    strain, stress, history = random_states(law, count, n, seed, kappa=0.06)
    if law.perfect:
        history[:, 0] = 0.0
    return strain, stress, history


# -- paths -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("φ", "ψ", "c"), [(30, 0, 10e3), (30, 10, 10e3), (20, 20, 5e3), (0, 0, 5e3)]
)
@pytest.mark.parametrize("kind", ["triaxial", "plane strain", "plane strain in 3D"])
def test_compression(kind, φ, ψ, c):
    """Soil under 100 kPa, shortened by 4 %, the stress at its sides held."""
    p0, count = 100e3, 4 if kind == "plane strain" else 6
    strain, start = np.zeros(count), np.zeros(count)
    strain[1], start[:3] = -0.04, -p0
    free = (0, 2) if kind == "triaxial" else (0,)
    path = drive(MohrCoulomb(SOIL, c, φ, ψ), strain, 20, free, start)
    Kp = math.tan(math.pi / 4 + math.radians(φ) / 2) ** 2
    q = p0 * (Kp - 1) + 2 * c * math.sqrt(Kp)
    found = path.stress[-1, 0] - path.stress[-1, 1]
    assert found == pytest.approx(q, rel=1e-10)
    middle = p0 if kind == "triaxial" else p0 + SOIL.poisson * q
    assert path.stress[-1, 2] == pytest.approx(-middle, rel=1e-10)
    late = path.strain[-1] - path.strain[-5]
    sine = math.sin(math.radians(ψ))
    assert late[:3].sum() / late[1] == pytest.approx(-2 * sine / (1 - sine), rel=1e-8, abs=1e-8)


@BOTH
def test_simple_shear_of_tresca(count):
    strain = np.zeros(count)
    strain[3] = 0.01
    path = drive(LAWS["Tresca"], strain, 100)
    exact = np.minimum(SOIL.lame[1] * path.strain[:, 3], C)
    np.testing.assert_allclose(path.stress[:, 3], exact, rtol=1e-11, atol=1e-8)
    np.testing.assert_allclose(path.stress[:, :3], 0.0, atol=1e-8)
    γ = 0.01 - C / SOIL.lame[1]
    np.testing.assert_allclose(path.history[-1], [γ / math.sqrt(3), C * γ], rtol=1e-10)


@pytest.mark.parametrize("ψ", [0.0, 10.0, 30.0])
@BOTH
def test_isotropic_tension_ends_at_the_apex_or_the_cut_off(count, ψ):
    apex = C / math.tan(math.radians(30.0))
    strain = np.zeros(count)
    strain[:3] = 0.01
    for tension, exact in ((None, apex), (5e3, 5e3), (1e6, apex)):
        law = MohrCoulomb(SOIL, C, 30.0, ψ, tensile_strength=tension)
        path = drive(law, strain, 3)
        np.testing.assert_allclose(path.stress[-1, :3], exact, rtol=1e-12)
        assert path.history[-1, 0] < 1e-16  # no deviatoric strain
        bulk = SOIL.lame[0] + 2 / 3 * SOIL.lame[1]
        work = exact * (0.03 - exact / bulk)
        assert path.history[-1, 1] == pytest.approx(work, rel=1e-10)


def test_uniaxial_tension_is_cut_off():
    """The other stresses follow elastically: Δσ = λ/(λ + 2μ) of none."""
    strain = np.zeros(6)
    strain[0] = 0.01
    path = drive(LAWS["cut off"], strain, 10, free=(1, 2))
    np.testing.assert_allclose(path.stress[-1], [5e3, 0, 0, 0, 0, 0], atol=1e-6)


def rate_equations(law, start, rate, knots):
    """Stress (3,) and κ at t = 1 of a point whose principal strains grow at ``rate`` (3,), in fixed
    axes and with a fixed direction of flow, by SciPy, from one corner of the curves to the next."""
    λ, μ = law.lame
    D, sine = λ + 2 * μ * np.eye(3), math.sin(math.radians(law.dilation_angle))
    m = np.array([1 + sine, 0.0, sine - 1])
    per = math.sqrt(2 / 3) * np.linalg.norm(m - m.mean())  # κ per multiplier

    def surface(κ, begin, end):
        """n, bound and their slopes on a piece of the curves."""
        share = (κ - begin) / (end - begin)
        (c0, φ0), (c1, φ1) = (
            (law.cohesion(k), math.radians(law.friction_angle(k))) for k in (begin, end)
        )
        c, φ = c0 + share * (c1 - c0), φ0 + share * (φ1 - φ0)
        dc, dφ = (c1 - c0) / (end - begin), (φ1 - φ0) / (end - begin)
        n = np.array([1 + math.sin(φ), 0.0, math.sin(φ) - 1])
        dn = np.array([1.0, 0.0, 1.0]) * math.cos(φ) * dφ
        return n, 2 * c * math.cos(φ), dn, 2 * (dc * math.cos(φ) - c * math.sin(φ) * dφ)

    n, bound, _, _ = surface(knots[0], *knots[:2])
    t = (bound - n @ start) / (n @ D @ rate)
    y = np.array([*(start + t * D @ rate), 0.0])
    for begin, end in pairwise(knots):

        def rates(t, y, begin=begin, end=end):
            n, _, dn, dbound = surface(y[3], begin, end)
            multiplier = n @ D @ rate / (n @ D @ m + (dbound - dn @ y[:3]) * per)
            return [*(D @ (rate - multiplier * m)), per * multiplier]

        def at_the_corner(t, y, end=end):
            return y[3] - end

        at_the_corner.terminal = True
        part = solve_ivp(rates, (t, 1.0), y, "DOP853", events=at_the_corner, rtol=1e-13, atol=1e-10)
        t, y = part.t[-1], part.y[:, -1]
        if t >= 1.0:
            return y[:3], y[3]
    raise AssertionError("the curves end before the path")


@pytest.mark.parametrize("steps", [1, 7, 50])
def test_following_curves_is_the_solution_of_the_rate_equations(steps):
    """Where axes and direction of flow stay, the return is exact at any step."""
    law = MohrCoulomb(SOIL, FALLING, MOBILISED, 8.0)
    strain = np.array([0.025, -0.03, 0.0, 0.0])
    for part, after in ((0.7, 0.01), (1.2, 0.02), (3.0, 0.05)):
        path = drive(law, part * strain, steps, start=[-50e3, -50e3, -50e3, 0.0])
        s, κ = rate_equations(
            law, np.full(3, -50e3), part * strain[[0, 2, 1]], [0.0, 0.01, 0.02, 0.05, 1.0]
        )
        assert after < κ
        np.testing.assert_allclose(path.stress[-1, [0, 2, 1]], s, rtol=1e-10)
        assert path.history[-1, 0] == pytest.approx(κ, rel=1e-10)


def test_a_dilation_angle_that_changes_is_followed_to_first_order():
    law = MohrCoulomb(SOIL, C, 30.0, FADING)
    strain, start = np.array([0.03, -0.03, 0.0, 0.01]), np.array([-5e4, -5e4, -5e4, 0.0])
    ends = [drive(law, strain, steps, start=start).stress[-1] for steps in (20, 40, 80)]
    first, second = (np.linalg.norm(b - a) for a, b in pairwise(ends))
    assert 1.8 < first / second < 2.2


# -- the return ------------------------------------------------------------------------------------


@EVERY
@BOTH
def test_stress_after_flow_is_on_the_yield_surface(count, law):
    strain, stress, history = states(law, count)
    new, after = law.respond(strain, stress, history)
    flows = after[:, 1] != history[:, 1]
    assert 0.2 < flows.mean() < 0.9
    scale = np.abs(new).max(axis=1) + C
    off = excess(law, new, after[:, 0]) / scale
    assert off.max() <= 1e-12
    assert np.abs(off[flows]).max() <= 1e-12


def planes(sine):
    """Six rows (6, 3) of the planes between sorted principal stresses."""
    rows = np.zeros((6, 3))
    for k, (i, j) in enumerate(((0, 2), (0, 1), (1, 2))):
        rows[k, i], rows[k, j] = 1 + sine, sine - 1
    rows[3:] = np.eye(3)
    return rows


@EVERY
def test_flow_is_a_sum_of_those_of_the_planes_that_are_active(law):
    """With multipliers that are not negative: what Koiter's rule asks."""
    strain, _, history = states(law, 6, 400)
    strain[:, 3:] = 0.0
    strain[:, :3] = np.sort(strain[:, :3], axis=1)[:, ::-1]
    stress = np.zeros_like(strain)
    new, after = law.respond(strain, stress, history)
    plastic = plastic_strain(law, strain, stress, new)[:, :3]
    sine, shear, T = bounds(law, after[:, 0])
    ψ = np.radians(at(law, "dilation_angle", after[:, 0]))
    for p in np.flatnonzero(np.abs(plastic).max(axis=1) > 1e-9):
        size = np.abs(strain[p]).max() * SOIL.young
        bound = np.array([shear[p]] * 3 + [T[p]] * 3)
        active = planes(sine[p]) @ new[p, :3] - bound > -1e-9 * size
        _, left = nnls(planes(math.sin(ψ[p]))[active].T, plastic[p] / np.abs(plastic[p]).max())
        assert left < 1e-6


@EVERY
@BOTH
def test_tangent_is_the_derivative(count, law):
    strain, stress, history = states(law, count)
    error = tangent_errors(law, strain, stress, history)
    flows = law.respond(strain, stress, history)[1][:, 1] != history[:, 1]
    assert np.median(error[flows]) < 1e-9
    assert error.max() < 1e-6


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
    np.testing.assert_array_equal(law.plastic_work(after), after[:, 1])


@EVERY
def test_directions_do_not_matter(law):
    strain, stress, history = states(law, 6, 500)
    stress[:, 3:] = 2e3 * np.random.default_rng(3).normal(size=(500, 3))
    rotation = Rotation.random(random_state=1).as_matrix()
    new, after = law.respond(strain, stress, history)
    again, too = law.respond(turned(strain, rotation, 0.5), turned(stress, rotation), history)
    np.testing.assert_allclose(again, turned(new, rotation), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(too, after, rtol=1e-8, atol=1e-10)


@EVERY
def test_plane_strain_is_a_part_of_space(law):
    strain, stress, history = states(law, 4, 500)
    wide = [np.hstack([rows, np.zeros((500, 2))]) for rows in (strain, stress)]
    new, after, tangent = law.tangent(strain, stress, history)
    other, too, stiff = law.tangent(*wide, history)
    np.testing.assert_allclose(other[:, :4], new, rtol=1e-10, atol=1e-7)
    np.testing.assert_allclose(too, after, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(stiff[:, :4, :4], tangent, atol=1e-6 * SOIL.young)


@EVERY
@BOTH
def test_yields_tells_the_pairs_that_flow(count, law):
    strain, stress, history = states(law, count)
    rng = np.random.default_rng(2)
    first, of = (rng.integers(0, len(strain), 3000).astype(np.int32) for _ in range(2))
    after = law.respond(strain[first], stress[of], history[of])[1]
    flows = np.flatnonzero((after != history[of]).any(axis=1))
    np.testing.assert_array_equal(law.yields(strain, stress, history, first, of), flows)


@EVERY
def test_what_is_on_the_surface_rests_there(law):
    strain, stress, history = states(law, 6)
    strain *= min(1.0, 3e-3 / np.abs(strain).max())
    new, after = law.respond(strain, stress, history)
    again, too, tangent = law.tangent(0 * strain, new, after)
    np.testing.assert_array_equal(again, new)
    np.testing.assert_array_equal(too, after)
    np.testing.assert_array_equal(tangent, SOIL.tangent(0 * strain, new, after)[2])


def test_tresca_is_mohr_coulomb_without_friction():
    law, other = LAWS["Tresca"], MohrCoulomb(SOIL, C, 0.0)
    strain, stress, history = states(law, 6)
    for mine, its in zip(
        law.tangent(strain, stress, history), other.tangent(strain, stress, history), strict=True
    ):
        np.testing.assert_array_equal(mine, its)
    assert law.symmetric and other.symmetric and law.keeps_volume and other.keeps_volume


@EVERY
def test_it_is_symmetric_where_it_says_so(law):
    tangent = law.tangent(*states(law, 6))[2]
    askew = np.abs(tangent - tangent.transpose(0, 2, 1)).max() / SOIL.young
    assert law.symmetric == (askew < 1e-9)


def test_a_point_in_shear_softens_as_von_mises_does():
    """In simple shear Tresca's c and von Mises's are one."""
    steep = 60e3
    law = Tresca(SOIL, Curve([0.0, 0.1], [10e3, 4e3]))
    other = VonMises(SOIL, 10e3, 4e3, steep)
    strain = np.array([0.0, 0.0, 0.0, 0.3])
    mine, its = drive(law, strain, 40), drive(other, strain, 40)
    np.testing.assert_allclose(mine.stress, its.stress, rtol=1e-10, atol=1e-7)
    np.testing.assert_allclose(mine.history[:, 0], its.history[:, 0], rtol=1e-10, atol=1e-13)


# -- parameters ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cut off", "following, cut off"])
def test_values_point_by_point(name):
    law, n = LAWS[name], 6
    strain, stress, history = states(law, 6, n)
    strain *= 5
    ratio = np.linspace(0.5, 1.5, n)
    base = {"cohesion": 10e3, "friction_angle": at(law, "friction_angle", np.zeros(1))[0]}
    base["dilation_angle"] = 10.0
    given = {key: value * ratio for key, value in base.items()}
    given["tensile_strength"] = 4e3 * ratio
    together = law.tangent(strain, stress, history, given)

    def scaled(value, r):
        if isinstance(value, Curve):
            return Curve(value.plastic_strain, r * np.array(value.value))
        return r * value

    for p, r in enumerate(ratio):
        own = MohrCoulomb(
            SOIL,
            *(scaled(getattr(law, key), r) for key in base),
            tensile_strength=4e3 * r,
        )
        single = own.tangent(strain[p : p + 1], stress[p : p + 1], history[p : p + 1])
        for one, many in zip(single, together, strict=True):
            np.testing.assert_allclose(many[p], one[0], rtol=1e-9, atol=1e-6)


def test_softening_scaled_by_size():
    """Beyond its peak a curve is followed size/length times as fast."""
    curve = Curve([0.0, 0.01, 0.05], [8e3, 10e3, 4e3])
    law = Tresca(SOIL, curve, length=0.5)
    strain, stress, history = states(LAWS["Tresca"], 6, 50)
    sizes = np.array([0.25, 0.5, 1.0])
    for size in sizes:
        own = Tresca(SOIL, Curve([0.0, 0.01, 0.01 + 0.04 * 0.5 / size], curve.value))
        mine = law.tangent(strain, stress, history, {"size": np.full(50, size)})
        for a, b in zip(mine, own.tangent(strain, stress, history), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-6)
    with pytest.raises(ValueError, match=r"size is required, because length = 0\.5"):
        law.respond(strain, stress, history)


@dataclass(frozen=True)
class Averaging:
    length: float = 0.2
    weight: float = 2.0


def test_strengths_go_by_the_nonlocal_strain():
    curve = Curve([0.0, 0.1], [10e3, 4e3])
    law = Tresca(SOIL, curve, averaging=Averaging())
    assert law.history == ("plastic_strain", "plastic_work", "nonlocal_strain")
    strain, stress, history = states(LAWS["Tresca"], 6, 300)
    history = np.hstack([history, np.zeros((300, 1))])
    history[:, 2] = np.random.default_rng(0).uniform(0.0, 0.08, 300)
    history[:, 0] = 0.01
    new, after, _ = law.tangent(strain, stress, history)
    np.testing.assert_array_equal(after[:, 2], history[:, 2])
    s = principal(new)
    strength = curve(np.maximum(0.0, 2.0 * after[:, 2] - after[:, 0]))
    flows = after[:, 1] != history[:, 1]
    assert flows.mean() > 0.3
    np.testing.assert_allclose((s[:, 0] - s[:, 2])[flows], 2 * strength[flows], rtol=1e-11)
    error = tangent_errors(law, strain, stress, history)
    assert np.median(error[flows]) < 1e-9 and error.max() < 1e-6


def test_no_points_are_no_trouble():
    """A rank may hold none."""
    law, none = LAWS["following, cut off"], np.zeros((0, 4))
    given = {name: np.zeros(0) for name in law.parameters}
    stress, history, tangent = law.tangent(none, none, np.zeros((0, 2)), given)
    assert stress.shape == (0, 4) and history.shape == (0, 2) and tangent.shape == (0, 4, 4)
    assert len(law.yields(none, none, np.zeros((0, 2)), *np.zeros((2, 0), np.int32), given)) == 0
    assert law.initial_history(none, given).shape == (0, 2)


def test_a_dilation_angle_of_zero_may_be_given():
    law = MohrCoulomb(SOIL, C, 30.0, 0.0)
    strain, stress, history = states(law, 4, 50)
    mine = law.tangent(strain, stress, history, {"dilation_angle": np.full(50, 10.0)})
    for a, b in zip(mine, LAWS["dilatant"].tangent(strain, stress, history), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-6)


# -- refusals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"elastic": 1.0}, r"elastic .* 1\.0"),
        ({"cohesion": -1.0}, r"cohesion must not be negative, got -1\.0"),
        ({"cohesion": "c"}, "cohesion must be a number, got 'c'"),
        ({"friction_angle": 90.0}, r"friction_angle must be below 90 degrees, got 90\.0"),
        ({"friction_angle": -1.0, "dilation_angle": -2.0}, r"friction_angle .* got -1\.0"),
        ({"dilation_angle": 31.0}, r"dilation_angle must not exceed .* 30\.0, .* got 31\.0"),
        ({"dilation_angle": -1.0}, r"dilation_angle must not be negative, got -1\.0"),
        (
            {"dilation_angle": FADING, "friction_angle": Curve([0, 0.04], [12.0, 1.0])},
            r"dilation_angle must not exceed friction_angle = 1\.0, .* got 2\.0",
        ),
        ({"cohesion": 0.0, "friction_angle": 0.0}, r"cohesion must be positive .* got 0\.0"),
        ({"tensile_strength": -5.0}, r"tensile_strength must not be negative, got -5\.0"),
        ({"tensile_strength": math.nan}, "tensile_strength must be finite, got nan"),
        ({"length": 0.0}, r"length must be positive, got 0\.0"),
        ({"length": 1.0, "averaging": Averaging()}, r"length must be None with .* got 1\.0"),
        ({"averaging": Averaging(weight=0.0)}, r"weight of averaging must be positive, got 0\.0"),
    ],
)
def test_refusals(change, message):
    numbers = {"elastic": SOIL, "cohesion": C, "friction_angle": 30.0, "dilation_angle": 0.0}
    with pytest.raises(ValueError, match=message):
        MohrCoulomb(**{**numbers, **change})


def test_snap_back_is_refused():
    """In triaxial compression 3 G (ε - κ) = q = 2 c(κ): snap-back begins where c falls by 1.5 G per
    unit κ, and in shear only at √3 G."""
    edge = 1.5 * SOIL.lame[1]
    for fall, is_refused in ((0.999, False), (1.001, True)):
        curve = Curve([0.0, 1e-3], [2 * edge * 1e-3, (2 - fall) * edge * 1e-3])
        if is_refused:
            with pytest.raises(ValueError, match=r"cohesion must not fall by .* snaps back, got"):
                Tresca(SOIL, curve)
        else:
            Tresca(SOIL, curve)
    law = Tresca(SOIL, Curve([0.0, 0.1], [10e3, 4e3]), length=0.5)
    limit = edge * 0.5 / 60e3
    with pytest.raises(ValueError, match=r"size must stay below .* got 300\.0") as refusal:
        law.respond(*np.zeros((2, 1, 4)), np.zeros((1, 2)), {"size": np.array([300.0])})
    assert float(str(refusal.value).split("below ")[1].split(",")[0]) == pytest.approx(limit)


def test_what_is_given_is_checked():
    law, zeros = LAWS["dilatant"], (np.zeros((3, 4)), np.zeros((3, 4)), np.zeros((3, 2)))
    for name, value, message in (
        ("cohesion", [1.0, -2.0, 3.0], r"cohesion must not be negative, got .* at point 1"),
        ("friction_angle", [30.0, 30.0, 95.0], r"friction_angle .* got 95\.0.* at point 2"),
        ("friction_angle", [30.0, 5.0, 30.0], r"dilation_angle must not exceed .* at point 1"),
        ("tensile_strength", [0.0, -1.0, 0.0], r"tensile_strength .* got -1\.0 at point 1"),
        ("cohesion", [1.0], r"cohesion must have shape \(3,\), got shape \(1,\)"),
    ):
        with pytest.raises(ValueError, match=message):
            law.respond(*zeros, {name: np.array(value)})
    with pytest.raises(ValueError, match="dilation_angle must be given as friction_angle is"):
        LAWS["associated"].respond(*zeros, {"friction_angle": np.array([30.0, 35.0, 30.0])})


def test_initial_stress_outside_is_refused():
    law = MohrCoulomb(SOIL, 0.0, 30.0)
    at_rest = np.array([[-33.4e3, -100e3, -33.4e3, 0.0]])
    assert law.initial_history(at_rest).shape == (1, 2)
    with pytest.raises(ValueError, match=r"stress must lie inside the yield surface.* at point 0"):
        law.initial_history(at_rest * [[0.9, 1.0, 1.0, 1.0]])


@pytest.mark.parametrize(
    ("strain", "value", "message"),
    [
        ([0.0, 1.0], [1.0], "two lists of the same length"),
        ([1.0, 0.5], [1.0, 2.0], "plastic_strain must increase"),
        ([-1.0, 0.5], [1.0, 2.0], "plastic_strain must increase from zero"),
        ([0.0, 0.5], [1.0, math.nan], "value must be finite"),
    ],
)
def test_curves_are_checked(strain, value, message):
    with pytest.raises(ValueError, match=message):
        Curve(strain, value)


def test_an_angle_in_radians_is_told_of():
    with pytest.warns(UserWarning, match=r"friction_angle is in degrees, and 0\.5 .* = 28\.6"):
        MohrCoulomb(SOIL, 5e3, 0.5)


@pytest.mark.parametrize("tension", [None, 12e3])
@pytest.mark.parametrize(
    "more", [{}, {"length": 0.5}, {"averaging": OverNonlocal(0.5, 2.0)}], ids=str
)
@BOTH
def test_the_closed_form_on_a_piece_is_the_root_that_a_search_finds(count, more, tension):
    """Which is made where an angle changes, if by round-off alone; steps cross points of the
    curve, and the planes that are active change in them."""
    barely = Curve([0.0, 1.0], [30.0, 30.0 * (1.0 + 1e-14)])
    strain, stress, history = random_states(LAWS["falling"], count)
    history[:, 0] = np.random.default_rng(5).choice([0.0, 0.004, 0.019, 0.0201, 0.06], 2000)
    given = {"size": np.geomspace(0.1, 1.0, 2000)} if "length" in more else {}
    if "averaging" in more:
        history = np.column_stack([history, 0.9 * history[:, 0]])
    found = [
        MohrCoulomb(SOIL, FALLING, angle, 10.0, tensile_strength=tension, **more).tangent(
            strain, stress, history, given
        )
        for angle in (30.0, barely)
    ]
    assert (found[0][1][:, 0] > history[:, 0]).mean() > 0.2
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-11 * np.abs(other).max())


def test_a_curve_that_rises_late_is_told_of():
    """Before its first point soil under loads flows at a constant strength."""
    late = r"cohesion rises only from plastic_strain = 0\.01 on .* begin the curve at"
    with pytest.warns(UserWarning, match=late):
        MohrCoulomb(SOIL, Curve([0.01, 0.02], [10e3, 15e3]), 30.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        MohrCoulomb(SOIL, Curve([0.01, 0.02], [10e3, 5e3]), 30.0)
        MohrCoulomb(SOIL, Curve([0.0, 0.02], [10e3, 15e3]), 30.0)
