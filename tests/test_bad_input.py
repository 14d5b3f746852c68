"""What a run refuses before its first step, each by the name of the parameter and its value."""

import dense
import numpy as np
import pytest

from mpm_fenicsx import (
    FiniteElements,
    Fixed,
    Gravity,
    Grid,
    LinearElastic,
    MaterialPoints,
    Newmark,
    QuasiStatic,
    Simulation,
    SurfacePoints,
    Traction,
    Viscoelastic,
    Viscous,
    fenicsx,
)

NAN = float("nan")
OTHER = dense.uneven(2)


@pytest.fixture(scope="module")
def grid():
    return dense.uneven(2)


@pytest.fixture
def body(grid):
    return MaterialPoints.fill(grid, dense.SOIL, 4)


def refused(message):
    return pytest.raises(ValueError, match=message)


@pytest.mark.parametrize(("values", "message"), [
    ((1e6, 0.5, 1e3), r"poisson .* got 0\.5"),
    ((1e6, -1.0, 1e3), r"poisson .* got -1"),
    ((1e6, NAN, 1e3), r"poisson .* got nan"),
    ((0.0, 0.3, 1e3), r"young .* got 0"),
    ((-2e6, 0.3, 1e3), r"young .* got -2000000"),
    ((NAN, 0.3, 1e3), r"young .* got nan"),
    ((1e6, 0.3, 0.0), r"density .* got 0"),
    (("soft", 0.3, 1e3), r"young .* got 'soft'"),
])
def test_soils(values, message):
    with refused(message):
        LinearElastic(*values)


@pytest.mark.parametrize(("make", "message"), [
    (lambda: Newmark(0.0), r"dt .* got 0"),
    (lambda: Newmark(-1e-3), r"dt .* got -0\.001"),
    (lambda: Newmark(NAN), r"dt .* got nan"),
    (lambda: Newmark(1e-3, beta=0.2), r"beta=0\.2, gamma=0\.5"),
    (lambda: QuasiStatic(0), r"steps .* got 0"),
    (lambda: QuasiStatic(2.5), r"steps .* got 2\.5"),
])
def test_steppings(make, message):
    with refused(message):
        make()


@pytest.mark.parametrize(("make", "message"), [
    (lambda: Grid.box((0, 0), (1, 0), (2, 2)), r"lower must lie below upper.*upper=\(1, 0\)"),
    (lambda: Grid.box((0, 0), (1, NAN), (2, 2)), r"upper .* got nan"),
    (lambda: Grid.box((0, 0), (1, 1), (2, 0)), r"cells .* got 0"),
    (lambda: Grid.box((0, 0, 0), (1, 1), (2, 2)), r"got \(0, 0, 0\), \(1, 1\), \(2, 2\)"),
    (lambda: Grid.rectilinear([np.array([0.0, 1.0, 1.0]), np.array([0.0, 1.0])]),
     r"must increase, got \[0\. 1\. 1\.\]"),
    (lambda: Grid.box((0, 0), (1, 1), (2, 2), {"low": lambda x: x[1] < 0.1, "edge": lambda x: x[1] < 0.2}),
     r"\['edge', 'low'\] overlap"),
    (lambda: Grid.box((0, 0), (1, 1), (2, 2), {"left": lambda x: x[0] < 0.1}), r"'left' is taken"),
    (lambda: Grid.box((0, 0), (1, 1), (2, 2), {"far": lambda x: x[0] > 9}), r"'far' is empty"),
    (lambda: OTHER.facets("ceiling"), r"facets .* got 'ceiling'"),
])
def test_grids_and_facets(make, message):
    with refused(message):
        make()


