"""Surfaces along lines, polygons, circles and level sets, bodies cut there, and pressure on
them."""

import json
from itertools import product

import inside
import numpy as np
import pytest
import slopes
import surfaces_on_ranks
from dense import SOIL
from scipy.spatial.transform import Rotation
from test_ranks import difference, on_ranks

import mpm_fenicsx as mpm
from mpm_fenicsx import Grid, MaterialPoints, SurfacePoints

P = 100e3
L_SHAPE = [(0.1, 0.2), (2.0, 0.2), (2.0, 1.0), (0.9, 1.3), (0.9, 2.0), (0.1, 2.0)]


def flux(on, power=1):
    """∮ x·n dA: dim times the volume of what a closed surface holds; ∮ n dA for power 0."""
    return (on.area[:, None] * on.normal * on.x**power).sum(axis=0)


def shoelace(corners):
    x, y = np.array(corners).T
    return 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()


# -- lines, polygons, circles ----------------------------------------------------------------------


@pytest.mark.parametrize("spacing", [0.07, 0.5, 1.0, 9.0])
def test_a_line_has_its_length_and_its_normal_to_the_right(spacing):
    a, b = np.array([0.3, 0.1]), np.array([1.5, 1.0])
    on = SurfacePoints.line(a, b, spacing)
    assert on.area.sum() == pytest.approx(1.5, rel=1e-14)
    assert len(on) == 2 * np.ceil(1.5 / spacing) and on.per_face == 2
    np.testing.assert_allclose(on.normal, np.tile([0.6, -0.8], (len(on), 1)), atol=1e-15)
    # exact for cubics along each face: here for all of s³
    s = (on.x - a) @ (b - a) / 1.5
    assert on.area @ s**3 == pytest.approx(1.5**4 / 4, rel=1e-13)


@pytest.mark.parametrize("way", [1, -1])
def test_a_polygon_is_closed_and_holds_its_area_and_a_hole_lacks_it(way):
    on = SurfacePoints.polygon(L_SHAPE[::way], 0.11)
    np.testing.assert_allclose(flux(on, 0), 0.0, atol=1e-14)
    np.testing.assert_allclose(flux(on), way * shoelace(L_SHAPE), rtol=1e-13)


def test_an_open_polygon_lacks_its_last_side_and_may_go_straight_on():
    whole, open_ = (SurfacePoints.polygon(L_SHAPE, 0.1, closed=c) for c in (True, False))
    assert whole.area.sum() - open_.area.sum() == pytest.approx(1.8, rel=1e-13)
    assert SurfacePoints.polygon([(0, 0), (1, 0), (3, 0)], 0.5, closed=False).area.sum() == 3.0


@pytest.mark.parametrize("hole", [False, True])
def test_a_circle_has_its_circumference(hole):
    on = SurfacePoints.circle((1.0, -2.0), 0.7, 0.1, hole)
    assert on.area.sum() == pytest.approx(2 * np.pi * 0.7, rel=1e-14)
    np.testing.assert_allclose(np.linalg.norm(on.x - (1.0, -2.0), axis=1), 0.7, rtol=1e-14)
    out = ((on.x - (1.0, -2.0)) * on.normal).sum(axis=1)
    np.testing.assert_allclose(out, -0.7 if hole else 0.7, rtol=1e-13)
    assert len(on) == 2 * np.ceil(2 * np.pi * 0.7 / 0.1)


@pytest.mark.parametrize("corners", [4, 3, 5])
def test_a_polygon_in_space_has_its_area_and_centre(corners):
    """A parallelogram, and other convex ones."""
    one, other = np.array([1.0, 0.2, 0.3]), np.array([-0.1, 0.8, 0.5])
    flat = {4: [(0, 0), (1, 0), (1, 1), (0, 1)], 3: [(0, 0), (1, 0), (0, 1)]}
    flat[5] = [(0, 0), (1, 0), (1.3, 0.6), (1, 1), (0, 1)]
    flat = np.array(flat[corners], float)
    on = SurfacePoints.polygon(flat @ np.stack((one, other)) + 0.5, 0.3)
    area = np.linalg.norm(np.cross(one, other))
    assert on.area.sum() == pytest.approx(shoelace(flat) * area, rel=1e-13)
    np.testing.assert_allclose(
        on.normal, np.tile(np.cross(one, other) / area, (len(on), 1)), atol=1e-14
    )
    assert on.per_face == (4 if corners == 4 else 1)
    a, b = flat, np.roll(flat, -1, axis=0)
    spun = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    centre = (spun[:, None] * (a + b)).sum(axis=0) / 3 / spun.sum()
    np.testing.assert_allclose(
        on.area @ on.x / on.area.sum(), centre @ np.stack((one, other)) + 0.5, rtol=1e-12
    )


