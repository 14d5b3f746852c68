"""What a scene holds: loads in every shape, one patch a surface, surface points that follow the
grid."""

import functools
import gc
import weakref

import dense
import inside
import numpy as np
import pytest
from scipy.interpolate import CubicSpline, interp1d, make_interp_spline

import mpm_fenicsx as mpm
from mpm_fenicsx.terms.load_functions import as_load


@pytest.fixture
def grid():
    return dense.uneven(2)


@pytest.mark.parametrize(
    ("value", "placed", "expected"),
    [
        ((1.0, -2.0), False, [1.0, -2.0]),
        (lambda t: (t, -2.0), False, [0.5, -2.0]),
        (lambda t, x: (t, -2.0), True, [0.5, -2.0]),
        (lambda t, x: x + t, True, [[1.5, 2.5], [3.5, 4.5]]),
    ],
)
def test_a_load_is_numbers_or_a_function_of_time_or_of_time_and_place(value, placed, expected):
    function, found = as_load("value", value, 2)
    assert found is placed
    np.testing.assert_array_equal(function(0.5, np.array([[1.0, 2.0], [3.0, 4.0]])), expected)


def test_a_load_keeps_the_numbers_it_was_given():
    value = np.array([1.0, 2.0])
    function, _ = as_load("value", value, 2)
    value[:] = 99.0
    np.testing.assert_array_equal(function(0.0, np.zeros((1, 2))), [1.0, 2.0])


class Ramp:
    """A callable object, with an option."""

    def __call__(self, t, rate=2.0):
        return 0.0, rate * t


def anything(*args):
    return 0.0, 2.0 * args[0]


TIMES = np.linspace(0.0, 1.0, 5)
RAMPS = {  # all of them (0, 2 t)
    "default": lambda t, s=2.0: (0.0, s * t),
    "defaults": lambda t, s=2.0, *, turned=False: (0.0, s * t),
    "partial by name": functools.partial(lambda t, s: (0.0, s * t), s=2.0),
    "partial by place": functools.partial(lambda s, t: (0.0, s * t), 2.0),
    "partial of one with a place": functools.partial(lambda t, x: (0.0, x * t), x=2.0),
    "object": Ramp(),
    "method": Ramp().__call__,
    "any number of arguments": anything,
    "spline": CubicSpline(TIMES, np.stack((0 * TIMES, 2 * TIMES), 1)),
    "B-spline": make_interp_spline(TIMES, np.stack((0 * TIMES, 2 * TIMES), 1)),
    "interp1d": interp1d(TIMES, np.stack((0 * TIMES, 2 * TIMES)), axis=1),
    "vectorized": np.vectorize(lambda t: np.array([0.0, 2.0 * t]), signature="()->(n)"),
    "built in, without signature": {t: (0.0, 2 * t) for t in (0.0, 0.5)}.__getitem__,
}
FIELDS = {  # all of them (0, t + x)
    "place": lambda t, x: np.stack((0 * x[:, 0], t + x[:, 0]), 1),
    "place by another name": lambda t, where: np.stack((0 * where[:, 0], t + where[:, 0]), 1),
    "default": lambda t, x, s=1.0: np.stack((0 * x[:, 0], s * (t + x[:, 0])), 1),
    "default first": lambda t, s=1.0, x=None: np.stack((0 * x[:, 0], s * (t + x[:, 0])), 1),
    "place with a default": lambda t, x=None: np.stack((0 * x[:, 0], t + x[:, 0]), 1),
    "by name": lambda t, *, position: np.stack((0 * position[:, 0], t + position[:, 0]), 1),
    "partial": functools.partial(
        lambda s, t, x: np.stack((0 * x[:, 0], s * (t + x[:, 0])), 1), 1.0
    ),
    "any number of arguments": lambda *a: np.stack((0 * a[1][:, 0], a[0] + a[1][:, 0]), 1),
}


@pytest.mark.parametrize("name", RAMPS)
def test_whatever_can_be_called_with_a_time_is_a_load(name):
    function, placed = as_load("value", RAMPS[name], 2)
    assert not placed
    np.testing.assert_allclose(function(0.5, np.ones((4, 2))), [0.0, 1.0], atol=1e-15)
    assert function.fault is None


@pytest.mark.parametrize("name", FIELDS)
def test_whatever_can_be_called_with_a_time_and_a_place_is_a_load(name):
    function, placed = as_load("value", FIELDS[name], 2)
    assert placed
    np.testing.assert_allclose(
        function(0.5, np.array([[1.0, 2.0], [3.0, 4.0]])), [[0.0, 1.5], [0.0, 3.5]]
    )


