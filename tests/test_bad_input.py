"""What a run refuses before its first step, each by the name of the parameter and its value."""

from dataclasses import replace

import dense
import numpy as np
import pytest
from dolfinx.mesh import create_unit_square

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions
from mpm_fenicsx.materials.law_checks import check_law
from mpm_fenicsx.materials.material import Law, hooke, stiffness

NAN = float("nan")
OTHER = dense.uneven(2)


@pytest.fixture(scope="module")
def grid():
    return dense.uneven(2)


@pytest.fixture
def body(grid):
    return mpm.MaterialPoints.fill(grid, dense.SOIL, 4)


def refused(message):
    return pytest.raises(ValueError, match=message)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((1e6, 0.5, 1e3), r"poisson .* got 0\.5"),
        ((1e6, -1.0, 1e3), r"poisson .* got -1"),
        ((1e6, NAN, 1e3), r"poisson .* got nan"),
        ((0.0, 0.3, 1e3), r"young .* got 0"),
        ((-2e6, 0.3, 1e3), r"young .* got -2000000"),
        ((NAN, 0.3, 1e3), r"young .* got nan"),
        ((1e6, 0.3, 0.0), r"density .* got 0"),
        (("soft", 0.3, 1e3), r"young .* got 'soft'"),
    ],
)
def test_soils(values, message):
    with refused(message):
        mpm.LinearElastic(*values)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mpm.Newmark(0.0), r"dt .* got 0"),
        (lambda: mpm.Newmark(-1e-3), r"dt .* got -0\.001"),
        (lambda: mpm.Newmark(NAN), r"dt .* got nan"),
        (lambda: mpm.Newmark("1e-3"), "^dt must be a number, got '1e-3'$"),
        (lambda: mpm.QuasiStatic("4"), "^steps must be a number, got '4'$"),
        (lambda: mpm.Newmark(1e-3, beta=0.2), r"beta=0\.2, gamma=0\.5"),
        (lambda: mpm.QuasiStatic(0), r"steps .* got 0"),
        (lambda: mpm.QuasiStatic(2.5), r"steps .* got 2\.5"),
    ],
)
def test_steppings(make, message):
    with refused(message):
        make()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: mpm.Grid.box((0, 0), (1, 0), (2, 2)),
            r"lower must lie below upper.*upper=\(1, 0\)",
        ),
        (lambda: mpm.Grid.box((0, 0), (1, NAN), (2, 2)), r"upper .* got nan"),
        (lambda: mpm.Grid.box((0, 0), (1, 1), (2, 0)), r"cells .* got 0"),
        (lambda: mpm.Grid.box((0, 0, 0), (1, 1), (2, 2)), r"got \(0, 0, 0\), \(1, 1\), \(2, 2\)"),
        (
            lambda: mpm.Grid.rectilinear([np.array([0.0, 1.0, 1.0]), np.array([0.0, 1.0])]),
            r"must increase, got \[0\. 1\. 1\.\]",
        ),
        (
            lambda: mpm.Grid.box(
                (0, 0), (1, 1), (2, 2), {"low": lambda x: x[1] < 0.1, "edge": lambda x: x[1] < 0.2}
            ),
            r"\['edge', 'low'\] overlap",
        ),
        (
            lambda: mpm.Grid.box((0, 0), (1, 1), (2, 2), {"left": lambda x: x[0] < 0.1}),
            r"'left' is taken",
        ),
        (
            lambda: mpm.Grid.box((0, 0), (1, 1), (2, 2), {"far": lambda x: x[0] > 9}),
            r"'far' is empty",
        ),
        (lambda: OTHER.facets("ceiling"), r"facets .* got 'ceiling'"),
    ],
)
def test_grids_and_facets(make, message):
    with refused(message):
        make()