# -- level sets ------------------------------------------------------------------------------------


def ball(x):
    return np.sqrt(((x - 0.03) ** 2).sum(axis=0)) - 0.8


@pytest.mark.parametrize("dim", [2, 3])
def test_a_level_set_is_closed_and_of_second_order(dim):
    grid = Grid.box((-1,) * dim, (1,) * dim, (6,) * dim)
    area = {2: 2 * np.pi * 0.8, 3: 4 * np.pi * 0.64}[dim]
    lacks = []
    for k in (1, 2, 4):
        on = SurfacePoints.level_set(grid, ball, k**dim)
        np.testing.assert_allclose(np.linalg.norm(on.normal, axis=1), 1.0, rtol=1e-12)
        assert ((on.x - 0.03) * on.normal).sum(axis=1).min() > 0.6
        if dim == 2:
            np.testing.assert_allclose(flux(on, 0), 0.0, atol=1e-14)
        lacks.append(1 - on.area.sum() / area)
    lacks = np.array(lacks)
    assert 0 < lacks[2] < (0.002 if dim == 2 else 0.004)
    assert (np.log2(lacks[:-1] / lacks[1:]) > 1.7).all()


@pytest.mark.parametrize("at", [0.5, 1.0, 0.437])
def test_a_level_set_on_a_grid_line_or_at_the_end_of_the_grid_counts_once(at):
    grid = Grid.box((0, 0), (1, 1), (4, 4))
    on = SurfacePoints.level_set(grid, lambda x: 3e4 * (x[0] - at))
    assert on.area.sum() == pytest.approx(1.0, rel=1e-9)
    np.testing.assert_allclose(on.x[:, 0], at, atol=1e-9)
    np.testing.assert_allclose(on.normal, np.tile([1.0, 0.0], (len(on), 1)), atol=1e-12)
    outside = SurfacePoints.level_set(grid, lambda x: at - x[0]) if at < 1 else None
    assert outside is None or outside.normal[0, 0] == pytest.approx(-1.0)


def test_a_plane_in_space_is_exact():
    """It meets the axes at 0.9, 1.8 and 0.9: a triangle, less one like it beyond y = 1."""
    grid = Grid.box((0, 0, 0), (1, 1, 1), (3, 4, 2))
    n = np.array([2.0, 1.0, 2.0]) / 3.0
    on = SurfacePoints.level_set(grid, lambda x: n @ x - 0.6)
    np.testing.assert_allclose(on.x @ n, 0.6, atol=1e-12)
    np.testing.assert_allclose(on.normal, np.tile(n, (len(on), 1)), atol=1e-9)
    whole = 0.5 * np.linalg.norm(np.cross([-0.9, 1.8, 0], [-0.9, 0, 0.9]))
    assert on.area.sum() == pytest.approx(whole * (1 - (0.8 / 1.8) ** 2), rel=1e-9)


# -- bodies cut at their edge ----------------------------------------------------------------------


