"""The background grid: lattice against brute force, points found, files read, facets named, input
refused."""

from itertools import pairwise, product

import meshio
import numpy as np
import pytest
from dolfinx import fem
from hypothesis import given, settings
from hypothesis import strategies as st
from test_ranks import on_ranks

from mpm_fenicsx import Grid
from mpm_fenicsx.grid import dolfinx_versions, partition

BITS = {d: np.array(list(product((0, 1), repeat=d)))[:, ::-1] for d in (2, 3)}


def area(surface):
    return fem.assemble_scalar(fem.form(fem.Constant(surface.grid.mesh, 1.0) * surface.measure))


def box(dim, **facets):
    return Grid.box((-2.0, 5.0, 1.0)[:dim], (1.0, 7.0, 2.0)[:dim], (6, 4, 2)[:dim], **facets)


@pytest.fixture
def index(grid, hats):
    """Place (cells, dim) of each cell among the grid lines."""
    centre = (grid.lattice.lower + grid.lattice.upper) / 2
    return np.stack([hats.cell(d, centre[:, d]) for d in range(grid.dim)], axis=1)


# -- lattice ---------------------------------------------------------------------------------------


def test_cells_fill_the_grid_lines(grid, hats, index):
    assert (
        len({*map(tuple, index)}) == np.prod([len(line) - 1 for line in hats.lines]) == grid.cells
    )
    for d, line in enumerate(hats.lines):
        np.testing.assert_allclose(grid.lattice.lower[:, d], line[index[:, d]], rtol=0, atol=1e-14)
        np.testing.assert_allclose(
            grid.lattice.upper[:, d], line[index[:, d] + 1], rtol=0, atol=1e-14
        )
    whole = np.prod([line[-1] - line[0] for line in hats.lines])
    assert grid.lattice.volume.sum() == pytest.approx(whole, rel=1e-13)


def test_neighbours_are_one_line_away(grid, index):
    at = {tuple(i): c for c, i in enumerate(index)}
    for c, d, end in product(range(grid.cells), range(grid.dim), range(2)):
        step = np.eye(grid.dim, dtype=int)[d] * (2 * end - 1)
        assert grid.lattice.neighbour[c, d, end] == at.get(tuple(index[c] + step), -1)


def test_patches_hold_the_nodes_within_a_cell(grid, hats, index):
    at = {tuple(i): n for n, i in enumerate(hats.place)}
    for c in range(grid.cells):
        for place, digit in enumerate(product(range(4), repeat=grid.dim)):
            assert grid.lattice.patch[c, place] == at.get(tuple(index[c] + digit[::-1] - 1), -1)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("family", ["Lagrange", "DQ"])
def test_tensor_order_runs_along_x_first(grid, family, degree):
    V = dolfinx_versions.space(grid.mesh, family, degree)
    lattice = grid.lattice
    digit = np.array(list(product(range(degree + 1), repeat=grid.dim)))[:, ::-1]
    wanted = lattice.lower[:, None] + digit / degree * (lattice.upper - lattice.lower)[:, None]
    x = V.tabulate_dof_coordinates()[grid.tensor_order(V, degree)][:, :, : grid.dim]
    np.testing.assert_allclose(x, wanted, rtol=0, atol=1e-13)


def test_a_grid_with_an_inward_corner_finds_what_it_holds(l_shape):
    grid = l_shape
    x = np.random.default_rng(3).uniform(0, (3, 2), (500, 2))
    inside = (x[:, 0] < 1.0) | (x[:, 1] < 0.5)
    found = grid.find(x)
    assert np.array_equal(found >= 0, inside)
    x, found = x[inside], found[inside]
    assert ((grid.lattice.lower[found] <= x) & (x <= grid.lattice.upper[found])).all()


# -- points in cells -------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_a_point_lies_in_the_cell_above_its_edges(grid, hats, data):
    coordinates = [
        st.one_of(st.sampled_from(list(line)), st.floats(line[0], line[-1])) for line in hats.lines
    ]
    x = np.array(data.draw(st.lists(st.tuples(*coordinates), min_size=1, max_size=8)))
    wanted = [hats.cell(d, x[:, d]) for d in range(grid.dim)]
    start = np.array(
        data.draw(st.lists(st.integers(0, grid.cells - 1), min_size=len(x), max_size=len(x))),
        np.int32,
    )
    found = grid.find(x)
    grid.walk(x, start)
    assert np.array_equal(start, found)
    for d, line in enumerate(hats.lines):
        np.testing.assert_allclose(
            grid.lattice.lower[found, d], line[wanted[d]], rtol=0, atol=1e-14
        )


