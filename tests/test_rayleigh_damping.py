"""Rayleigh damping: standing waves decay by the exact ratio, bodies that move as a whole by α
alone."""

import json
from dataclasses import replace

import damped
import numpy as np
import pytest
from open_ground import TIGHT
from test_ranks import on_ranks

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical.damping import DampedVibration, bar_frequency
from mpm_fenicsx.scenes.bar import tiles

LENGTH, CELLS, STEPS = 1.0, 20, 40
SOIL = mpm.LinearElastic(young=1e6, poisson=0.25, density=1000.0)
PERIOD = 2.0 * LENGTH / SOIL.p_speed
TENTH = mpm.RayleighDamping(0.1, (10.0, 40.0))
SMALL = 1e-6  # m/s: points stay in their cells


def bar(dim=2, terms=(TENTH,), stepping=mpm.Newmark, mapping=None, **options):
    """A bar with both ends held, and rollers along it, in its first vibration."""
    cells = (CELLS, *[2] * (dim - 1))
    grid = mpm.Grid.box((0.0,) * dim, (LENGTH, *[0.1] * (dim - 1)), cells)
    sides = {"y": grid.facets("bottom", "top")}
    if dim == 3:
        sides["z"] = grid.facets("back", "front")
    held = [mpm.Fixed(on, d) for d, on in sides.items()]
    terms = [mpm.Fixed(grid.facets("left", "right"), "x"), *held, *terms]
    step, speed = stepping(PERIOD / STEPS), 0.0 if options.pop("at_rest", False) else SMALL
    material = options.pop("material", SOIL)
    if mapping is None:
        run = mpm.FiniteElements(grid, material, step, terms, **options)
        x = grid.space.tabulate_dof_coordinates()[:, 0]
        run.nodal("velocity")[:, 0] = speed * np.sin(np.pi * x / LENGTH)
        return run, x
    inside = options.pop("inside", None)
    body = mpm.MaterialPoints.fill(grid, material, 2**dim, inside)
    body.velocity = np.zeros_like(body.x)
    body.velocity[:, 0] = speed * np.sin(np.pi * body.x[:, 0] / LENGTH)
    return mpm.Simulation(grid, body, step, terms, mapping, **options), body.x[:, 0]


def vibration(damping=TENTH):
    """The bar's first vibration as its elements have it."""
    ω = bar_frequency(1, LENGTH, SOIL.p_speed, LENGTH / CELLS)
    return DampedVibration(ω, damping.ratio_at(ω / (2.0 * np.pi)), SMALL)


def after(run, steps=2 * STEPS):
    """Energies of the run, which makes so many steps."""
    energy = run.record(mpm.Energy())
    for _ in range(steps):
        run.step()
    return energy


# -- what it is ------------------------------------------------------------------------------------


def test_the_ratio_is_that_asked_for_at_both_frequencies_and_less_between():
    np.testing.assert_allclose(TENTH.ratio_at([10.0, 40.0]), 0.1, rtol=1e-14)
    assert TENTH.ratio_at(20.0) == pytest.approx(0.08, rel=1e-14)  # 2 ξ √(f₁ f₂)/(f₁ + f₂)
    assert TENTH.ratio_at(80.0) == pytest.approx(0.17, rel=1e-14)
    both = mpm.RayleighDamping(alpha=TENTH.alpha, beta=TENTH.beta)
    assert both.ratio_at(3.0) == pytest.approx(TENTH.ratio_at(3.0), rel=1e-14)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "none of them"),
        ({"ratio": 0.1, "frequencies": (1, 5), "beta": 1e-3}, "all of them"),
        ({"ratio": 0.1}, "frequencies is missing"),
        ({"frequencies": (1, 5)}, "ratio is missing"),
        ({"ratio": 5.0, "frequencies": (1, 5)}, "ratio must lie between 0.0 and 1.0, .* got 5.0"),
        ({"ratio": 0.05, "frequencies": (5, 1)}, r"the lower one first .* got \(5, 1\)"),
        ({"ratio": 0.05, "frequencies": (0, 1)}, r"got \(0, 1\)"),
        ({"ratio": 0.05, "frequencies": 3.0}, "two numbers of Hz, .* got 3.0"),
        ({"alpha": -1.0}, "alpha must not be negative, got -1.0"),
        ({"beta": np.nan}, "beta must be finite"),
        ({"alpha": 0.0, "beta": 0.0}, "leave it out"),
    ],
)
def test_what_is_no_damping_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        mpm.RayleighDamping(**given)


def test_a_frequency_of_zero_has_no_ratio():
    with pytest.raises(ValueError, match="frequency must be positive, got 0"):
        TENTH.ratio_at(0.0)