@pytest.mark.parametrize(
    "make",
    [
        lambda on, f: mpm.Traction(on, f),
        lambda on, f: mpm.DeadLoad(on, f),
        lambda on, f: mpm.Gravity(f),
    ],
    ids=["Traction", "DeadLoad", "Gravity"],
)
def test_terms_do_not_give_a_default_the_place(grid, make):
    """Only what g = 2 is in it differs: the work of lambda t, g=2 is that of lambda t with 2."""
    found = []
    for function in (lambda t: (0.0, 2.0 * t), *RAMPS.values()):
        scene = dense.bare_scene(grid, mpm.Newmark(0.5))
        work = scene.bind(
            [make(mpm.MaterialPoints.fill(grid, dense.SOIL, 4).surface("top"), function)]
        )[-1].work
        scene.prepare(0.0, 0.5)
        found.append(dense.vector(grid.space, work))
    assert np.abs(found[0]).max() > 0.0
    for vector in found[1:]:
        np.testing.assert_allclose(vector, found[0], atol=1e-14)


@pytest.mark.parametrize(
    "value",
    [
        lambda t, s=2.0: s * t,
        CubicSpline(TIMES, 2 * TIMES),
        interp1d(TIMES, 2 * TIMES),
        functools.partial(np.interp, xp=TIMES, fp=2 * TIMES),
        np.vectorize(lambda t: 2 * t),
        lambda t: np.array([2 * t]),
        np.poly1d([2.0, 0.0]),
    ],
)
def test_supports_move_by_whatever_can_be_called_with_a_time(grid, value):
    scene = dense.bare_scene(grid, mpm.QuasiStatic(2))
    scene.bind([mpm.Fixed(grid.facets("top"), "y", value)])[-1]
    scene.prepare(0.0, 0.5)
    moved = inside.displaced(scene)[:, 1]
    assert moved.max() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (lambda: (0.0, 1.0), r"which says at t=0: .*positional argument"),
        (
            lambda t, x, s: (0.0, s),
            "which says at t=0: .*missing 1 required positional argument: 's'",
        ),
        (lambda x, t: x, "take time before place"),
        (lambda t: None, "got None at t=0"),
        (lambda t: {}["key"], "which says at t=0: KeyError: 'key'"),
        (
            interp1d(TIMES + 1, np.stack((TIMES, TIMES))),
            "which says at t=0: .*below the interpolation range",
        ),
        (lambda t, x: np.full(x.shape, np.nan), "nan"),
    ],
)
def test_what_is_no_load_is_refused_with_its_own_words(value, words):
    with pytest.raises(ValueError, match=rf"(?s)^value must .*{words}"):
        as_load("value", value, 2)


def test_a_load_that_is_not_a_number_everywhere_is_heard_where_it_is_asked_for():
    """Towards a centre: nothing is wrong with it while no point is there."""
    load, _ = as_load(
        "value",
        lambda t, x: -x / np.linalg.norm(x, axis=1)[:, None] ** 3,
        2,
        np.array([[0.0, 0.0], [1.0, 0.0]]),
    )
    np.testing.assert_array_equal(load(0.0, np.array([[2.0, 0.0]])), [[-0.25, 0.0]])
    with np.errstate(all="ignore"):
        load(0.0, np.zeros((1, 2)))
    assert load.fault.startswith("value must be finite, got [nan nan] at t = 0, x=[0. 0.]")


@pytest.mark.parametrize("late", [None, (1.0, 2.0, 3.0), "soon"])
def test_a_load_that_turns_into_something_else_stops_the_run_with_a_sentence(grid, late):
    run = mpm.FiniteElements(
        grid,
        dense.SOIL,
        mpm.Newmark(0.1),
        [mpm.Gravity(lambda t: late if t > 0.15 else (0.0, 1.0))],
    )
    run.step()
    with pytest.raises(
        mpm.RunError,
        match=r"step 2, t = 0\.2: g of Gravity must give 2 finite numbers, got .*at t = 0\.2",
    ):
        run.step()


def test_terms_on_one_surface_share_its_patch(grid):
    scene = dense.bare_scene(grid, mpm.Newmark(0.01))
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
    bottom, top = grid.facets("bottom"), body.surface("top")
    for on in (bottom, top):
        scene.bind([mpm.ViscoelasticBoundary(on, dense.SOFT, 2.0)])[-1]
        scene.bind([mpm.Traction(on, (1.0, 2.0))])[-1]
    assert len(scene.patches) == 2
    scene.prepare(0.0, 0.01)
    before = top.x.copy()
    inside.displaced(scene, np.full((grid.nodes, 2), 1e-3))
    scene.carry()
    np.testing.assert_allclose(top.x - before, 1e-3, rtol=1e-12)  # once, not once a term