def test_what_is_cut_has_the_volume_and_centre_of_its_shape():
    """Exact but at corners, where a box is divided three times more."""
    grid = Grid.box((0, 0), (2.2, 2.2), (11, 11))
    from matplotlib.path import Path

    body = MaterialPoints.fill(
        grid, SOIL, 4, inside=lambda x: Path(L_SHAPE).contains_points(x.T), cut=True
    )
    stairs = MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: Path(L_SHAPE).contains_points(x.T))
    exact = shoelace(L_SHAPE)
    assert body.mass.sum() / SOIL.density == pytest.approx(exact, rel=1e-5)
    assert abs(stairs.volume.sum() / exact - 1) > 1e-3
    x, y = np.array(L_SHAPE).T
    spun = x * np.roll(y, -1) - y * np.roll(x, -1)
    centre = [(spun * (c + np.roll(c, -1))).sum() / 6 / exact for c in (x, y)]
    np.testing.assert_allclose(body.volume @ body.x / body.volume.sum(), centre, rtol=1e-5)
    low = body.x - body.half, np.floor(body.x / 0.1) * 0.1  # domains stay in theirs
    assert (low[0] > low[1] - 1e-12).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_the_volume_below_a_plane_is_exact(dim):
    grid = Grid.rectilinear([np.array([0.0, 0.3, 0.5, 1.0])] * dim)
    n = np.array([0.3, 0.5, 0.9])[:dim]
    body = MaterialPoints.fill(grid, SOIL, 2**dim, inside=lambda x: n @ x < 0.21, cut=True)
    simplex = (0.21 / n).prod() / (2 if dim == 2 else 6)
    assert body.volume.sum() == pytest.approx(simplex, rel=1e-5)
    np.testing.assert_allclose(
        body.volume @ body.x / body.volume.sum(), 0.21 / n / (dim + 1), rtol=1e-5
    )


def test_a_body_that_ends_on_grid_lines_is_the_one_that_is_not_cut():
    grid = Grid.box((0, 0), (1, 1), (4, 5))
    one, other = (
        MaterialPoints.fill(
            grid, SOIL, 9, inside=lambda x: (x[0] < 0.5) & (x[1] < 0.8 + 1e-12), cut=cut
        )
        for cut in (False, True)
    )
    for name, value in one.state().items():
        np.testing.assert_array_equal(value, other.state()[name])
    assert other.surface("top").area.sum() == pytest.approx(0.5)


# -- pressure --------------------------------------------------------------------------------------


def at_rest(grid, body, on, h, steps=10):
    """How far stress is from −p after some steps under p."""
    body.stress[:, :3] = -P
    run = mpm.Simulation(grid, body, mpm.Newmark(0.5 * h / SOIL.p_speed), [mpm.Pressure(on, P)])
    for _ in range(steps):
        run.step()
    return np.abs(body.stress[:, : body.dim] / P + 1)


def disc(dim, h):
    return slopes.Ball(dim, h, SOIL)


def test_a_disc_under_pressure_rests():
    """To round-off, and what LEAST leaves out, where edge and body are cut in the same boxes; with
    the true circle to what a curve is more than its chords."""
    made = disc(2, 0.25)
    assert at_rest(made.grid, made.body, made.edge(64), 0.25).max() < 1e-6
    for on, worst, rms in (
        (made.edge(), 0.006, 1.2e-3),
        (SurfacePoints.circle(made.centre, 1.0, 0.125), 0.002, 4e-4),
    ):
        fresh = disc(2, 0.25)
        off = at_rest(fresh.grid, fresh.body, on, 0.25)
        assert off.max() < worst and np.sqrt((off**2).mean()) < rms


def test_a_tilted_block_under_pressure_rests():
    """Its corners, which are cut in boxes of 1/512 of a cell where these see them, are off by less
    than a hundredth."""
    h, turn = 0.25, np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])
    grid = Grid.box((-1, 0), (1.5, 2), (10, 8))
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) @ turn + (0.11, 0.23)

    def block(x):
        y = (x.T - (0.11, 0.23)) @ turn.T
        return ((y > 0) & (y < 1)).all(axis=1)

    body = MaterialPoints.fill(grid, SOIL, 4, inside=block, cut=True)
    off = at_rest(grid, body, SurfacePoints.polygon(corners, h / 2), h)
    assert off.max() < 0.01 and np.sqrt((off**2).mean()) < 1.5e-3


def test_a_ball_under_pressure_rests():
    made = disc(3, 0.25)
    off = at_rest(made.grid, made.body, made.edge(), 0.25, steps=3)
    assert off.max() < 0.05 and np.sqrt((off**2).mean()) < 0.01