def test_a_run_says_what_damps_it():
    for mapping in (None, mpm.DM_GC):
        run, _ = bar(mapping=mapping)
        assert "RayleighDamping: 0.1 of critical at 10 and 40 Hz: alpha = 10.05 1/s" in str(run)


# -- a standing wave -------------------------------------------------------------------------------


@pytest.mark.parametrize(("dim", "b_bar"), [(2, False), (2, True), (3, True)])
def test_elements_decay_as_the_trapezoidal_rule_has_it(dim, b_bar):
    run, x = bar(dim, b_bar=b_bar, solver=TIGHT)
    energy, mode = after(run), vibration()
    q, v = mode.stepped(PERIOD / STEPS, 2 * STEPS)
    shape = np.sin(np.pi * x / LENGTH)
    for name, value, size in (("displacement", q, SMALL * PERIOD), ("velocity", v, SMALL)):
        wrong = np.abs(run.nodal(name)[:, 0] - value * shape).max()
        assert wrong < 1e-10 * size, name
    left = mode.energy_stepped(PERIOD / STEPS, np.arange(2 * STEPS + 1))
    np.testing.assert_allclose(energy.left / energy.left[0], left, rtol=1e-9)
    assert np.abs(energy.lost).max() < 1e-11 * energy.left[0]


@pytest.mark.parametrize("radius", [0.5, 1.0])
@pytest.mark.parametrize("start", [0.0, 0.5])
def test_elements_decay_as_one_vibration_by_generalized_alpha(radius, start):
    def stepping(dt):
        return mpm.GeneralizedAlpha(dt, spectral_radius=radius, start=start)

    run, x = bar(stepping=stepping, solver=TIGHT)
    mode, step = vibration(), stepping(PERIOD / STEPS)
    ω, c = mode.angular_frequency, 2.0 * mode.ratio * mode.angular_frequency
    (c0, c1, c2), (d0, d1, d2) = step.balanced
    q, v, a = 0.0, SMALL, -c * SMALL
    for _ in range(STEPS):
        known = d1 * v + d2 * a + c * (c1 * v + c2 * a) + ω**2 * (1.0 + start) * q
        u = -known / (d0 + c * c0 + ω**2)
        v, a = (f[0] * u + f[1] * v + f[2] * a for f in (step.velocity, step.acceleration))
        q += u
        run.step()
    found = run.nodal("displacement")[:, 0]
    assert np.abs(found - q * np.sin(np.pi * x / LENGTH)).max() < 1e-10 * SMALL * PERIOD


@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.DM_GCL, mpm.GIMP, mpm.MPM])
def test_points_keep_the_exact_energy_after_two_periods(mapping):
    """To 1 % of it, which the method without damping is from exact after as long."""
    run, _ = bar(mapping=mapping)
    energy, exact = after(run), vibration().energy_stepped(PERIOD / STEPS, 2 * STEPS)
    assert energy.left[-1] / energy.left[0] == pytest.approx(exact, rel=0.01)
    assert energy["damped"][-1] / energy.left[0] == pytest.approx(1.0 - exact, rel=0.002)


@pytest.mark.parametrize("mapping", [mpm.DM_GC, replace(mpm.DM_GC, b_bar=True), mpm.GIMP])
@pytest.mark.parametrize(("courant", "beta"), [(0.5, 1e-3), (2.0, 1e-3), (0.5, 1e-2)])
def test_waves_among_points_of_random_sizes_only_die(mapping, courant, beta):
    """Waves three cells long, far more than critically damped, in points that drift: their energy
    never rises by more than the method lets it without damping."""
    soil, cell = mpm.LinearElastic(young=1e6, poisson=0.3, density=1000.0), 0.05
    dt = courant * cell / soil.p_speed
    grid = mpm.Grid.box((-0.1, -0.1), (1.5, 0.2), (32, 6))
    body = tiles(soil, cell / 2, 0.3)
    drift = np.array([0.1 / (60 * dt), 0.0])
    x = 40.0 * body.x[:, 0]
    body.velocity = SMALL * np.stack([np.sin(x), np.cos(0.75 * x)], axis=1) + drift
    rough = mpm.InitialAcceleration.ZERO
    terms = [mpm.RayleighDamping(beta=beta)]
    run = mpm.Simulation(grid, body, mpm.Newmark(dt), terms, mapping, initial_acceleration=rough)
    energy, left = run.record(mpm.Energy()), []
    for _ in range(61):
        relative = body.velocity - drift
        left.append(energy["strain"][-1] + 0.5 * body.mass @ (relative**2).sum(axis=1))
        run.step()
    assert (np.diff(left) < 1e-3 * left[0]).all()
    assert left[-1] < 0.1 * left[0]


