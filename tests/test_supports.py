"""A quasi-static run with a rigid motion that nothing holds is refused before its first step."""

import pytest

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)


def box(dim, cells=4):
    return mpm.Grid.box((0,) * dim, (cells,) * dim, (cells,) * dim)


def elements(grid, fixed, **_):
    return mpm.FiniteElements(grid, SOIL, mpm.QuasiStatic(1), fixed)


def points(grid, fixed, inside=None):
    return mpm.Simulation(
        grid,
        mpm.MaterialPoints.fill(grid, SOIL, 2**grid.dim, inside=inside),
        mpm.QuasiStatic(1),
        fixed,
    )


METHODS = pytest.mark.parametrize("run", [elements, points], ids=["elements", "points"])
FREE = [
    (2, {}, "the body from moving along x and y and turning"),
    (2, {"left": "x"}, "moving along y:?"),
    (2, {"left": "y"}, "moving along x"),
    (2, {"bottom": "y"}, "the body from moving along x;"),
    (3, {"left": "xyz"}, None),
    (3, {"left": "x"}, "moving along y and z and turning about x"),
    (3, {"left": "x", "back": "z"}, "moving along y;"),
    (2, {"left": "x", "bottom": "y"}, None),
    (3, {"left": "x", "bottom": "y", "back": "z"}, None),
    (2, {"bottom": "xy"}, None),
]


@METHODS
@pytest.mark.parametrize(("dim", "fixed", "message"), FREE, ids=str)
def test_what_is_free_is_named(run, dim, fixed, message):
    grid = box(dim, 2)
    made = run(
        grid,
        [
            mpm.Gravity((0.0, -9.81, 0.0)[:dim]),
            *(mpm.Fixed(grid.facets(s), c) for s, c in fixed.items()),
        ],
    )
    if message is None:
        return made.step()
    for start in (made.step, made.settle):
        with pytest.raises(ValueError, match=message.rstrip(":?")):
            start()


def test_a_roller_that_no_material_touches_holds_nothing():
    grid = box(2)
    fixed = [mpm.Fixed(grid.facets("left"), "x"), mpm.Fixed(grid.facets("bottom"), "y")]
    with pytest.raises(
        ValueError, match="Fixed acts on the facets left, where there is no material"
    ):
        points(grid, fixed, inside=lambda x: x[0] > 1).step()
    points(grid, fixed, inside=lambda x: x[0] < 3).step()


def test_each_piece_is_held_on_its_own():
    grid = box(2)
    with pytest.raises(
        ValueError, match=r"the piece of material around x=\[.*\] from moving along x and y and"
    ):
        points(
            grid, [mpm.Fixed(grid.facets("bottom"))], inside=lambda x: (x[1] < 1) | (x[1] > 2)
        ).step()


def test_in_contact_each_body_needs_its_own():
    grid = box(2)
    halves = [
        mpm.MaterialPoints.fill(
            grid, SOIL, 4, inside=lambda x, low=low: (x[1] > low) & (x[1] < low + 1) & (x[0] < 3)
        )
        for low in (0, 1)
    ]
    supports = [[mpm.Fixed(grid.facets("bottom"))], []]
    run = mpm.Contact(
        *(
            (
                mpm.Simulation(grid, body, mpm.QuasiStatic(1), [*held, mpm.Gravity((0.0, -9.81))]),
                body.surface("top", "bottom"),
            )
            for body, held in zip(halves, supports, strict=True)
        )
    )
    with pytest.raises(
        ValueError, match="nothing keeps the body from moving along x and y and turning"
    ):
        run.step()


def test_dynamics_may_fly():
    grid = box(2)
    mpm.Simulation(
        grid,
        mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: x[0] < 3),
        mpm.Newmark(1e-3),
        [],
    ).step()
