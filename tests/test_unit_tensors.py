"""Cell tensors that are sums of those of unit fields are what DOLFINx assembles."""

import dense
import inserting
import inside
import numpy as np
import plastic
import pytest
import ufl
from dolfinx import fem
from test_ranks import on_ranks

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions
from mpm_fenicsx.grid.consistent_mass import ConsistentMass
from mpm_fenicsx.grid.kinds import kinds_of
from mpm_fenicsx.grid.unit_tensors import AT_ONCE, UnitTensors, tensors

ROUND_OFF = 1e-14
"""Of the largest entry."""


def given(grid, space, seed: int) -> fem.Function:
    f = fem.Function(dolfinx_versions.space(grid.mesh, *space))
    f.x.array[:] = np.random.default_rng(seed).uniform(0.5, 1.5, len(f.x.array))
    return f


def forms(grid) -> dict:
    """Bilinear forms that are linear in fields, and such as have a part without."""
    u, w = ufl.TrialFunction(grid.space), ufl.TestFunction(grid.space)
    ρ, λ, μ = given(grid, ("DQ", 2), 0), given(grid, ("DQ", 1), 1), given(grid, ("DQ", 1), 2)
    nodal, c = given(grid, ("Lagrange", 1, (grid.dim,)), 3), fem.Constant(grid.mesh, np.array(7.0))
    dx = {degree: ufl.dx(metadata={"quadrature_degree": degree}) for degree in (1, 3, 5)}
    strain = ufl.sym(ufl.grad(w))
    return {
        "mass": c * ρ * ufl.inner(u, w) * dx[5],
        "stiffness": λ * ufl.div(u) * ufl.div(w) * dx[3]
        + 2 * μ * ufl.inner(ufl.sym(ufl.grad(u)), strain) * dx[3],
        "one point beside others": λ * ufl.div(u) * ufl.div(w) * dx[1]
        + ρ * ufl.inner(u, w) * dx[5],
        "without fields": c * ufl.inner(ufl.grad(u), ufl.grad(w)) * dx[3],
        "affine": (1 + λ) * ufl.inner(u, w) * dx[3],
        "little beside much": (1e9 + λ) * ufl.inner(u, w) * dx[3]
        + 1e-3 * μ * ufl.div(u) * ufl.div(w) * dx[3],
        "nodal": ufl.dot(nodal, nodal.dx(0) * 0 + ufl.as_vector([1.0] * grid.dim))
        * ufl.inner(u, w)
        * dx[3],
        "askew": λ * ufl.inner(ufl.dot(ufl.grad(u), ufl.as_vector([1.0] * grid.dim)), w) * dx[3],
    }


def by_cells(unit: UnitTensors, grid) -> np.ndarray:
    """The matrix of all cells, tensor by tensor."""
    size = grid.dim * 2**grid.dim
    A = np.zeros((grid.dim * grid.nodes,) * 2)
    nodes = dolfinx_versions.cell_dofs(grid.space)
    unit.refresh()
    tables, cells, start = unit.by_kind(np.arange(grid.cells, dtype=np.int32))
    *rest, out = unit.arguments()
    for table, begin, end in zip(tables, start[:-1], start[1:], strict=True):
        for first in range(begin, end, AT_ONCE):
            some = cells[first : min(first + AT_ONCE, end)]
            tensors(table, some, *rest, out)
            for row, c in enumerate(some):
                dofs = (grid.dim * nodes[c][:, None] + np.arange(grid.dim)).ravel()
                A[np.ix_(dofs, dofs)] += out[row].reshape(size, size)
    return A


GRIDS = {
    "uneven": dense.uneven,
    "box": lambda dim: mpm.Grid.box((0,) * dim, (2.1, 1.0, 0.7)[:dim], (9, 8, 2)[:dim]),
}
"""27 or 64 kinds of cells, and one."""


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    "name",
    [
        "mass",
        "stiffness",
        "one point beside others",
        "without fields",
        "affine",
        "little beside much",
        "nodal",
        "askew",
    ],
)
def test_sums_of_unit_tensors_are_the_assembled_matrix(dim, name, grid):
    grid = GRIDS[grid](dim)
    form = forms(grid)[name]
    unit = UnitTensors.of(grid, form, np.arange((dim * 2**dim) ** 2))
    expected = dense.matrix(form)
    assert np.abs(by_cells(unit, grid) - expected).max() <= ROUND_OFF * np.abs(expected).max()
    assert unit.symmetric is (name != "askew")