def test_a_tilted_cube_under_pressure_on_its_six_sides_rests():
    """Parallelograms, whose faces are cut axis by axis."""
    h, turn = 0.25, Rotation.from_euler("xyz", [20, 30, 10], degrees=True).as_matrix()
    grid, centre = Grid.box((-1.25,) * 3, (1.25,) * 3, (10,) * 3), np.array([0.03, 0.02, 0.01])
    body = MaterialPoints.fill(
        grid, SOIL, 8, inside=lambda x: (np.abs((x.T - centre) @ turn) < 0.5).all(axis=1), cut=True
    )
    assert body.volume.sum() == pytest.approx(1.0, rel=5e-4)
    body.stress[:, :3] = -P
    sides = []
    for d, sign in product(range(3), (-1, 1)):
        a, b, out = (0.5 * np.roll(np.eye(3)[d], k) for k in (1, 2, 0))
        corners = np.array([-a - b, a - b, a + b, -a + b])[::sign] + sign * out
        sides.append(SurfacePoints.polygon(corners @ turn.T + centre, h / 2))
    np.testing.assert_allclose(sum(flux(side) for side in sides), 1.0, rtol=1e-12)
    stepping = mpm.Newmark(0.5 * h / SOIL.p_speed)
    run = mpm.Simulation(grid, body, stepping, [mpm.Pressure(side, P) for side in sides])
    for _ in range(3):
        run.step()
    off = np.abs(body.stress[:, :3] / P + 1)
    assert off.max() < 0.05 and np.sqrt((off**2).mean()) < 0.01


@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_GC], ids=str)
def test_a_quarter_of_a_disc_on_rollers_bears_the_pressure(mapping):
    """σ = −p and u = −p (1 + ν)(1 − 2ν)/E x in plane strain, to what areas change by the strain;
    the matrix of eq. (7), which is not that of the points' force, needs more than one solve."""
    made, p = slopes.Ball(2, 0.125, SOIL, whole=False), 100.0
    on = made.edge(64)
    terms = [
        mpm.Fixed(made.grid.facets("left"), "x"),
        mpm.Fixed(made.grid.facets("bottom"), "y"),
        mpm.Pressure(on, lambda t: t * p),
    ]
    before = made.body.x.copy()
    run = mpm.Simulation(made.grid, made.body, mpm.QuasiStatic(1), terms, mapping)
    run.until(1.0)
    if mapping is mpm.DM_GC:
        assert np.abs(made.body.stress[:, :2] / p + 1).max() > 0.05
        run.settle()
    np.testing.assert_allclose(made.body.stress[:, :2], -p, rtol=3e-5)
    shrinks = (1 + SOIL.poisson) * (1 - 2 * SOIL.poisson) / SOIL.young * p
    np.testing.assert_allclose(made.body.x - before, -shrinks * before, atol=1e-4 * shrinks)


@pytest.mark.parametrize("kind", ["facets", "points", "elements"])
def test_pressure_is_a_traction_against_the_normal(kind):
    """A function of time and place, on all sides at once, as tractions side by side."""

    def run_of(make_terms):
        grid = Grid.box((0, 0), (1, 1), (3, 3))
        body = MaterialPoints.fill(grid, SOIL, 4)
        sides = {"left": (-1, 0), "right": (1, 0), "top": (0, 1)}
        on = body.surface if kind == "points" else grid.facets
        terms = [mpm.Fixed(grid.facets("bottom")), *make_terms(on, sides)]
        stepping = mpm.Newmark(2e-3)
        if kind == "elements":
            run = mpm.FiniteElements(grid, SOIL, stepping, terms)
        else:
            run = mpm.Simulation(grid, body, stepping, terms)
        energy = run.record(mpm.Energy())
        for _ in range(3):
            run.step()
        return run.nodal("increment").copy(), np.array(energy["work"])

    def p(t, x):
        return 1e3 * (1 + t) * (1 + x[:, 0] + 2 * x[:, 1])

    one = run_of(lambda on, sides: [mpm.Pressure(on(*sides), p)])
    other = run_of(
        lambda on, sides: [
            mpm.Traction(on(side), lambda t, x, n=n: -p(t, x)[:, None] * np.array(n))
            for side, n in sides.items()
        ]
    )
    size = np.abs(other[0]).max()
    np.testing.assert_allclose(
        one[0], other[0], rtol=0, atol=(1e-4 if kind == "points" else 1e-9) * size
    )
    np.testing.assert_allclose(one[1], other[1], rtol=1e-4 if kind == "points" else 1e-9)


