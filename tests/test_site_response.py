"""Transfer functions of layered, damped ground, against closed forms, linear elements along
one line and d'Alembert."""

import numpy as np
import pytest

from mpm_fenicsx.analytical.site_response import HalfSpace, Layer, LayeredGround, split

H, SOIL, ROCK = 20.0, (1800.0, 200.0), HalfSpace(2200.0, 800.0)
FREQUENCY = np.linspace(0.1, 24.9, 200)
THREE = (
    Layer(1700.0, 150.0, 0.04, thickness=4.0),
    Layer(1900.0, 300.0, 0.02, thickness=9.0),
    Layer(1800.0, 220.0, 0.07, thickness=6.0),
)


def ground(damping=0.0, base=ROCK, **rayleigh):
    return LayeredGround((Layer(*SOIL, damping, thickness=H, **rayleigh),), base)


def test_an_undamped_layer_on_rigid_rock():
    exact = 1 / np.cos(2 * np.pi * FREQUENCY * H / SOIL[1])
    found = ground(base=None).transfer(FREQUENCY, kind="within")
    assert found == pytest.approx(exact, rel=1e-10)


def test_a_damped_layer_on_elastic_rock():
    """1/(cos k*H + i α* sin k*H) over the outcrop (Kramer 1996, Geotechnical Earthquake
    Engineering)."""
    ξ, base = 0.05, HalfSpace(2200.0, 800.0, 0.01)
    speed = SOIL[1] * np.sqrt(1 + 2j * ξ)
    k = 2 * np.pi * FREQUENCY / speed
    α = SOIL[0] * speed / (base.density * base.speed * np.sqrt(1 + 0.02j))
    exact = 1 / (np.cos(k * H) + 1j * α * np.sin(k * H))
    damped = ground(ξ, base)
    assert damped.transfer(FREQUENCY, kind="outcrop") == pytest.approx(exact, rel=1e-12)
    assert damped.transfer(FREQUENCY) == pytest.approx(2 * exact, rel=1e-12)
    assert damped.transfer(FREQUENCY, kind="within") == pytest.approx(1 / np.cos(k * H), rel=1e-12)


def fine_elements(layers, base, ω, cells=400):
    """Motion of the nodes of linear elements, from the surface, over the up-going motion of an
    undamped base: (K* − ω² M* + iω Z) u = 2iω Z at the base."""
    nodes = cells * len(layers) + 1
    S = np.zeros((nodes, nodes), complex)
    stiffness, mass = np.array([[1, -1], [-1, 1]]), np.array([[2, 1], [1, 2]]) / 6
    for j, layer in enumerate(layers):
        h, α = layer.thickness / cells, layer.mass_damping
        G = layer.density * layer.speed**2
        K = G / h * (1 + 2j * layer.damping + 1j * ω * layer.stiffness_damping) * stiffness
        cell = K + layer.density * h * (1j * ω * α - ω**2) * mass
        for i in range(j * cells, (j + 1) * cells):
            S[i : i + 2, i : i + 2] += cell
    Z = base.density * base.speed
    S[-1, -1] += 1j * ω * Z
    force = np.zeros(nodes, complex)
    force[-1] = 2j * ω * Z
    return np.linalg.solve(S, force)


@pytest.mark.parametrize("frequency", [0.7, 3.0, 11.0])
def test_damping_of_rayleigh_and_hysteretic_damping_are_those_of_matrices(frequency):
    """C = α M + β K as a code in time has it, and K (1 + 2iξ), by 400 elements a layer: their error
    is of second order, (kh)²/24 a radian of phase."""
    layers = (
        Layer(1700.0, 150.0, 0.03, 1.3, 2e-3, thickness=4.0),
        Layer(1900.0, 300.0, 0.0, 0.4, 1e-3, thickness=9.0),
    )
    u = fine_elements(layers, ROCK, 2 * np.pi * frequency)
    site = LayeredGround(layers, ROCK)
    for node, depth in ((0, 0.0), (200, 2.0), (400, 4.0), (600, 8.5), (800, 13.0)):
        assert site.transfer(frequency, depth) == pytest.approx(u[node], rel=2e-5)


def test_rayleigh_damping_has_its_ratio():
    """At the two frequencies of a fit ξ is met, and a lightly damped peak is that of ξ."""
    ω = 2 * np.pi * np.array([1.0, 6.0])
    α, β = 2 * 0.02 * ω.prod() / ω.sum(), 2 * 0.02 / ω.sum()
    soil = Layer(*SOIL, 0.0, α, β, thickness=H)
    assert soil.damping_ratio(ω / (2 * np.pi)) == pytest.approx([0.02, 0.02], rel=1e-12)
    by_rayleigh = LayeredGround((soil,), None)
    first = SOIL[1] / (4 * H)
    ratio = soil.damping_ratio(first)
    hysteretic = ground(lambda f: np.full(np.shape(f), ratio), None)
    peaks = [abs(one.transfer(first, kind="within")) for one in (by_rayleigh, hysteretic)]
    assert peaks[0] == pytest.approx(peaks[1], rel=ratio)
    assert peaks[1] == pytest.approx(2 / (np.pi * ratio), rel=2 * ratio)