def test_yielding_soil_below_yield_is_the_elastic_one():
    law = mpm.VonMises(SOIL, peak=1e6, residual=1e6, softening=0.0)
    for mapping in (None, mpm.DM_GC):
        how = {"b_bar": True} if mapping is None else {}
        plain, _ = bar(mapping=mapping and replace(mapping, b_bar=True), **how)
        other, _ = bar(mapping=mapping, material=law)
        one, two = (after(run, STEPS)["damped"][-1] for run in (plain, other))
        assert two == pytest.approx(one, rel=1e-6)


# -- a body that moves as a whole ------------------------------------------------------------------


def rigid(mapping, *terms, dim=2, far=False, speed=SMALL):
    """A free block that moves along x."""
    grid = mpm.Grid.box((0.0,) * dim, (3.0,) * dim, (3,) * dim)
    terms = [*terms, *([mpm.FarField(lambda x: x[1] < 1.0, SOIL)] if far else [])]
    if mapping is None:
        run = mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-3), terms, solver=TIGHT)
        run.nodal("velocity")[:, 0] = speed
        return run
    body = mpm.MaterialPoints.fill(grid, SOIL, 2**dim, lambda x: x[1] > (1.0 if far else 0.0))
    body.velocity = speed * np.eye(dim)[0] * np.ones((len(body), 1))
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), terms, mapping, solver=TIGHT)
    return run


@pytest.mark.parametrize(
    ("mapping", "dim"), [(None, 2), (mpm.DM_GC, 2), (mpm.DM_GC, 3), (mpm.GIMP, 2)]
)
def test_a_block_that_moves_as_a_whole_loses_by_alpha_alone(mapping, dim):
    energy = after(rigid(mapping, mpm.RayleighDamping(beta=0.1), dim=dim), 10)
    np.testing.assert_allclose(energy.left, energy.left[0], rtol=1e-11)
    half = 0.5 * 20.0 * 1e-3  # α dt/2
    energy = after(rigid(mapping, mpm.RayleighDamping(alpha=20.0), dim=dim), 10)
    factor = ((1.0 - half) / (1.0 + half)) ** 2
    np.testing.assert_allclose(energy.left, energy.left[0] * factor ** np.arange(11.0), rtol=1e-10)
    np.testing.assert_allclose(energy["damped"], energy.left[0] - energy.left, rtol=1e-9)


# -- several materials -----------------------------------------------------------------------------

LEFT = mpm.LinearElastic(young=1e6, poisson=0.25, density=1000.0)
RIGHT = mpm.LinearElastic(young=4e6, poisson=0.3, density=2000.0)


def two(mapping, *terms):
    """Two free blocks that do not touch, each of its material, moving along x."""
    grid = mpm.Grid.box((0.0, 0.0), (8.0, 2.0), (8, 2))
    bodies = [
        mpm.MaterialPoints.fill(grid, LEFT, 4, lambda x: x[0] < 2.0),
        mpm.MaterialPoints.fill(grid, RIGHT, 4, lambda x: x[0] > 6.0),
    ]
    for body in bodies:
        body.velocity = np.tile([0.0, SMALL], (len(body), 1))
    return mpm.Simulation(grid, bodies, mpm.Newmark(1e-3), terms, mapping, solver=TIGHT)


@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.GIMP])
def test_each_material_decays_by_its_own_ratio(mapping):
    α = {LEFT: 20.0, RIGHT: 60.0}
    run = two(mapping, *(mpm.RayleighDamping(alpha=a, material=m) for m, a in α.items()))
    for _ in range(5):
        run.step()
    for body in run.bodies:
        half = 0.5 * α[body.material] * 1e-3
        exact = SMALL * ((1.0 - half) / (1.0 + half)) ** 5
        np.testing.assert_allclose(body.velocity[:, 1], exact, rtol=1e-10)


def test_the_same_for_each_material_is_that_for_all():
    materials = [(LEFT, lambda x: x[0] < 0.5), (RIGHT, lambda x: x[0] > 0.5)]
    each = [mpm.RayleighDamping(0.1, (10, 40), material=m) for m in (LEFT, RIGHT)]
    (one, _), (other, _) = (
        bar(terms=terms, material=materials, solver=TIGHT) for terms in ([TENTH], each)
    )
    first, second = after(one, STEPS), after(other, STEPS)
    for name in ("kinetic", "strain", "damped"):
        np.testing.assert_allclose(second[name], first[name], rtol=1e-9, atol=1e-20)
    assert np.abs(second.lost).max() < 1e-11 * second.left[0]