@pytest.mark.parametrize("dim", [2, 3])
def test_a_hair_outside_is_inside_and_more_is_not(dim):
    grid = Grid.rectilinear([np.array([0.0, 0.4, 1.0])] * dim)
    x = np.full((6, dim), 0.2)
    x[0, 0] = -1e-18
    x[1, -1] = 1.0 + 1e-14
    x[2, 0] = -1e-6
    x[3, -1] = 1.0 + 1e-6
    x[4, 0] = np.nan
    x[5, -1] = np.inf
    assert np.array_equal(grid.find(x) >= 0, [True, True, False, False, False, False])
    cell = np.zeros(6, np.int32)
    grid.walk(x, cell)
    assert np.array_equal(cell, grid.find(x))


def test_a_hair_below_an_inner_edge_is_the_cell_below():
    grid = Grid.rectilinear([np.array([-1.0, 0.0, 1.0])] * 2)
    below, above = grid.find(np.array([[-1e-18, 0.5], [0.0, 0.5]]))
    assert grid.lattice.upper[below, 0] == 0.0 == grid.lattice.lower[above, 0]


def test_a_lost_point_stays_lost(grid):
    cell = np.full(1, -1, np.int32)
    grid.walk((grid.lattice.lower + grid.lattice.upper)[:1] / 2, cell)
    assert cell[0] == -1


# -- files -----------------------------------------------------------------------------------------


def shuffled(dim, rng):
    """An uneven grid as a mesher might write it: nodes in any order, some unused, cells turned at
    random."""
    lines = [np.array(v) for v in ([-3.0, -2.2, -1.7, -0.3], [10.0, 10.5, 11.7], [1.0, 1.3, 2.0])][
        :dim
    ]
    index = {i: n for n, i in enumerate(product(*(range(len(line)) for line in lines)))}
    x = np.array([[line[k] for line, k in zip(lines, i, strict=True)] for i in index])
    ring = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    if dim == 3:
        ring = np.array([(*r, 0) for r in ring] + [(*r, 1) for r in ring])
    cells = []
    for corner in product(*(range(len(line) - 1) for line in lines)):
        turned = ring
        for axis in range(dim):
            for _ in range(rng.integers(4)):  # quarter turns about an axis, of the numbering only
                i, j = [(0, 1), (1, 2), (0, 2)][axis if dim == 3 else 0]
                turned = turned.copy()
                turned[:, i], turned[:, j] = 1 - turned[:, j], turned[:, i].copy()
        cells.append([index[tuple(np.add(corner, t))] for t in turned])
    names = rng.permutation(len(x) + 5)
    points = np.full((len(names), 3), 99.0)
    points[names[: len(x)], :dim] = x
    points[:, dim:] = 0.0
    return lines, points, names[np.array(cells)][rng.permutation(len(cells))]


@pytest.mark.parametrize("dim, kind", [(2, "quad"), (3, "hexahedron")])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_file_in_any_order_gives_the_same_grid(tmp_path, dim, kind, seed):
    lines, points, cells = shuffled(dim, np.random.default_rng(seed))
    meshio.write(
        tmp_path / "grid.vtu", meshio.Mesh(points, [(kind, cells), ("line", cells[:2, :2])])
    )
    read, made = Grid.read(tmp_path / "grid.vtu"), Grid.rectilinear(lines)
    places = []
    for grid in (read, made):
        node = grid.space.tabulate_dof_coordinates()[:, :dim]
        order = np.lexsort(np.round(grid.lattice.lower, 9).T)
        patch = grid.lattice.patch[order]
        places.append(np.where(patch[..., None] >= 0, node[patch], np.nan))
        x = grid.lattice.lower + 0.3 * (grid.lattice.upper - grid.lattice.lower)
        assert np.array_equal(grid.find(x), np.arange(grid.cells))
        digit = node[grid.lattice.nodes] > (grid.lattice.lower + 1e-9)[:, None]
        assert np.array_equal(digit, np.broadcast_to(BITS[dim], digit.shape))
    np.testing.assert_allclose(places[0], places[1], rtol=0, atol=1e-13)


def test_a_file_without_quadrilaterals_is_refused(tmp_path):
    mesh = meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])])
    meshio.write(tmp_path / "triangle.vtu", mesh)
    with pytest.raises(ValueError, match="without quadrilaterals or hexahedra"):
        Grid.read(tmp_path / "triangle.vtu")


