"""Layers absorb what comes to them, and nothing else happens there."""

import numpy as np
import open_ground
import pytest
from heard import warned
from inside import plain
from open_ground import TIGHT, soil
from test_ranks import on_ranks

import mpm_fenicsx as mpm

# -- waves -----------------------------------------------------------------------------------------


def lamb(kind, wide=12, deep=6, pad=24, points=False):
    """Displacements (steps, nodes, dim) in a box of so many cells, 1 m each, after a blow on its
    top: between layers, or dashpots, or in ground so large that nothing comes back."""
    beyond = {"layer": 7, "dashpots": 0, "large": pad}[kind]
    corner = 0.5 * wide + beyond
    grid = mpm.Grid.box(
        (-corner, -deep - beyond),
        (corner, 0.0),
        (wide + 2 * beyond, deep + beyond),
        facets={"strip": lambda x: (x[1] > -1e-9) & (abs(x[0]) < 1 + 1e-9)},
    )
    edges = grid.facets("left", "right", "bottom")
    ends = {
        "layer": mpm.AbsorbingLayer(("left", "right", "bottom"), soil),
        "dashpots": mpm.ViscousBoundary(edges, soil),
        "large": mpm.Fixed(edges),
    }

    def blow(t):  # Ricker's wavelet, S waves of 10 cells at its peak
        a = (np.pi * 0.1 * (t - 15.0)) ** 2
        return (0.0, -1e-4 * (1 - 2 * a) * np.exp(-a))

    terms = [mpm.Traction(grid.facets("strip"), blow), ends[kind]]
    x = grid.space.tabulate_dof_coordinates()[:, :2]
    at = np.flatnonzero((abs(x[:, 0]) < 0.5 * wide + 0.1) & (x[:, 1] > -deep - 0.1))
    at = at[np.lexsort(np.round(x[at], 3).T)]
    if points:
        inner = kind == "layer"
        body = mpm.MaterialPoints.fill(
            grid, soil, 4, lambda x: (not inner) | (abs(x[0]) < 0.5 * wide) & (x[1] > -deep)
        )
        run = mpm.Simulation(grid, body, mpm.Newmark(0.3), terms, solver=TIGHT)
    else:
        run = mpm.FiniteElements(grid, soil, mpm.Newmark(0.3), terms)
    moved, found = np.zeros((len(at), 2)), []
    for _ in range(100):
        run.step()
        moved = moved + run.nodal("increment")[at]
        found.append(moved)
    return np.array(found)


@pytest.mark.parametrize("points, allowed", [(False, 0.03), (True, 0.04)])
def test_less_comes_back_than_from_dashpots(points, allowed):
    large = lamb("large", points=points)
    errors = {
        kind: np.linalg.norm(lamb(kind, points=points) - large) / np.linalg.norm(large)
        for kind in ("layer", "dashpots")
    }
    assert errors["layer"] < allowed
    assert errors["layer"] < 0.1 * errors["dashpots"]


# -- energy ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.validation)])
def test_what_the_body_loses_is_absorbed(dim):
    """Trapezoidal rule: kinetic + strain + absorbed energy is that of the start, exactly."""
    run = open_ground.block(dim, points=False)
    energy = run.record(mpm.Energy())
    for _ in range(60):
        run.step()
    total = energy["kinetic"] + energy["strain"] + energy["absorbed"]
    assert total == pytest.approx(np.full(61, total[0]), rel=1e-11)
    assert energy["absorbed"][-1] > 0.9 * total[0]


def test_nothing_grows():
    """What is left of a blow after 4,000 steps goes on falling."""
    run = open_ground.block(2, points=False)
    left = []
    for _ in range(4):
        for _ in range(1000):
            run.step()
        left.append(sum(run.energy().values()))
    start = sum(open_ground.block(2, points=False).energy().values())
    assert left[0] < 1e-6 * start
    assert left[-1] < left[0]