def test_pressure_turns_with_the_surface_and_acts_per_area_as_it_is():
    """A disc that spins by 0.8 rad while it is pressed: as much spin is left as without."""
    left = []
    for p in (0.0, 2e4):
        made = disc(2, 0.25)
        on, body = made.edge(), made.body
        body.velocity = 2.0 * np.column_stack((-body.x[:, 1], body.x[:, 0]))
        run = mpm.Simulation(made.grid, body, mpm.Newmark(0.025), [mpm.Pressure(on, p)])
        normal = on.normal.copy()
        for _ in range(16):
            run.step()
        across = normal[:, 0] * on.normal[:, 1] - normal[:, 1] * on.normal[:, 0]
        turn = np.arctan2(across, (normal * on.normal).sum(axis=1))
        assert np.abs(turn - 0.8).max() < 0.05
        x = body.x - body.mass @ body.x / body.mass.sum()
        left.append(body.mass @ (x[:, 0] * body.velocity[:, 1] - x[:, 1] * body.velocity[:, 0]))
    assert left[1] == pytest.approx(left[0], rel=2e-3)


# -- what a run makes of them ----------------------------------------------------------------------


def test_cut_cells_are_held_where_such_a_surface_is_and_nowhere_else():
    """Free sides of the bar, too, on which nothing acts; without the mark only what is beside the
    dashpots is, as for any other surface."""
    bar, held = slopes.Bar(), []
    for flag in (True, False):
        run = bar.material_points(0.5)
        for term in run.terms:
            term.on.cuts_cells = flag
        run = mpm.Simulation(run.grid, run.bodies, run.stepping, run.terms)
        run.step()
        nodes = run.grid.space.tabulate_dof_coordinates()[inside.tied(run), :2]
        s = bar.s(nodes)
        held.append((len(nodes), ((s > 2) & (s < slopes.LENGTH - 2)).sum()))
    (most, beside), (few, none) = held
    assert most > few > 0 and beside > 5 and none == 0


def test_energy_goes_into_dashpots_and_springs_of_a_slope():
    bar = slopes.Bar()
    run = bar.material_points(0.5)
    springs = [mpm.ViscoelasticBoundary(term.on, bar.soil, 50.0) for term in run.terms]
    run = mpm.Simulation(run.grid, run.bodies, run.stepping, springs)
    energy = run.record(mpm.Energy())
    for _ in range(int(bar.end / run.stepping.dt)):
        run.step()
    assert energy["absorbed"][-1] == pytest.approx(energy.left[0], rel=0.1)
    assert energy["stored"][-1] > 0


def test_whole_points_beside_a_slope_are_warned_of_and_cut_ones_are_not(recwarn):
    slopes.Bar().material_points(0.5)
    assert not [w for w in recwarn if "stairs" in str(w.message)]
    with pytest.warns(UserWarning, match="ViscousBoundary acts on a slanted or curved surface"):
        slopes.Bar().material_points(0.5, cut=False)


# -- refusals --------------------------------------------------------------------------------------

