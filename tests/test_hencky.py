"""Hencky's hyperelasticity and multiplicative von Mises at the points, against closed forms and
matrix series."""

import math

import dense
import numpy as np
import pytest

from mpm_fenicsx import Hencky, LinearElastic, MaterialPoints, VonMises
from mpm_fenicsx.common import tensors
from mpm_fenicsx.materials import hencky_strain
from mpm_fenicsx.materials.kinematics import (
    FINITE_STRAIN,
    SHEAR,
    SMALL_STRAIN,
    deformation,
    volume_ratio,
)
from mpm_fenicsx.response.finite_strain import product

SOIL = Hencky(young=20e6, poisson=0.3, density=1500.0)
LAW = VonMises(SOIL, peak=300e3, residual=100e3, softening=800e3)
λ, μ = SOIL.lame
DIMS = pytest.mark.parametrize("dim", [2, 3])
LAWS = pytest.mark.parametrize("law", [SOIL, LAW], ids=["Hencky", "von Mises"])


def body_of(n, dim, law=SOIL):
    return MaterialPoints(law, np.zeros((n, dim)), np.full((n, dim), 0.5), np.ones(n))


def strained(body, f):
    """The body after the deformation f (n, dim, dim) or (dim, dim)."""
    gradient = np.broadcast_to(f, (len(body), body.dim, body.dim)) - np.eye(body.dim)
    FINITE_STRAIN.respond(body, gradient)
    body.deform(np.zeros_like(body.x), *body.stretches(gradient, np.ones(gradient.shape[:2])))
    return body


def full(rows):
    """Stress tensors (n, 3, 3)."""
    if rows.shape[1] == 6:
        return tensors.matrix(rows, 3)
    out = np.zeros((len(rows), 3, 3))
    out[:, :2, :2], out[:, 2, 2] = tensors.matrix(rows, 2), rows[:, 2]
    return out


# -- the law in matrix series, fit for complex steps -----------------------------------------------


def logarithm(A):
    """By square roots (Denman and Beavers) and Taylor's series."""
    for _ in range(7):
        Y, Z = A, np.eye(3)
        for _ in range(30):
            Y, Z = 0.5 * (Y + np.linalg.inv(Z)), 0.5 * (Z + np.linalg.inv(Y))
        A = Y
    X = A - np.eye(3)
    power, total = X, X
    for k in range(2, 14):
        power = -power @ X
        total = total + power / k
    return 2**7 * total


def exponential(A):
    """By Taylor's series and squaring."""
    term = total = np.eye(3)
    for k in range(1, 14):
        term = term @ A / (64.0 * k)
        total = total + term
    for _ in range(6):
        total = total @ total
    return total


def returned(law, ε, κ):
    """Kirchhoff's stress and κ by the textbook's radial return."""
    tr = np.trace(ε)
    s, p = 2 * μ * (ε - tr / 3 * np.eye(3)), (λ + 2 * μ / 3) * tr
    if law is not SOIL:
        q, c = np.sqrt(1.5 * (s * s).sum()), max(law.residual, law.peak - law.softening * κ)
        if q.real > math.sqrt(3) * c:
            Δ = (q - math.sqrt(3) * (law.peak - law.softening * κ)) / (
                3 * μ - math.sqrt(3) * law.softening
            )
            if law.peak - law.softening * (κ + Δ.real) < law.residual:
                Δ = (q - math.sqrt(3) * law.residual) / (3 * μ)
            s, κ = s * (1 - 3 * μ * Δ / q), κ + Δ
    return s + p * np.eye(3), κ


def reference(law, f, σ, J, κ):
    """P = τ f⁻ᵀ/J, τ and κ for f (dim, dim), from Cauchy's stress before."""
    F = np.eye(3, dtype=f.dtype)
    F[: len(f), : len(f)] = f
    E, ν, τ = law.young, law.poisson, J * σ
    ε = ((1 + ν) * τ - ν * np.trace(τ) * np.eye(3)) / E
    τ, κ = returned(law, 0.5 * logarithm(F @ exponential(2 * ε) @ F.T), κ)
    return (τ @ np.linalg.inv(F).T / J)[: len(f), : len(f)], τ, κ


def states(law, dim, n=12, seed=0):
    """A body with stress, volume and history at random; small deformations that leave it elastic,
    and others that take it to residual strength."""
    rng = np.random.default_rng(seed)
    body = body_of(n, dim, law)
    body.stress[:] = 1.5e5 * rng.normal(size=body.stress.shape)
    body.volume[:] = rng.uniform(0.8, 1.2, n)
    if law.history:
        body.history[:] = rng.uniform(0.0, 0.1, (n, 1))
    return body, np.eye(dim) + np.geomspace(3e-4, 0.3, n)[:, None, None] * rng.normal(
        size=(n, dim, dim)
    )