def test_a_grid_that_is_not_rectilinear_where_points_are_used():
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.2, 1.0], [1.0, 1.0]])
    skew = mpm.Grid(
        dolfinx_versions.create_mesh(
            OTHER.comm, x, np.array([[0, 1, 2, 3]]), lambda ranks: (np.array([0, 1]), np.zeros(1))
        )
    )
    mpm.FiniteElements(
        skew, dense.SOIL, mpm.Newmark(1e-3), [mpm.Fixed(skew.facets("bottom"))]
    ).step()
    points = mpm.MaterialPoints(dense.SOIL, [[0.5, 0.5]], [[0.1, 0.1]], [0.04])
    with refused("mesh must be rectilinear"):
        mpm.MaterialPoints.fill(skew, dense.SOIL, 4)
    with refused("mesh must be rectilinear"):
        mpm.Simulation(skew, points, mpm.Newmark(1e-3), [])
    with refused("mesh must be rectilinear"):
        mpm.FiniteElements(
            skew,
            dense.SOIL,
            mpm.Newmark(1e-3),
            [mpm.Traction(mpm.SurfacePoints([[0.5, 0.5]], [[0.0, 1.0]], [1.0]), (0, 1))],
        )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"per_cell": 0}, r"per_cell .* got 0"),
        ({"per_cell": 3}, r"per_cell .* got 3"),
        ({"per_cell": 4, "jitter": 0.5}, r"jitter .* got 0\.5"),
        ({"per_cell": 4, "jitter": NAN}, r"jitter .* got nan"),
        (
            {"per_cell": 4, "inside": lambda x: x[0] > 9},
            "inside leaves a body without material points",
        ),
        ({"per_cell": 4, "inside": lambda x: x > 0}, r"inside must map \(dim, n\) to \(n,\)"),
        (
            {"per_cell": 4, "inside": lambda x: x[:, 1] < 1},
            r"gave \(2,\) for n=36; coordinates y are x\[1\]: x\[:, 1\] is one place$",
        ),
        (
            {"per_cell": 4, "inside": lambda x: 1.0 - x[1]},
            r"^inside must say True or False of each place, as lambda x: x\[1\] < 1 does, gave 0\.",
        ),
        ({"per_cell": 4, "inside": lambda x: x[1] / 0.0}, "^inside must say True .* gave inf$"),
        ({"per_cell": 4, "inside": lambda x: x[1].astype(str)}, "^inside must say True or False"),
        (
            {"per_cell": 4, "inside": lambda x: x[1].astype(int) + 2},
            "^inside must say True or False .* gave 2$",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_bodies(grid, arguments, message):
    with refused(message):
        mpm.MaterialPoints.fill(grid, dense.SOIL, **arguments)


def test_places_may_be_chosen_by_zeros_and_ones(grid):
    chosen = mpm.MaterialPoints.fill(grid, dense.SOIL, 4, lambda x: x[1] < 0.5)
    for kind in (int, float):
        same = mpm.MaterialPoints.fill(grid, dense.SOIL, 4, lambda x, k=kind: (x[1] < 0.5) * k(1))
        assert np.array_equal(same.x, chosen.x) and 0 < len(same) < 36


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x": [[NAN, 0.5]]}, r"x .* nan"),
        ({"x": [[9.0, 0.5]]}, r"points: 1 lie outside the grid, the first at x=\[9\.  0\.5\]"),
        ({"half": [[0.0, 0.1]]}, "half"),
        ({"volume": [-1.0]}, "volume"),
        ({"volume": [1.0, 2.0]}, "volume"),
        ({"stress": [[0.0, 0.0, NAN, 0.0]]}, r"stress"),
        ({"stress": [[0.0, 0.0, 0.0]]}, r"stress"),
        ({"velocity": [[0.0, NAN]]}, r"velocity"),
        ({"acceleration": [[0.0, 0.0, 0.0]]}, r"acceleration"),
    ],
)
def test_points(grid, changes, message):
    given = {"x": [[0.5, 0.5]], "half": [[0.1, 0.1]], "volume": [0.04], **changes}
    with refused(message):
        mpm.Simulation(grid, mpm.MaterialPoints(dense.SOIL, **given), mpm.Newmark(1e-3), [])