GRID = Grid.box((0, 0), (2, 2), (4, 4))
REFUSED = {
    "no length": (lambda: SurfacePoints.line((1, 1), (1, 1), 0.1), "a and b must be two places"),
    "spacing": (lambda: SurfacePoints.line((0, 0), (1, 1), 0.0), "spacing must be positive, got 0"),
    "3D line": (lambda: SurfacePoints.line((0, 0, 0), (1, 1, 1), 1), r"a must be a place \(x, y\)"),
    "crosses": (
        lambda: SurfacePoints.polygon([(0, 0), (1, 1), (1, 0), (0, 1)], 0.1),
        r"side from \(0.0, 0.0\) to \(1.0, 1.0\) and that .* cross or touch",
    ),
    "touches": (
        lambda: SurfacePoints.polygon([(0, 0), (2, 0), (1, 0), (0, 1)], 0.1),
        "cross or touch",
    ),
    "twice": (
        lambda: SurfacePoints.polygon([(0, 0), (1, 0), (1, 1), (0, 0)], 0.1),
        r"got \(0.0, 0.0\) twice; a closed polygon returns",
    ),
    "few": (lambda: SurfacePoints.polygon([(0, 0), (1, 0)], 0.1), "at least 3, got 2"),
    "text": (lambda: SurfacePoints.polygon("square", 0.1), "corners must be an array of numbers"),
    "bent": (
        lambda: SurfacePoints.polygon([(0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 1, 0)], 0.1),
        "corners must lie in a plane, got 0.204 m out of it",
    ),
    "bay": (
        lambda: SurfacePoints.polygon(
            [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 0.5, 0), (0, 2, 0)], 0.1
        ),
        "have no bay",
    ),
    "on a line": (
        lambda: SurfacePoints.polygon([(0, 0, 0), (1, 0, 0), (2, 0, 0)], 0.1),
        "must not lie on a line",
    ),
    "radius": (lambda: SurfacePoints.circle((0, 0), -1.0, 0.1), "radius must be positive"),
    "no zero": (lambda: SurfacePoints.level_set(GRID, lambda x: x[0] + 5), "function has no zero"),
    "nan": (
        lambda: SurfacePoints.level_set(GRID, lambda x: np.where(x[0] > 1, np.inf, -1.0)),
        "finite numbers .* got inf",
    ),
    "rows": (lambda: SurfacePoints.level_set(GRID, lambda x: x), r"to finite numbers \(n,\)"),
    "number": (lambda: SurfacePoints.level_set(GRID, 3.0), "function must map x"),
    "boxes": (
        lambda: SurfacePoints.level_set(GRID, lambda x: x[0] - 1, 3),
        "per_cell must be a square of a whole number, got 3",
    ),
    "jitter": (
        lambda: MaterialPoints.fill(GRID, SOIL, 4, lambda x: x[0] < 1, jitter=0.1, cut=True),
        "jitter must be 0 .* got 0.1",
    ),
    "cut": (
        lambda: MaterialPoints.fill(GRID, SOIL, 4, lambda x: x[0] < 1, cut="edge"),
        "cut must be True or False, got 'edge'",
    ),
    "surface": (
        lambda: MaterialPoints.fill(GRID, SOIL, 4, lambda x: x[0] < 1.1, cut=True).surface("top"),
        "along the edge of a body that is cut take SurfacePoints.line",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_sense_is_refused(name):
    make, message = REFUSED[name]
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("value", "message"),
    [("high", "value of Pressure"), ((0.0, -1e3), "value of Pressure"), (np.nan, "Pressure")],
)
def test_a_pressure_that_is_none_is_refused(value, message):
    body = MaterialPoints.fill(GRID, SOIL, 4, lambda x: x[0] < 1)
    with pytest.raises(ValueError, match=message):
        mpm.Simulation(GRID, body, mpm.Newmark(1e-3), [mpm.Pressure(body.surface("right"), value)])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (((1.0, 0.0), (1.0, 3.0)), "lies outside the grid"),
        (((1.0, 0.0), (1.9, 2.0)), "farther than a cell from any material"),
    ],
    ids=["outside the grid", "far from material"],
)
def test_a_surface_that_leaves_grid_or_body_is_refused(line, message):
    body = MaterialPoints.fill(GRID, SOIL, 4, lambda x: x[0] < 1 + 1e-9, cut=True)
    terms = [mpm.Pressure(SurfacePoints.line(*line, 0.25), 1e3)]
    with pytest.raises(ValueError, match=message):
        mpm.Simulation(GRID, body, mpm.Newmark(1e-3), terms)


# -- ranks -----------------------------------------------------------------------------------------


@pytest.mark.ranks
def test_two_ranks_make_the_faces_of_one_and_compute_the_same(tmp_path):
    out = tmp_path / "out.json"
    on_ranks(2, surfaces_on_ranks.__file__, out)
    several, serial = json.loads(out.read_text()), surfaces_on_ranks.everything()
    assert sorted(several) == sorted(serial)
    for name, rows in serial.items():
        assert difference(several[name], rows) < 1e-9, name