def test_one_material_alone_is_damped():
    materials = [(LEFT, lambda x: x[0] < 0.5), (RIGHT, lambda x: x[0] > 0.5)]
    half = mpm.RayleighDamping(alpha=20.0, material=RIGHT)
    run, x = bar(terms=[half], material=materials, solver=TIGHT)
    energy = run.record(mpm.Energy())
    run.nodal("velocity")[x > 0.5 - 1e-9] = 0.0
    first = energy.left[0]
    run.step()
    assert 0.0 < energy["damped"][-1] < 1e-3 * first  # nothing has come to the right yet


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        ([TENTH, TENTH], "give each its material"),
        ([mpm.RayleighDamping(alpha=1.0, material=SOIL)] * 2, "two terms damp the material"),
        ([mpm.RayleighDamping(alpha=1.0, material=RIGHT)], "material of RayleighDamping: no "),
    ],
)
@pytest.mark.parametrize("mapping", [None, mpm.DM_GC])
def test_soil_is_damped_once_and_is_there(terms, message, mapping):
    with pytest.raises(ValueError, match=message):
        bar(terms=terms, mapping=mapping)


def test_statics_have_no_velocities():
    with pytest.raises(ValueError, match="RayleighDamping needs velocities: step with Newmark"):
        bar(stepping=lambda dt: mpm.QuasiStatic(2))


# -- a far field -----------------------------------------------------------------------------------


def pull(t):
    """Body force per mass, m/s², from zero at the start, when all is at rest."""
    return np.sin(2.0 * np.pi * t / PERIOD), 0.0


def pulled(dim, *terms, **options):
    """The bar at rest, pulled along by its mass."""
    force = mpm.Gravity(lambda t: (*pull(t), 0.0)[:dim])
    run, _ = bar(dim, terms=[force, *terms], at_rest=True, **options)
    return after(run, STEPS)


@pytest.mark.parametrize(("dim", "b_bar", "material"), [(2, False, SOIL), (2, True, None)])
def test_elements_in_a_far_field_are_the_same_elements(dim, b_bar, material):
    damping = mpm.RayleighDamping(0.1, (10.0, 40.0), material=material)
    far = mpm.FarField(lambda x: x[0] < 0.5 * LENGTH, SOIL)
    one, other = (pulled(dim, *terms, b_bar=b_bar) for terms in ([damping], [damping, far]))
    for name in ("work", "kinetic", "strain", "damped"):
        most = np.abs(one[name]).max()
        np.testing.assert_allclose(other[name], one[name], rtol=1e-9, atol=1e-11 * most)
    assert np.abs(other.lost).max() < 1e-11 * other["work"].max()
    assert other["damped"][-1] > 0.1 * other["work"].max()


@pytest.mark.parametrize("mapping", [None, mpm.DM_GC])
def test_a_far_field_beside_is_pulled_and_damped_as_a_whole(mapping):
    α, dt, force = 20.0, 1e-3, mpm.Gravity(pull)
    run = rigid(mapping, mpm.RayleighDamping(alpha=α), force, far=True, speed=0.0)
    energy, v, half = after(run, 10), 0.0, 0.5 * α * dt
    for n in range(10):
        v = (v * (1.0 - half) + 0.5 * dt * (pull(n * dt)[0] + pull((n + 1) * dt)[0])) / (1.0 + half)
    assert energy["kinetic"][-1] == pytest.approx(0.5 * 9.0 * SOIL.density * v**2, rel=1e-9)
    assert energy["damped"][-1] > 0.05 * energy["work"][-1]


def test_a_material_of_the_far_field_alone_is_damped_there():
    """What the term takes is what is lost of the work: of the rest points lose a hundredth."""
    far = mpm.FarField(lambda x: x[0] < 0.5 * LENGTH, RIGHT)
    term = mpm.RayleighDamping(alpha=20.0, material=RIGHT)
    energy = pulled(2, far, term, mapping=mpm.DM_GC, inside=lambda x: x[0] > 0.5 * LENGTH)
    assert energy["damped"][-1] > 0.1 * energy["work"].max()
    assert np.abs(energy.lost).max() < 0.01 * energy["work"].max()


@pytest.mark.ranks
def test_two_ranks_lose_what_one_does(tmp_path):
    out = tmp_path / "out.json"
    on_ranks(2, damped.__file__, out)
    several, alone = json.loads(out.read_text()), damped.numbers()
    for case, expected in alone.items():
        np.testing.assert_allclose(several[case], expected, rtol=1e-9)
        assert expected[2] > 0.1 * expected[0], case
