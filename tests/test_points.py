"""Material points fill a body, surface points its edge; both follow an affine motion exactly."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mpm_fenicsx as mpm
from mpm_fenicsx.common.random_numbers import uniform

SOIL = mpm.LinearElastic(young=5e6, poisson=0.3, density=1800.0)
few = settings(max_examples=30, deadline=None)
SIDES = {
    "left": (0, 0),
    "right": (0, 1),
    "bottom": (1, 0),
    "top": (1, 1),
    "back": (2, 0),
    "front": (2, 1),
}


def sides(dim):
    return list(SIDES)[: 2 * dim]


def affine(dim, seed, size=0.3):
    """Gradient H of a motion x -> x + H x that turns nothing inside out."""
    return size * np.random.default_rng(seed).uniform(-1, 1, (dim, dim)) / dim


def everywhere(gradient, n):
    return np.broadcast_to(gradient, (n, *gradient.shape))


# -- filling ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("jitter", [0.0, 0.45])
def test_volumes_sum_to_the_bodys_cell_by_cell(grid, soil, k, jitter):
    points = mpm.MaterialPoints.fill(grid, soil, k**grid.dim, jitter=jitter, seed=3)
    assert len(points) == grid.cells * k**grid.dim and points.dim == grid.dim
    in_cell = np.bincount(grid.find(points.x), points.volume, minlength=grid.cells)
    np.testing.assert_allclose(in_cell, grid.lattice.volume, rtol=1e-12)
    np.testing.assert_allclose(points.volume, (2 * points.half).prod(axis=1), rtol=1e-14)
    np.testing.assert_allclose(points.mass, soil.density * points.volume, rtol=1e-14)
    assert (
        points.stress.shape == (len(points), 4 if grid.dim == 2 else 6) and not points.stress.any()
    )
    assert points.velocity is None and points.acceleration is None


def test_jitter_moves_by_less_than_its_share_of_the_spacing_and_repeats(grid, soil):
    even = mpm.MaterialPoints.fill(grid, soil, 2**grid.dim)
    moved, again, other = (
        mpm.MaterialPoints.fill(grid, soil, 2**grid.dim, jitter=0.45, seed=s) for s in (5, 5, 6)
    )
    share = np.abs(moved.x - even.x) / (2 * even.half)
    assert 0.4 < share.max() <= 0.45 and np.array_equal(moved.half, even.half)
    assert np.array_equal(moved.x, again.x) and not np.array_equal(moved.x, other.x)


def test_jitter_belongs_to_the_place_and_not_to_its_neighbours(grid, soil):
    """The same point moves alike, whatever else there is."""

    def places(inside):
        body = mpm.MaterialPoints.fill(grid, soil, 2**grid.dim, inside, jitter=0.4, seed=5)
        return {tuple(seat): tuple(x) for seat, x in zip(body.seat, body.x, strict=True)}

    middle = 0.5 * (grid.lower_corner + grid.upper_corner)[0]
    whole, part = places(None), places(lambda x: x[0] > middle)
    assert 0 < len(part) < len(whole) and part.items() <= whole.items()


def test_random_numbers_are_those_of_splitmix64_and_even():
    """The first two of seed 0 as published with the generator; moments of a million within 4
    standard errors."""
    first = uniform(0, np.arange(2), 1)[:, 0]
    assert (
        first == np.array([0xE220A8397B1DCDAF >> 11, 0x6E789E6AA1B965F4 >> 11]) * 2.0**-53
    ).all()
    n = 10**6
    numbers = uniform(3, np.arange(n // 2), 2)
    assert abs(numbers.mean() - 0.5) < 4 / np.sqrt(12 * n) and abs(
        12 * numbers.var() - 1
    ) < 4 * np.sqrt(0.8 / n)
    assert numbers.min() >= 0.0 and numbers.max() < 1.0
    assert abs(np.corrcoef(numbers.T)[0, 1]) < 4 / np.sqrt(n / 2)


def test_given_rows_follow_those_that_are_kept():
    surface = mpm.SurfacePoints(
        np.arange(8.0).reshape(4, 2), np.tile((0.0, 1.0), (4, 1)), np.arange(1.0, 5.0)
    )
    values = np.arange(4.0)
    assert (surface.of_given(values) == values).all()
    surface.keep(np.array([1, 2, 3]))
    surface.keep(np.array([0, 2]))
    assert (
        surface.number.tolist() == [1, 3]
        and surface.area.tolist() == [2.0, 4.0]
        and len(surface.x) == 2
    )
    assert surface.of_given(values).tolist() == [1.0, 3.0] and surface.of_given(
        values[:2]
    ).tolist() == [0.0, 1.0]


def test_a_part_of_the_grid_is_filled(grid, soil, hats):
    end = hats.lines[0][2]
    points = mpm.MaterialPoints.fill(
        grid, soil, 2**grid.dim, inside=lambda x: x[0] < end, jitter=0.45
    )
    length = np.array([line[-1] - line[0] for line in hats.lines])
    assert points.volume.sum() == pytest.approx(
        (end - hats.lines[0][0]) * length[1:].prod(), rel=1e-12
    )
    assert (points.x[:, 0] < end).all()


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"per_cell": 3}, "per_cell must be a square"),
        ({"per_cell": 0}, "per_cell"),
        ({"per_cell": 2.5}, "per_cell"),
        ({"jitter": 0.5}, "jitter must lie in"),
        ({"jitter": -0.1}, "jitter"),
        ({"jitter": np.nan}, "jitter"),
        ({"inside": lambda x: x[0] > 99}, "without material points"),
        ({"inside": lambda x: x > 0}, r"inside must map \(dim, n\) to \(n,\)"),
        ({"inside": lambda x: True}, r"inside must map \(dim, n\) to \(n,\)"),
    ],
)
def test_what_fills_nothing_is_refused(soil, changes, words):
    with pytest.raises(ValueError, match=words):
        mpm.MaterialPoints.fill(
            mpm.Grid.box((0, 0), (1, 1), (2, 2)), soil, **{"per_cell": 4, **changes}
        )


def test_per_cell_in_3d_is_a_cube(soil):
    with pytest.raises(ValueError, match="per_cell must be a cube"):
        mpm.MaterialPoints.fill(mpm.Grid.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), soil, 4)


GOOD = {"x": np.zeros((3, 2)), "half": np.ones((3, 2)), "volume": np.ones(3)}


@pytest.mark.parametrize(
    "name, value",
    [
        ("x", np.full((3, 2), np.nan)),
        ("half", np.full((3, 2), np.inf)),
        ("volume", np.array([1, np.nan, 1])),
        ("half", np.ones((3, 3))),
        ("half", np.ones(3)),
        ("volume", np.ones(2)),
        ("volume", np.ones((3, 1))),
        ("volume", np.array([1.0, 0.0, 1.0])),
        ("half", -np.ones((3, 2))),
        ("x", np.zeros(3)),
        ("stress", np.zeros((3, 6))),
        ("stress", np.full((3, 4), np.nan)),
        ("stress", np.zeros(4)),
        ("velocity", np.zeros((2, 2))),
        ("velocity", np.full((3, 2), np.inf)),
        ("acceleration", np.zeros((3, 3))),
    ],
)
def test_arrays_that_do_not_fit_are_refused_by_name(soil, name, value):
    mpm.MaterialPoints(soil, **GOOD)
    with pytest.raises(ValueError, match=name):
        mpm.MaterialPoints(soil, **{**GOOD, name: value})


def test_arrays_given_are_copied(soil):
    given = {
        **{k: v.copy() for k, v in GOOD.items()},
        "stress": np.ones((3, 4)),
        "velocity": np.ones((3, 2)),
    }
    points = mpm.MaterialPoints(soil, **given)
    assert not any(np.shares_memory(getattr(points, name), value) for name, value in given.items())


# -- motion ----------------------------------------------------------------------------------------


@few
@given(seed=st.integers(0, 10**6))
def test_an_affine_motion_scales_volumes_by_its_determinant(grid, soil, seed):
    points = mpm.MaterialPoints.fill(grid, soil, 2**grid.dim, jitter=0.45)
    x, volume, half = points.x.copy(), points.volume.copy(), points.half.copy()
    H = affine(grid.dim, seed)
    stretch = everywhere(1.0 + np.diag(H), len(x))
    points.deform(x @ H.T, *points.stretches(everywhere(H, len(x)), stretch))
    np.testing.assert_allclose(
        points.volume, volume * np.linalg.det(np.eye(grid.dim) + H), rtol=1e-12
    )
    np.testing.assert_allclose(
        points.x, x @ (np.eye(grid.dim) + H).T, rtol=0, atol=1e-14 * np.abs(x).max()
    )
    np.testing.assert_allclose(points.half, half * (1 + np.diag(H)), rtol=1e-12)
    np.testing.assert_allclose(points.mass, soil.density * volume, rtol=1e-14)


@pytest.mark.parametrize("bad", [-1.5, -1.0, np.nan])
@pytest.mark.parametrize("which", ["gradient", "stretch"])
def test_a_point_that_turns_inside_out_is_refused_by_number(grid, points, bad, which):
    n = len(points)
    arrays = {
        "gradient": np.zeros((n, grid.dim, grid.dim)),
        "stretch": np.ones((n, grid.dim)),
    }
    row = arrays["gradient"][5, 1] if which == "gradient" else arrays["stretch"][5]
    row[1] += bad
    with pytest.raises(ValueError, match=r"material point 5 at x=.* turns inside out"):
        points.stretches(**arrays)


# -- surfaces --------------------------------------------------------------------------------------


@pytest.mark.parametrize("jitter", [0.0, 0.45])
def test_sides_have_their_areas_normals_and_places(grid, soil, hats, jitter):
    points = mpm.MaterialPoints.fill(grid, soil, 2**grid.dim, jitter=jitter)
    length = np.array([line[-1] - line[0] for line in hats.lines])
    for side in sides(grid.dim):
        d, end = SIDES[side]
        surface = points.surface(side)
        assert surface.area.sum() == pytest.approx(length.prod() / length[d], rel=1e-12)
        assert np.array_equal(
            surface.normal, np.tile((2 * end - 1) * np.eye(grid.dim)[d], (len(surface), 1))
        )
        np.testing.assert_allclose(surface.x[:, d], hats.lines[d][-end], rtol=0, atol=1e-13)


def test_surface_integrals_of_cubics_are_exact(grid, soil, hats):
    surface = mpm.MaterialPoints.fill(grid, soil, 2**grid.dim).surface("left")
    total = (surface.area * surface.x[:, 1] ** 3).sum()
    y = hats.lines[1]
    rest = np.prod([line[-1] - line[0] for line in hats.lines[2:]])
    assert total == pytest.approx((y[-1] ** 4 - y[0] ** 4) / 4 * rest, rel=1e-13)


@few
@given(seed=st.integers(0, 10**6), k=st.integers(1, 3))
def test_a_surface_is_closed_about_any_body(grid, soil, seed, k):
    """Σ n A = 0 and Σ x·n A = dim V for bodies with holes, steps and corners, in cells of unlike
    sizes."""
    rng = np.random.default_rng(seed)
    points = mpm.MaterialPoints.fill(
        grid, soil, k**grid.dim, inside=lambda x: rng.random(x.shape[1]) < 0.7
    )
    enclosed(points)


def enclosed(points):
    faces = [points.surface(side) for side in sides(points.dim)]
    np.testing.assert_allclose(sum(f.area @ f.normal for f in faces), 0, rtol=0, atol=1e-12)
    volume = sum((f.area * (f.x * f.normal).sum(axis=1)).sum() for f in faces) / points.dim
    assert volume == pytest.approx(points.volume.sum(), rel=1e-11)


@pytest.mark.parametrize("k", [1, 2])
def test_a_surface_is_closed_where_a_cell_is_far_narrower_than_the_next(soil, k):
    lines = [np.array([0.0, 1.0, 1.1]), np.array([2.0, 2.05, 3.0])]
    enclosed(mpm.MaterialPoints.fill(mpm.Grid.rectilinear(lines), soil, k**2))


def test_a_surface_is_closed_on_a_grid_with_an_inward_corner(soil, l_shape):
    points = mpm.MaterialPoints.fill(l_shape, soil, 4)
    enclosed(points)
    assert points.surface("top").area.sum() == pytest.approx(3.0, rel=1e-13)
    assert points.surface("right").area.sum() == pytest.approx(2.0, rel=1e-13)


@pytest.mark.parametrize("jitter", [0.0, 0.45])
def test_part_of_a_side(soil, jitter):
    grid = mpm.Grid.box((2.0, -1.0), (6.0, 1.0), (4, 2))
    points = mpm.MaterialPoints.fill(grid, soil, 4, jitter=jitter)
    footing = points.surface("top", where=lambda x: x[0] < 3.0)
    assert footing.area.sum() == pytest.approx(1.0, rel=1e-13)
    assert (footing.x[:, 0] < 3.0).all()


def test_one_surface_of_two_sides_is_both(soil):
    points = mpm.MaterialPoints.fill(mpm.Grid.box((0, 0), (2, 1), (4, 3)), soil, 4)
    both, parts = points.surface("left", "top"), (points.surface("left"), points.surface("top"))
    for name in ("x", "normal", "area"):
        np.testing.assert_array_equal(
            getattr(both, name), np.concatenate([getattr(part, name) for part in parts])
        )
    with pytest.raises(ValueError, match="sides"):
        points.surface()


def test_sides_of_no_body_are_refused(points, soil):
    with pytest.raises(ValueError, match="side must be one of left, right"):
        points.surface("north")
    with pytest.raises(ValueError, match="made by fill"):
        mpm.MaterialPoints(soil, **GOOD).surface("top")
    flat = mpm.MaterialPoints.fill(mpm.Grid.box((0, 0), (1, 1), (2, 2)), soil, 4)
    with pytest.raises(
        ValueError, match="side must be one of left, right, bottom, top, got 'front'"
    ):
        flat.surface("front")


@few
@given(seed=st.integers(0, 10**6))
def test_surface_points_follow_an_affine_motion_as_nanson_says(grid, soil, seed):
    """n a = J F⁻ᵀ N A; the moved surface is closed, and holds the moved volume."""
    dim = grid.dim
    points = mpm.MaterialPoints.fill(grid, soil, 2**dim)
    H = affine(dim, seed)
    F = np.eye(dim) + H
    faces = [points.surface(side) for side in sides(dim)]
    cofactor = np.linalg.det(F) * np.linalg.inv(F).T
    for f in faces:
        wanted = f.area[:, None] * f.normal @ cofactor.T
        f.displacement, x = np.zeros_like(f.x), f.x.copy()
        f.follow(x @ H.T, everywhere(H, len(f)))
        np.testing.assert_allclose(f.area[:, None] * f.normal, wanted, rtol=0, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(f.normal, axis=1), 1, rtol=1e-13)
        np.testing.assert_allclose(f.x, x @ F.T, rtol=0, atol=1e-13)
        np.testing.assert_allclose(f.displacement, x @ H.T, rtol=0, atol=1e-13)
    np.testing.assert_allclose(sum(f.area @ f.normal for f in faces), 0, rtol=0, atol=1e-11)
    volume = sum((f.area * (f.x * f.normal).sum(axis=1)).sum() for f in faces) / dim
    assert volume == pytest.approx(points.volume.sum() * np.linalg.det(F), rel=1e-11)


def test_two_steps_of_a_surface_are_one(grid, soil):
    surface, once = (mpm.MaterialPoints.fill(grid, soil, 1).surface("top") for _ in range(2))
    x, A, B = surface.x.copy(), affine(grid.dim, 1), affine(grid.dim, 2)
    surface.follow(x @ A.T, everywhere(A, len(x)))
    surface.follow(surface.x @ B.T, everywhere(B, len(x)))
    both = A + B + B @ A
    once.follow(x @ both.T, everywhere(both, len(x)))
    for name in ("x", "normal", "area"):
        np.testing.assert_allclose(getattr(surface, name), getattr(once, name), rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "x, normal, area, words",
    [
        (np.zeros((2, 2)), [[0, 1], [0, 2]], np.ones(2), "unit vector, got one of length 2"),
        (np.zeros((2, 2)), [[0, 1], [np.nan, 1]], np.ones(2), "unit vector"),
        (np.zeros((2, 2)), [[0, 1], [0, 1]], np.array([1, 0]), "area must be positive, got 0"),
        (np.zeros((2, 2)), [[0, 1], [0, 1]], np.array([1, np.nan]), "area must be positive"),
        (np.zeros((2, 2)), [[0, 1]], np.ones(2), "surface points need"),
        (np.zeros((2, 2)), [[0, 1], [0, 1]], np.ones(3), "surface points need"),
        (np.zeros(2), [0, 1], np.ones(2), "surface points need"),
    ],
)
def test_surface_points_that_make_no_sense_are_refused(x, normal, area, words):
    with pytest.raises(ValueError, match=words):
        mpm.SurfacePoints(x, np.array(normal, float), area)


@pytest.mark.parametrize(("per_cell", "low", "high"), [(4, 0.06, 0.10), (16, 0.015, 0.04)])
def test_jitter_costs_what_fill_says(per_cell, low, high):
    """A block on rollers under 500 Pa: 6 to 10 % off with 4 points a cell, 2 to 4 % with 16, on
    either grid."""
    for n in (4, 8):
        grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (n, n))
        body = mpm.MaterialPoints.fill(grid, SOIL, per_cell, jitter=0.3)
        rollers = (
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.Fixed(grid.facets("bottom"), "y"),
        )
        run = mpm.Simulation(
            grid,
            body,
            mpm.QuasiStatic(1),
            [*rollers, mpm.Traction(grid.facets("top"), (0.0, -500.0))],
        )
        run.step()
        run.settle()
        assert low < np.sqrt(((body.stress[:, 1] + 500.0) ** 2).mean()) / 500.0 < high


# -- staircases ------------------------------------------------------------------------------------


def on_a_fine_grid(dim, inside):
    grid = mpm.Grid.box((0.0,) * dim, (2.0, 2.0, 0.5)[:dim], (16, 16, 4)[:dim])
    return mpm.MaterialPoints.fill(grid, SOIL, 2**dim, inside, jitter=0.2)


def below(angle, top=1.0):
    """What lies under a slope through the middle, in degrees."""
    return lambda x: x[1] - top < np.tan(np.radians(angle)) * (x[0] - 1.0)


SLOPES = {
    f"{angle} degrees": (below(angle), ("top",)) for angle in (5, 10, 20, 30, 45, 60, 75, 85)
} | {
    "30 degrees, from the left": (below(-30), ("right",)),
    "80 degrees, from the left": (below(80), ("left",)),
    "circle": (lambda x: np.hypot(x[0] - 1, x[1] - 1) < 0.7, ("left", "top")),
    "tunnel": (lambda x: np.hypot(x[0] - 1, x[1] - 1) > 0.5, ("bottom",)),
    "embankment": (lambda x: x[1] < np.minimum(1.0, 0.8 * np.minimum(x[0], 2 - x[0])), ("top",)),
    "arc": (lambda x: x[1] < 1.0 + 0.3 * np.sin(2 * x[0]), ("top",)),
}
BLOCKS = {
    "block": (lambda x: (np.abs(x[:2] - 1) < 0.5).all(axis=0), ("left", "right", "top", "bottom")),
    "full": (None, ("left", "right", "top", "bottom")),
    "L": (lambda x: (x[0] < 0.5) | (x[1] < 0.5), ("left", "right", "top")),
    "stairs": (lambda x: x[1] < 0.25 + 0.25 * np.floor(4 * x[0]) / 1.0, ("left", "top")),
    "steps down and up": (
        lambda x: x[1] < 0.5 + 0.375 * np.abs(np.floor(2 * x[0]) - 1.5),
        ("left", "right", "top"),
    ),
    "square tunnel": (
        lambda x: (np.abs(x[:2] - 1) > 0.3).any(axis=0),
        ("left", "right", "top", "bottom"),
    ),
    "two blocks": (
        lambda x: ((x[0] < 0.5) & (x[1] < 1.2)) | ((x[0] > 1.1) & (x[1] < 0.7)),
        ("left", "top"),
    ),
    "wall of one point": (
        lambda x: (np.abs(x[0] - 1.03) < 0.0625) & (x[1] < 1),
        ("left", "right", "top"),
    ),
    "flat part of a slope": (lambda x: x[1] < np.minimum(1.0, 0.25 + x[0]), None),
}


@pytest.mark.parametrize("name", SLOPES)
@pytest.mark.parametrize("dim", [2, 3])
def test_slopes_and_curves_are_told_to_be_staircases(dim, name):
    inside, sides = SLOPES[name]
    with pytest.warns(
        UserWarning, match=r"is a staircase of \d+ levels, .*where=.*SurfacePoints"
    ) as heard:
        on_a_fine_grid(dim, inside).surface(*sides)
    assert heard[0].filename == __file__


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.parametrize("dim", [2, 3])
def test_blocks_and_large_steps_are_not(dim, name):
    inside, sides = BLOCKS[name]
    body = on_a_fine_grid(dim, inside)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if sides is None:
            body.surface("top", where=lambda x: x[0] > 0.8)
        else:
            body.surface(*sides, *(("back", "front") if dim == 3 else ()))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_ball_is_told_from_every_side(axis):
    grid = mpm.Grid.box((0.0,) * 3, (2.0,) * 3, (8,) * 3)
    ball = mpm.MaterialPoints.fill(grid, SOIL, 8, lambda x: np.linalg.norm(x - 1.0, axis=0) < 0.8)
    for side in list(SIDES)[2 * axis : 2 * axis + 2]:
        with pytest.warns(UserWarning, match=f"surface: {side} is a staircase of"):
            ball.surface(side)
