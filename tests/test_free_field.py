"""Free fields: beside level ground, ground goes on as if it had no side."""

import numpy as np
import pytest
from earthquakes import ROCK, SOIL, compliant, pulse
from heard import warned
from open_ground import TIGHT

import mpm_fenicsx as mpm
from mpm_fenicsx.points.geostatic_stress import GRAVITY

H, CELLS, EDGE = 0.5, 8, 2.0
HEIGHT = CELLS * H
LAYERS = [(SOIL, lambda x: x[1] > EDGE), (ROCK, lambda x: x[1] < EDGE)]
CLAY = mpm.Tresca(SOIL, 40.0)
YIELDS = [(CLAY, lambda x: x[1] > EDGE), (ROCK, lambda x: x[1] < EDGE)]
FREQUENCY = SOIL.s_speed / (16 * H)


def grid_of(above=0):
    """A box with names for the parts of its sides in each layer."""
    facets = {
        f"{side} {layer}": lambda x, at=at, up=up: (
            (np.abs(x[0] - at) < 1e-9) & ((x[1] - EDGE) * up > -1e-9)
        )
        for side, at in (("left", 0.0), ("right", HEIGHT))
        for layer, up in (("soil", 1), ("rock", -1))
    }
    return mpm.Grid.box((0.0, 0.0), (HEIGHT, HEIGHT + above * H), (CELLS, CELLS + above), facets)


def base(motion=None, **options):
    return lambda grid: compliant(grid, motion=motion or pulse(FREQUENCY), **options)


def sides(grid, material, terms, **options):
    """Dashpots on both sides, layer by layer, and the free fields there."""
    found = []
    for side in ("left", "right"):
        names = f"{side} soil", f"{side} rock"
        found += [
            mpm.ViscousBoundary(grid.facets(name), law)
            for name, law in zip(names, (SOIL, ROCK), strict=True)
        ]
        found.append(mpm.FreeField(grid.facets(*names), material, terms, **options))
    return found


def level(material=LAYERS, terms=None, stepping=None, **options):
    """Level ground of finite elements, and its free fields."""
    grid, terms = grid_of(), terms or base()
    ground = sides(grid, material, terms, **options)
    stepping = stepping or mpm.Newmark(0.25 * H / SOIL.s_speed)
    solver = mpm.Solver(newton=mpm.Newton(tolerance=1e-12))
    run = mpm.FiniteElements(grid, material, stepping, [*terms(grid), *ground], solver=solver)
    return run, [term for term in ground if isinstance(term, mpm.FreeField)]


def differs(run, field, where=slice(None)):
    """Largest difference of nodal velocity from the column's at the same height, and its size."""
    column = field.columns[0]
    x, of = run.grid.space.tabulate_dof_coordinates(), column.grid.space.tabulate_dof_coordinates()
    order = np.argsort(of[:, 1])[::2]
    exact = column.nodal("velocity")[order]
    level = np.stack([np.interp(x[:, 1], of[order, 1], v) for v in exact.T], axis=1)
    return np.abs(run.nodal("velocity") - level)[where].max(), np.abs(exact).max()


@pytest.mark.parametrize("wave", ["SV", "P"])
def test_level_ground_has_no_sides(wave):
    run, (field, _) = level(terms=base(wave=wave))
    energy = run.record(mpm.Energy())
    largest = size = 0.0
    for _ in range(60):
        run.step()
        error, now = differs(run, field)
        largest, size = max(largest, error), max(size, now)
    assert size > 0.005
    assert largest < 1e-12 * size
    sums = sum(energy[name][-1] for name in ("kinetic", "strain", "absorbed"))
    assert sums == pytest.approx(energy["work"][-1], rel=1e-10)