def test_surface_points_follow_a_linear_motion_as_nanson_says():
    rng = np.random.default_rng(5)
    for dim in (2, 3):
        grid = dense.uneven(dim)
        x = 0.2 + 0.5 * rng.random((7, dim))
        normal = rng.normal(size=(7, dim))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        on = mpm.SurfacePoints(x, normal, np.ones(7))
        scene = dense.bare_scene(grid, mpm.Newmark(0.01))
        scene.bind([mpm.ViscousBoundary(on, dense.SOFT)])[-1]
        scene.prepare(0.0, 0.01)
        H = 0.1 * rng.normal(size=(dim, dim))
        inside.displaced(scene, dense.at_nodes(grid, lambda y, H=H: y @ H.T))
        scene.carry()
        F = np.eye(dim) + H
        expected = np.linalg.det(F) * normal @ np.linalg.inv(F)
        np.testing.assert_allclose(on.x, x @ F.T, rtol=1e-12)
        np.testing.assert_allclose(on.area[:, None] * on.normal, expected, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(on.normal, axis=1), 1.0, rtol=1e-12)


def test_a_surface_point_on_a_cell_edge_belongs_to_the_cell_inside(grid):
    at = float(np.unique(grid.space.tabulate_dof_coordinates()[:, 1].round(12))[1])
    for up in (1.0, -1.0):
        scene = dense.bare_scene(grid, mpm.Newmark(0.01))
        on = mpm.SurfacePoints([[0.1, at]], [[0.0, up]], [1.0])
        scene.patch(on)
        scene.prepare(0.0, 0.01)
        centre = 0.5 * (grid.lattice.lower + grid.lattice.upper)[scene.patch(on)._cell[0]]
        assert (centre[1] < at) == (up > 0)


# -- a scene pays only for what it names -----------------------------------------------------------


def test_a_static_scene_has_no_velocities(grid):
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
    run = mpm.Simulation(
        grid,
        body,
        mpm.QuasiStatic(2),
        [mpm.Fixed(grid.facets("bottom")), mpm.Traction(grid.facets("top"), (0, -1))],
    )
    run.step()
    assert body.velocity is None
    assert body.acceleration is None
    for name in ("v", "a", "velocity", "acceleration"):
        assert not hasattr(run.motion, name)
    assert not hasattr(run, "_deposit")
    assert "kinetic" not in run.energy()


def test_only_springs_make_surfaces_remember(grid):
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
    for make, remembers in (
        (lambda on: mpm.ViscousBoundary(on, dense.SOFT), False),
        (lambda on: mpm.Traction(on, (0.0, -1.0)), False),
        (lambda on: mpm.ViscoelasticBoundary(on, dense.SOFT, 2.0), True),
    ):
        points, facets = body.surface("bottom"), grid.facets("bottom")
        run = mpm.Simulation(
            grid,
            mpm.MaterialPoints.fill(grid, dense.SOIL, 4),
            mpm.Newmark(1e-3),
            [make(points), make(facets)],
        )
        assert (points.displacement is not None) is remembers
        assert any(name.startswith("surfaces/1/") for name in run.state()) is remembers
        assert ("surfaces/0/displacement" in run.state()) is remembers


@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.DM_GC], ids=str)
def test_only_composite_mappings_have_patches(grid, mapping):
    run = mpm.Simulation(
        grid, mpm.MaterialPoints.fill(grid, dense.SOIL, 4), mpm.Newmark(1e-3), [], mapping
    )
    assert bool(run.composites) is mapping.composite
    assert inside.bill(run).nodes_of_a_point == (9 if mapping.support else 4)


def test_a_scene_without_terms_has_nothing_to_prepare(grid):
    run = mpm.Simulation(grid, mpm.MaterialPoints.fill(grid, dense.SOIL, 4), mpm.Newmark(1e-3), [])
    bill = inside.bill(run)
    assert (bill.surfaces, bill.supports, bill.refreshed) == (0, 0, [])
    loaded = mpm.Simulation(grid, run.bodies, mpm.Newmark(1e-3), [mpm.Gravity((0, -1))])
    assert inside.bill(loaded).refreshed == [1]


def test_the_tangent_has_no_dashpots_without_a_dashpot(grid):
    forms = [
        len(
            mpm.Simulation(
                grid, mpm.MaterialPoints.fill(grid, dense.SOIL, 4), mpm.Newmark(1e-3), terms
            ).contributions
        )
        for terms in ([], [mpm.ViscousBoundary(grid.facets("bottom"), dense.SOFT)])
    ]
    assert forms == [2, 3]


def test_a_load_outlives_the_form_it_was_made_for(grid):
    """A patch goes on writing the load of a term whose form is gone, so it must hold what it writes
    to."""
    scene = dense.bare_scene(grid, mpm.Newmark(0.01))
    loads = []
    for value in ((1.0, 2.0), lambda t, x: x):
        work = scene.bind([mpm.Traction(grid.facets("top"), value)])[-1].work
        mine = [*work.coefficients(), *work.constants()]
        loads += [
            weakref.ref(f) for f in mine if hasattr(f, "value") or f.function_space != grid.space
        ]
        del work, mine
    gc.collect()
    assert len(loads) == 2
    scene.prepare(0.0, 0.01)
    assert all(load() is not None for load in loads)
