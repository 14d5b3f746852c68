"""Boundaries and loads against hand sums; facets and surface points say the same."""

import dense
import inside
import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions

DT = 0.01
STEPPING = mpm.Newmark(DT)
DIRECT = mpm.Solver(petsc={"ksp_type": "preonly", "pc_type": "lu"})


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def system(grid, term, rng=None, start=0.3):
    """Residual and matrix of one term, for a random motion if ``rng`` is given, and its scene."""
    scene = dense.bare_scene(grid, STEPPING)
    work = scene.bind([term])[-1].work
    scene.prepare(start, start + DT)
    R, derivative = inside.term_system(scene, work, rng)
    K = None if isinstance(term, mpm.Traction) else dense.matrix(derivative)
    return R, K, scene


def same(a, b, tolerance=1e-12):
    assert np.abs(b).max() > 0.0
    assert np.abs(a - b).max() < tolerance * np.abs(b).max()


def markers(grid, rng, n=9):
    x = grid.lower_corner + rng.uniform(0.01, 0.99, (n, grid.dim)) * (
        grid.upper_corner - grid.lower_corner
    )
    normal = rng.normal(size=x.shape)
    return mpm.SurfacePoints(
        x, normal / np.linalg.norm(normal, axis=1)[:, None], rng.uniform(0.1, 0.5, n)
    )


# -- facets against surface points -----------------------------------------------------------------

TERMS = {
    "viscous": lambda on: mpm.ViscousBoundary(on, dense.SOFT),
    "viscoelastic": lambda on: mpm.ViscoelasticBoundary(on, dense.SOFT, 3.0),
    "constant traction": lambda on: mpm.Traction(on, tuple(np.arange(on_dim(on)) + 1.5)),
    "traction of time": lambda on: mpm.Traction(
        on, lambda t: np.sin(t) * (np.arange(on_dim(on)) + 1.5)
    ),
    "traction of place": lambda on: mpm.Traction(
        on, lambda t, x: t * (x @ LINEAR[: on_dim(on), : on_dim(on)] + 0.3)
    ),
}
LINEAR = np.array([[1.0, -2.0, 0.5], [0.3, 1.7, 2.0], [-1.0, 0.2, 0.9]])


def on_dim(on):
    return on.x.shape[1] if isinstance(on, mpm.SurfacePoints) else on.grid.dim


@pytest.mark.parametrize("side", ["bottom", "right"])
@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("dim", [2, 3])
def test_facets_and_surface_points_agree(dim, name, side):
    grid = dense.uneven(dim)
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 2**dim)
    found = [
        system(grid, TERMS[name](on), np.random.default_rng(2))
        for on in (grid.facets(side), body.surface(side))
    ]
    same(found[1][0], found[0][0])
    if found[0][1] is not None:
        same(found[1][1], found[0][1])


@pytest.mark.parametrize("dim", [2, 3])
def test_springs_of_facets_and_surface_points_remember_alike(dim, rng):
    grid = dense.uneven(dim)
    surfaces = (
        grid.facets("bottom"),
        mpm.MaterialPoints.fill(grid, dense.SOIL, 2**dim).surface("bottom"),
    )
    increments = 1e-12 * rng.normal(
        size=(3, grid.nodes * dim)
    )  # the surface points stay on the facets
    found = []
    for on in surfaces:
        scene = dense.bare_scene(grid, STEPPING)
        work = scene.bind([mpm.ViscoelasticBoundary(on, dense.SOFT, 3.0)])[-1].work
        for u in increments:
            scene.prepare(0.0, DT)
            inside.displaced(scene, u)
            scene.carry()
        scene.prepare(0.0, DT)
        inside.displaced(scene)
        found.append(dense.vector(grid.space, work))
    same(found[1], found[0], 1e-10)


# -- by hand ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_dashpots_on_turned_surface_points_are_the_sum_by_hand(dim, rng):
    grid = dense.uneven(dim)
    on = markers(grid, rng)
    _, K, _ = system(grid, mpm.ViscousBoundary(on, dense.SOFT))
    N = dense.hats(grid, on.x)
    Zp, Zs = (dense.SOFT.density * c for c in (dense.SOFT.p_speed, dense.SOFT.s_speed))
    nn = on.normal[:, :, None] * on.normal[:, None, :]
    Z = Zp * nn + Zs * (np.eye(dim) - nn)
    by_hand = np.einsum("p,pi,pj,pab->iajb", on.area, N, N, Z).reshape(K.shape)
    same(K, 2 / DT * by_hand)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_uniform_velocity_meets_the_impedances(dim, rng):
    grid = dense.uneven(dim)
    for _ in range(4):
        on = markers(grid, rng, 1)
        n = on.normal[0]
        across = rng.normal(size=dim)
        across -= across @ n * n
        scene = dense.bare_scene(grid, STEPPING)
        work = scene.bind([mpm.ViscousBoundary(on, dense.SOFT)])[-1].work
        scene.prepare(0.0, DT)
        for v, speed in ((n, dense.SOFT.p_speed), (across, dense.SOFT.s_speed)):
            # from rest, so that v is the velocity at the end
            inside.displaced(scene)[:] = v * DT / 2
            traction = -dense.vector(grid.space, work).reshape(-1, dim).sum(axis=0) / on.area[0]
            np.testing.assert_allclose(
                traction, -dense.SOFT.density * speed * v, rtol=1e-11, atol=1e-9
            )