@LAWS
@DIMS
def test_points_follow_the_law_in_matrix_series(dim, law):
    body, f = states(law, dim)
    J, before = volume_ratio(body), full(body.stress)
    κ = np.zeros(len(body)) if body.history is None else body.history[:, 0].copy()
    strained(body, f)
    after = volume_ratio(body)
    for p in range(len(body)):
        _, τ, new = reference(law, f[p], before[p], J[p], κ[p])
        np.testing.assert_allclose(after[p] * full(body.stress)[p], τ, atol=1e-10 * np.abs(τ).max())
        if law.history:
            assert body.history[p, 0] == pytest.approx(new, abs=1e-13)
    if law.history:
        assert 0.3 < (body.history[:, 0] > κ).mean() < 1.0
        assert body.history.max() > (law.peak - law.residual) / law.softening


def responses(body, f):
    """P (n, dim, dim) and its derivative from the compiled loops, the upper triangle where the law
    is symmetric."""
    dim, n, law = body.dim, len(body), body.material
    J, rows = volume_ratio(body), np.arange(len(body), dtype=np.int32)
    state = FINITE_STRAIN.state(law, J[:, None] * body.stress)
    strain, *eigen = FINITE_STRAIN.trial(state, f - np.eye(dim), rows, rows)
    τ, _, D = law.tangent(strain, np.zeros_like(strain), body.remembered)
    entries, _ = tensors.entries(dim**2, law.symmetric)
    P, A = np.empty((n, dim**2)), np.empty((n, len(entries)))
    hencky_strain.nominal(
        (tuple(range(dim)), SHEAR[dim], tensors.in_plane(dim)),
        f,
        1.0 / J,
        (rows, rows),
        (τ, D),
        tuple(eigen),
        P,
        A,
    )
    return P.reshape(n, dim, dim), A


@LAWS
@DIMS
def test_nominal_stress_and_its_tangent_are_those_of_the_series_by_complex_steps(dim, law):
    body, f = states(law, dim, seed=1)
    f[0], f[1] = (
        np.eye(dim),
        1.1 * np.eye(dim),
    )  # equal eigenvalues, where nothing has happened before
    f[2] = np.eye(dim) + 1e-7 * np.ones((dim, dim))  # and nearly equal ones
    body.stress[:3] = 0.0
    P, A = responses(body, f)
    way = np.random.default_rng(2).normal(size=f.shape)
    change = product(A, way.reshape(len(way), -1)).reshape(f.shape)
    for p in range(len(body)):
        κ = 0.0 if body.history is None else body.history[p, 0]
        exact = reference(
            law, f[p] + 1e-30j * way[p], full(body.stress)[p], volume_ratio(body)[p], κ
        )[0]
        np.testing.assert_allclose(P[p], exact.real, atol=1e-10 * λ)
        np.testing.assert_allclose(change[p], exact.imag / 1e-30, atol=1e-9 * λ)


@DIMS
def test_at_no_strain_the_tangent_is_hookes_plus_the_stress(dim):
    """For σ small against E; and a turn of the frame turns σ."""
    body = body_of(5, dim)
    rng = np.random.default_rng(4)
    body.stress[:] = 20.0 * rng.normal(size=body.stress.shape)  # 1e-6 E
    g = rng.normal(size=(5, dim, dim))
    P, A = responses(body, deformation(np.zeros_like(g)))
    small = LinearElastic(SOIL.young, SOIL.poisson, SOIL.density)
    hooke = tensors.matrix(small.update(tensors.strain(g), np.zeros_like(body.stress)), dim)
    found = product(A, g.reshape(len(g), -1)).reshape(g.shape)
    np.testing.assert_allclose(found, hooke, atol=1e-5 * np.abs(hooke).max())
    σ, spin = tensors.matrix(body.stress, dim), g - g.transpose(0, 2, 1)
    np.testing.assert_allclose(P, σ, atol=1e-14 * SOIL.young)
    np.testing.assert_allclose(
        product(A, spin.reshape(len(spin), -1)).reshape(g.shape),
        spin @ σ,
        atol=1e-6 * np.abs(spin @ σ).max(),
    )


# -- closed forms ----------------------------------------------------------------------------------


@pytest.mark.parametrize("steps", [1, 7])
@DIMS
def test_uniaxial_strain(dim, steps):
    for stretch in (0.4, 1.9):
        body = body_of(1, dim)
        f = np.eye(dim)
        f[1, 1] = stretch ** (1 / steps)
        for _ in range(steps):
            strained(body, f)
        exact = np.zeros(tensors.components(dim))
        exact[:3] = λ * math.log(stretch) / stretch
        exact[1] += 2 * μ * math.log(stretch) / stretch
        np.testing.assert_allclose(body.stress[0], exact, atol=1e-13 * μ)
        energy = 0.5 * (λ + 2 * μ) * math.log(stretch) ** 2
        assert FINITE_STRAIN.energy(body) == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("steps", [1, 7])
@DIMS
def test_simple_shear(dim, steps):
    """b has the eigenvalues e^(±2 asinh(γ/2)), its axes at half the angle whose cotangent is γ/2;
    σ_zz = 0."""
    γ = 1.7
    body, f = body_of(1, dim), np.eye(dim)
    f[0, 1] = γ / steps
    for _ in range(steps):
        strained(body, f)
    size = 2 * μ * math.asinh(γ / 2) / math.sqrt(4 + γ**2)
    exact = np.zeros(tensors.components(dim))
    exact[0], exact[1], exact[3] = size * γ, -size * γ, size * 2
    np.testing.assert_allclose(body.stress[0], exact, atol=1e-13 * μ)
    assert volume_ratio(body)[0] == pytest.approx(1.0, abs=1e-14)


