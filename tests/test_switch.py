"""From rest under gravity to dynamics: what fixed edges bore is carried over, and surfaces move
with the material."""

import dense
import inside
import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical import waves
from mpm_fenicsx.analytical.column import Column

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
PLASTIC = mpm.VonMises(SOIL, peak=60e3, residual=20e3, softening=50e3)
G = 9.81
WALLS = {2: {"left": "x", "right": "x"}, 3: {"left": "x", "right": "x", "bottom": "y", "top": "y"}}
BASE = {2: "bottom", 3: "back"}
VISCOUS = {
    "viscous": lambda on: mpm.ViscousBoundary(on, SOIL),
    "viscoelastic": lambda on: mpm.ViscoelasticBoundary(on, SOIL, 20.0),
}


class RestingColumn:
    """A column at rest under gravity on a grid that fits it; then on one with room to drift, or on
    its elements."""

    def __init__(self, mapping=None, dim=2, height=3.0, h=0.25, soil=SOIL, base=None):
        self.mapping, self.dim, self.h, self.height = mapping, dim, h, height
        room = 0.0 if mapping is None else 2 * h
        self.gravity = mpm.Gravity((0.0,) * (dim - 1) + (-G,))
        self.grid = self._grid(0.0, 0.0, room)
        terms = [
            self.gravity,
            mpm.Fixed(self.grid.facets(BASE[dim]), base),
            *self._rollers(self.grid),
        ]
        if mapping is None:
            self.static = mpm.FiniteElements(self.grid, soil, mpm.QuasiStatic(1), terms)
        else:
            self.points = mpm.MaterialPoints.fill(
                self.grid, soil, 2**dim, inside=lambda x: x[-1] < height
            )
            self.static = mpm.Simulation(self.grid, self.points, mpm.QuasiStatic(1), terms, mapping)
        self.static.step()
        self.left = self.static.settle()
        self.speed = G * height / SOIL.p_speed  # σ/(ρ c)

    def _grid(self, beside, below, above):
        lower = [-beside] * (self.dim - 1) + [-below]
        upper = [1 + beside] * (self.dim - 1) + [self.height + above]
        return mpm.Grid.box(
            lower, upper, [round((b - a) / self.h) for a, b in zip(lower, upper, strict=True)]
        )

    def _rollers(self, grid):
        return [mpm.Fixed(grid.facets(side), axis) for side, axis in WALLS[self.dim].items()]

    def surfaces(self, walls):
        make = self.grid.facets if self.mapping is None else self.points.surface
        return [make(BASE[self.dim])] + [make(side) for side in WALLS[self.dim] if walls]

    def release(self, surfaces, more, dt=1e-3):
        """The dynamic run, ``surfaces`` (base, and perhaps walls) no longer fixed."""
        walls = len(surfaces) > 1
        grid, room = self.grid, 2 * self.h
        if self.mapping is not None:
            grid = self._grid(room if walls else 0.0, room, room)
        terms = [self.gravity, *([] if walls else self._rollers(grid)), *more]
        if self.mapping is None:
            return mpm.FiniteElements(
                grid, self.static.material, mpm.Newmark(dt), terms, start=self.static
            )
        return mpm.Simulation(grid, self.points, mpm.Newmark(dt), terms, self.mapping)

    def velocity(self, run):
        return run.nodal("velocity") if self.mapping is None else self.points.velocity


@pytest.fixture
def rng():
    return np.random.default_rng(11)


MAPPINGS = pytest.mark.parametrize(
    "mapping", [None, mpm.DM_GC, mpm.GIMP], ids=lambda m: m.name if m else "FE"
)


# -- case 11 ---------------------------------------------------------------------------------------


@MAPPINGS
@pytest.mark.parametrize(
    ("soil", "boundary", "walls"),
    [
        (SOIL, "viscous", False),
        (SOIL, "viscoelastic", True),
        (PLASTIC, "viscous", True),
    ],
    ids=["base, viscous", "base and walls, viscoelastic", "base and walls, von Mises"],
)
def test_with_its_reactions_nothing_moves(mapping, soil, boundary, walls):
    column = RestingColumn(mapping, soil=soil)
    assert column.left <= 1e-10
    surfaces = column.surfaces(walls)
    run = column.release(
        surfaces, column.static.reactions(*surfaces) + [VISCOUS[boundary](s) for s in surfaces]
    )
    assert run.time == 0.0
    fastest = 0.0
    for _ in range(200):
        run.step()
        fastest = max(fastest, np.abs(column.velocity(run)).max())
    assert fastest < 1e-9 * column.speed