def test_ground_that_yields_has_a_free_field_that_yields():
    run, (field, _) = level(YIELDS)
    largest = size = 0.0
    for _ in range(60):
        run.step()
        error, now = differs(run, field)
        largest, size = max(largest, error), max(size, now)
    assert largest < 1e-9 * size
    assert run.gauss_history().max() > 1e-6
    elastic, _ = level()
    elastic.until(run.time)
    assert differs(elastic, field)[0] > 0.1 * size


@pytest.mark.parametrize("wave, damping", [("SV", 0.0), ("P", 0.0), ("SV", 0.05)])
def test_level_ground_has_no_layer(wave, damping):
    """Layers of cells round layered ground bear nothing while it moves as its column does."""
    beyond = 5
    far = beyond * H
    grid = mpm.Grid.box((-far, -far), (HEIGHT + far, HEIGHT), (CELLS + 2 * beyond, CELLS + beyond))
    middle = mpm.LinearElastic(young=30e6, poisson=0.3, density=1800.0)
    ground = [(SOIL, lambda x: x[1] > EDGE), (middle, lambda x: x[1] < EDGE)]
    layer = mpm.AbsorbingLayer(("left", "right", "bottom"), ground, absorbing=2, elastic=3)
    damped = [mpm.RayleighDamping(damping, (FREQUENCY, 3 * FREQUENCY))] if damping else []
    late = pulse(FREQUENCY, begin=2.0)  # nothing of it is there at the start
    field = mpm.FreeField(
        layer, ground, lambda g: [*compliant(g, middle, late, wave=wave), *damped]
    )
    stepping = mpm.Newmark(0.25 * H / SOIL.s_speed)
    run = mpm.FiniteElements(grid, ground, stepping, [layer, field, *damped], solver=TIGHT)
    x = grid.space.tabulate_dof_coordinates()
    inside = (x[:, 0] > -1e-9) & (x[:, 0] < HEIGHT + 1e-9) & (x[:, 1] > -1e-9)
    largest = size = 0.0
    for _ in range(120):
        run.step()
        error, now = differs(run, field, inside)
        largest, size = max(largest, error), max(size, now)
    assert size > 0.005
    assert len(field.columns) == 2
    assert largest < 1e-10 * size


def test_points_beside_free_fields_move_as_their_own_column():
    """But for what waves in points and in finite elements of the same cells differ by, here at 32
    cells a wavelength; most at the upper corners."""
    slow = base(motion=pulse(0.5 * FREQUENCY))
    grid = grid_of(above=1)
    column = mpm.Grid.box((0.0, 0.0), (H, HEIGHT + H), (1, CELLS + 1))
    stepping = mpm.Newmark(0.25 * H / SOIL.s_speed)
    runs = []
    for on, more in ((grid, sides(grid, LAYERS, slow)), (column, [mpm.Tied("left", "right")])):
        bodies = [
            mpm.MaterialPoints.fill(on, law, 4, lambda x, of=of: of(x) & (x[1] < HEIGHT))
            for law, of in LAYERS
        ]
        runs.append(mpm.Simulation(on, bodies, stepping, [*slow(on), *more]))
    heights = [run.sampler("velocity")[0][:, 1] for run in runs]
    order = np.argsort(heights[1])[::2]
    rows = order[np.abs(heights[0][:, None] - heights[1][order]).argmin(axis=1)]
    off = size = 0.0
    for _ in range(120):
        for run in runs:
            run.step()
        whole, of_column = (
            run.sampler("velocity")[1](np.arange(len(y)))
            for run, y in zip(runs, heights, strict=True)
        )
        off = np.maximum(off, np.abs(whole - of_column[rows]))
        size = max(size, np.abs(of_column).max())
    assert off[:, 0].max() < 0.005 * size
    assert off[:, 1].max() < 0.02 * size