def test_a_layer_split_in_two_is_the_same_layer():
    whole, parts = LayeredGround(THREE, ROCK), LayeredGround(split(THREE, 1.5), ROCK)
    assert len(parts.layers) == 3 + 6 + 4
    assert parts.depth == pytest.approx(whole.depth, rel=1e-14)
    for depth in (0.0, 5.0, 19.0, 30.0):
        for name in ("transfer", "strain_transfer", "stress_transfer"):
            a, b = (getattr(one, name)(FREQUENCY, depth, "outcrop") for one in (whole, parts))
            assert np.abs(a - b).max() < 1e-12 * np.abs(b).max() + 1e-15, name


def test_rock_below_rock_is_no_interface():
    """A layer of the base's own kind: the surface of the base, and half-space at depth."""
    same = LayeredGround((Layer(2200.0, 800.0, thickness=7.0),), ROCK)
    k = 2 * np.pi * FREQUENCY / 800.0
    for depth in (0.0, 3.0, 7.0, 12.0):
        exact = 2 * np.cos(k * depth) * np.exp(-1j * k * 7.0)
        assert same.transfer(FREQUENCY, depth) == pytest.approx(exact, abs=1e-12)


def test_undamped_ground_sends_all_back_and_damped_ground_less():
    """Down-going over up-going at the base: of modulus 1, or less by what the layers dissipate,
    ω Im(G*) |γ|²/2 of each metre."""
    undamped = LayeredGround(
        [Layer(*SOIL, thickness=3.0), Layer(1900.0, 90.0, thickness=2.0)], ROCK
    )
    back = undamped.transfer(FREQUENCY, undamped.depth) - 1
    assert np.abs(back) == pytest.approx(np.ones(len(back)), rel=1e-12)
    damped = LayeredGround(THREE, ROCK)
    ω = 2 * np.pi * FREQUENCY
    sent = 1 - np.abs(damped.transfer(FREQUENCY, damped.depth) - 1) ** 2
    lost, top = 0.0, 0.0
    points, weights = np.polynomial.legendre.leggauss(24)
    for layer in THREE:
        loss = layer.density * layer.speed**2 * 2 * layer.damping
        for x, w in zip(points, weights, strict=True):
            γ = damped.strain_transfer(FREQUENCY, top + layer.thickness * (1 + x) / 2)
            lost += w / 2 * layer.thickness * ω / 2 * loss * np.abs(γ) ** 2
        top += layer.thickness
    flux = ROCK.density * ROCK.speed * ω**2 / 2
    assert lost / flux == pytest.approx(sent, abs=1e-13)


def test_stress_goes_on_at_interfaces_and_ends_at_the_surface():
    site = LayeredGround(THREE, ROCK)
    for depth in (4.0, 13.0, 19.0):
        above, below = (site.stress_transfer(FREQUENCY, d) for d in (depth, depth + 1e-9))
        assert below == pytest.approx(above, rel=1e-6)
    assert np.abs(site.stress_transfer(FREQUENCY, 0.0)).max() < 1e-6


def test_strain_is_the_slope_of_the_motion():
    site, h = LayeredGround(THREE, ROCK), 1e-3
    for depth in (2.0, 8.0, 25.0):
        slope = (site.transfer(FREQUENCY, depth - h) - site.transfer(FREQUENCY, depth + h)) / (
            2 * h
        )
        assert site.strain_transfer(FREQUENCY, depth) == pytest.approx(slope, rel=1e-5, abs=1e-9)


def test_slow_motion_is_borne_whole():
    site = LayeredGround(THREE, ROCK)
    for kind, whole in (("up-going", 2.0), ("outcrop", 1.0), ("within", 1.0)):
        assert site.transfer(0.0, 0.0, kind) == pytest.approx(whole, rel=1e-6)
        assert site.transfer([0.0, 1e-6], 3.0, kind) == pytest.approx([whole] * 2, rel=1e-6)
    inert = Layer(*SOIL, 0.0, 0.5, thickness=H)  # a mass that the air holds by α M
    held = 1 + 0.5 * SOIL[0] * H / (ROCK.density * ROCK.speed)
    assert LayeredGround([inert], ROCK).transfer(0.0) == pytest.approx(2 / held, rel=1e-6)


def test_a_pulse_comes_as_dalembert_says():
    """One undamped layer whose impedance the base has not: echoes by their coefficients."""
    dt = 0.002
    t = dt * np.arange(600)

    def pulse(t):
        return np.exp(-(((t - 0.2) / 0.03) ** 2))

    site, travel = ground(), H / SOIL[1]
    Z, Z_base = SOIL[0] * SOIL[1], ROCK.density * ROCK.speed
    into, back = 2 * Z_base / (Z + Z_base), (Z - Z_base) / (Z + Z_base)
    exact = sum(2 * into * back**n * pulse(t - (2 * n + 1) * travel) for n in range(8))
    assert site.motion_at(0.0, pulse(t), dt) == pytest.approx(exact, abs=2e-4)
    assert site.motion_at(0.0, pulse(t), dt, quiet=20.0) == pytest.approx(exact, abs=1e-10)
    assert site.motion_at(0.0, 2 * pulse(t), dt, "outcrop", 20.0) == pytest.approx(exact, abs=1e-10)


