"""Exact answers for soil: against published numbers, one another, and integration by SciPy."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_banded

from mpm_fenicsx import LinearElastic, MohrCoulomb
from mpm_fenicsx.analytical import bearing_capacity, compression, earth_pressure
from mpm_fenicsx.analytical.cavity import CylindricalCavity

REST, C, E, NU = 100e3, 10e3, 50e6, 0.3
CAVITIES = [  # pressure (Pa), φ, ψ, R/r, u/r
    (400e3, 30.0, 0.0, 3.65180, 2.535468e-2),
    (400e3, 30.0, 10.0, 3.65180, 2.038107e-2),
    (400e3, 20.0, 20.0, 6.02979, 2.991337e-2),
    (20e3, 30.0, 0.0, 1.25371, -2.524153e-3),
    (20e3, 30.0, 10.0, 1.25371, -2.636979e-3),
    (20e3, 20.0, 20.0, 1.72885, -5.641554e-3),
]
EVERY = pytest.mark.parametrize(("pressure", "φ", "ψ"), [row[:3] for row in CAVITIES])


def test_coefficients():
    assert compression.passive_coefficient(30.0) == pytest.approx(3.0, rel=1e-14)
    assert compression.deviatoric_strength(100e3, 0.0, 30.0) == pytest.approx(200e3, rel=1e-14)
    assert compression.deviatoric_strength(100e3, 5e3, 0.0) == pytest.approx(10e3, rel=1e-14)
    assert compression.pressure_out_of_plane(100e3, 200e3, 0.3) == pytest.approx(160e3)
    assert compression.dilation_rate(30.0) == pytest.approx(-2.0, rel=1e-14)


def test_earth_pressure():
    """The circles of both pressures touch the line of the soil; forces are their integrals."""
    numbers = (18e3, 7e3, 25.0)
    for z in (1.0, 3.0):
        for pressure in (earth_pressure.active_pressure, earth_pressure.passive_pressure):
            low, high = sorted((pressure(z, *numbers), 18e3 * z))
            assert high - low == pytest.approx(
                compression.deviatoric_strength(low, 7e3, 25.0), rel=1e-12
            )
    for pressure, force in (
        (earth_pressure.active_pressure, earth_pressure.active_force),
        (earth_pressure.passive_pressure, earth_pressure.passive_force),
    ):
        z = (np.arange(1000) + 0.5) * 5.0 / 1000
        assert force(5.0, *numbers) == pytest.approx(pressure(z, *numbers).mean() * 5.0, rel=1e-12)
    assert earth_pressure.active_force(4.0, 18e3, 0.0, 30.0) == pytest.approx(48e3, rel=1e-12)
    assert earth_pressure.passive_force(4.0, 18e3, 0.0, 30.0) == pytest.approx(432e3, rel=1e-12)


def test_bearing_capacity():
    """Tables of N_c and N_q, as in textbooks."""
    for φ, N_c, N_q in ((0.0, 5.142, 1.0), (20.0, 14.835, 6.399), (30.0, 30.140, 18.401)):
        assert bearing_capacity.cohesion_factor(φ) == pytest.approx(N_c, abs=6e-4)
        assert bearing_capacity.surcharge_factor(φ) == pytest.approx(N_q, abs=6e-4)
    assert bearing_capacity.cohesion_factor(1e-6) == pytest.approx(2 + math.pi, rel=1e-7)
    both = bearing_capacity.bearing_capacity(10e3, 20.0, 5e3)
    assert both == pytest.approx(10e3 * 14.8347 + 5e3 * 6.3994, rel=1e-5)


@pytest.mark.parametrize(("pressure", "φ", "ψ", "R", "u"), CAVITIES)
def test_cavity_by_its_numbers(pressure, φ, ψ, R, u):
    cavity = CylindricalCavity(REST, pressure, C, φ, ψ, E, NU, radius=2.0)
    assert cavity.plastic_radius == pytest.approx(2.0 * R, abs=1.1e-5)
    assert cavity.displacement(2.0) == pytest.approx(2.0 * u, rel=3e-7)


def integrated(cavity, φ, ψ):
    """Displacement and radial stress at the wall, from those at R inwards: equilibrium, the yield
    surface and the ratio of plastic strains, as they stand."""
    K, Kψ = (compression.passive_coefficient(angle) for angle in (φ, ψ))
    Y, G = compression.unconfined_strength(cavity.cohesion, φ), 0.5 * E / (1 + NU)
    expands = cavity.pressure > REST

    def rates(r, state):
        u, radial = state
        hoop = (radial - Y) / K if expands else K * radial + Y
        d_r, d_t = radial - REST, hoop - REST
        elastic_r = ((1 - NU) * d_r - NU * d_t) / (2 * G)
        elastic_t = ((1 - NU) * d_t - NU * d_r) / (2 * G)
        plastic_t = -u / r - elastic_t  # strains positive in compression
        plastic_r = -plastic_t / Kψ if expands else -plastic_t * Kψ
        return [-(elastic_r + plastic_r), (hoop - radial) / r]

    R = cavity.plastic_radius
    start = [(cavity.yield_pressure - REST) * R / (2 * G), cavity.yield_pressure]
    return solve_ivp(rates, (R, cavity.radius), start, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]


@pytest.mark.parametrize(
    ("pressure", "φ", "ψ"), [*(row[:3] for row in CAVITIES), (130e3, 0.0, 0.0), (70e3, 0.0, 0.0)]
)
def test_cavity_by_integration(pressure, φ, ψ):
    cavity = CylindricalCavity(REST, pressure, C, φ, ψ, E, NU)
    assert cavity.plastic_radius > 1.2
    u, radial = integrated(cavity, φ, ψ)
    assert cavity.displacement(1.0) == pytest.approx(u, rel=1e-9)
    assert pressure == pytest.approx(radial, rel=1e-9)
    assert cavity.stress(1.0)[0] == pytest.approx(pressure, rel=1e-12)


@EVERY
def test_cavity_is_of_one_piece(pressure, φ, ψ):
    """Displacement and stress agree on both sides of R, and equilibrium holds."""
    cavity = CylindricalCavity(REST, pressure, C, φ, ψ, E, NU)
    R = cavity.plastic_radius
    inside, outside = R * (1 - 1e-9), R * (1 + 1e-9)
    np.testing.assert_allclose(cavity.stress(inside), cavity.stress(outside), rtol=1e-7)
    assert cavity.displacement(inside) == pytest.approx(cavity.displacement(outside), rel=1e-7)
    r = np.array([1.0 + 0.5 * (R - 1.0), 2.0 * R])
    radial, hoop, axial = cavity.stress(r)
    slope = (cavity.stress(r + 1e-5)[0] - cavity.stress(r - 1e-5)[0]) / 2e-5
    np.testing.assert_allclose(slope, (hoop - radial) / r, rtol=1e-6)
    low, high = np.minimum(radial, hoop), np.maximum(radial, hoop)
    assert ((axial >= low) & (axial <= high)).all()
    np.testing.assert_allclose(cavity.stress(1e6), REST, rtol=1e-9)


def test_cavity_that_stays_elastic():
    cavity = CylindricalCavity(REST, 110e3, C, 30.0, 0.0, E, NU)
    assert cavity.plastic_radius == 1.0
    assert cavity.displacement(2.0) == pytest.approx(10e3 / (E / 1.3) / 2.0, rel=1e-12)
    np.testing.assert_allclose(cavity.stress(1.0), [110e3, 90e3, REST], rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"at_rest": -20e3}, r"at_rest must be a pressure that this soil bears, got -20000\.0"),
        ({"pressure": -18e3}, r"pressure must hold the cavity open, got -18000\.0"),
        ({"pressure": 4e6, "poisson": 0.0}, "axial stress .* leave the range"),
    ],
)
def test_cavities_that_are_refused(change, message):
    numbers = {"at_rest": REST, "pressure": 20e3, "cohesion": C, "friction_angle": 30.0}
    numbers |= {"dilation_angle": 0.0, "young": E, "poisson": NU}
    with pytest.raises(ValueError, match=message):
        CylindricalCavity(**{**numbers, **change})


def on_a_ray(law, cavity, nodes=301, outer=60.0, steps=20):
    """Displacement of the wall and radius of the plastic zone, of linear elements along a radius
    with two Gauss points each, and the exact spring of elastic ground beyond the last node."""
    r = np.geomspace(1.0, outer, nodes)
    h, cells, G = np.diff(r), nodes - 1, law.lame[1]
    share = 0.5 + np.array([-0.5, 0.5]) / math.sqrt(3.0)
    x = r[:-1, None] + share * h[:, None]
    B = np.zeros((cells, 2, 4, 2))  # strains rr, θθ, zz, and a shear that stays zero
    B[:, :, 0] = np.stack([-1.0 / h, 1.0 / h], axis=1)[:, None]
    B[:, :, 1, 0], B[:, :, 1, 1] = (1.0 - share) / x, share / x
    weight = 0.5 * x * h[:, None]
    stress, history = np.full((2 * cells, 4), -REST), np.zeros((2 * cells, 2))
    stress[:, 3] = 0.0
    u, ends = np.zeros(nodes), np.stack([np.arange(cells), np.arange(1, nodes)], axis=1)
    for step in range(1, steps + 1):
        p, du = REST + (cavity.pressure - REST) * step / steps, np.zeros(nodes)
        for _ in range(30):
            strain = np.einsum("cgij,cj->cgi", B, du[ends]).reshape(-1, 4)
            new, after, D = law.tangent(strain, stress, history)
            force = np.zeros(nodes)
            each = np.einsum("cg,cgi,cgij->cj", weight, new.reshape(cells, 2, 4), B)
            np.add.at(force, ends, each)
            force[0] -= p
            force[-1] += (REST + 2 * G * (u[-1] + du[-1]) / outer) * outer
            if np.abs(force).max() < 1e-9 * REST:
                break
            K = np.einsum("cg,cgij,cgik,cgkl->cjl", weight, B, D.reshape(cells, 2, 4, 4), B)
            bands = np.zeros((3, nodes))
            bands[0, 1:], bands[2, :-1] = K[:, 0, 1], K[:, 1, 0]
            bands[1, :-1] += K[:, 0, 0]
            bands[1, 1:] += K[:, 1, 1]
            bands[1, -1] += 2 * G
            du -= solve_banded((1, 1), bands, force)
        else:
            raise AssertionError(f"step {step}: residual {np.abs(force).max()}")
        u, stress, history = u + du, new, after
    return u[0], x.ravel()[history[:, 0] > 0.0].max()


@EVERY
def test_cavity_in_elements_along_a_ray(pressure, φ, ψ):
    cavity = CylindricalCavity(REST, pressure, C, φ, ψ, E, NU)
    law = MohrCoulomb(LinearElastic(E, NU, 1800.0), C, φ, ψ)
    u, R = on_a_ray(law, cavity)
    assert u == pytest.approx(cavity.displacement(1.0), rel=2e-3)
    assert R == pytest.approx(cavity.plastic_radius, rel=0.014)  # a cell