@pytest.mark.parametrize(
    ("axes", "words"),
    [((0, 2), "in the xz plane"), ((1, 2), "in the yz plane"), ((0, 1), None), ((1, 0), None)],
)
def test_quadrilaterals_lie_in_the_xy_plane_at_any_height(tmp_path, axes, words):
    x = np.full((4, 3), 7.0)
    x[:, axes] = [[0, 0], [2, 0], [2, 1], [0, 1]]
    meshio.write(tmp_path / "flat.vtu", meshio.Mesh(x, [("quad", [[0, 1, 2, 3]])]))
    if words is None:
        assert Grid.read(tmp_path / "flat.vtu").cells == 1
        return
    with pytest.raises(
        ValueError, match=f"path names a file whose quadrilaterals lie {words}; .*turn the mesh"
    ):
        Grid.read(tmp_path / "flat.vtu")


def test_quadrilaterals_on_a_surface_in_space_are_refused(tmp_path):
    x = np.array([[0, 0, 0], [2, 0, 1], [2, 1, 1], [0, 1, 0]], float)
    meshio.write(tmp_path / "roof.vtu", meshio.Mesh(x, [("quad", [[0, 1, 2, 3]])]))
    with pytest.raises(ValueError, match="quadrilaterals lie on a surface in space"):
        Grid.read(tmp_path / "roof.vtu")


def test_a_file_that_cannot_be_read_is_an_error_of_the_system(tmp_path):
    (tmp_path / "junk.vtu").write_text("no mesh")
    for name, words in (("junk.vtu", "meshio cannot read it"), ("nowhere.vtu", "nowhere.vtu")):
        with pytest.raises(OSError, match=f"grid not read: .*{words}"):
            Grid.read(tmp_path / name)


def test_a_crooked_mesh_is_refused_where_the_lattice_is_wanted(tmp_path):
    _, points, cells = shuffled(2, np.random.default_rng(0))
    points[cells[0, 0], 0] += 1e-3
    meshio.write(tmp_path / "crooked.vtu", meshio.Mesh(points, [("quad", cells)]))
    grid = Grid.read(tmp_path / "crooked.vtu")
    with pytest.raises(ValueError, match="mesh must be rectilinear"):
        grid.lattice  # noqa: B018


# -- facets ----------------------------------------------------------------------------------------


def test_sides_have_their_areas_and_unite(grid, hats):
    length = np.array([line[-1] - line[0] for line in hats.lines])
    sides = [("left", "right"), ("bottom", "top"), ("back", "front")][: grid.dim]
    for d, names in enumerate(sides):
        for name in names:
            assert area(grid.facets(name)) == pytest.approx(length.prod() / length[d], rel=1e-13)
    left, bottom = grid.facets("left"), grid.facets("bottom")
    assert area(grid.facets("left", "bottom")) == pytest.approx(
        area(left) + area(bottom), rel=1e-13
    )
    assert area(grid.facets("left", "left")) == pytest.approx(area(left), rel=1e-13)
    assert len(np.intersect1d(left.facets, bottom.facets)) == 0
    assert len(left.facets) == np.prod([len(line) - 1 for line in hats.lines[1:]])


@pytest.mark.parametrize("dim", [2, 3])
def test_a_named_set_may_share_facets_with_sides(dim):
    low = {
        "footing": lambda x: (x[1] > 7 - 1e-9) & (x[0] < -1 + 1e-9),
        "corner": lambda x: (x[0] > 1 - 1e-9) | ((x[1] > 7 - 1e-9) & (x[0] > 0.5 - 1e-9)),
    }
    grid = box(dim, facets=low)
    assert area(grid.facets("footing")) == pytest.approx(1.0, rel=1e-13)
    assert area(grid.facets("top")) == pytest.approx(3.0, rel=1e-13)
    assert area(grid.facets("top", "footing")) == pytest.approx(3.0, rel=1e-13)
    assert area(grid.facets("corner")) == pytest.approx(2.5, rel=1e-13)
    assert area(grid.facets("corner", "footing")) == pytest.approx(3.5, rel=1e-13)
    assert area(grid.facets("corner", "top", "left")) == pytest.approx(7.0, rel=1e-13)