def test_arrays_that_were_spoilt_after_the_points_were_made(grid, body):
    for name, shape in (
        ("stress", (len(body), 4)),
        ("velocity", (len(body), 2)),
        ("acceleration", (len(body), 2)),
    ):
        kept = getattr(body, name)
        for bad in (np.full(shape, NAN), np.zeros((1, 2))):
            setattr(body, name, bad)
            with refused(f"{name} of points"):
                mpm.Simulation(grid, body, mpm.Newmark(1e-3), [])
        setattr(body, name, kept)
    body.x[3] = 99.0
    with refused("1 lie outside the grid"):
        mpm.Simulation(grid, body, mpm.Newmark(1e-3), [])


def test_scenes_without_points_or_of_another_dimension(grid, body):
    with refused("there is no body"):
        mpm.Simulation(grid, [], mpm.Newmark(1e-3), [])
    nothing = mpm.MaterialPoints(dense.SOIL, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    with refused("has no material points"):
        mpm.Simulation(grid, [body, nothing], mpm.Newmark(1e-3), [])
    solid = mpm.MaterialPoints(dense.SOIL, [[0.5] * 3], [[0.1] * 3], [0.008])
    with refused("points have 3 coordinates, the grid 2"):
        mpm.Simulation(grid, solid, mpm.Newmark(1e-3), [])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: mpm.SurfacePoints([[0.5, 0.5]], [[0.0, 2.0]], [1.0]),
            r"normal .* got one of length 2",
        ),
        (lambda: mpm.SurfacePoints([[0.5, 0.5]], [[0.0, NAN]], [1.0]), r"normal .* nan"),
        (lambda: mpm.SurfacePoints([[0.5, 0.5]], [[0.0, 1.0]], [0.0]), r"area .* got 0"),
        (lambda: mpm.SurfacePoints([[0.5, 0.5]], [[0.0, 1.0]], [NAN]), r"area .* got nan"),
        (
            lambda: mpm.SurfacePoints([[0.5, 0.5]], [[0.0, 1.0, 0.0]], [1.0]),
            r"surface points need .* got",
        ),
    ],
)
def test_surface_points(make, message):
    with refused(message):
        make()


def mark(x=0.5, dim=2):
    return mpm.SurfacePoints([[x] * dim], [[0.0] * (dim - 1) + [1.0]], [1.0])


