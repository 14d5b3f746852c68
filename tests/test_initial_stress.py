"""Ground at rest: the stress of layers is the weight above, and nothing moves."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from test_ranks import on_ranks

import mpm_fenicsx as mpm

G = 9.81
LIGHT = mpm.LinearElastic(young=20e6, poisson=0.3, density=1500.0)
DENSE = mpm.LinearElastic(young=50e6, poisson=0.25, density=2100.0)
STRONG = mpm.VonMises(DENSE, peak=1e6, residual=1e6, softening=0.0)
STEPS = {
    "static": mpm.QuasiStatic(2),
    "Newmark": mpm.Newmark(1e-3),
    "alpha": mpm.GeneralizedAlpha(1e-3, 0.8, start=0.5),
}


def two_layers(grid, interface=3.75, soils=(LIGHT, DENSE), top=6.0, **more):
    return [
        mpm.MaterialPoints.fill(
            grid, soils[0], 2**grid.dim, lambda x: (x[1] > interface) & (x[1] < top), **more
        ),
        mpm.MaterialPoints.fill(grid, soils[1], 2**grid.dim, lambda x: x[1] <= interface, **more),
    ]


def by_hand(body, n, interface=3.75, top=6.0, K0=(0.5, 0.7)):
    y = body.x[:, 1]
    weight = LIGHT.density * (top - (y if n == 0 else interface))
    weight = weight + (DENSE.density * (interface - y) if n else 0.0)
    rows = np.zeros_like(body.stress)
    rows[:, :3] = -G * weight[:, None] * np.array([K0[n], 1.0, K0[n]])
    return rows


def rollers(grid):
    held = {"left": "x", "right": "x", "bottom": "y"}
    held |= {"front": "z", "back": "z"} if grid.dim == 3 else {}
    gravity = (0.0, -G, 0.0)[: grid.dim]
    return [*(mpm.Fixed(grid.facets(s), d) for s, d in held.items()), mpm.Gravity(gravity)]


def box(dim=2, height=6.5):
    return mpm.Grid.box([0.0] * dim, (2.0, height, 1.0)[:dim], (4, round(2 * height), 2)[:dim])


# -- points ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_points_bear_the_layers_above_them(dim, jitter):
    bodies = two_layers(box(dim), jitter=jitter)
    mpm.initial_stress(bodies, 6.0, [0.5, 0.7])
    for n, body in enumerate(bodies):
        np.testing.assert_allclose(body.stress, by_hand(body, n), rtol=1e-12, atol=1e-8)


def test_the_vertical_is_where_gravity_points():
    grid = mpm.Grid.box((0.0, 0.0, 0.0), (1.0, 1.0, 3.0), (2, 2, 6))
    body = mpm.MaterialPoints.fill(grid, DENSE, 8)
    mpm.initial_stress(body, 3.0, 0.4, gravity=(0.0, 0.0, -G))
    vertical = -DENSE.density * G * (3.0 - body.x[:, 2])
    np.testing.assert_allclose(body.stress[:, 2], vertical, rtol=1e-12)
    np.testing.assert_allclose(body.stress[:, :2], 0.4 * vertical[:, None] * [1, 1], rtol=1e-12)
    assert not body.stress[:, 3:].any()
    ground = mpm.GeostaticStress(DENSE, 3.0, 0.4, gravity=(0.0, 0.0, -G))
    np.testing.assert_allclose(ground(body.x.T), body.stress, rtol=1e-12)


@pytest.mark.parametrize("interface", [3.5, 3.75])
@pytest.mark.parametrize("stepping", STEPS.values(), ids=STEPS)
@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.GIMP], ids=str)
def test_level_layers_of_points_are_at_rest(mapping, stepping, interface):
    """Also where the interface is inside cells."""
    grid = box()
    bodies = two_layers(grid, interface, (LIGHT, STRONG))
    mpm.initial_stress(bodies, 6.0, [0.5, 0.7])
    before = [body.x.copy() for body in bodies]
    run = mpm.Simulation(grid, bodies, stepping, rollers(grid), mapping)
    assert run.balance()[1] < 1e-12
    for _ in range(3):
        run.step()
    assert run.balance()[1] < 1e-10
    for body, x in zip(bodies, before, strict=True):
        assert np.abs(body.x - x).max() < 1e-12


def test_a_slope_bears_the_depth_below_its_surface_and_settles():
    """Stairs of points under a straight slope; K0 is a function of place."""

    def height(x):
        return 2.0 + 0.5 * x[0]

    grid = mpm.Grid.box((0.0, 0.0), (4.0, 5.0), (8, 10))
    body = mpm.MaterialPoints.fill(grid, LIGHT, 4, inside=lambda x: x[1] < height(x))
    mpm.initial_stress(body, height, lambda x: 0.4 + 0.1 * x[1])
    vertical = -LIGHT.density * G * (height(body.x.T) - body.x[:, 1])
    np.testing.assert_allclose(body.stress[:, 1], vertical, rtol=1e-12)
    np.testing.assert_allclose(body.stress[:, 0], (0.4 + 0.1 * body.x[:, 1]) * vertical)
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom")),
        mpm.Gravity((0.0, -G)),
    ]
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(1), terms)
    assert run.balance()[1] > 1e-2
    assert run.settle(1e-9) <= 1e-9


@dataclass(frozen=True)
class Preconsolidated(mpm.OnElastic):
    """Elastic, and remembers the pressure it started with, which must not be zero."""

    elastic: mpm.LinearElastic

    history = ("preconsolidation", "plastic_work")
    check_pressure = 1e3

    def initial_history(self, stress, given=()):
        if (stress[:, 1] >= 0.0).any():
            raise ValueError("stress must be a pressure")
        return np.column_stack((-2.0 * stress[:, 1], np.zeros(len(stress))))

    def tangent(self, strain, stress, history, given=()):
        return *self.elastic.tangent(strain, stress, history)[:2], np.repeat(
            mpm.stiffness(self.lame, 2)[None], len(strain), axis=0
        )


def test_state_variables_follow_the_stress():
    """Also of a law that cannot be without: its points get their stress as they are made."""
    law, grid = Preconsolidated(LIGHT), box()
    with pytest.raises(ValueError, match="stress must be a pressure"):
        mpm.MaterialPoints.fill(grid, law, 4)
    ground = mpm.GeostaticStress(law, 6.5, 0.5)
    body = mpm.MaterialPoints.fill(grid, law, 4, stress=ground)
    np.testing.assert_array_equal(body.history[:, 0], -2.0 * body.stress[:, 1])
    np.testing.assert_allclose(body.stress[:, 1], -LIGHT.density * G * (6.5 - body.x[:, 1]))
    mpm.initial_stress(body, 6.5, 0.5, gravity=2 * G)
    np.testing.assert_array_equal(body.history[:, 0], -2.0 * body.stress[:, 1])
    np.testing.assert_allclose(body.stress[:, 1], -2 * LIGHT.density * G * (6.5 - body.x[:, 1]))
    run = mpm.FiniteElements(grid, law, mpm.Newmark(1e-3), rollers(grid), stress=ground)
    np.testing.assert_allclose(run.gauss_history()[:, 0], -2.0 * run.gauss_stress()[:, 1])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bodies": []}, "bodies must be material points, one body or several, got"),
        ({"K0": [0.5, 0.6, 0.7]}, r"K0 must be .* one for each body \(2\), or a function of x"),
        ({"K0": -0.5}, "K0 must be a number that is not negative"),
        ({"K0": lambda x: np.ones(3)}, r"K0 must map \(dim, n\) to \(n,\) finite numbers, gave"),
        ({"surface": 5.0}, r"surface at 5.0 m is not that of the points, the highest of which"),
        ({"surface": 8.0}, "surface at 8.0 m is not that of the points"),
        ({"gravity": (1.0, -9.81)}, "gravity must be .* down one axis"),
        ({"gravity": -9.81}, "gravity must be positive, got -9.81"),
        ({"gravity": (0.0, 0.0, -9.81)}, "gravity acts along axis 2, and points have 2"),
    ],
)
def test_what_is_no_layered_ground_is_refused(change, words):
    given = {"bodies": two_layers(box()), "surface": 6.0, "K0": 0.5} | change
    with pytest.raises(ValueError, match=words):
        mpm.initial_stress(**given)


def test_points_that_stand_in_no_columns_are_refused():
    grid = box()
    upper, lower = two_layers(grid)
    hole = mpm.MaterialPoints.fill(grid, DENSE, 4, inside=lambda x: x[1] < 2.0)
    with pytest.raises(ValueError, match=r"1.75 m are open above .*give all bodies that lie above"):
        mpm.initial_stress([upper, hole], 6.0, 0.5)
    with pytest.raises(ValueError, match="points lie upon one another"):
        mpm.initial_stress([upper, lower, hole], 6.0, 0.5)
    before = lower.stress.copy()
    lower.x += np.random.default_rng(0).uniform(-0.1, 0.1, lower.x.shape)
    with pytest.raises(ValueError, match="points must be as fill makes them, not cut or moved"):
        mpm.initial_stress([upper, lower], 6.0, 0.5)
    np.testing.assert_array_equal(lower.stress, before)


RANKS = """
import json, sys
import numpy as np
from mpi4py import MPI
import mpm_fenicsx as mpm
sys.path.insert(0, sys.argv[1])
import test_initial_stress as t
grid = mpm.Grid.box((0.0, 0.0), (1.0, 6.5), (2, 13))
bodies = t.two_layers(grid)
mpm.initial_stress(bodies, 6.0, [0.5, 0.7])
off = max(
    np.abs(b.stress - t.by_hand(b, n)).max(initial=0.0) for n, b in enumerate(bodies)
)
run = mpm.Simulation(grid, bodies, mpm.Newmark(1e-3), t.rollers(grid))
fe = mpm.FiniteElements(
    grid, t.LIGHT, mpm.Newmark(1e-3), t.rollers(grid), stress=mpm.GeostaticStress(t.LIGHT, 6.5, 0.5)
)
fe.step()
found = MPI.COMM_WORLD.allreduce(float(off), MPI.MAX), run.balance()[1], fe.balance()[1]
try:
    mpm.initial_stress(bodies[:1], 7.5, 0.5)