def test_little_is_not_lost_beside_much():
    """A stiffness of 1 beside a mass of 1e12, as in a step that is very short: rows that sum up to
    the mass alone hide it, and what stretches shows it."""
    grid = GRIDS["box"](2)
    u, w, λ = ufl.TrialFunction(grid.space), ufl.TestFunction(grid.space), given(grid, ("DQ", 1), 1)
    parts = 1e12 * ufl.inner(u, w) * ufl.dx, λ * ufl.div(u) * ufl.div(w) * ufl.dx
    unit = UnitTensors.of(grid, parts[0] + parts[1], np.arange(64))
    unit.refresh()
    alone = UnitTensors.of(grid, parts[1], np.arange(64))
    alone.refresh()
    size = np.abs(alone.tables).max()
    assert np.abs(unit.tables[0, :4] - alone.tables[0, :4]).max() <= ROUND_OFF * size


def test_constants_that_change_are_followed():
    grid = GRIDS["box"](2)
    u, w = ufl.TrialFunction(grid.space), ufl.TestFunction(grid.space)
    c, ρ = fem.Constant(grid.mesh, np.array(1.0)), given(grid, ("DQ", 1), 0)
    form = c * ρ * ufl.inner(u, w) * ufl.dx
    unit = UnitTensors.of(grid, form, np.arange(64))
    one = by_cells(unit, grid)
    c.value = np.array(3.0)
    np.testing.assert_allclose(by_cells(unit, grid), 3.0 * one, rtol=1e-15)


def test_what_is_not_linear_in_fields_goes_the_general_way():
    grid = GRIDS["box"](2)
    u, w = ufl.TrialFunction(grid.space), ufl.TestFunction(grid.space)
    ρ, λ = given(grid, ("DQ", 1), 0), given(grid, ("DQ", 1), 1)
    for factor in (ρ * λ, ρ**2, 1 / ρ, ufl.sqrt(λ)):
        assert UnitTensors.of(grid, factor * ufl.inner(u, w) * ufl.dx, np.arange(64)) is None
    assert UnitTensors.of(grid, ufl.inner(u, w) * ufl.ds, np.arange(64)) is None
    f, g = (fem.Function(grid.space) for _ in range(2))
    nothing = ufl.derivative(ρ * ufl.inner(f, w) * ufl.dx, g, u)  # zero, which UFL sees late
    assert UnitTensors.of(grid, nothing, np.arange(64)) is None


def test_cells_are_of_one_kind_where_they_differ_by_round_off_only():
    lines = np.linspace(0.0, 7.0, 31)
    x, y = (a.ravel() for a in np.meshgrid(lines, lines, indexing="ij"))
    n = np.arange(31 * 31).reshape(31, 31)
    cells = np.stack([n[:-1, :-1], n[1:, :-1], n[:-1, 1:], n[1:, 1:]], axis=-1).reshape(-1, 4)
    corners = np.stack((x, y), axis=1)[cells]
    assert len(kinds_of(corners).corners) == 1
    turned = corners.copy()
    turned[5] = turned[5, [1, 3, 0, 2]]  # a cell that the mesh numbers otherwise
    found = kinds_of(turned)
    assert len(found.corners) == 2 and np.count_nonzero(found.of == found.of[5]) == 1
    askew = corners.copy()
    askew[7, 3] += 1e-9
    assert kinds_of(askew) is None


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("dim", [2, 3])
def test_mass_times_values_is_that_of_the_form(dim, grid):
    grid = GRIDS[grid](dim)
    for space in (("DQ", 1), ("DQ", 2)):
        ρ, dx = given(grid, space, 0), ufl.dx(metadata={"quadrature_degree": 5})
        values = np.random.default_rng(1).normal(size=(grid.nodes, 3))
        found = np.zeros_like(values)
        ConsistentMass(grid, ρ, dx).add_times(values, np.arange(grid.cells), found)
        V = dolfinx_versions.space(grid.mesh, "Lagrange", 1, (3,))
        f, expected = fem.Function(V), fem.Function(V)
        f.x.array[:] = values.ravel()
        form = dolfinx_versions.compile_form(ρ * ufl.inner(f, ufl.TestFunction(V)) * dx)
        dolfinx_versions.assemble_vector(expected, form)
        expected = expected.x.array.reshape(found.shape)
        assert np.abs(found - expected).max() <= ROUND_OFF * np.abs(expected).max()


HENCKY = mpm.Hencky(young=2e7, poisson=0.3, density=1500.0)
LAWS = {"plastic": plastic.LAW, "finite strain": HENCKY, "elements of finite strain": HENCKY}
MAPPINGS = ("MPM", "GIMP", "CMPM", "DM", "DM_G", "DM_C", "DM_GC", "DM_GCL")