TERMS = [
    (lambda g: mpm.ViscoelasticBoundary(g.facets("left"), dense.SOFT, -2.0), r"radius .* got -2"),
    (lambda g: mpm.ViscoelasticBoundary(g.facets("left"), dense.SOFT, NAN), r"radius .* got nan"),
    (lambda g: mpm.Fixed(mark()), r"Fixed acts on facets of the grid, got SurfacePoints"),
    (lambda g: mpm.Fixed(g.facets("left"), "z"), r"components .* got 'z'"),
    (lambda g: mpm.Fixed(g.facets("left"), "yw"), r"components .* got 'w'"),
    (
        lambda g: mpm.Fixed(g.facets("left"), "yxy"),
        "^components must name each direction once, got 'y' twice in 'yxy'$",
    ),
    (lambda g: mpm.Fixed(g.facets("left"), ["x", "x"]), r"once, got 'x' twice in \['x', 'x'\]$"),
    (lambda g: mpm.Fixed(OTHER.facets("left")), r"\('left',\) belong to another grid"),
    (lambda g: mpm.Traction(OTHER.facets("top"), (0.0, 1.0)), r"\('top',\) belong to another grid"),
    (
        lambda g: mpm.ViscousBoundary(OTHER.facets("top"), dense.SOFT),
        r"\('top',\) belong to another grid",
    ),
    (lambda g: mpm.Traction("top", (0.0, 1.0)), r"on must be .* got 'top'"),
    (
        lambda g: mpm.Traction(mark(dim=3), (0.0, 1.0)),
        r"surface points have 3 coordinates, the grid 2",
    ),
    (
        lambda g: mpm.Traction(mark(5.0), (0.0, 1.0)),
        r"surface point 0 at x=\[5\. 5\.\] lies outside the grid",
    ),
    (
        lambda g: mpm.Traction(mark(NAN), (0.0, 1.0)),
        r"surface point 0 at x=\[nan nan\] lies outside the grid",
    ),
    (
        lambda g: mpm.Traction(g.facets("top"), (0.0, 1.0, 2.0)),
        r"value of Traction .* 2 finite numbers, got array\(\[0",
    ),
    (lambda g: mpm.Traction(g.facets("top"), 5.0), r"value of Traction .* got array\(5"),
    (lambda g: mpm.Traction(g.facets("top"), "up"), r"value of Traction .* got 'up'"),
    (
        lambda g: mpm.Traction(g.facets("top"), (0.0, NAN)),
        r"value of Traction .* got array\(\[ ?0\., nan",
    ),
    (lambda g: mpm.Traction(g.facets("top"), lambda t: (0.0, NAN)), r"value of Traction .* nan"),
    (lambda g: mpm.Traction(g.facets("top"), lambda t: 1.0), r"value of Traction .* got array\(1"),
    (
        lambda g: mpm.Traction(g.facets("top"), lambda t, x: x.T),
        r"value of Traction .* 2 finite numbers",
    ),
    (lambda g: mpm.Gravity((0.0, -9.81, 0.0)), r"g of Gravity .* 2 finite numbers"),
    (lambda g: mpm.Gravity(lambda t, x: x[:, :1]), r"g of Gravity .* 2 finite numbers"),
]


@pytest.mark.parametrize(("make", "message"), TERMS, ids=range(len(TERMS)))
def test_terms(grid, body, make, message):
    with refused(message):
        mpm.Simulation(grid, body, mpm.Newmark(1e-3), [make(grid)])
    with refused(message):
        mpm.FiniteElements(grid, dense.SOIL, mpm.Newmark(1e-3), [make(grid)])


@pytest.mark.parametrize(
    "make",
    [
        lambda on: mpm.ViscousBoundary(on, dense.SOFT),
        lambda on: mpm.ViscoelasticBoundary(on, dense.SOFT, 2.0),
    ],
)
def test_dashpots_in_statics(grid, body, make):
    name = type(make(mark())).__name__
    for on in (grid.facets("left"), mark()):
        with refused(f"{name} needs velocities: step with Newmark"):
            mpm.Simulation(grid, body, mpm.QuasiStatic(2), [make(on)])
        with refused(f"{name} needs velocities: step with Newmark"):
            mpm.FiniteElements(grid, dense.SOIL, mpm.QuasiStatic(2), [make(on)])


# -- what is often given in place of something else ------------------------------------------------


def points_with(**changed):
    def make(grid, body):
        return mpm.Simulation(
            **{"grid": grid, "bodies": body, "stepping": mpm.Newmark(1e-3), "terms": [], **changed}
        )

    return make


def elements_with(**changed):
    def make(grid, body):
        return mpm.FiniteElements(
            **{
                "grid": grid,
                "material": dense.SOIL,
                "stepping": mpm.Newmark(1e-3),
                "terms": [],
                **changed,
            }
        )

    return make