# -- a scene ---------------------------------------------------------------------------------------


def box(cells=20, **how):
    grid = mpm.Grid.box((0.0, 0.0), (20.0, 20.0), (cells, cells))
    given = {"sides": ("left", "bottom"), "material": soil, **how}
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: (x > 7).all(0))
    return mpm.Simulation(grid, body, mpm.Newmark(0.3), [mpm.AbsorbingLayer(**given)])


@pytest.mark.parametrize(
    "how, message",
    [
        ({"sides": ()}, "sides must be one side of the grid or several"),
        ({"sides": ("left", "left")}, "sides must be one side of the grid or several"),
        ({"sides": ("west",)}, "sides must be one of left, right"),
        ({"sides": ("left", "front")}, "a grid in 2D has no side 'front'"),
        ({"absorbing": 0}, "absorbing must be"),
        ({"elastic": -1}, "elastic must be"),
        ({"absorbing": 5}, "there are material points in its cell at"),
        ({"sides": ("left", "right", "bottom"), "absorbing": 8}, "leaves nothing of the grid"),
        ({"material": 3}, "material of AbsorbingLayer"),
    ],
)
def test_what_cannot_be_is_refused(how, message):
    with pytest.raises(ValueError, match=message):
        box(**how)


def between(top, sides, held=(), lower=7, wide=6, cells=None, elastic=4, material=soil):
    """A body of finite elements, ``wide`` cells, 6 high, with layers at ``sides``."""
    thick = 3 + elastic
    left, right = (thick * (side in sides) for side in ("left", "right"))
    grid = mpm.Grid.box(
        (-float(left), -float(thick)), (float(wide + right), 6.0), (left + wide + right, 6 + thick)
    )
    layer = mpm.AbsorbingLayer(sides, material, elastic=elastic)
    supports = [mpm.Fixed(grid.facets(*names), components) for names, components in held]
    return mpm.FiniteElements(grid, top, mpm.Newmark(0.3), [layer, *supports])


STIFF = mpm.LinearElastic(young=2.5 * 9, poisson=0.25, density=1.0)  # c_s three times as high


@pytest.mark.parametrize(
    "how, message",
    [
        ({"sides": ("bottom",)}, "needs a layer at one end at least of the direction x"),
        (
            {"sides": ("bottom",), "held": [(("left", "right"), "x")]},
            "needs a layer at one end at least of the direction x",
        ),
        ({"sides": ("left", "bottom"), "elastic": 0, "wide": 90}, "90 times as long|15 times"),
        (
            {
                "sides": ("left", "bottom"),
                "material": [(STIFF, lambda x: x[1] > 3), (soil, lambda x: x[1] < 3)],
            },
            "S waves are 3 times faster in a stratum than in one below; up to 1.5",
        ),
        (
            {
                "sides": ("left", "bottom"),
                "elastic": 1,
                "material": [(soil, lambda x: x[1] > 3), (STIFF, lambda x: x[1] < 3)],
            },
            "takes two elastic cells or more, got elastic=1",
        ),
    ],
)
def test_what_would_grow_is_refused(how, message):
    with pytest.raises(ValueError, match=message):
        between(soil, **how)


@pytest.mark.parametrize("side", ["top", "bottom"])
def test_loads_on_its_cells_are_refused(side):
    grid = mpm.Grid.box((0.0, 0.0), (20.0, 20.0), (20, 20))
    layer = mpm.AbsorbingLayer(("left", "bottom"), soil)
    load = mpm.Traction(grid.facets(side), (0.0, -1.0))
    with pytest.raises(ValueError, match=r"Traction on the facets .* acts on cells of the Absorb"):
        mpm.FiniteElements(grid, soil, mpm.Newmark(0.3), [layer, load])