@pytest.mark.parametrize(
    "facets, words",
    [
        ({"top": lambda x: x[1] > 6}, "'top' is taken"),
        ({"nowhere": lambda x: x[0] > 99}, "'nowhere' is empty"),
        ({"inner": lambda x: np.isclose(x[0], 0.0)}, "'inner' is empty"),
        ({"a": lambda x: x[0] < -1.9, "b": lambda x: x[0] < -1.5}, r"\['a', 'b'\] overlap"),
    ],
)
def test_sets_that_make_no_sense_are_refused(facets, words):
    with pytest.raises(ValueError, match=words):
        box(2, facets=facets)


def test_a_facet_set_that_is_not_known_is_refused():
    with pytest.raises(
        ValueError, match="facets must be one of left, right, bottom, top, got 'front'"
    ):
        box(2).facets("front")
    with pytest.raises(ValueError, match="no facet"):
        box(2).facets()


@pytest.mark.parametrize(
    "lower, upper, cells, words",
    [
        ((0,), (1,), (3,), "2 or 3"),
        ((0, 0), (1, 1), (3, 3, 3), "2 or 3"),
        ((0, 0), (1, 1), (3, 0), "cells"),
        ((0, 0), (1, 1), (3, 2.5), "cells"),
        ((0, 1), (1, 1), (3, 3), "lower must lie below upper"),
        ((0, np.nan), (1, 1), (3, 3), "lower must be finite"),
        ((0, 0), (1, np.inf), (3, 3), "upper must be finite"),
    ],
)
def test_what_makes_no_box_is_refused(lower, upper, cells, words):
    with pytest.raises(ValueError, match=words):
        Grid.box(lower, upper, cells)


@pytest.mark.parametrize("line", [[0.0], [0.0, 1.0, 1.0], [1.0, 0.0], [0.0, np.nan, 1.0]])
def test_grid_lines_that_do_not_increase_are_refused(line):
    with pytest.raises(ValueError, match="grid lines must increase"):
        Grid.rectilinear([np.array([0.0, 1.0]), np.array(line)])


# -- ranks -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("ranks", [1, 2, 3, 5])
def test_owners_are_even_and_ghosts_are_the_vertex_neighbours(grid, ranks):
    cells = grid.lattice.nodes.astype(np.int64)
    centre = grid.space.tabulate_dof_coordinates()[cells, : grid.dim].mean(axis=1)
    ones = np.ones(len(cells))
    owner = partition.owners(grid.comm, centre, np.arange(len(cells)), ones, ranks)
    offsets, destinations = partition.destinations(grid.comm, cells, owner)
    assert np.ptp(np.bincount(owner, minlength=ranks)) <= 1
    for c, (a, b) in enumerate(pairwise(offsets)):
        touching = np.isin(cells, cells[c]).any(axis=1)
        assert destinations[a] == owner[c]
        assert sorted(destinations[a:b]) == sorted({*owner[touching]})


PROGRAM = """
from mpi4py import MPI
import numpy as np
from mpm_fenicsx import Grid
grid = Grid.rectilinear([np.array([-3, -2.2, -1.7, -0.3]), np.array([10, 10.5, 11.7, 12, 13])])
lat, comm = grid.lattice, grid.comm
owned = slice(0, grid.owned_cells)
edges = comm.allreduce(int((lat.neighbour[owned] < 0).sum()))
x = np.random.default_rng(0).uniform(lat.lower.min(0), lat.upper.max(0), (200, 2))
x = np.concatenate(comm.allgather(x))
cell = grid.find(x)
held = comm.allreduce(((cell >= 0) & (cell < grid.owned_cells)).astype(int))
assert comm.allreduce(grid.owned_cells) == 12 and grid.owned_cells == 6
assert edges == 14 and abs(comm.allreduce(lat.volume[owned].sum()) - 8.1) < 1e-12
assert (held == 1).all()
print("fine")
"""


def test_two_ranks_share_the_cells():
    assert on_ranks(2, "-c", PROGRAM).count("fine") == 2


def test_a_grid_says_how_many_cells_it_has_and_where_it_lies():
    """On every rank alike, and in what names it."""
    grid = Grid.box((0, -1), (1, 21.5), cells=(4, 88))
    assert repr(grid) == "Grid(352 cells in 2D, corners (0, -1) and (1, 21.5) m)"
    assert f"grid={grid!r}" in repr(grid.facets("left"))
    assert repr(Grid.box((0, 0, 0), (1, 1, 0.5), (2, 2, 1))).startswith("Grid(4 cells in 3D, ")