BOTH = [
    ({"stepping": 1e-3}, r"^stepping must be Newmark\(dt\) or QuasiStatic\(steps\), got 0\.001$"),
    ({"stepping": mpm.Newmark}, "^stepping must be .*got the class Newmark itself$"),
    ({"terms": 3}, "^terms must be a list such as .*got 3$"),
    ({"terms": None}, "^terms must be a list such as .*got None$"),
    ({"terms": [mpm.Gravity((0, -1)), 3]}, "^terms: number 1 is no boundary or load .*got 3$"),
    ({"terms": mpm.Gravity}, "^terms: number 0 .*got the class Gravity itself$"),
    ({"solver": "cg"}, r"^solver must be a Solver, such as Solver\(petsc=.*\), got 'cg'$"),
    ({"solver": mpm.Solver}, "^solver must be a Solver, .*got the class Solver itself$"),
    (
        {"solver": mpm.Solver(petsc={"pc_type": "nonsense"})},
        "^solver: PETSc takes none .*'pc_type': 'nonsense'",
    ),
    ({"grid": 3}, r"^grid must be a Grid, such as .*got 3$"),
]
KINDS = [
    *((points_with(**changed), words) for changed, words in BOTH),
    *((elements_with(**changed), words) for changed, words in BOTH),
    (
        points_with(mapping="DM_GC"),
        "^mapping must be an object such as DM_GC, imported by its name, got 'DM_GC'$",
    ),
    (points_with(mapping=mpm.Mapping), "^mapping must be .*got the class Mapping itself$"),
    (points_with(bodies=3), "^bodies must be MaterialPoints, .*got 3$"),
    (
        points_with(bodies=mpm.MaterialPoints),
        "^bodies must be MaterialPoints, .*got the class MaterialPoints itself$",
    ),
    (
        lambda grid, body: mpm.Simulation(grid, [body, body], mpm.Newmark(1e-3), []),
        "^bodies: a body is named twice$",
    ),
    (
        lambda grid, body: mpm.Simulation(grid, body.surface("top"), mpm.Newmark(1e-3), []),
        "^bodies must be .*got SurfacePoi",
    ),
    (
        elements_with(material=mpm.LinearElastic),
        "^material must be an object, got the class LinearElastic itself",
    ),
    (
        lambda grid, body: mpm.FiniteElements(grid, body, mpm.Newmark(1e-3), [], mpm.DM_GC),
        "^finite elements take no mapping, got DM-GC: leave it out$",
    ),
    (
        elements_with(
            material=[(dense.SOIL, lambda x: x[1] - 0.5), (dense.SOFT, lambda x: x[1] > 0.5)]
        ),
        "^where must say True or False of each place, .* gave -0.",
    ),
    (lambda grid, body: points_with()(grid, body).until("1"), "^t must be a number, got '1'$"),
    (elements_with(b_bar="yes"), "^b_bar must be True or False, got 'yes'$"),
    (elements_with(start=3), "^start must be a finite element run, got 3$"),
    (
        lambda grid, body: mpm.MaterialPoints.fill(3, dense.SOIL, 4),
        "^grid must be a Grid, .*got 3$",
    ),
    (
        lambda grid, body: mpm.MaterialPoints.fill(grid, mpm.LinearElastic, 4),
        "^material must be an object, got the class",
    ),
    (
        lambda grid, body: mpm.MaterialPoints.fill(grid, 2e6, 4),
        "^material lacks density .*got 2000000.0$",
    ),
    (
        lambda grid, body: mpm.MaterialPoints.fill(grid, dense.SOIL, 4, inside=3),
        "^inside must be a function .*got 3$",
    ),
    (
        lambda grid, body: mpm.MaterialPoints.fill(grid, dense.SOIL, 4, seed="a"),
        "^seed must be a number, got 'a'$",
    ),
    (
        lambda grid, body: mpm.MaterialPoints(dense.SOIL, "here", None, None),
        "^x must be an array of numbers, got 'here'$",
    ),
    (
        lambda grid, body: mpm.MaterialPoints(dense.SOIL, [[0.5, 0.5]], None, [1.0]),
        "^half must be an array of numbers, got None$",
    ),
    (
        lambda grid, body: mpm.MaterialPoints(dense.SOIL, [[0.5, 0.5]], [[0.1, 0.1]], "a"),
        "^volume must be an array of",
    ),
    (
        lambda grid, body: mpm.SurfacePoints([[0.5, 0.5]], "up", [1.0]),
        "^normal must be an array of numbers, got 'up'$",
    ),
    (lambda grid, body: body.surface("top", where=3), "^where must be a function .*got 3$"),
    (
        lambda grid, body: body.surface("top", where=lambda x: True),
        r"^where must map \(dim, n\) to \(n,\), gave \(\)",
    ),
    (
        lambda grid, body: body.surface("top", where=lambda x: 0.5 - x[0]),
        "^where must say True or False of each place, .* gave 0.",
    ),
    (
        lambda grid, body: mpm.Contact(body, body),
        r"^bodies: contact takes .*pairs.*got \(MaterialPoints\)$",
    ),
    (
        lambda grid, body: mpm.Grid.box((0, 0), (1, 1), 10),
        r"^a box needs .*such as Grid\.box.*got \(0, 0\), \(1, 1\), 10$",
    ),
    (lambda grid, body: mpm.Grid.rectilinear(3), "^lines must be .*got 3$"),
    (lambda grid, body: mpm.Grid("mesh"), "^mesh must be a dolfinx mesh, got 'mesh'"),
    (
        lambda grid, body: mpm.Grid(create_unit_square(grid.comm, 1, 1)),
        "^mesh must be of quadrilaterals .*triangle$",
    ),
    (
        lambda grid, body: mpm.Grid.box((0, 0), (1, 1), (1, 1), {"a": 3}),
        "^facets: 'a' must be a function .*got 3$",
    ),
    (
        lambda grid, body: mpm.Grid.box((0, 0), (1, 1), (1, 1), {"a": lambda x: True}),
        r"^facets: 'a' must map .*gave \(\)",
    ),
    (
        lambda grid, body: mpm.Grid.box((0, 0), (1, 1), (2, 2), {"a": lambda x: x[1] - 1.0}),
        r"^facets: 'a' must say True or False of each place, .* gave -",
    ),
    (
        lambda grid, body: mpm.Grid.box((0, 0), (1, 1), (2, 2), {"a": lambda x: x[:, 1] > 0}),
        r"^facets: 'a' must map .*gave \(3,\) for n=.*coordinates y are x\[1\]",
    ),
    (
        lambda grid, body: mpm.Grid.box((0, 0), (1, 1), (1, 1), ["a"]),
        r"^facets must be functions .*got \['a'\]$",
    ),
    (
        lambda grid, body: mpm.Probe("stress", "here"),
        "^at must be an array of numbers, got 'here'$",
    ),
    (lambda grid, body: mpm.Checkpoint(3), "^path must be a path, got 3$"),
    (lambda grid, body: mpm.Snapshots(None), "^path must be a path, got None$"),
    (
        lambda grid, body: points_with()(grid, body).record(mpm.Energy),
        "^recorder must be an object such as",
    ),
    (
        lambda grid, body: points_with()(grid, body).until(1.0, 3),
        "^progress must be a function .*got 3$",
    ),
    (lambda grid, body: points_with()(grid, body).restart(3), "^path must be a path, got 3$"),
]


