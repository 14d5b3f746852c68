"""Plane waves in a half-space: the surface is free, the waves are waves, and no energy is lost."""

import numpy as np
import pytest
from scipy.special import erf

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical.plane_waves import (
    PlaneWaves,
    critical_angle,
    reflection,
    surface_motion,
)
from mpm_fenicsx.common import tensors
from mpm_fenicsx.dynamics.waveform import Waveform

SOIL = mpm.LinearElastic(young=90e6, poisson=0.3, density=1900.0)
SPEEDS = SOIL.p_speed, SOIL.s_speed
ω = 9.0  # rad/s
SINE = Waveform(lambda t: np.sin(ω * t) / ω, lambda t: np.cos(ω * t), lambda t: -ω * np.sin(ω * t))
TOP = 12.0
CASES = [
    ("P", 0.0, 2, 1, 0.0),
    ("P", 35.0, 2, 1, 0.0),
    ("P", -80.0, 2, 1, 0.0),
    ("SV", 0.0, 2, 1, 0.0),
    ("SV", 25.0, 2, 1, 0.0),
    ("SV", -20.0, 3, 2, 50.0),
    ("P", 40.0, 3, 1, 120.0),
    ("SH", 0.0, 3, 1, 0.0),
    ("SH", 70.0, 3, 2, -30.0),
]
every_case = pytest.mark.parametrize("kind, angle, dim, up, azimuth", CASES)


def waves(kind, angle, dim=2, up=1, azimuth=0.0, surface=TOP, motion=SINE, origin=None):
    origin = (3.0, -40.0, -2.0)[:dim] if origin is None else origin
    return PlaneWaves(kind, angle, SOIL.density, *SPEEDS, motion, origin, surface, dim, up, azimuth)


def places(dim, n=40):
    return np.random.default_rng(7).uniform(-60.0, 10.0, (n, dim))


@every_case
def test_nothing_pulls_at_the_free_surface(kind, angle, dim, up, azimuth):
    field, x, normal = waves(kind, angle, dim, up, azimuth), places(dim), np.eye(dim)[up]
    x[:, up] = TOP
    incoming = np.abs(field.traction(0.7, x, normal, incoming_only=True)).max()
    assert incoming > 0.1 * SOIL.density * SOIL.s_speed * np.cos(np.radians(angle))
    assert np.abs(field.traction(0.7, x, normal)).max() < 1e-13 * SOIL.density * SPEEDS[0]


@every_case
def test_the_motion_obeys_the_wave_equation(kind, angle, dim, up, azimuth):
    """∇·σ = ρ a, and σ is that of the law, by central differences of sixth order."""
    field, x, t = waves(kind, angle, dim, up, azimuth), places(dim), 0.7
    h, weights = 0.3, {1: 0.75, 2: -0.15, 3: 1 / 60}

    def slope(function, j):
        shift = h * np.eye(dim)[j]
        return sum(
            w / h * (function(x + k * shift) - function(x - k * shift)) for k, w in weights.items()
        )

    force = sum(
        slope(lambda x: tensors.matrix(field.stress(t, x), dim), j)[:, :, j] for j in range(dim)
    )
    a = field.acceleration(t, x)
    assert np.abs(force - SOIL.density * a).max() < 1e-6 * SOIL.density * ω
    gradient = np.stack([slope(lambda x: field.displacement(t, x), j) for j in range(dim)], axis=2)
    by_law = SOIL.update(tensors.strain(gradient), np.zeros((len(x), tensors.components(dim))))
    assert np.abs(by_law - field.stress(t, x)).max() < 1e-6 * SOIL.density * SPEEDS[0]
    rate = sum(
        w / 1e-3 * (field.displacement(t + k * 1e-3, x) - field.displacement(t - k * 1e-3, x))
        for k, w in weights.items()
    )
    assert np.abs(rate - field.velocity(t, x)).max() < 1e-9