@pytest.mark.validation
@MAPPINGS
def test_in_3d_nothing_moves_either(mapping):
    column = RestingColumn(mapping, dim=3, height=1.0, h=0.5)
    surfaces = column.surfaces(walls=True)
    run = column.release(
        surfaces,
        column.static.reactions(*surfaces) + [mpm.ViscousBoundary(s, SOIL) for s in surfaces],
        dt=5e-3,
    )
    run.until(0.25)
    assert np.abs(column.velocity(run)).max() < 1e-9 * column.speed


@pytest.mark.parametrize(
    ("mapping", "scatter"),
    [(None, 2e-3), (mpm.GIMP, 1e-3), (mpm.DM_GC, 0.03), (mpm.DM_GCL, 1e-3)],
    ids=lambda value: str(value or "FE"),
)
def test_without_its_reactions_the_column_drifts(mapping, scatter):
    """At σ/(ρc) everywhere, once the unloading has been to the top and back.

    Where its base has come past a grid line points scatter about that, but where stress is linear
    over domains.  In finite elements the fastest mode, which a load that goes at once excites,
    rings on at the base: means of the column.
    """
    column = RestingColumn(mapping)
    surfaces = column.surfaces(walls=False)
    run = column.release(surfaces, [mpm.ViscousBoundary(s, SOIL) for s in surfaces])
    run.until(0.2)
    assert run.time > 3 * (2 * column.height / SOIL.p_speed)
    found = column.velocity(run)[:, 1]
    np.testing.assert_allclose(
        found.mean() if mapping is None else found, -column.speed, rtol=scatter
    )


# -- what the tractions are ------------------------------------------------------------------------


@MAPPINGS
def test_walls_bear_earth_pressure_at_rest_and_the_base_the_weight(mapping):
    column = RestingColumn(mapping, height=4.0, base="y")
    surfaces = column.surfaces(walls=True)
    at_rest = SOIL.poisson / (1 - SOIL.poisson) * SOIL.density * G
    weight, push = SOIL.density * G * column.height, at_rest * column.height**2 / 2
    totals = []
    for surface, carried in zip(surfaces, column.static.reactions(*surfaces), strict=True):
        if mapping is None:
            from dolfinx import fem

            totals.append(
                [
                    fem.assemble_scalar(fem.form(carried.value[i] * surface.measure))
                    for i in range(2)
                ]
            )
        else:
            totals.append(surface.area @ carried.value)
            depth = column.height - surface.x[:, 1]
            expected = (
                np.outer(at_rest * depth, [1.0, 0.0]) * -surface.normal[:, :1]
                if surface is not surfaces[0]
                else np.array([[0.0, weight]])
            )
            inner = (
                np.abs(surface.x[:, 1] - column.height / 2) < column.height / 4
                if surface is not surfaces[0]
                else slice(None)
            )
            difference = (carried.value - expected)[inner]
            assert np.abs(difference).max() < 0.02 * weight
    np.testing.assert_allclose(totals, [[0, weight], [push, 0], [-push, 0]], atol=0.02 * push)


def loaded(mapping, rng):
    """An uneven grid, points anywhere, a strip load; surface points that the static run carries
    along."""
    grid = dense.uneven(2)
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, jitter=0.3, seed=int(rng.integers(99)))
    on = [body.surface(side) for side in ("left", "right", "bottom")]
    strip = body.surface("top", where=lambda x: x[0] < 0.4)
    keep = [mpm.Fixed(grid.facets("left", "right"), "x"), mpm.Fixed(grid.facets("bottom"))]
    still = [mpm.Traction(surface, (0.0, 0.0)) for surface in on]
    run = mpm.Simulation(
        grid,
        body,
        mpm.QuasiStatic(2),
        [mpm.Traction(strip, lambda t: (0.0, -3e5 * t)), *keep, *still],
        mapping,
    )
    run.until(1.0)
    return run, on