except ValueError as error:
    words = str(error)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps([*found, words]))
"""


def test_on_two_ranks_columns_go_on_over_the_border(tmp_path):
    from pathlib import Path

    script = tmp_path / "two.py"
    script.write_text(RANKS)
    off, points, elements, words = json.loads(on_ranks(2, script, Path(__file__).parent))
    assert off < 1e-8 and points < 1e-12 and elements < 1e-10
    assert words.startswith("surface at 7.5 m is not that of the points")


# -- as a function of place, and finite elements ---------------------------------------------------


def test_layers_of_any_shape_weigh_what_is_above():
    def interface(x):
        return 2.0 + 0.5 * x[0] + 0.3 * np.sin(x[0])

    def height(x):
        return 5.0 - 0.25 * x[0]

    pairs = [(LIGHT, lambda x: x[1] > interface(x)), (DENSE, lambda x: x[1] <= interface(x))]
    ground = mpm.GeostaticStress(pairs, height, (0.5, 0.8))
    x = np.random.default_rng(0).uniform(0.0, 3.0, (2, 200))
    a, h = interface(x), height(x)
    exact = np.where(
        x[1] > a,
        LIGHT.density * (h - x[1]),
        LIGHT.density * (h - a) + DENSE.density * (a - x[1]),
    )
    rows = ground(x)
    np.testing.assert_allclose(rows[:, 1], -G * exact, rtol=1e-12)
    np.testing.assert_allclose(rows[:, 0], np.where(x[1] > a, 0.5, 0.8) * rows[:, 1])
    assert (rows[:, 0] == rows[:, 2]).all() and not rows[:, 3].any()


SOLID = pytest.param(3, "alpha", marks=pytest.mark.validation)


@pytest.mark.parametrize(
    "soils",
    [
        (LIGHT, DENSE),
        (LIGHT, STRONG),
        (mpm.Hencky(20e6, 0.3, 1500.0), mpm.Hencky(50e6, 0.25, 2100.0)),
    ],
    ids=["elastic", "yielding", "finite strain"],
)
@pytest.mark.parametrize("dim, name", [(2, name) for name in STEPS] + [SOLID])
def test_level_layers_of_elements_are_at_rest(soils, dim, name):
    grid, stepping = box(dim, 6.0), STEPS[name]
    pairs = [(soils[0], lambda x: x[1] > 3.5), (soils[1], lambda x: x[1] <= 3.5)]
    ground = mpm.GeostaticStress(pairs, 6.0, [0.5, 0.7])
    run = mpm.FiniteElements(grid, pairs, stepping, rollers(grid), stress=ground)
    assert run.balance()[1] < 1e-12
    for _ in range(3):
        run.step()
    assert run.balance()[1] < 1e-10
    assert np.abs(run.nodal("displacement")).max() < 1e-12
    given = ground(run.gauss_places().T)
    np.testing.assert_allclose(run.gauss_stress(), given, atol=1e-9 * np.abs(given).max())


def test_elements_wave_on_top_of_their_stress_as_without_it():
    """Elastic soil is linear: a pulse moves it as it does without gravity, and energy balances."""

    def ran(stress, b_bar=False):
        grid = box(height=6.0)
        terms = rollers(grid)[: None if stress else -1]
        push = mpm.Traction(grid.facets("top"), lambda t: (0.0, -1e4 * np.sin(200.0 * t)))
        run = mpm.FiniteElements(
            grid, LIGHT, mpm.Newmark(1e-3), [*terms, push], b_bar=b_bar, stress=stress
        )
        energy = run.record(mpm.Energy())
        for _ in range(20):
            run.step()
        return run, energy

    for b_bar in (False, True):
        ground = mpm.GeostaticStress(LIGHT, 6.0, 0.5)
        (stressed, energy), (plain, _) = ran(ground, b_bar), ran(None, b_bar)
        a, b = (run.nodal("displacement") for run in (stressed, plain))
        np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(b).max())
        change = stressed.gauss_stress() - ground(stressed.gauss_places().T)
        size = np.abs(plain.gauss_stress()).max()
        np.testing.assert_allclose(change, plain.gauss_stress(), atol=1e-9 * size)
        assert abs(energy.lost[-1]) < 1e-6 * np.abs(energy["work"]).max()


def test_elements_with_stress_are_checkpointed_and_set_free(tmp_path):
    """The static run's stress goes over to the next run by start; with what the base bore as a
    traction nothing moves."""
    ground = mpm.GeostaticStress(LIGHT, 6.0, 0.5)

    def loaded():
        grid = box(height=6.0)
        top = mpm.Traction(grid.facets("top"), lambda t: (0.0, -1e3 * t))
        return mpm.FiniteElements(
            grid, LIGHT, mpm.QuasiStatic(4), [*rollers(grid), top], stress=ground
        )

    run = loaded()
    run.record(mpm.Checkpoint(tmp_path / "run", every=2))
    run.until(1.0)
    again = loaded()
    again.restart(tmp_path / "run")
    np.testing.assert_array_equal(again.gauss_stress(), run.gauss_stress())
    expected = ground(run.gauss_places().T)[:, 1] - 1e3
    np.testing.assert_allclose(run.gauss_stress()[:, 1], expected, rtol=1e-9)
    grid = run.grid
    base = grid.facets("bottom")
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Gravity((0.0, -G)),
        mpm.Traction(grid.facets("top"), (0.0, -1e3)),
        *run.reactions(base),
        mpm.ViscousBoundary(base, LIGHT),
    ]
    free = mpm.FiniteElements(grid, LIGHT, mpm.Newmark(1e-3), terms, start=run)
    np.testing.assert_array_equal(free.gauss_stress(), run.gauss_stress())
    for _ in range(3):
        free.step()
    assert np.abs(free.nodal("velocity")).max() < 1e-10
    with pytest.raises(ValueError, match=r"stress at the start is that of start .*: give one"):
        mpm.FiniteElements(grid, LIGHT, mpm.Newmark(1e-3), terms, start=run, stress=ground)


@pytest.mark.parametrize(
    ("stress", "words"),
    [
        (3.0, r"stress must be a function of x \(dim, n\), m, such as GeostaticStress, got 3.0"),
        (lambda x: x, r"stress must map x .* to \(\d+, 4\) finite numbers, .* gave shape"),
        (lambda x: np.full((x.shape[1], 4), np.nan), "stress must map x"),
        (lambda x: x[5], "stress raises IndexError"),
        (mpm.GeostaticStress(LIGHT, 5.0, 0.5), "surface at 5.0 m lies below the place"),
        (
            mpm.GeostaticStress([(LIGHT, lambda x: x[1] > 4.0)], 6.0, 0.5),
            "layers: the place .* lies in no layer",
        ),
        (
            mpm.GeostaticStress([(LIGHT, lambda x: x[1] > -1.0)] * 2, 6.0, 0.5),
            r"lies in the layers \[0, 1\]: each place is in one",
        ),
    ],
)
def test_what_is_no_stress_is_refused(stress, words):
    grid = box(height=6.0)
    with pytest.raises(ValueError, match=words):
        mpm.FiniteElements(grid, LIGHT, mpm.Newmark(1e-3), [], stress=stress)
    with pytest.raises(ValueError, match=words):
        mpm.MaterialPoints.fill(grid, LIGHT, 4, stress=stress)


def test_layers_that_are_none_are_refused():
    for layers, words in (
        (3.0, r"layers must be a material, or pairs \(material, where\)"),
        ([], "layers must be"),
        ([(LIGHT, 3.0)], "layers must be"),
    ):
        with pytest.raises(ValueError, match=words):
            mpm.GeostaticStress(layers, 6.0, 0.5)
    for more, words in (
        ({"K0": (0.1, 0.2)}, r"one for each layer \(1\)"),
        ({"surface": "high"}, "surface must be a number, got 'high'"),
        ({"gravity": 0.0}, "gravity must be positive"),
    ):
        with pytest.raises(ValueError, match=words):
            mpm.GeostaticStress(**({"layers": LIGHT, "surface": 6.0, "K0": 0.5} | more))


def test_k0_of_undrained_ground_is_of_effective_stresses():
    """By hand: σ'_v = σ_v + u, σ_h = K0 σ'_v - u below a water table."""
    soil = mpm.LinearElastic(young=20e6, poisson=0.3, density=1700.0)
    clay = mpm.Undrained(mpm.MohrCoulomb(soil, 10e3, 25.0), 5e8)
    grid = mpm.Grid.box((0.0, 0.0), (2.0, 3.0), (4, 6))
    water = {"pore_pressure": mpm.hydrostatic(2.0)}
    body = mpm.MaterialPoints.fill(grid, clay, 4, parameters=water)
    mpm.initial_stress(body, surface=3.0, K0=0.6)
    u = 9810.0 * np.maximum(0.0, 2.0 - body.x[:, 1])
    vertical = -1700.0 * 9.81 * (3.0 - body.x[:, 1])
    np.testing.assert_allclose(body.stress[:, 1], vertical, rtol=1e-12)
    np.testing.assert_allclose(body.stress[:, 0], 0.6 * (vertical + u) - u, rtol=1e-12)
    np.testing.assert_allclose(body.history[:, -1], u, atol=1e-9)