@pytest.mark.parametrize("rows", [False, True])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", [*MAPPINGS, "elements", *LAWS])
def test_a_run_inserts_what_dolfinx_assembles(name, dim, rows):
    """Each mapping, elements, yielding soil and finite strain, in matrices of blocks and of rows,
    on cells that are partly full, with nodes held."""
    # cells of two sizes along each direction; of 27 kinds, tensors of many fields are too many
    grid = mpm.Grid.rectilinear([np.array([0.0, 0.2, 0.4, 1.0])] * dim)
    if dim == 3 and name in LAWS:
        grid = GRIDS["box"](dim)
    soil = LAWS.get(name, dense.SOIL)
    terms = [mpm.Fixed(grid.facets("bottom"), "y"), mpm.Fixed(grid.facets("left"), "x")]
    solver = mpm.Solver(petsc={"pc_type": "lu", "ksp_type": "preonly"} if rows else None)
    if name.startswith("elements"):
        run = mpm.FiniteElements(grid, soil, mpm.Newmark(1e-3), terms, solver=solver)
    else:
        rng = np.random.default_rng(0)
        body = dense.random_body(grid, rng, lambda x: x[1] < 0.68, material=soil)
        mapping = getattr(mpm, name if name in MAPPINGS else "DM_GC")
        run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), terms, mapping, solver)
    run.step()
    inserted, assembled_anew = inside.inserted_matrix(run)
    assert inserted.shape == assembled_anew.shape
    difference = np.abs(inserted - assembled_anew).max()
    assert difference <= ROUND_OFF * np.abs(assembled_anew).max()


@pytest.mark.ranks
@pytest.mark.parametrize("count", [2, 3, 4])
def test_ranks_insert_what_dolfinx_assembles(count):
    """Blocks and rows, with nodes held, on ranks that have many cells, one or none."""
    found = dict(line.rsplit(": ", 1) for line in on_ranks(count, inserting.__file__).splitlines())
    assert list(found) == list(inserting.SCENES)
    assert all(float(difference) <= ROUND_OFF for difference in found.values()), found


def springs(factor):
    """A term of one's own: springs in all of the body, of a stiffness (Pa/m²) that ``factor`` makes
    of the grid and the scene."""

    class Springs:
        def bind(self, scene):
            u, w = scene.motion.u, scene.motion.w
            return mpm.Contribution(work=1e7 * factor(scene) * ufl.inner(u, w) * scene.dx)

    return Springs()


def uneven_field(scene):
    """Values of both signs."""
    f = fem.Function(dolfinx_versions.space(scene.grid.mesh, "DQ", 1))
    f.x.array[:] = np.random.default_rng(0).uniform(-1.0, 1.0, len(f.x.array))
    return f


def late(scene):
    """A constant that a condition is on, beside what is by chance."""
    t = fem.Constant(scene.grid.mesh, np.array(1e-3))
    return ufl.conditional(ufl.lt(t, 4e-3), 1.0, 0.0)


OWN = {
    "of place": lambda scene: ufl.SpatialCoordinate(scene.grid.mesh)[1],
    "largest": lambda scene: ufl.max_value(uneven_field(scene), 0.0),
    "least": lambda scene: ufl.min_value(uneven_field(scene), 0.3),
    "absolute": lambda scene: abs(uneven_field(scene)),
    "if": lambda scene: ufl.conditional(ufl.gt(uneven_field(scene), 0.1), 1.0, 20.0),
    "from a time on": late,
    "product of fields": lambda scene: uneven_field(scene) ** 2,
    "density": lambda scene: ufl.min_value(scene.density, 1000.0) / 1000.0,
}


@pytest.mark.parametrize("kind", ["points", "elements"])
@pytest.mark.parametrize("name", OWN)
def test_terms_of_ones_own_are_in_the_matrix_whatever_they_are(name, kind):
    """The rest of the matrix is ours, and these are DOLFINx's."""
    grid = mpm.Grid.box((0, 0), (2, 1), (5, 4))
    terms = [mpm.Fixed(grid.facets("bottom")), springs(OWN[name])]
    if kind == "elements":
        run = mpm.FiniteElements(grid, dense.SOIL, mpm.Newmark(1e-3), terms)
    else:
        body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
        run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), terms)
    run.step()
    inserted, assembled_anew = inside.inserted_matrix(run)
    difference = np.abs(inserted - assembled_anew).max()
    assert difference <= ROUND_OFF * np.abs(assembled_anew).max()


def test_vectors_along_edges_go_the_general_way_on_cells_that_are_turned():
    """Their values are turned with the cell, which kernels leave to DOLFINx."""
    grid = mpm.Grid.box((0, 0), (2, 1), (4, 3))
    space = ("RTCE", 1)

    class Along:
        def bind(self, scene):
            f = fem.Function(dolfinx_versions.space(scene.grid.mesh, *space))
            f.x.array[:] = 1.0
            u, w = scene.motion.u, scene.motion.w
            return mpm.Contribution(work=1e7 * f[0] * ufl.inner(u, w) * scene.dx)

    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
    terms = [mpm.Fixed(grid.facets("bottom")), Along()]
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), terms)
    run.step()
    assert space[0] not in str([f.function_space for f in inside.inserted_fields(run)])