@pytest.mark.parametrize(("make", "words"), KINDS, ids=range(len(KINDS)))
def test_what_is_of_another_kind_is_refused_with_a_sentence(grid, body, make, words):
    with refused(words):
        make(grid, body)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: mpm.Mapping("M", True, "points", True),
            "^integrate must be mpm_fenicsx.AT_POINTS or mpm_fenicsx.DOUBLE_MAPPED, got 'points'$",
        ),
        (lambda: replace(mpm.DM_GC, mass="points"), "^mass must be .*got 'points'$"),
        (lambda: replace(mpm.DM_GC, sweeps="two"), "^sweeps .*got 'two'"),
        (lambda: replace(mpm.DM_GC, transfer="flip"), "^transfer must be a function .*got 'flip'$"),
        (
            lambda: replace(mpm.DM_GC, transfer=mpm.Newton),
            "^transfer must be a function .*Newton'>$",
        ),
        (
            lambda: replace(mpm.DM_GC, correction="off"),
            "^correction must be AccelerationCorrection.IMPLICIT, LUMPED or OFF, got 'off'$",
        ),
        (lambda: replace(mpm.DM_GC, b_bar="yes"), "^b_bar must be True or False, got 'yes'$"),
        (
            lambda: replace(mpm.DM_GC, hold_cut_cells=3),
            "^hold_cut_cells must be True or False, got 3$",
        ),
        (lambda: mpm.Solver(newton=1e-6), r"^newton must be Newton\(tolerance\), got 1e-06$"),
        (lambda: mpm.Solver(newton=mpm.Newton), "^newton must be .*got the class Newton itself$"),
        (lambda: mpm.Solver(petsc="cg"), "^petsc must be PETSc options by name, .*got 'cg'$"),
        (
            lambda: mpm.Solver(petsc={"-ksp_type": "cg"}),
            "^petsc: names of PETSc options are texts without a dash, got '-ksp_type'$",
        ),
        (lambda: mpm.Solver(reuse="some"), "^reuse must be a number, got 'some'$"),
        (lambda: mpm.Solver(reuse=0.2), r"^reuse must be at least 0 and at most 0\.1, got 0\.2$"),
    ],
)
def test_options_of_a_mapping_and_of_a_solver(make, words):
    with refused(words):
        make()