def test_motions_and_surface_points_in_it_are_refused():
    grid = mpm.Grid.box((0.0, 0.0), (20.0, 20.0), (20, 20))
    layer = mpm.AbsorbingLayer(("left", "bottom"), soil)
    inside = mpm.SurfacePoints.line((5.0, 3.0), (15.0, 3.0), 0.5)
    moved = mpm.Fixed(grid.facets("bottom"), "y", value=lambda t: 1e-6 * np.sin(t))
    for term, message in (
        (mpm.Traction(inside, (0.0, -1.0)), r"Traction on .* acts on cells of the AbsorbingLayer"),
        (moved, "Fixed gives a motion to cells of the AbsorbingLayer"),
    ):
        with pytest.raises(ValueError, match=message):
            mpm.FiniteElements(grid, soil, mpm.Newmark(0.3), [layer, term])


@pytest.mark.parametrize("start", [0.0, pytest.param(0.8, marks=pytest.mark.validation)])
def test_nothing_grows_with_generalized_alpha(start):
    run = open_ground.block(2, points=False)
    grid, terms = run.grid, run.terms
    damped = mpm.FiniteElements(grid, soil, mpm.GeneralizedAlpha(0.3, start=start), terms)
    damped.nodal("velocity")[:] = run.nodal("velocity")
    left = [sum(damped.energy().values())]
    for _ in range(3):
        for _ in range(300):
            damped.step()
        left.append(sum(damped.energy().values()))
    assert left[3] < left[2] < left[1] < 1e-4 * left[0]


def test_two_layers_of_one_scene_are_one():
    grid = mpm.Grid.box((0.0, 0.0), (20.0, 20.0), (20, 20))
    both = [mpm.AbsorbingLayer(side, soil) for side in ("left", "bottom")]
    with pytest.raises(ValueError, match="one AbsorbingLayer: name all its sides in it"):
        mpm.FiniteElements(grid, soil, mpm.Newmark(0.3), both)


@pytest.mark.parametrize("held", ["x", "y"])
def test_a_column_held_to_plane_motion_may_end_in_one(held):
    """A blow of P or S waves leaves next to nothing: what is left is the displacement by its
    momentum, which the layer holds like a spring, and which goes on falling."""
    run = between(soil, sides=("bottom",), wide=1, held=[(("left", "right"), held)])
    d = "yx".index(held)
    run.nodal("velocity")[:, d] = np.exp(
        -((run.grid.space.tabulate_dof_coordinates()[:, 1] - 3.0) ** 2)
    )
    run.nodal("velocity")[:, 1 - d] = 0.0
    left = [sum(run.energy().values())]
    for _ in range(2):
        for _ in range(400):
            run.step()
        left.append(sum(run.energy().values()))
    assert left[2] < left[1] < 1e-4 * left[0]


def test_soft_ground_over_stiffer_may_end_in_one():
    layers = [(soil, lambda x: x[1] > 3), (STIFF, lambda x: x[1] < 3)]
    run = between(layers, sides=("left", "bottom"), material=layers)
    run.nodal("velocity")[:, 0] = np.exp(
        -((run.grid.space.tabulate_dof_coordinates()[:, :2] - [3.0, 4.0]) ** 2).sum(axis=1)
    )
    energy = run.record(mpm.Energy())
    for _ in range(600):
        run.step()
    total = energy["kinetic"] + energy["strain"]
    assert total[-1] < total[300] < 1e-4 * total[0]