@DIMS
def test_rigid_rotations_turn_the_stress_and_add_none(dim):
    rng = np.random.default_rng(3)
    body = body_of(20, dim)
    body.stress[10:] = 1e6 * rng.normal(size=body.stress[10:].shape)
    before, Q = full(body.stress), np.eye(dim)
    for _ in range(100):
        R = dense.rotation(rng, dim)
        strained(body, R)
        Q = R @ Q
    assert np.abs(body.stress[:10]).max() < 1e-12 * SOIL.young
    turn = np.eye(3)
    turn[:dim, :dim] = Q
    np.testing.assert_allclose(
        full(body.stress)[10:], turn @ before[10:] @ turn.T, atol=1e-12 * SOIL.young
    )


@DIMS
def test_a_closed_path_gives_the_energy_back(dim):
    """Two steps are the one of their product, whatever the way; back at the start nothing is
    left."""
    rng = np.random.default_rng(6)
    f = np.eye(dim) + 0.2 * rng.normal(size=(5, 10, dim, dim))
    once, twice = body_of(10, dim), body_of(10, dim)
    total = np.broadcast_to(np.eye(dim), (10, dim, dim))
    for part in f:
        strained(twice, part)
        total = part @ total
    strained(once, total)
    np.testing.assert_allclose(once.stress, twice.stress, atol=1e-11 * np.abs(once.stress).max())
    strained(twice, np.linalg.inv(total))
    assert np.abs(twice.stress).max() < 1e-11 * np.abs(once.stress).max()
    np.testing.assert_allclose(volume_ratio(twice), 1.0, rtol=1e-13)


@pytest.mark.parametrize("steps", [1, 10])
@DIMS
def test_plane_strain_extension_through_softening(dim, steps):
    """Stretch e^a by e^-a, axes fixed: τ_x = -τ_y = c, κ = 2/√3 (a - c/2μ) with c = peak - h κ;
    volume is kept."""
    a = 0.2
    body, f = body_of(1, dim, LAW), np.eye(dim)
    f[0, 0], f[1, 1] = math.exp(a / steps), math.exp(-a / steps)
    for _ in range(steps):
        strained(body, f)
    κ = 2 / math.sqrt(3) * (a - LAW.peak / (2 * μ)) / (1 - LAW.softening / (math.sqrt(3) * μ))
    c = LAW.peak - LAW.softening * κ
    assert LAW.residual < c < 0.7 * LAW.peak
    np.testing.assert_allclose(body.stress[0, :4], [c, -c, 0.0, 0.0], atol=1e-10 * c)
    assert body.history[0, 0] == pytest.approx(κ, rel=1e-12)
    work = LAW.plastic_work(np.array([[κ]]))[0]
    assert FINITE_STRAIN.plastic_work(body) == pytest.approx(work, rel=1e-12)
    assert FINITE_STRAIN.energy(body) == pytest.approx(c**2 / (2 * μ), rel=1e-10)


@DIMS
def test_plastic_flow_keeps_the_volume(dim):
    """ln J is the trace of the elastic strain, however much has flowed."""
    rng = np.random.default_rng(8)
    body = body_of(10, dim, LAW)
    for _ in range(20):
        strained(body, np.eye(dim) + 0.1 * rng.normal(size=(10, dim, dim)))
    J = volume_ratio(body)
    assert body.history.min() > 0.1
    np.testing.assert_allclose(
        LAW.strain(J[:, None] * body.stress)[:, :3].sum(axis=1), np.log(J), atol=1e-12
    )


# -- what the material says ------------------------------------------------------------------------


def test_materials_say_how_their_points_strain():
    assert LinearElastic(1e6, 0.3, 1e3).kinematics is SMALL_STRAIN
    assert VonMises(LinearElastic(1e6, 0.3, 1e3), 1e3, 1e3, 0.0).kinematics is SMALL_STRAIN
    assert SOIL.kinematics is LAW.kinematics is FINITE_STRAIN
    assert SOIL.history == ()
    with pytest.raises(ValueError, match=r"poisson .* got 0\.5"):
        Hencky(1e6, 0.5, 1e3)


@DIMS
def test_compliance_undoes_stiffness(dim):
    ε = np.random.default_rng(1).normal(size=(7, tensors.components(dim)))
    np.testing.assert_allclose(SOIL.strain(SOIL.update(ε, np.zeros_like(ε))), ε, atol=1e-14)


@DIMS
def test_a_body_turned_inside_out_has_no_response(dim):
    body, f = body_of(1, dim), np.eye(dim)[None].copy()
    f[0, 0, 0] = -0.1
    P, A = responses(body, f)
    assert np.isnan(P).any() and np.isnan(A).any()
    with pytest.raises(ValueError, match=r"turns inside out: det F = -0\.1"):
        strained(body, f)