@pytest.mark.parametrize(
    ("term", "words"),
    [
        (
            lambda on: mpm.Fixed(on, "x", 0.01),
            r"^value of Fixed must be a function of time, such as lambda t.*got 0\.01$",
        ),
        (
            lambda on: mpm.Fixed(on, "x", lambda t: (t, t)),
            r"^value of Fixed must be .*one finite number, got array\(\[0",
        ),
        (
            lambda on: mpm.Fixed(on, "x", acceleration=lambda t: 1 + 0j),
            r"^acceleration of Fixed must be .*one finite number, got \(1\+0j\) at t = 0$",
        ),
        (lambda on: mpm.Fixed(on, "x", lambda t: "1"), "one finite number, got '1' at t = 0$"),
        (
            lambda on: mpm.Traction(on, lambda t: (np.complex128(1j), 0.0)),
            "^value of Traction must give 2 finite numbers, got .*1j",
        ),
        (lambda on: mpm.Traction(on, ("0", "1")), r"2 finite numbers, got \('0', '1'\)$"),
        (
            lambda on: mpm.Fixed(on, "x", lambda t, x: t),
            "^value of Fixed must be a function of time alone",
        ),
        (lambda on: mpm.Fixed(on, 3), "^components must be one or several of xy in a text, got 3$"),
        (
            lambda on: mpm.Fixed(on, ""),
            "^components must be one or several of xy in a text, got ''$",
        ),
        (
            lambda on: mpm.ViscousBoundary(on, mpm.LinearElastic),
            "^material of ViscousBoundary must be an object, got the class LinearElastic",
        ),
        (
            lambda on: mpm.ViscoelasticBoundary(on, 3.0, 1.0),
            "^material of ViscoelasticBoundary lacks density .*p_speed, s_speed, .*got 3.0$",
        ),
        (
            lambda on: mpm.Gravity(9.81),
            r"^g of Gravity must give 2 finite numbers, got array\(9\.81\)",
        ),
        (
            lambda on: mpm.Traction(on, None),
            "^value of Traction must give 2 finite numbers, got None$",
        ),
    ],
)
def test_what_terms_refuse(grid, body, term, words):
    for make in (points_with, elements_with):
        with refused(words):
            make(terms=[term(grid.facets("bottom"))])(grid, body)


def test_one_term_and_one_body_need_no_list(grid, body):
    gravity = mpm.Gravity((0.0, -1.0))
    assert points_with(terms=gravity)(grid, body).terms == [gravity]
    assert elements_with(terms=gravity)(grid, body).terms == [gravity]
    assert points_with(terms=(gravity,), bodies=(body,))(grid, body).bodies == [body]