def test_the_motion_within_leads_to_the_same_surface():
    """Damped ground: from the wave that comes in to the base's motion, and from that one up."""
    dt, site = 0.005, LayeredGround(THREE, ROCK)
    t = dt * np.arange(2000)
    record = np.sin(9.0 * t) * np.exp(-(((t - 2.0) / 0.7) ** 2))
    surface = site.motion_at(0.0, record, dt)
    base = site.motion_at(site.depth, record, dt)
    assert np.abs(surface).max() > 2.2 * np.abs(record).max()
    again = site.motion_at(0.0, base, dt, "within")
    assert again == pytest.approx(surface, abs=2e-4 * np.abs(surface).max())
    longer = site.motion_at(0.0, record, dt, quiet=500.0)
    assert longer == pytest.approx(surface, abs=1e-4 * np.abs(surface).max())


def test_strain_in_time_is_that_of_a_wave_that_comes_up():
    """In rock up to the time the surface's echo comes: γ = v/c by depth, −v/c by height."""
    dt, depth = 0.001, 60.0
    t = dt * np.arange(400)
    s = (t - 0.15) / 0.02
    acceleration = -2 * s / 0.02 * np.exp(-(s**2))  # of v = exp(−s²)
    rock = LayeredGround((Layer(2200.0, 800.0, thickness=160.0),), ROCK)
    found = rock.strain_at(depth, acceleration, dt, quiet=10.0)
    delay = 100.0 / 800.0
    exact = -np.exp(-(((t - delay - 0.15) / 0.02) ** 2)) / 800.0
    echo = np.exp(-(((t - delay - 0.15 - 2 * depth / 800.0) / 0.02) ** 2)) / 800.0
    assert found == pytest.approx(exact + echo, abs=1e-6 / 800)


def test_stress_bears_the_inertia_of_what_lies_above():
    """−τ is ∫ρ a over the depth, whatever damps."""
    dt, site = 0.01, LayeredGround(THREE[:1], ROCK)
    t = dt * np.arange(500)
    record = np.sin(20.0 * t) * np.exp(-(((t - 2.0) / 0.5) ** 2))
    depth, (points, weights) = 4.0, np.polynomial.legendre.leggauss(12)
    above = sum(
        w / 2 * depth * 1700.0 * site.motion_at(depth * (1 + x) / 2, record, dt, quiet=20.0)
        for x, w in zip(points, weights, strict=True)
    )
    found = site.stress_at(depth, record, dt, quiet=20.0)
    assert found == pytest.approx(-above, abs=1e-6 * np.abs(above).max())


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: HalfSpace(0.0, 1.0), "density must be positive, got 0.0"),
        (lambda: HalfSpace(1.0, np.nan), "speed must be positive, got nan"),
        (lambda: HalfSpace(1.0, 1.0, 5.0), "damping must be a ratio below 1, got 5.0: 5 % are"),
        (lambda: HalfSpace(1.0, 1.0, -0.1), "damping must not be negative, got -0.1"),
        (lambda: Layer(1.0, 1.0, thickness=0.0), "thickness must be positive, got 0.0"),
        (lambda: LayeredGround((ROCK,), ROCK), "layers must be Layer objects"),
        (lambda: LayeredGround((), ROCK), "one or more, got \\(\\)"),
        (lambda: LayeredGround(THREE, THREE[0]), "base must be a HalfSpace, or None"),
        (
            lambda: ground().transfer(1.0, 0.0, "bedrock"),
            "up-going, outcrop, within, got 'bedrock'",
        ),
        (
            lambda: ground(base=None).transfer(1.0),
            "must be 'within' on a rigid base, got 'up-going'",
        ),
        (lambda: ground().transfer(1.0, -1.0), "depth must lie between 0, got -1.0"),
        (
            lambda: ground(base=None).transfer(1.0, 21.0, "within"),
            "20.0 m, the rigid base, got 21.0",
        ),
        (lambda: ground().transfer(-1.0), "not negative, got -1.0"),
        (lambda: ground(lambda f: -f).transfer(1.0), "ratios that are not negative"),
        (lambda: ground().motion_at(0.0, np.ones((3, 2)), 0.1), "got shape \\(3, 2\\)"),
        (lambda: ground().motion_at(0.0, np.ones(3), 0.0), "dt must be positive, got 0.0"),
        (
            lambda: ground(base=None).motion_at(0.0, np.array([0, 1.0, 0, 0]), 0.02, "within"),
            "does not come to rest in .* damp its layers",
        ),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