def test_a_grid_that_is_not_rectilinear_where_points_are_used():
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.2, 1.0], [1.0, 1.0]])
    skew = Grid(fenicsx.create_mesh(OTHER.comm, x, np.array([[0, 1, 2, 3]]),
                                    lambda ranks: (np.array([0, 1]), np.zeros(1))))
    FiniteElements(skew, dense.SOIL, Newmark(1e-3), [Fixed(skew.facets("bottom"))]).step()
    points = MaterialPoints(dense.SOIL, [[0.5, 0.5]], [[0.1, 0.1]], [0.04])
    with refused("mesh must be rectilinear"):
        MaterialPoints.fill(skew, dense.SOIL, 4)
    with refused("mesh must be rectilinear"):
        Simulation(skew, points, Newmark(1e-3), [])
    with refused("mesh must be rectilinear"):
        FiniteElements(skew, dense.SOIL, Newmark(1e-3),
                       [Traction(SurfacePoints([[0.5, 0.5]], [[0.0, 1.0]], [1.0]), (0, 1))])


@pytest.mark.parametrize(("arguments", "message"), [
    ({"per_cell": 0}, r"per_cell .* got 0"),
    ({"per_cell": 3}, r"per_cell .* got 3"),
    ({"per_cell": 4, "jitter": 0.5}, r"jitter .* got 0\.5"),
    ({"per_cell": 4, "jitter": NAN}, r"jitter .* got nan"),
    ({"per_cell": 4, "inside": lambda x: x[0] > 9}, "inside leaves a body without material points"),
    ({"per_cell": 4, "inside": lambda x: x > 0}, r"inside must map \(dim, n\) to \(n,\)"),
])
def test_bodies(grid, arguments, message):
    with refused(message):
        MaterialPoints.fill(grid, dense.SOIL, **arguments)


@pytest.mark.parametrize(("changes", "message"), [
    ({"x": [[NAN, 0.5]]}, r"x .* nan"),
    ({"x": [[9.0, 0.5]]}, r"points: 1 lie outside the grid, the first at x=\[9\.  0\.5\]"),
    ({"half": [[0.0, 0.1]]}, "half"),
    ({"volume": [-1.0]}, "volume"),
    ({"volume": [1.0, 2.0]}, "volume"),
    ({"stress": [[0.0, 0.0, NAN, 0.0]]}, r"stress"),
    ({"stress": [[0.0, 0.0, 0.0]]}, r"stress"),
    ({"velocity": [[0.0, NAN]]}, r"velocity"),
    ({"acceleration": [[0.0, 0.0, 0.0]]}, r"acceleration"),
])
def test_points(grid, changes, message):
    given = {"x": [[0.5, 0.5]], "half": [[0.1, 0.1]], "volume": [0.04], **changes}
    with refused(message):
        Simulation(grid, MaterialPoints(dense.SOIL, **given), Newmark(1e-3), [])


def test_arrays_that_were_spoilt_after_the_points_were_made(grid, body):
    for name, shape in (("stress", (len(body), 4)), ("velocity", (len(body), 2)), ("acceleration", (len(body), 2))):
        kept = getattr(body, name)
        for bad in (np.full(shape, NAN), np.zeros((1, 2))):
            setattr(body, name, bad)
            with refused(f"{name} of points"):
                Simulation(grid, body, Newmark(1e-3), [])
        setattr(body, name, kept)
    body.x[3] = 99.0
    with refused("1 lie outside the grid"):
        Simulation(grid, body, Newmark(1e-3), [])