def test_static_stress_is_its_own_and_nothing_moves_before_the_wave():
    clay = mpm.Tresca(SOIL, 100e3)
    at_rest = mpm.GeostaticStress(clay, surface=HEIGHT, K0=0.5)

    def terms(grid):
        return [mpm.Fixed(grid.facets("bottom")), mpm.Gravity((0.0, -GRAVITY))]

    def bears(t, x):
        outward = np.where(x[:, 0] > 0.5 * HEIGHT, 1.0, -1.0)
        return np.stack((outward * at_rest(x.T)[:, 0], 0.0 * outward), axis=1)

    grid = mpm.Grid.box((0.0, 0.0), (HEIGHT, HEIGHT), (CELLS, CELLS))
    side = grid.facets("left", "right")
    field = mpm.FreeField(grid.facets("left"), clay, terms, stress=at_rest, b_bar=False)
    absorbing = [mpm.ViscousBoundary(side, SOIL), mpm.Traction(side, bears), field]
    stepping = mpm.Newmark(1e-2)
    run = mpm.FiniteElements(
        grid, clay, stepping, [*terms(grid), *absorbing], stress=at_rest, b_bar=False
    )
    for _ in range(5):
        run.step()
    for one in (run, field.columns[0]):
        assert np.abs(one.nodal("velocity")).max() < 1e-12


def test_it_goes_on_bit_for_bit_and_takes_steps_back(tmp_path):
    (run, _), (again, _) = level(YIELDS), level(YIELDS)
    run.record(mpm.Checkpoint(tmp_path / "state", every=25))
    for _ in range(25):
        run.step()
    again.restart(tmp_path / "state")
    for _ in range(5):
        run.step()
        again.step()
    for name, value in run.state().items():
        assert np.array_equal(value, again.state()[name]), name


def test_what_is_no_side_is_refused():
    grid = grid_of()
    step = mpm.Newmark(1e-3)
    dashpots = mpm.ViscousBoundary(grid.facets("bottom", "left"), ROCK)

    def build(*terms, stepping=step):
        return lambda: mpm.FiniteElements(grid, ROCK, stepping, [dashpots, *terms])

    def field(on, terms=None):
        return mpm.FreeField(on, ROCK, base() if terms is None else terms)

    for make, words in (
        (build(field(grid.facets("bottom"))), "for one vertical side"),
        (build(field(grid.facets("left", "bottom"))), "for one vertical side"),
        (build(field(grid.facets("right"))), "nothing absorbs where FreeField comes in"),
        (lambda: field(grid.facets("left"), [1]), "must be a function of the column's grid"),
        (build(field("left")), "on must be"),
    ):
        with pytest.raises(ValueError, match=words):
            make()
    with pytest.raises(ValueError, match="needs velocities"):
        mpm.FiniteElements(grid, ROCK, mpm.QuasiStatic(1), [field(grid.facets("left"))])


def test_a_column_of_other_ground_is_told_of():
    grid = grid_of()

    def said(run_terms, material, terms):
        ground = [*run_terms, *sides(grid, material, terms)]
        return warned(lambda: mpm.FiniteElements(grid, LAYERS, mpm.Newmark(1e-3), ground))

    assert said(base()(grid), LAYERS, base()) == []
    damped = mpm.RayleighDamping(beta=1e-3)
    for run_terms, material, words in (
        (base(kind="outcrop")(grid), LAYERS, "other waves come in in its column"),
        ([*base()(grid), damped], LAYERS, "other damping acts in its column"),
        (base()(grid), SOIL, "between y = 0 and 2 m its ground has the impedances"),
    ):
        found = said(run_terms, material, base())
        assert len(found) == 2 and all(words in sentence for sentence in found)
    with pytest.raises(ValueError, match="leave the column free at its base"):
        free = sides(grid, LAYERS, lambda g: [])
        mpm.FiniteElements(grid, LAYERS, mpm.Newmark(1e-3), [*base()(grid), *free])
    with pytest.raises(ValueError, match="what terms of FreeField return must be a list of terms"):
        none = sides(grid, LAYERS, lambda g: None)
        mpm.FiniteElements(grid, LAYERS, mpm.Newmark(1e-3), [*base()(grid), *none])
