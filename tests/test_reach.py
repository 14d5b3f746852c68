"""Loads, dashpots and supports that reach no material are refused; of those that reach it in part
is told how much."""

import warnings

import dense
import pytest
from test_ranks import on_ranks

import mpm_fenicsx as mpm
from mpm_fenicsx.mapping.shape_functions import Stencil
from mpm_fenicsx.terms.reach import check_reach, filled

STEPPINGS = {"dynamic": mpm.Newmark(1e-3), "static": mpm.QuasiStatic(2)}


def grid_of(dim):
    """From -1 to 2 in x, to 2 in height, in cells of a quarter."""
    return mpm.Grid.box((-1.0, 0.0, 0.0)[:dim], (2.0, 2.0, 0.5)[:dim], (12, 8, 2)[:dim])


def column(grid, **keywords):
    """A body of a metre by a metre, with a metre of empty grid at its sides and above."""
    return mpm.MaterialPoints.fill(
        grid,
        dense.SOIL,
        2**grid.dim,
        lambda x: (x[0] > 0.0) & (x[0] < 1.0) & (x[1] < 1.0),
        **keywords,
    )


def look(grid, terms, stepping=STEPPINGS["dynamic"], mapping=mpm.DM_GC, body=None):
    """What a Simulation does when it is built, without compiling anything."""
    body = column(grid) if body is None else body
    scene = dense.bare_scene(grid, stepping)
    scene.bind(terms)
    check_reach(scene, [body], [grid.find(body.x)], [Stencil(grid, len(body), mapping.support)])


LOADS = {
    "Traction": lambda on: mpm.Traction(on, (0.0, -1.0, 0.0)[: dim_of(on)]),
    "DeadLoad": lambda on: mpm.DeadLoad(on, (0.0, -1.0, 0.0)[: dim_of(on)]),
    "ViscousBoundary": lambda on: mpm.ViscousBoundary(on, dense.SOIL),
    "ViscoelasticBoundary": lambda on: mpm.ViscoelasticBoundary(on, dense.SOIL, 3.0),
}


def dim_of(on):
    return on.x.shape[1] if isinstance(on, mpm.SurfacePoints) else on.grid.dim


def above(height, dim=2):
    return mpm.SurfacePoints([[0.5, height, 0.2][:dim]], [[0.0, 1.0, 0.0][:dim]], [2.0])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", LOADS)
def test_loads_and_dashpots_where_no_material_is_are_refused(dim, name):
    grid = grid_of(dim)
    for on, where in (
        (grid.facets("left", "right"), "the facets left, right"),
        (above(1.6, dim), r"surface points, as at x=\[0\.5 1\.6"),
    ):
        with pytest.raises(
            ValueError, match=f"on: {name} acts on {where}.*no material.*points.surface"
        ):
            look(grid, [LOADS[name](on)])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", LOADS)
def test_what_is_lost_of_an_area_is_told(dim, name):
    """A surface point 0.1 m above the body, in an empty cell of 0.25 m: 0.4 of its weight is on
    nodes above.  Of the facets below, the body's five nodes of thirteen bear 4 facets and two
    halves."""
    grid = grid_of(dim)
    with pytest.warns(
        UserWarning,
        match=rf"{name} acts on surface points, as at x=\[0\.5 1\.1.*60 % only, 1\.2 of 2 ",
    ):
        look(grid, [LOADS[name](above(1.1, dim))])
    area, every = (1.25, "3 m") if dim == 2 else (0.625, "1.5 m²")
    with pytest.warns(
        UserWarning,
        match=rf"{name} acts on the facets bottom.* bear 41\.7 % only, {area} of {every}:",
    ):
        look(grid, [LOADS[name](grid.facets("bottom"))])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.DM_GC], ids=str)
def test_what_acts_on_the_bodys_own_surface_is_never_in_doubt(dim, mapping):
    """Wherever the body lies, with jitter too, and where it fills the grid."""
    grid = grid_of(dim)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for shift, jitter in ((0.0, 0.0), (0.07, 0.0), (0.0, 0.4)):
            body = mpm.MaterialPoints.fill(
                grid,
                dense.SOIL,
                2**dim,
                jitter=jitter,
                inside=lambda x, s=shift: (x[0] > s) & (x[0] < 1.0 + s) & (x[1] < 1.0 - s),
            )
            look(
                grid,
                [mpm.ViscousBoundary(body.surface("left", "top"), dense.SOIL)],
                mapping=mapping,
                body=body,
            )
        whole = mpm.MaterialPoints.fill(grid, dense.SOIL, 2**dim)
        look(
            grid,
            [load(grid.facets("left", "top")) for load in LOADS.values()],
            mapping=mapping,
            body=whole,
        )