def test_scenes_without_points_or_of_another_dimension(grid, body):
    with refused("there is no body"):
        Simulation(grid, [], Newmark(1e-3), [])
    nothing = MaterialPoints(dense.SOIL, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    with refused("has no material points"):
        Simulation(grid, [body, nothing], Newmark(1e-3), [])
    solid = MaterialPoints(dense.SOIL, [[0.5] * 3], [[0.1] * 3], [0.008])
    with refused("points have 3 coordinates, the grid 2"):
        Simulation(grid, solid, Newmark(1e-3), [])


@pytest.mark.parametrize(("make", "message"), [
    (lambda: SurfacePoints([[0.5, 0.5]], [[0.0, 2.0]], [1.0]), r"normal .* got one of length 2"),
    (lambda: SurfacePoints([[0.5, 0.5]], [[0.0, NAN]], [1.0]), r"normal .* nan"),
    (lambda: SurfacePoints([[0.5, 0.5]], [[0.0, 1.0]], [0.0]), r"area .* got 0"),
    (lambda: SurfacePoints([[0.5, 0.5]], [[0.0, 1.0]], [NAN]), r"area .* got nan"),
    (lambda: SurfacePoints([[0.5, 0.5]], [[0.0, 1.0, 0.0]], [1.0]), r"surface points need .* got"),
])
def test_surface_points(make, message):
    with refused(message):
        make()


def mark(x=0.5, dim=2):
    return SurfacePoints([[x] * dim], [[0.0] * (dim - 1) + [1.0]], [1.0])


TERMS = [
    (lambda g: Viscoelastic(g.facets("left"), dense.SOFT, -2.0), r"radius .* got -2"),
    (lambda g: Viscoelastic(g.facets("left"), dense.SOFT, NAN), r"radius .* got nan"),
    (lambda g: Fixed(mark()), r"Fixed acts on facets of the grid, got SurfacePoints"),
    (lambda g: Fixed(g.facets("left"), "z"), r"components .* got 'z'"),
    (lambda g: Fixed(g.facets("left"), "yw"), r"components .* got 'w'"),
    (lambda g: Fixed(OTHER.facets("left")), r"\('left',\) belong to another grid"),
    (lambda g: Traction(OTHER.facets("top"), (0.0, 1.0)), r"\('top',\) belong to another grid"),
    (lambda g: Viscous(OTHER.facets("top"), dense.SOFT), r"\('top',\) belong to another grid"),
    (lambda g: Traction("top", (0.0, 1.0)), r"on must be .* got 'top'"),
    (lambda g: Traction(mark(dim=3), (0.0, 1.0)), r"surface points have 3 coordinates, the grid 2"),
    (lambda g: Traction(mark(5.0), (0.0, 1.0)), r"surface point 0 at x=\[5\. 5\.\] lies outside the grid"),
    (lambda g: Traction(mark(NAN), (0.0, 1.0)), r"surface point 0 at x=\[nan nan\] lies outside the grid"),
    (lambda g: Traction(g.facets("top"), (0.0, 1.0, 2.0)), r"value of Traction .* 2 finite numbers, got array\(\[0"),
    (lambda g: Traction(g.facets("top"), 5.0), r"value of Traction .* got array\(5"),
    (lambda g: Traction(g.facets("top"), "up"), r"value of Traction .* got 'up'"),
    (lambda g: Traction(g.facets("top"), (0.0, NAN)), r"value of Traction .* got array\(\[ ?0\., nan"),
    (lambda g: Traction(g.facets("top"), lambda t: (0.0, NAN)), r"value of Traction .* nan"),
    (lambda g: Traction(g.facets("top"), lambda t: 1.0), r"value of Traction .* got array\(1"),
    (lambda g: Traction(g.facets("top"), lambda t, x: x.T), r"value of Traction .* 2 finite numbers"),
    (lambda g: Gravity((0.0, -9.81, 0.0)), r"g of Gravity .* 2 finite numbers"),
    (lambda g: Gravity(lambda t, x: x[:, :1]), r"g of Gravity .* 2 finite numbers"),
]


@pytest.mark.parametrize(("make", "message"), TERMS, ids=range(len(TERMS)))
def test_terms(grid, body, make, message):
    with refused(message):
        Simulation(grid, body, Newmark(1e-3), [make(grid)])
    with refused(message):
        FiniteElements(grid, dense.SOIL, Newmark(1e-3), [make(grid)])


@pytest.mark.parametrize("make", [lambda on: Viscous(on, dense.SOFT), lambda on: Viscoelastic(on, dense.SOFT, 2.0)])
def test_dashpots_in_statics(grid, body, make):
    name = type(make(mark())).__name__
    for on in (grid.facets("left"), mark()):
        with refused(f"{name} needs velocities: step with Newmark"):
            Simulation(grid, body, QuasiStatic(2), [make(on)])
        with refused(f"{name} needs velocities: step with Newmark"):
            FiniteElements(grid, dense.SOIL, QuasiStatic(2), [make(on)])