@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.GIMP], ids=str)
def test_tractions_sum_to_the_nodal_reactions(mapping, rng):
    run, on = loaded(mapping, rng)
    run.settle(1e-8)
    borne, _ = run.balance()
    found = sum(
        dense.over_faces(run.grid, term.on, term.on.area[:, None] * term.value)
        for term in run.reactions(*on)
    )
    assert np.abs(borne).max() > 1e4
    assert np.abs(found.ravel() - borne).max() < 1e-8 * np.abs(borne).max()
    assert np.array_equal(run.balance()[0], borne)  # looking changes nothing


def test_tractions_of_elements_sum_to_the_nodal_reactions():
    grid = mpm.Grid.rectilinear(
        [dense.LINES, dense.LINES], {"strip": lambda x: (x[1] > 0.999) & (x[0] < 0.31)}
    )
    keep = [mpm.Fixed(grid.facets("left", "right"), "x"), mpm.Fixed(grid.facets("bottom"))]
    run = mpm.FiniteElements(
        grid, SOIL, mpm.QuasiStatic(1), [mpm.Traction(grid.facets("strip"), (0.0, -3e5)), *keep]
    )
    run.step()
    borne, left = run.balance()
    assert left < 1e-10
    terms = run.reactions(*(grid.facets(side) for side in ("left", "right", "bottom")))
    found = sum(
        -dense.vector(grid.space, dense.bare_scene(grid, mpm.Newmark(1.0)).bind([term])[-1].work)
        for term in terms
    )
    assert np.abs(found - borne).max() < 1e-10 * np.abs(borne).max()


def test_carried_tractions_add_to_others_on_the_same_surface():
    """Elements are linear: under gravity with its reactions a pulse does what it does without
    either."""

    def pulse(t):
        return 0.0, 1e3 * np.sin(100.0 * t)

    column = RestingColumn()
    [base] = surfaces = column.surfaces(walls=False)
    run = column.release(
        surfaces,
        [
            *column.static.reactions(base),
            mpm.Traction(base, pulse),
            mpm.ViscousBoundary(base, SOIL),
        ],
    )
    alone = mpm.FiniteElements(
        column.grid,
        SOIL,
        mpm.Newmark(1e-3),
        [*column._rollers(column.grid), mpm.Traction(base, pulse), mpm.ViscousBoundary(base, SOIL)],
    )
    energy = run.record(mpm.Energy())
    run.until(0.05)
    alone.until(0.05)
    v = column.velocity(alone)
    assert np.abs(v).max() > 1e-3
    np.testing.assert_allclose(column.velocity(run), v, atol=1e-9 * np.abs(v).max())
    assert abs(energy.lost[-1]) < 1e-9 * abs(energy["work"]).max()


# -- equilibrium of the static stage ---------------------------------------------------------------


def test_settling_reaches_what_one_solve_leaves(rng):
    run, _ = loaded(mpm.DM_GC, rng)
    before, x = run.balance()[1], run.bodies[0].x.copy()
    assert before > 1e-4
    with pytest.raises(mpm.RunError, match=r"out of balance .* after 2 steps at t = 1"):
        run.settle(steps=2)
    left = run.settle(1e-8)
    assert left == run.balance()[1] <= 1e-8 < before
    assert run.steps == 2 and run.time == 1.0
    x, solves = run.bodies[0].x.copy(), run.solves
    assert run.settle(1e-8) == left and run.solves == solves  # nothing left to do
    np.testing.assert_array_equal(run.bodies[0].x, x)


def test_an_elastic_scene_does_not_pay_for_settling():
    column = RestingColumn(mpm.DM_GC)
    surfaces = column.surfaces(walls=False)
    run = column.release(surfaces, [mpm.ViscousBoundary(s, SOIL) for s in surfaces])
    run.step()
    assert "_forces" not in vars(run.equilibrium)


def test_yielded_elements_go_on_as_they_are():
    grid = mpm.Grid.box((0, 0), (2, 2), (8, 8), {"strip": lambda x: (x[1] > 1.99) & (x[0] < 0.51)})
    weak = mpm.VonMises(SOIL, peak=10e3, residual=5e3, softening=50e3)
    load = mpm.Traction(grid.facets("strip"), (0.0, -50e3))
    keep = [mpm.Fixed(grid.facets("left", "right"), "x"), mpm.Fixed(grid.facets("bottom"))]
    static = mpm.FiniteElements(grid, weak, mpm.QuasiStatic(1), [load, *keep])
    static.step()
    static.settle()
    assert static.gauss_history().max() > 0.0
    edges = [grid.facets(side) for side in ("left", "right", "bottom")]
    run = mpm.FiniteElements(
        grid,
        weak,
        mpm.Newmark(1e-3),
        [load, *static.reactions(*edges), *(mpm.ViscousBoundary(edge, SOIL) for edge in edges)],
        start=static,
    )
    run.until(0.05)
    assert np.abs(run.nodal("velocity").ravel()).max() < 1e-6 * 50e3 / (SOIL.density * SOIL.p_speed)
    assert run.gauss_stress() is not static.gauss_stress()