@pytest.mark.parametrize("points", [True, False])
def test_nothing_moves_when_statics_become_dynamics(points):
    """Gravity first, the edge held on lines inside the grid; then the layer, and what they bore."""
    grid = mpm.Grid.box((-7.0, -7.0), (11.0, 4.0), (18, 11))
    layer, weight = mpm.AbsorbingLayer(("left", "right", "bottom"), soil), mpm.Gravity((0, -1e-4))

    def at(d, value):
        return lambda x: (
            (abs(x[d] - value) < 1e-9) & (x[0] > -1e-9) & (x[0] < 4 + 1e-9) & (x[1] > -1e-9)
        )

    sides = [mpm.Fixed(grid.inner_facets(at(0, value)), "x") for value in (0.0, 4.0)]
    held = [*sides, mpm.Fixed(grid.inner_facets(at(1, 0.0)))]
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: (x > 0).all(0) & (x[0] < 4))
    if points:
        static = mpm.Simulation(
            grid, body, mpm.QuasiStatic(1), [layer, *held, weight], solver=mpm.Solver()
        )
    else:
        static = mpm.FiniteElements(grid, soil, mpm.QuasiStatic(1), [layer, *held, weight])
    static.step()
    static.settle()
    edge = [body.surface(side) for side in ("left", "right", "bottom")]
    borne = static.reactions(*edge)
    terms = [layer, weight, *borne]
    if points:
        run = mpm.Simulation(grid, body, mpm.Newmark(0.3), terms, solver=TIGHT)
    else:
        run = mpm.FiniteElements(grid, soil, mpm.Newmark(0.3), terms, start=static)
    for _ in range(60):
        run.step()
    speed = body.velocity if points else run.nodal("velocity")
    assert np.abs(speed).max() < 1e-12  # m/s; 4e-4 Pa of weight make 4e-4 m/s
    assert run.energy()["strain"] > 1e-9


@pytest.mark.parametrize("follows", [False, True])
def test_material_that_moves_from_it_is_told_of_unless_the_grid_follows(follows):
    grid = mpm.Grid.box((0.0, 0.0), (20.0, 20.0), (20, 20))
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: (x > 7).all(0))
    body.velocity = np.tile((0.05, 0.0), (len(body), 1))
    layer = mpm.AbsorbingLayer(("left", "bottom"), soil, follows=follows)
    run = mpm.Simulation(grid, body, mpm.Newmark(0.3), [layer], solver=TIGHT)
    told = warned(lambda: [run.step() for _ in range(5)])
    assert sum("beside AbsorbingLayer has moved by 0.02" in words for words in told) == (
        0 if follows else 1
    )
    assert bool(run.grid.offset.any()) == follows


def test_it_lies_beside_the_body_alone():
    """Over a free surface there is none, nor beside a part of the grid that is empty."""
    grid = mpm.Grid.box((0.0, 0.0), (20.0, 20.0), (20, 20))
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: (x > 7).all(0) & (x[1] < 15))
    layer = mpm.AbsorbingLayer(("left", "bottom"), soil)
    run = mpm.Simulation(grid, body, mpm.Newmark(0.3), [layer])
    (part,) = plain(run)
    centre = grid.centres[part.cells]
    assert centre[:, 1].max() == 14.5 and len(part.cells) == 20 * 15 - 13 * 8


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.validation)])
@pytest.mark.parametrize("numbers", ["plain", "fair"])
def test_a_restart_goes_on_bit_for_bit(tmp_path, numbers, dim):
    path = tmp_path / "state"
    run, again = (open_ground.block(dim, fair=numbers == "fair") for _ in range(2))
    run.record(mpm.Checkpoint(path, every=3))
    for _ in range(3):
        run.step()
    again.restart(path)
    for _ in range(3):
        run.step()
        again.step()
    for name, value in run.state().items():
        assert np.array_equal(value, again.state()[name]), name


@pytest.mark.ranks
@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize("dim, how", [(2, "fair"), (2, "follows"), (3, "own")])
def test_more_ranks_compute_the_same(tmp_path, dim, how, count):
    one, more = tmp_path / "one.npz", tmp_path / "more.npz"
    for ranks, out in ((1, one), (count, more)):
        on_ranks(ranks, open_ground.__file__, str(dim), "20", str(out), how)
    alone, together = np.load(one), np.load(more)
    for name in alone.files:
        largest = np.abs(alone[name]).max()
        assert np.abs(alone[name] - together[name]).max() < 1e-9 * largest, name