@pytest.mark.parametrize(
    "make",
    [
        lambda on: mpm.ViscousBoundary(on, dense.SOFT),
        lambda on: mpm.ViscoelasticBoundary(on, dense.SOFT, 2.0),
    ],
)
def test_turning_the_normal_turns_the_force(make, rng):
    grid = dense.uneven(3)
    on, Q = markers(grid, rng), dense.rotation(rng, 3)
    turned = mpm.SurfacePoints(on.x, on.normal @ Q.T, on.area)
    K, KQ = (system(grid, make(s))[1].reshape(grid.nodes, 3, grid.nodes, 3) for s in (on, turned))
    same(KQ, np.einsum("ab,ibjc,dc->iajd", Q, K, Q))


@pytest.mark.parametrize("dim", [2, 3])
def test_springs_add_their_stiffness(dim, rng):
    grid = dense.uneven(dim)
    on, r = markers(grid, rng), 1.7
    K = (
        system(grid, mpm.ViscoelasticBoundary(on, dense.SOFT, r))[1]
        - system(grid, mpm.ViscousBoundary(on, dense.SOFT))[1]
    )
    G = dense.SOFT.young / (2 * (1 + dense.SOFT.poisson))
    nn = on.normal[:, :, None] * on.normal[:, None, :]
    k = 2 * G / r * nn + G / (2 * r) * (np.eye(dim) - nn)
    N = dense.hats(grid, on.x)
    same(
        K, np.einsum("p,pi,pj,pab->iajb", on.area, N, N, k).reshape(K.shape), 1e-9
    )  # a small part of the sum


@pytest.mark.parametrize("where", ["facets", "surface points"])
@pytest.mark.parametrize("direction", [0, 1])
def test_a_stiff_block_on_springs_and_dashpots_is_an_oscillator(where, direction):
    """m a + c v + k U = m g over 40 steps, U the displacement since the start."""
    grid = mpm.Grid.rectilinear([np.array([0, 0.4, 1.0]), np.array([-1.0, -0.4, 0.0, 0.3, 1.0])])
    stiff = mpm.LinearElastic(young=1e12, poisson=0.0, density=2000.0)
    rock, r, dt = mpm.LinearElastic(young=2e6, poisson=0.2, density=20.0), 2.0, 2e-3
    if where == "facets":
        body = mpm.MaterialPoints.fill(grid, stiff, 4)
        on, height = grid.facets("bottom"), 2.0
    else:
        body = mpm.MaterialPoints.fill(grid, stiff, 4, inside=lambda x: x[1] > -0.7)
        on, height = body.surface("bottom"), 1.7

    def push(t):
        return 1e-3 * np.sin(60 * t) * np.eye(2)[direction]

    keep = (
        mpm.Fixed(grid.facets("left", "right"), "x")
        if direction
        else mpm.Fixed(grid.facets("top"), "y")
    )
    run = mpm.Simulation(
        grid,
        body,
        mpm.Newmark(dt),
        [keep, mpm.Gravity(push), mpm.ViscoelasticBoundary(on, rock, r)],
        solver=DIRECT,
    )
    start = body.x.copy()
    G = rock.lame[1]
    m = 2000.0 * height
    c = rock.density * (rock.s_speed, rock.p_speed)[direction]
    k = (G / 2 / r, 2 * G / r)[direction]
    U = v = a = 0.0
    history = []
    for step in range(1, 41):
        f = m * push(step * dt)[direction]
        u = (f - k * U + c * v + m * (4 * v / dt + a)) / (4 * m / dt**2 + 2 * c / dt + k)
        U, v, a = U + u, 2 * u / dt - v, 4 * u / dt**2 - 4 * v / dt - a
        run.step()
        history.append((U, (body.x - start)[:, direction].mean()))
    exact, found = np.array(history).T
    assert np.abs(exact).max() > 1e-8
    assert np.abs(found - exact).max() < 1e-4 * np.abs(exact).max()