# -- materials -------------------------------------------------------------------------------------


class Bare:
    """A law with a density and nothing else."""

    density = 1e3


class Capped(mpm.LinearElastic):
    """Its shear stress ends at 1 kPa, and it says that it is linear."""

    def update(self, strain, stress):
        new = super().update(strain, stress)
        new[:, 3:] = np.clip(new[:, 3:], -1e3, 1e3)
        return new


class NoTension(Capped):
    def update(self, strain, stress):
        return np.minimum(mpm.LinearElastic.update(self, strain, stress), 1.0)


class Softer(Capped):
    """Elastic, but not with its own constants."""

    def update(self, strain, stress):
        return mpm.LinearElastic.update(self, 0.999 * strain, stress)


class Remembers(Law):
    """It has no plastic work."""

    density, lame = 1e3, (1e6, 1e6)
    history = ("plastic_strain",)

    def tangent(self, strain, stress, history, given=None):
        C = stiffness(self.lame, 2 if strain.shape[1] == 4 else 3)
        return hooke(self.lame, strain, stress), history, np.tile(C, (len(strain), 1, 1))


class Askew(Remembers):
    """Its tangent is not symmetric, and it says that it is."""

    history = ("plastic_work",)

    def tangent(self, strain, stress, history, given=None):
        new, history, tangent = super().tangent(strain, stress, history)
        tangent[:, 0, 1] *= 1.5
        return new, history, tangent


class OneRow(Remembers):
    history = ("plastic_work",)

    def tangent(self, strain, stress, history, given=None):
        new, history, tangent = super().tangent(strain, stress, history)
        return new, history, tangent[:1]


class OneName(Capped):
    history = "plastic_strain"


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    ("law", "words"),
    [
        (
            Bare(),
            r"^material lacks lame \(.*\), kinematics \(.*\), linear \(.*\), symmetric \(.*\), "
            r"history \(.*\), parameters \(.*\), length \(.*\), keeps_volume \(.*\), moduli "
            r"\(.*\), respond \(.*\), energy \(.*\), which .*got <.*Bare object",
        ),
        (
            Capped(2e6, 0.3, 1e3),
            "Capped says linear = True, and is not: its stress differs .*say linear = False",
        ),
        (NoTension(2e6, 0.3, 1e3), "NoTension says linear = True, and is not"),
        (Softer(2e6, 0.3, 1e3), r"Softer says linear = True, and is not: .*by 0\.001 of itself"),
        (Remembers(), "Remembers needs a state variable plastic_work, or a function"),
        (OneName(2e6, 0.3, 1e3), "history of material must be a tuple of names"),
        (Askew(), r"Askew says symmetric = True, and its tangent is askew by 0\.\d+ of its"),
        (OneRow(), r"tangent of OneRow must be \(\d+, \d, \d\) numbers .*got shape \(1, \d, \d\)"),
        (mpm.LinearElastic, "material must be an object, got the class LinearElastic itself"),
    ],
)
def test_a_law_that_a_run_would_take_for_another_is_refused(dim, law, words):
    grid = dense.uneven(dim)
    for make in (
        lambda: mpm.MaterialPoints.fill(grid, law, 2**dim),
        lambda: mpm.FiniteElements(grid, law, mpm.QuasiStatic(1), []),
    ):
        with refused(words):
            make()


@pytest.mark.parametrize(
    "law",
    [
        dense.SOIL,
        mpm.Hencky(2e6, 0.3, 1e3),
        mpm.VonMises(dense.SOIL, 1e3, 1e3, 0.0),
        mpm.LinearElastic(1e-3, -0.9, 1.0),
        mpm.LinearElastic(1e12, 0.4999, 1.0),
    ],
)
def test_laws_that_are_what_they_say_are_taken(law):
    for dim in (2, 3):
        check_law(law, dim)