def test_in_finite_elements_all_of_the_grid_is_material():
    grid = grid_of(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mpm.FiniteElements(
            grid,
            dense.SOIL,
            mpm.Newmark(1e-3),
            [mpm.Traction(grid.facets("left"), (0.0, -1.0)), mpm.Traction(above(1.6), (0.0, -1.0))],
        )


@pytest.mark.parametrize("stepping", STEPPINGS)
def test_rollers_on_the_sides_of_a_grid_that_is_wider_than_the_body_are_heard(stepping):
    grid = grid_of(2)
    rollers, stepping = mpm.Fixed(grid.facets("left", "right"), "x"), STEPPINGS[stepping]
    if stepping.dynamic:  # a body may come
        with pytest.warns(
            UserWarning,
            match="Fixed acts on the facets left, right, where there is no material at ",
        ):
            look(grid, [rollers], stepping)
    else:
        with pytest.raises(
            ValueError,
            match="on: Fixed acts on the facets left, right, where there is no material; ",
        ):
            look(grid, [rollers], stepping)
    with pytest.warns(
        UserWarning, match="Fixed acts on the facets left, where there is no material at the start"
    ):
        look(grid, [mpm.Fixed(grid.facets("bottom", "left"))], stepping)


@pytest.mark.parametrize("stepping", STEPPINGS)
def test_a_floor_wider_than_the_body_is_no_mistake(stepping):
    grid = grid_of(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        look(grid, [mpm.Fixed(grid.facets("bottom"))], STEPPINGS[stepping])


def test_a_run_looks_and_its_warning_names_the_line_of_the_script():
    grid = grid_of(2)
    body = column(grid)
    for term in (mpm.Traction(grid.facets("bottom"), (0.0, -1.0)), mpm.Fixed(grid.facets("left"))):
        with pytest.warns(UserWarning) as heard:
            mpm.Simulation(grid, body, mpm.Newmark(1e-3), [term])
        assert heard[0].filename == __file__


PROGRAM = """
import warnings
from mpi4py import MPI
import test_reach as t
comm = MPI.COMM_WORLD
grid = t.grid_of(2)
try:
    t.look(grid, [t.mpm.Traction(grid.facets("right"), (0.0, -1.0))])
except ValueError as error:
    assert "no material" in str(error)
else:
    raise SystemExit("not refused")
with warnings.catch_warnings(record=True) as heard:
    warnings.simplefilter("always")
    t.look(grid, [t.mpm.Traction(grid.facets("bottom"), (0.0, -1.0))])
    body = t.column(grid)
    t.look(grid, [t.mpm.ViscousBoundary(body.surface("top", "left"), t.dense.SOIL)], body=body)
    body = t.column(grid)
    part = t.filled(grid, [body], [grid.find(body.x)])
    assert (part.round(9) % 1.0 == 0.0).all()
words = ["1.25 of 3 m" in str(w.message) for w in heard]
assert words == [True] * (comm.rank == 0), heard
words = ["no error"]
with warnings.catch_warnings():
    warnings.simplefilter("error")
    try:
        t.look(grid, [t.mpm.Traction(grid.facets("bottom"), (0.0, -1.0))])
    except UserWarning:
        words = []
assert not words
print("fine")
"""


def test_two_ranks_decide_together():
    assert on_ranks(2, "-c", PROGRAM, cwd=__file__.rpartition("/")[0]).count("fine") == 2


# -- cells that are full ---------------------------------------------------------------------------


def partly(grid, bodies, cells) -> int:
    """Cells that are neither full nor empty."""
    part = filled(grid, bodies, cells)
    return int(((part > 1e-12) & (part < 1.0 - 1e-6)).sum())


@pytest.mark.parametrize("dim", [2, 3])
def test_partly_filled_cells_are_counted(dim):
    """A square off the grid's lines by 0.15 h: of its five by five cells three by three are
    full."""
    grid = mpm.Grid.box((0.0,) * dim, (2.0,) * dim, (8,) * dim)
    body = mpm.MaterialPoints.fill(
        grid, dense.SOIL, 2**dim, lambda x: ((x > 0.5) & (x < 1.5)).all(axis=0), jitter=0.4
    )
    assert partly(grid, [body], [grid.find(body.x)]) == 0
    body.x += 0.15 * 0.25
    body.seat += 0.15 * 0.25
    assert partly(grid, [body], [grid.find(body.x)]) == 5**dim - 3**dim
    rest = mpm.MaterialPoints.fill(
        grid, dense.SOFT, 2**dim, lambda x: ~((x > 0.5) & (x < 1.5)).all(axis=0)
    )
    body.x -= 0.15 * 0.25
    body.seat -= 0.15 * 0.25
    assert partly(grid, [body, rest], [grid.find(b.x) for b in (body, rest)]) == 0