@every_case
def test_the_incoming_wave_has_the_motion_given_at_its_origin(kind, angle, dim, up, azimuth):
    field = waves(kind, angle, dim, up, azimuth)
    at = np.array([field.origin])
    for name in ("displacement", "velocity", "acceleration"):
        found = getattr(field, name)(0.3, at, incoming_only=True)[0]
        assert found @ found == pytest.approx(getattr(SINE, name)(0.3) ** 2, rel=1e-14)
    α, θ = np.radians(azimuth), np.radians(angle)
    direction = {
        "P": (np.sin(θ) * np.cos(α), np.sin(θ) * np.sin(α), np.cos(θ)),
        "SV": (np.cos(θ) * np.cos(α), np.cos(θ) * np.sin(α), -np.sin(θ)),
        "SH": (-np.sin(α), np.cos(α), 0.0),
    }[kind]  # horizontal, horizontal, up
    order = [0, 1] if dim == 2 else [0, 3 - up, up]
    expected = np.array(direction)[[0, 2]] if dim == 2 else np.array(direction)
    assert found[order] == pytest.approx(SINE.acceleration(0.3) * expected, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("kind, most", [("P", 89.9), ("SV", critical_angle(*SPEEDS)), ("SH", 89.9)])
def test_what_is_reflected_has_the_energy_of_what_came_in(kind, most):
    """Vertical flux ρ c² q A² of each wave, q = cos θ/c."""
    for angle in np.linspace(0.0, most, 40):
        p = np.sin(np.radians(angle)) / SPEEDS[kind != "P"]

        def flux(kind, amplitude, p=p):
            c = SPEEDS[kind != "P"]
            return c**2 * np.sqrt(max(0.0, c**-2 - p**2)) * amplitude**2

        back = sum(flux(other, value) for other, value in reflection(kind, angle, *SPEEDS).items())
        assert back == pytest.approx(flux(kind, 1.0), rel=1e-12)


@every_case
def test_the_surface_moves_as_its_closed_form_says(kind, angle, dim, up, azimuth):
    """Aki and Richards' closed form against the sum of the waves."""
    field = waves(kind, angle, dim, up, azimuth)
    x = np.array([field.origin])
    x[0, up] = TOP
    t = 0.4
    came = t - field.delays(x, incoming_only=True)[0, 0]
    along, across, upwards = surface_motion(kind, angle, *SPEEDS) * SINE.velocity(came)
    α = np.radians(azimuth)
    first = along * np.cos(α) - across * np.sin(α)
    second = along * np.sin(α) + across * np.cos(α)
    exact = [first, upwards] if dim == 2 else [first, second, upwards]
    order = [0, 1] if dim == 2 else [0, 3 - up, up]
    assert field.velocity(t, x)[0, order] == pytest.approx(exact, rel=1e-12, abs=1e-13)


def test_a_surface_doubles_what_comes_up_straight():
    assert surface_motion("P", 0.0, *SPEEDS) == pytest.approx([0.0, 0.0, 2.0])
    assert surface_motion("SV", 0.0, *SPEEDS) == pytest.approx([2.0, 0.0, 0.0])


def test_sv_at_45_degrees_comes_back_as_it_went():
    """B = 0 there: no P wave, and a surface that moves up and down by √2, the other way."""
    assert reflection("SV", 45.0, 300.0, 250.0) == pytest.approx({"SV": -1.0, "P": 0.0}, abs=1e-15)
    assert surface_motion("SV", 45.0, 300.0, 250.0) == pytest.approx(
        [0.0, 0.0, -np.sqrt(2)], abs=1e-15
    )


def test_traction_balances_the_stress_of_any_normal():
    field, x = waves("SV", 25.0, 3, 1, 40.0), places(3)
    normal = np.random.default_rng(1).normal(size=(len(x), 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    full = tensors.matrix(field.stress(0.2, x), 3)
    assert np.allclose(
        field.traction(0.2, x, normal), np.einsum("nij,nj->ni", full, normal), rtol=1e-13
    )


def test_in_a_full_space_nothing_comes_back():
    x = places(2)
    alone = waves("SV", 60.0, surface=None)
    assert np.array_equal(alone.velocity(0.3, x), alone.velocity(0.3, x, incoming_only=True))
    low, high = waves("P", 30.0, surface=None), waves("P", 30.0)
    assert np.array_equal(low.stress(0.3, x), high.stress(0.3, x, incoming_only=True))


def test_nothing_moves_before_the_wave_is_there():
    pulse = Waveform(velocity=lambda t: np.where(t > 0, 1.0, 0.0))
    field, x = waves("P", 30.0, motion=pulse), places(2)
    first = field.delays(x).min(axis=0)
    assert (field.velocity(0.1, x)[first > 0.1] == 0).all()
    assert (field.velocity(0.1, x)[first < 0.1] != 0).all(axis=1).all()
    assert (field.delays(x)[0] < field.delays(x)[1:]).all()  # below the surface


def pulse_of(width):
    """exp(−s²) as velocity, s = (t − 0.25)/width, with what belongs to it."""
    return Waveform(
        lambda t: width * np.sqrt(np.pi) / 2 * (1 + erf((t - 0.25) / width)),
        lambda t: np.exp(-(((t - 0.25) / width) ** 2)),
        lambda t: -2 * (t - 0.25) / width**2 * np.exp(-(((t - 0.25) / width) ** 2)),
    )


def driving(field, normal):
    """σn + Zv of the field at a side with dashpots."""

    def load(t, x):
        v = field.velocity(t, x)
        across = (v @ normal)[:, None] * normal
        Zv = SOIL.density * (SPEEDS[0] * across + SPEEDS[1] * (v - across))
        return field.traction(t, x, normal) + Zv

    return load


@pytest.mark.parametrize("kind, angle", [("P", 30.0), ("SV", 20.0)])
def test_a_block_that_its_sides_drive_moves_as_the_ground_does(kind, angle):
    """Finite elements, dashpots at three sides and σn + Zv of the whole field on them: what is
    left over is the error of the elements, of second order."""
    error = []
    for cells in (6, 12):
        field = waves(kind, angle, motion=pulse_of(0.06), origin=(0.0, -10.0), surface=0.0)
        grid = mpm.Grid.box((0.0, -10.0), (20.0, 0.0), cells=(2 * cells, cells))
        terms = []
        for side, normal in (("bottom", (0, -1)), ("left", (-1, 0)), ("right", (1, 0))):
            on = grid.facets(side)
            terms += [
                mpm.ViscousBoundary(on, SOIL),
                mpm.Traction(on, driving(field, np.array(normal, float))),
            ]
        stepping = mpm.Newmark(dt=0.5 * 10.0 / cells / SPEEDS[0])
        run = mpm.FiniteElements(grid, SOIL, stepping, terms)
        place, read = run.sampler("velocity")
        off, whole = 0.0, 0.0
        while run.time < 0.6:
            run.step()
            exact = field.velocity(run.time, place)
            off += ((read(np.arange(len(place))) - exact) ** 2).sum()
            whole += (exact**2).sum()
        error.append(np.sqrt(off / whole))
    assert error[1] < 2e-3
    assert np.log2(error[0] / error[1]) > 1.8


@pytest.mark.parametrize(
    "change, words",
    [
        ({"kind": "S"}, "P, SV, SH, got 'S'"),
        ({"kind": "SH"}, "got 'SH', which moves out of the plane: take dim=3"),
        ({"kind": "SV", "angle": 33.0}, "at most 32.31°, the critical angle .* got 33.0"),
        ({"angle": 90.0}, "between -90 and 90.* got 90"),
        ({"angle": np.nan}, "got nan"),
        ({"azimuth": 180.0}, "azimuth .* got 180.0: a wave towards −x .* negative angle"),
        ({"up": 2}, "up must be 1 in 2D, got 2"),
        ({"dim": 4}, "dim must be 2 or 3, got 4"),
        ({"origin": (0.0,)}, "origin must be 2 numbers"),
        ({"surface": -41.0}, "surface must not be below origin, at -40.0 m, got -41.0"),
    ],
)
def test_what_cannot_be_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        waves(**{"kind": "P", "angle": 10.0, **change})


def test_soil_and_motion_that_cannot_be_are_refused():
    for density, fast, slow, words in (
        (0.0, 300.0, 150.0, "density must be positive, got 0.0"),
        (1900.0, 150.0, 300.0, "p_speed must be above .* got p_speed=150.0"),
    ):
        with pytest.raises(ValueError, match=words):
            PlaneWaves("P", 0.0, density, fast, slow, SINE, (0.0, 0.0))
    lacking = waves("P", 0.0, motion=Waveform(velocity=lambda t: np.zeros(3)))
    with pytest.raises(ValueError, match="function displacement of time, has None"):
        lacking.displacement(0.0, places(2))
    with pytest.raises(ValueError, match=r"map times \(n,\) to \(n,\) .* gave shape \(3,\)"):
        lacking.velocity(0.0, places(2))
    of_one = waves("P", 0.0, motion=Waveform(velocity=lambda t: max(0.0, t)))
    with pytest.raises(ValueError, match=r"must take an array of times \(n,\), s, raises ValueErr"):
        of_one.velocity(0.0, places(2))
    with pytest.raises(ValueError, match=r"x must be places \(n, 2\), got shape \(3, 40\)"):
        lacking.velocity(0.0, places(3).T)


def test_rickers_pulse_ends_where_it_began_and_its_rates_are_its_slopes():
    pulse = Waveform.ricker(2.0, peak=0.3)
    t = np.linspace(0.0, 1.5, 3001)
    u, v, a = (f(t) for f in (pulse.displacement, pulse.velocity, pulse.acceleration))
    assert v.max() == pytest.approx(0.3) and t[v.argmax()] == pytest.approx(0.75)
    assert np.abs(np.gradient(u, t) - v)[1:-1].max() < 1e-5
    assert np.abs(np.gradient(v, t) - a)[1:-1].max() < 1e-3
    assert np.abs([u[0], u[-1]]).max() < 1e-8
    with pytest.raises(ValueError, match="frequency must be positive, got 0"):
        Waveform.ricker(0.0)