# -- loads and supports ----------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_a_traction_sums_to_its_resultant(dim, rng):
    grid = dense.uneven(dim)
    on = markers(grid, rng)
    R, _, _ = system(grid, mpm.Traction(on, lambda t, x: t * x), start=0.3)
    np.testing.assert_allclose(-R.reshape(-1, dim).sum(axis=0), 0.31 * on.area @ on.x, rtol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_dead_load_keeps_its_force_where_the_surface_stretches(dim, rng):
    """A traction grows with the area."""
    grid = dense.uneven(dim)
    on, value = markers(grid, rng), np.arange(dim) + 1.0
    force = {mpm.DeadLoad: on.area.sum() * value, mpm.Traction: 4.0 * on.area.sum() * value}
    scene = dense.bare_scene(grid, STEPPING)
    terms = [
        mpm.DeadLoad(on, lambda t, x: np.tile(value, (len(x), 1))),
        mpm.DeadLoad(on, tuple(value)),
        mpm.Traction(on, tuple(value)),
    ]
    work = [scene.bind([term])[-1].work for term in terms]
    on.area *= 4.0
    scene.prepare(0.0, 1.0)
    for term, form in zip(terms, work, strict=True):
        found = -dense.vector(grid.space, form).reshape(-1, dim).sum(axis=0)
        np.testing.assert_allclose(found, force[type(term)], rtol=1e-12)


def test_a_dead_load_keeps_its_force_in_the_next_run(rng):
    """The area at the start is that of the first run, be the second one built on a surface that has
    stretched."""
    grid = dense.uneven(2)
    on = markers(grid, rng)
    force = on.area.sum() * np.array([1.0, 2.0])
    system(grid, mpm.DeadLoad(on, (1.0, 2.0)))
    on.area *= 4.0
    R, _, scene = system(grid, mpm.DeadLoad(on, (1.0, 2.0)))
    np.testing.assert_allclose(-R.reshape(-1, 2).sum(axis=0), force, rtol=1e-12)
    kept = scene.patch(on).state()["rest_area"]
    assert kept is on.rest_area  # it goes into checkpoints
    assert "rest_area" not in dense.bare_scene(grid, STEPPING).patch(markers(grid, rng)).state()


def test_a_dead_load_refuses_what_is_no_load(rng):
    with pytest.raises(
        ValueError, match="value of DeadLoad must give 2 finite numbers, got 'heavy'"
    ):
        system(dense.uneven(2), mpm.DeadLoad(markers(dense.uneven(2), rng), "heavy"))


def test_a_dead_load_on_facets_is_a_traction(rng):
    grid = dense.uneven(2)
    both = [
        system(grid, kind(grid.facets("top"), lambda t, x: t * x))[0]
        for kind in (mpm.DeadLoad, mpm.Traction)
    ]
    same(*both)


@pytest.mark.parametrize("dim", [2, 3])
def test_gravity_is_the_weight(dim):
    grid = dense.uneven(dim)
    scene = dense.bare_scene(grid, STEPPING)
    scene.density = 1500.0
    g = np.arange(1.0, dim + 1)
    work = scene.bind([mpm.Gravity(lambda t: g * t)])[-1].work
    scene.prepare(1.0, 2.0)
    force = -dense.vector(grid.space, work).reshape(-1, dim).sum(axis=0)
    np.testing.assert_allclose(
        force, 3000.0 * g * (grid.upper_corner - grid.lower_corner).prod(), rtol=1e-12
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_a_body_force_of_place_is_the_sum_over_the_points(dim, rng):
    """A force linear in x, which the nodes hold exactly: its virtual work, and the work that it
    does."""
    grid = dense.uneven(dim)
    body = dense.random_body(grid, rng)

    def force(t, x):
        return t * (x @ LINEAR[:dim, :dim] + 0.3)

    run = mpm.Simulation(grid, body, STEPPING, [mpm.Gravity(force)], mpm.MPM)
    done = run.term_energies()["work"]
    inside.prepared(run, 0.3, 0.3 + DT)
    u, N = run.nodal("increment"), dense.hats(grid, body.x)
    u[:] = rng.normal(size=u.shape)
    R = inside.force_of(run, -1)
    same(-R, np.einsum("p,pi,pd->id", body.mass, N, force(0.3 + DT, body.x)))
    work = dolfinx_versions.assemble_scalar(dolfinx_versions.compile_form(done))
    mean = 0.5 * (force(0.3, body.x) + force(0.3 + DT, body.x))
    assert work == pytest.approx(np.einsum("p,pd,pd->", body.mass, mean, N @ u), rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_fixed_holds_its_components_and_no_others(dim, rng):
    grid = dense.uneven(dim)
    body = dense.random_body(grid, rng)
    run = mpm.Simulation(
        grid,
        body,
        mpm.Newmark(1e-3),
        [mpm.Fixed(grid.facets("left"), "y"), mpm.Fixed(grid.facets("bottom"))],
    )
    run.step()
    u, x = run.nodal("increment"), grid.space.tabulate_dof_coordinates()
    left, bottom = (np.abs(x[:, d] - grid.lower_corner[d]) < 1e-12 for d in (0, 1))
    assert (u[bottom] == 0.0).all()
    assert (u[left, 1] == 0.0).all()
    assert (u[left & ~bottom, 0] != 0.0).all()
    assert (u[~left & ~bottom] != 0.0).all()


@pytest.mark.parametrize(
    "stepping", [mpm.Newmark(1e-3), mpm.QuasiStatic(2)], ids=["dynamic", "static"]
)
def test_loads_take_their_value_at_the_end_of_the_step(stepping):
    grid, times = dense.uneven(2), []
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)

    def load(t):
        times.append(t)
        return 0.0, 0.0

    run = mpm.Simulation(
        grid,
        body,
        stepping,
        [mpm.Fixed(grid.facets("bottom")), mpm.Traction(grid.facets("top"), load)],
    )
    times.clear()
    run.step()
    run.step()
    assert times == pytest.approx(
        [0.0] * stepping.dynamic + [stepping.dt, 2 * stepping.dt]
    )  # a₀ is of the start


# -- supports that meet ----------------------------------------------------------------------------


def both_kinds(grid, terms, stepping=STEPPING):
    return [
        lambda: mpm.Simulation(
            grid, mpm.MaterialPoints.fill(grid, dense.SOIL, 2**grid.dim), stepping, terms
        ),
        lambda: mpm.FiniteElements(grid, dense.SOIL, stepping, terms),
    ]


@pytest.mark.parametrize("dim", [2, 3])
def test_supports_that_move_a_corner_in_two_ways_are_refused_by_name_and_place(dim):
    grid = dense.uneven(dim)
    left, bottom = grid.facets("left"), grid.facets("bottom")
    for first, second in (
        (None, lambda t: 2.0 * t),
        (lambda t: t, lambda t: 2.0 * t),
        (lambda t: 2.0 * t, None),
    ):
        for make in both_kinds(
            grid, [mpm.Fixed(left, "x", first), mpm.Fixed(bottom, value=second)]
        ):
            with pytest.raises(
                ValueError,
                match=r"Fixed on left and Fixed on bottom share the node "
                r"x=\[0\. 0\.( 0\.)?\] in x, and move it by .* from t = 0 to 0\.01",
            ):
                make()


def test_supports_that_move_what_they_share_alike_are_taken():
    grid = dense.uneven(2)
    sides = [grid.facets(side) for side in ("left", "right", "bottom", "top")]
    for terms in (
        [
            mpm.Fixed(sides[0], "x", lambda t: t),
            mpm.Fixed(sides[2], "y", lambda t: 2 * t),
        ],  # other components
        [mpm.Fixed(sides[0], "x", lambda t: t), mpm.Fixed(sides[1], "x")],  # no node in common
        [mpm.Fixed(sides[0], "x", lambda t: 0.1 * t), mpm.Fixed(sides[2], "x", lambda t: t / 10)],
        [mpm.Fixed(side) for side in sides],
    ):
        for make in both_kinds(grid, terms):
            assert len(make().terms) == len(terms)


def test_supports_that_part_later_stop_the_run_there():
    grid = dense.uneven(2)
    terms = [
        mpm.Fixed(grid.facets("left"), "x"),
        mpm.Fixed(grid.facets("bottom"), "x", lambda t: 1e-6 * max(t - 0.255, 0.0)),
    ]
    for make in both_kinds(grid, terms):
        run = make()
        run.until(0.25)
        with pytest.raises(
            mpm.RunError,
            match=r"step 26, t = 0\.26: Fixed on left and Fixed on bottom share the node",
        ):
            run.step()
    with pytest.raises(ValueError, match=r"from t = 0\.5 to 0\.75"):
        mpm.FiniteElements(
            grid,
            dense.SOIL,
            mpm.QuasiStatic(4),
            [terms[0], mpm.Fixed(grid.facets("bottom"), "x", lambda t: 1e-6 * max(t - 0.5, 0.0))],
        )