# -- refusals --------------------------------------------------------------------------------------


def test_what_cannot_be_carried_over_is_refused(rng):
    run, on = loaded(mpm.DM_GC, rng)
    grid, body = run.grid, run.bodies[0]
    for surfaces, message in [
        ((), "must all be"),
        ((on[0], grid.facets("bottom")), "must all be"),
        ((on[2], body.surface("top")), "number 1 is on no fixed edge"),
        ((grid.facets("top"),), "number 0 is on no fixed edge"),
        ((grid.facets("left", "bottom"),), "give them one by one"),
        ((dense.uneven(2).facets("left"),), "another grid"),
    ]:
        with pytest.raises(ValueError, match=message):
            run.reactions(*surfaces)
    few = mpm.SurfacePoints(on[2].x[:2], on[2].normal[:2], on[2].area[:2])
    with pytest.raises(ValueError, match="too few"):
        run.reactions(on[0], on[1], few, mpm.SurfacePoints([[0.9, 0.0]], [[0.0, -1.0]], [0.1]))
    dynamic = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [])
    for call in (dynamic.settle, lambda: dynamic.reactions(on[0])):
        with pytest.raises(ValueError, match="needs a quasi-static run"):
            call()
    for value in (np.zeros((3, 2)), np.full(on[0].x.shape, np.nan), grid_field(grid)):
        with pytest.raises(ValueError, match="a load on surface points must be"):
            dense.bare_scene(grid, mpm.Newmark(1e-3)).bind([mpm.Traction(on[0], value)])[-1]
    with pytest.raises(ValueError, match="vector on the grid's mesh"):
        dense.bare_scene(grid, mpm.Newmark(1e-3)).bind(
            [mpm.Traction(grid.facets("top"), grid_field(dense.uneven(2)))]
        )[-1]


def grid_field(grid):
    from dolfinx import fem

    return fem.Function(grid.space)


def test_another_grid_or_material_cannot_be_the_start():
    static = RestingColumn().static
    for grid, soil in ((dense.uneven(2), SOIL), (static.grid, dense.SOFT)):
        with pytest.raises(ValueError, match="same grid, of the same material"):
            mpm.FiniteElements(grid, soil, mpm.Newmark(1e-3), [], start=static)


# -- surfaces move with the material ---------------------------------------------------------------


@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.GIMP], ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_surfaces_are_dragged_across_cells(dim, mapping):
    grid = mpm.Grid.box((0,) * dim, (4,) * dim, (8,) * dim)
    body = mpm.MaterialPoints.fill(
        grid, SOIL, 2**dim, inside=lambda x: ((x > 0.5) & (x < 1.5)).all(axis=0)
    )
    surfaces = [body.surface(side) for side in ["left", "right", *WALLS[dim], BASE[dim]][2:]]
    v = np.array([6.0, 4.5, -1.5])[:dim]
    body.velocity = np.tile(v, (len(body), 1))
    before = [(s.x.copy(), s.normal.copy(), s.area.copy()) for s in surfaces]
    run = mpm.Simulation(
        grid,
        body,
        mpm.Newmark(0.02),
        [mpm.Traction(s, np.zeros(s.x.shape)) for s in surfaces],
        mapping,
    )
    run.until(0.32)
    assert v[0] * run.time > 3 * 0.5
    for surface, (x, normal, area) in zip(surfaces, before, strict=True):
        np.testing.assert_allclose(surface.x, x + v * run.time, atol=1e-9)
        np.testing.assert_allclose(surface.normal, normal, atol=1e-9)
        np.testing.assert_allclose(surface.area, area, rtol=1e-9)


def strip_of_soil(mapping, shift, h=0.25, dt=1e-3):
    """A pulse on a column with a dashpot below, everything ``shift`` cells (m) off; absorbed/work,
    error, stresses."""

    def load(t):
        return 300.0 * np.maximum(0.0, 1.0 - np.abs(t - 0.05) / 0.05)

    grid = mpm.Grid.box((0, -4 * h), (1, 3 + 4 * h), (round(1 / h), round(3 / h) + 8))
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: (x[1] > 0) & (x[1] < 3))
    top, base = body.surface("top"), body.surface("bottom")
    for moved in (body, top, base):
        moved.x[:, 1] += shift
    run = mpm.Simulation(
        grid,
        body,
        mpm.Newmark(dt),
        [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.ViscousBoundary(base, SOIL),
            mpm.Traction(top, lambda t: (0.0, -load(t))),
        ],
        mapping,
    )
    energy, stress = run.record(mpm.Energy()), run.record(mpm.Probe("stress", (0.5, 1.5 + shift)))
    run.until(0.16)
    column = Column(3.0, SOIL.p_speed, SOIL.density, load, 0.2, fixed=False)
    error = waves.relative_error(-stress.values[:, 1], column.pressure(1.5, stress.times))
    return energy["absorbed"][-1] / energy["work"][-1], error, stress.values


@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.GIMP], ids=str)
def test_a_boundary_moved_by_whole_cells_is_the_same_boundary(mapping):
    still, moved = (strip_of_soil(mapping, shift) for shift in (0.0, 0.75))
    assert abs(still[0] - moved[0]) < 1e-9
    assert np.abs(still[2] - moved[2]).max() < 1e-9 * 300.0


@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.GIMP], ids=str)
@pytest.mark.parametrize("cells", [0.37, 2.6])
def test_a_boundary_inside_cells_absorbs_within_the_error_of_the_grid(mapping, cells):
    (coarse, error, _), (fine, finer, _) = (
        strip_of_soil(mapping, cells * h, h, 4e-3 * h) for h in (0.25, 0.125)
    )
    assert abs(coarse - 1) < 0.01 and abs(fine - 1) < 0.5 * abs(coarse - 1)
    assert error < 0.02 and finer < 0.6 * error


@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.GIMP], ids=str)
def test_carried_tractions_move_with_their_surface(mapping):
    """Shifted by whole cells, points and surfaces together, nothing moves either."""
    column = RestingColumn(mapping)
    surfaces = column.surfaces(walls=True)
    carried = column.static.reactions(*surfaces)
    for moved in (column.points, *surfaces):
        moved.x += np.array([0.25, -0.25])
    run = column.release(surfaces, carried + [mpm.ViscousBoundary(s, SOIL) for s in surfaces])
    run.until(0.1)
    assert np.abs(column.points.velocity).max() < 1e-9 * column.speed


@pytest.mark.parametrize("beyond", [1e-2, 1e-4, 1e-6])
def test_a_dashpot_just_over_a_corner_keeps_the_matrix_exact_in_its_smallest_rows(beyond):
    """Its far node takes beyond⁴ of it, next to one that takes it all."""
    grid = mpm.Grid.box((0, 0), (3, 3), (3, 3))
    on = mpm.SurfacePoints([[2 - beyond, 1 + beyond]], [[0.6, 0.8]], [1.0])
    scene = dense.bare_scene(grid, mpm.Newmark(1e-2))
    work = scene.bind([mpm.ViscousBoundary(on, SOIL)])[-1].work
    scene.prepare(0.0, 1e-2)
    K = dense.matrix(inside.term_system(scene, work)[1])
    N = dense.hats(grid, on.x)
    n = on.normal[:, :, None] * on.normal[:, None, :]
    Z = SOIL.density * (SOIL.p_speed * n + SOIL.s_speed * (np.eye(2) - n))
    by_hand = 200.0 * np.einsum("p,pi,pj,pab->iajb", on.area, N, N, Z).reshape(K.shape)
    d = by_hand.diagonal()
    touched = np.flatnonzero(d > 0)
    assert d[touched].min() < 2 * beyond**4 * d.max()
    scale = 1 / np.sqrt(d[touched])
    difference = (K - by_hand)[np.ix_(touched, touched)] * scale[:, None] * scale
    assert (
        np.abs(difference).max() < 1e-15 / beyond**2 + 1e-12
    )  # with Gauss points it would be 1e-16 / beyond⁴
