"""Generalised α: its amplification matrix from the definitions, one element step by step, and every
law's balance."""

from dataclasses import replace

import dense
import inside
import numpy as np
import pytest
from dolfinx import fem

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.dynamics.motion import Motion

RADIUS = pytest.mark.parametrize(
    "ρ, w", [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.8, 0.3), (0.8, 0.8), (1.0, 0.0), (1.0, 1.0)]
)
EXACT = mpm.Solver(newton=mpm.Newton(tolerance=1e-11))
SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
LAWS = {
    "elastic": dense.SOIL,
    "von Mises": mpm.VonMises(dense.SOIL, 10e3, 5e3, 1e6),
    "Hencky": mpm.Hencky(20e6, 0.25, 1500.0),
}


def alphas(ρ, w):
    """α_m, α_f: Chung & Hulbert's for w = ρ, Wood, Bossak & Zienkiewicz's for w = 0."""
    known = {ρ: ((2 * ρ - 1) / (ρ + 1), ρ / (ρ + 1)), 0.0: ((ρ - 1) / (ρ + 1), 0.0)}
    return known.get(w, (w / (1 + w) - (1 - ρ) / (1 + ρ), w / (1 + w)))


def amplification(Ω, ρ, w, ξ=0.0):
    """(u, Δt v, Δt² a) of ü + 2ξω u̇ + ω²u = 0 over a step Ω = ωΔt, by the definitions (Chung &
    Hulbert 1993), and what a load Δt² ((1 - α_f) p₁ + α_f p₀) adds."""
    αm, αf = alphas(ρ, w)
    γ, β = 0.5 - αm + αf, (1 - αm + αf) ** 2 / 4
    end = np.array(
        [[1.0, 0.0, -β], [0.0, 1.0, -γ], [(1 - αf) * Ω**2, (1 - αf) * 2 * ξ * Ω, 1 - αm]]
    )
    start = np.array([[1.0, 1.0, 0.5 - β], [0.0, 1.0, 1 - γ], [-αf * Ω**2, -αf * 2 * ξ * Ω, -αm]])
    return np.linalg.solve(end, start), np.linalg.solve(end, [0.0, 0.0, 1.0])


@RADIUS
def test_the_matrix_has_the_spectral_radius_asked_for(ρ, w):
    """ρ at infinity, where all eigenvalues meet; never above 1; 1 for slow vibrations."""
    radius = [
        np.abs(np.linalg.eigvals(amplification(Ω, ρ, w)[0])).max() for Ω in np.logspace(-3, 4, 60)
    ]
    assert max(radius) < 1 + 1e-7
    assert radius[0] == pytest.approx(1.0, abs=1e-6)
    assert radius[-1] == pytest.approx(ρ, abs=0.02)
    if ρ < 1:
        assert min(np.diff(radius)) < -1e-3


@RADIUS
def test_factors_are_the_definitions(ρ, w):
    """A step of an oscillator by the factors, the balance written over 1 - α_f, equals the
    matrix."""
    dt, ω, ξ, rng = 0.3, 7.0, 0.2, np.random.default_rng(0)
    step, (x, v, a) = mpm.GeneralizedAlpha(dt, ρ, w), rng.normal(size=3)
    (c, d), (C, D) = (step.velocity, step.acceleration), step.balanced
    u = -(np.dot(D[1:], (v, a)) + 2 * ξ * ω * np.dot(C[1:], (v, a)) + (1 + step.start) * ω**2 * x)
    u /= D[0] + 2 * ξ * ω * C[0] + ω**2
    found = x + u, dt * np.dot(c, (u, v, a)), dt**2 * np.dot(d, (u, v, a))
    expected = amplification(ω * dt, ρ, w, ξ)[0] @ (x, dt * v, dt**2 * a)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def one_element(stepping, load, H=0.5):
    """A cell between rollers, held on its left, with load, dashpot and spring on its right."""
    grid = mpm.Grid.box((0, 0), (H, H), (1, 1))
    terms = [
        mpm.Fixed(grid.facets("left"), "x"),
        mpm.Fixed(grid.facets("bottom", "top"), "y"),
        mpm.Traction(grid.facets("right"), lambda t: (load(t), 0.0)),
        mpm.ViscoelasticBoundary(grid.facets("right"), SOIL, 2.0),
    ]
    run = mpm.FiniteElements(grid, SOIL, stepping, terms)
    mass, (λ, μ) = SOIL.density * H / 3, SOIL.lame
    stiffness = (λ + 2 * μ) / H + 2 * μ / 2.0
    ω = np.sqrt(stiffness / mass)
    return run, ω, SOIL.density * SOIL.p_speed / (2 * mass * ω), mass


def state(run):
    """Displacement, velocity and acceleration of the right-hand side."""
    i = np.argmax(run.grid.space.tabulate_dof_coordinates()[:, 0])
    return np.array([run.nodal(f)[i, 0] for f in ("displacement", "velocity", "acceleration")])


@pytest.mark.parametrize("courant", [0.3, 20.0])
@RADIUS
def test_one_element_follows_the_matrix_step_by_step(ρ, w, courant):
    def load(t):
        return 1e3 * np.cos(40 * t)

    step = mpm.GeneralizedAlpha(courant * 0.5 / SOIL.p_speed, ρ, w)
    run, ω, ξ, mass = one_element(step, load)
    dt, αf, known = step.dt, alphas(ρ, w)[1], np.array([0.0, 0.0, step.dt**2 * load(0.0) / mass])
    A, b = amplification(ω * dt, ρ, w, ξ)
    for n in range(40):
        run.step()
        p = ((1 - αf) * load((n + 1) * dt) + αf * load(n * dt)) / mass
        known = A @ known + b * dt**2 * p
        np.testing.assert_allclose(
            state(run) * [1, dt, dt**2], known, rtol=0, atol=1e-10 * np.abs(known).max()
        )


@RADIUS
def test_second_order(ρ, w):
    """Error after a fixed time against the exact damped vibration; a is that of the balance at the
    start."""
    ω, ξ, end = 3.0, 0.1, 2.0
    roots = np.array([-ξ + 1j * np.sqrt(1 - ξ**2), -ξ - 1j * np.sqrt(1 - ξ**2)]) * ω
    share = np.linalg.solve([np.ones(2), roots], [1.0, 0.5])
    errors = []
    for n in (200, 400):
        dt, A = end / n, amplification(ω * end / n, ρ, w, ξ)[0]
        x, v, _ = np.linalg.matrix_power(A, n) @ [1.0, 0.5 * dt, -(ω**2 + 2 * ξ * ω * 0.5) * dt**2]
        exact = (
            (share * np.exp(roots * end)).sum().real,
            (share * roots * np.exp(roots * end)).sum().real,
        )
        errors.append(np.abs([x - exact[0], v / dt - exact[1]]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def test_a_radius_of_one_is_the_trapezoidal_rule():
    """Where forces balance at the start."""
    found = []
    for stepping in (mpm.Newmark(1e-3), mpm.GeneralizedAlpha(1e-3, 1.0, 1.0)):
        run, *_ = one_element(stepping, lambda t: 1e3 * np.sin(90 * t))
        for _ in range(100):
            run.step()
        found.append(state(run))
    assert mpm.GeneralizedAlpha(1e-3, 1.0).velocity == mpm.Newmark(1e-3).velocity
    np.testing.assert_allclose(found[0], found[1], rtol=1e-10)


def test_a_radius_of_one_is_the_trapezoidal_rule_bit_by_bit_with_the_balance_at_the_end():
    """Random points, out of balance at the start."""
    found = []
    for stepping in (mpm.Newmark(1e-3), mpm.GeneralizedAlpha(1e-3, 1.0)):
        body = dense.random_body(dense.uneven(2), np.random.default_rng(6))
        grid = mpm.Grid.box((-1, -1), (2, 2), (9, 9))
        load = mpm.Traction(body.surface("top"), lambda t: (0.0, 1e3 + t))
        run = mpm.Simulation(
            grid,
            body,
            stepping,
            [load, mpm.ViscoelasticBoundary(body.surface("bottom"), SOIL, 3.0)],
            mpm.DM_GC,
        )
        run.until(3e-3)
        found.append(np.hstack((body.x, body.velocity, body.acceleration, body.stress)))
    np.testing.assert_array_equal(*found)


@RADIUS
@pytest.mark.parametrize("law", LAWS)
def test_forces_of_finite_elements_balance_inside_the_step(law, ρ, w):
    """A bar under a sudden blow: M [(1 - α_m) a₁ + α_m a₀] + A [(1 - α_f) σ₁ + α_f σ₀] = 0 for one
    element that cannot move sideways; its nominal stress is Cauchy's."""
    grid = mpm.Grid.box((0, 0), (1, 1), (1, 1))
    fixed = [mpm.Fixed(grid.facets("left"), "x"), mpm.Fixed(grid.facets("bottom", "top"), "y")]
    run = mpm.FiniteElements(grid, LAWS[law], mpm.GeneralizedAlpha(2e-3, ρ, w), fixed, solver=EXACT)
    right = grid.space.tabulate_dof_coordinates()[:, 0] > 0.5
    run.nodal("velocity")[right, 0] = -5.0
    mass, before, (αm, αf) = LAWS[law].density / 3, (0.0, 0.0), alphas(ρ, w)
    for _ in range(12):
        run.step()
        now = run.nodal("acceleration")[right, 0].mean(), run.stress(np.array([0]))[0, 0]
        inertia = mass * ((1 - αm) * now[0] + αm * before[0])
        assert inertia + (1 - αf) * now[1] + αf * before[1] == pytest.approx(
            0.0, abs=1e-8 * abs(inertia)
        )
        before = now
    assert abs(now[1]) > 1e4


@pytest.mark.parametrize("ρ, w", [(0.5, 0.0), (0.5, 0.5), (1.0, 1.0)])
@pytest.mark.parametrize("law", LAWS)
def test_forces_of_material_points_balance_inside_the_step(law, ρ, w):
    """The same, node by node, for points placed at random, with gravity that varies, on linear
    shape functions."""
    grid, rng = dense.uneven(2), np.random.default_rng(5)
    body = dense.random_body(grid, rng, material=LAWS[law])
    body.stress *= 0.01 if law == "von Mises" else 1.0
    terms = [mpm.Fixed(grid.facets("bottom")), mpm.Gravity(lambda t: (3.0 + 4e3 * t, -9.81))]
    run = mpm.Simulation(grid, body, mpm.GeneralizedAlpha(1e-3, ρ, w), terms, mpm.MPM, EXACT)

    αm, αf = alphas(ρ, w)

    def force(stress):
        return np.einsum("p,pij,pkj->ki", volume, stress, slope)

    for n in range(3):
        volume, stress = body.volume.copy(), tensors.matrix(body.stress, 2).copy()
        run.step()
        _, slope = inside.shape_functions(run)
        f = np.eye(2) + np.einsum("ki,pkj->pij", run.nodal("increment"), slope)
        P = tensors.matrix(body.stress, 2)
        if law == "Hencky":
            P = np.linalg.det(f)[:, None, None] * P @ np.linalg.inv(f).transpose(0, 2, 1)
        mean = (1 - αm) * run.end_of_step()[1] + αm * run.nodal("acceleration")
        g = np.array([3.0 + 4e3 * 1e-3 * (n + 1 - αf), -9.81])
        inertia = inside.times_mass(run, mean - g)
        left = inertia + (1 - αf) * force(P) + αf * force(stress)
        free = ~inside.equations(run).fixed.reshape(-1, 2)
        assert np.abs(left[free]).max() < 1e-8 * np.abs(force(P)).max()


@pytest.mark.parametrize(
    "stepping", [mpm.Newmark(0.05, 0.4, 0.7), mpm.GeneralizedAlpha(0.05, 0.3, 0.2)], ids=["γ", "α"]
)
@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_GC], ids=str)
def test_points_take_the_velocity_of_the_grids_rule(mapping, stepping):
    """A body without stress under gravity that grows: what its points have is what its nodes
    have."""
    grid = mpm.Grid.box((0, 0), (3, 3), (6, 6))
    body = mpm.MaterialPoints.fill(
        grid, SOIL, 4, inside=lambda x: ((x > 0.5) & (x < 1.5)).all(axis=0)
    )
    factor = mpm.Solver(petsc={"ksp_type": "preonly", "pc_type": "lu"})
    run = mpm.Simulation(
        grid, body, stepping, [mpm.Gravity(lambda t: (t, 2.0 * t))], mapping, factor
    )
    for _ in range(10):
        run.step()
        v, a = run.end_of_step()
        there = run.nodal("increment")[:, 1] > 0.0
        for at_points, at_nodes in ((body.velocity, v), (body.acceleration, a)):
            np.testing.assert_allclose(
                at_points, np.tile(at_nodes[there].mean(axis=0), (len(body), 1)), rtol=1e-8
            )


@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.DM_GC], ids=str)
def test_a_body_that_falls_from_rest_with_its_acceleration_is_where_it_should_be(mapping):
    grid, g, dt = mpm.Grid.box((0, 0), (3, 3), (6, 6)), np.array([4.0, 2.0]), 0.05
    body = mpm.MaterialPoints.fill(
        grid, SOIL, 4, inside=lambda x: ((x > 0.5) & (x < 1.5)).all(axis=0)
    )
    start, body.acceleration = body.x.copy(), np.tile(g, (len(body), 1))
    run = mpm.Simulation(grid, body, mpm.GeneralizedAlpha(dt, 0.4, 0.4), [mpm.Gravity(g)], mapping)
    run.until(8 * dt)
    np.testing.assert_allclose(body.x, start + g * (8 * dt) ** 2 / 2, rtol=1e-8)


@pytest.mark.parametrize("k", [1, 7])
@pytest.mark.parametrize("ρ, w", [(1.0, 0.0), (0.8, 0.0), (0.8, 0.8), (0.5, 0.5)])
def test_modes_of_a_bar_lose_what_the_matrix_says(ρ, w, k):
    """The slowest and the fastest of 8 cells, Courant 2: modes sin θx, ω² = 6 c² (1 - cos θ)/(2 +
    cos θ)."""
    grid, dt, steps, θ = mpm.Grid.box((0, 0), (8, 1), (8, 1)), 2.0 / SOIL.p_speed, 50, k * np.pi / 8
    run = mpm.FiniteElements(
        grid,
        SOIL,
        mpm.GeneralizedAlpha(dt, ρ, w),
        [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.Fixed(grid.facets("bottom", "top"), "y"),
        ],
    )
    run.nodal("velocity")[:, 0] = np.sin(θ * grid.space.tabulate_dof_coordinates()[:, 0])
    energy = run.record(mpm.Energy())
    run.until(steps * dt)
    Ω = 2.0 * np.sqrt(6 * (1 - np.cos(θ)) / (2 + np.cos(θ)))
    u, v, _ = np.linalg.matrix_power(amplification(Ω, ρ, w)[0], steps) @ [0.0, 1.0, 0.0]
    assert energy.left[-1] / energy.left[0] == pytest.approx(
        Ω**2 * u**2 + v**2, rel=1e-6, abs=1e-12
    )
    np.testing.assert_allclose(
        energy.lost, energy.left[0] - energy.left, atol=1e-9 * energy.left[0]
    )


def test_newmark_does_not_pay():
    grid = mpm.Grid.box((0, 0), (1, 1), (1, 1))
    motion = Motion(grid, mpm.Newmark(0.1))
    assert motion.known(motion.v) is motion.v
    assert mpm.Newmark(0.1).start == 0.0


def test_a_part_of_a_step_has_the_same_radius():
    assert mpm.GeneralizedAlpha(0.2, 0.6, 0.1).part(0.5) == mpm.GeneralizedAlpha(0.1, 0.6, 0.1)
    assert (
        replace(mpm.GeneralizedAlpha(0.2, 0.6), dt=0.3).gamma
        == mpm.GeneralizedAlpha(1.0, 0.6).gamma
    )


@pytest.mark.parametrize(
    "parameters, name",
    [
        ({"dt": 0.0, "spectral_radius": 0.5}, "dt"),
        ({"dt": 0.1, "spectral_radius": 1.1}, "spectral_radius .* 1.1"),
        ({"dt": 0.1, "spectral_radius": -0.1}, "spectral_radius"),
        ({"dt": 0.1, "spectral_radius": 0.5, "start": 0.6}, "start .* 0.6"),
        ({"dt": 0.1, "spectral_radius": 0.5, "start": -0.1}, "start"),
        ({"dt": 0.1, "spectral_radius": np.nan}, "spectral_radius"),
    ],
)
def test_senseless_radii_are_refused(parameters, name):
    with pytest.raises(ValueError, match=name):
        mpm.GeneralizedAlpha(**parameters)


@pytest.mark.parametrize("surface", ["points", "facets"])
def test_a_load_that_stays_as_it_is_counts_as_one_that_is_constant(surface):
    found = []
    for held in (False, True):
        grid = mpm.Grid.box((0, 0), (1, 1), (2, 2))
        body = mpm.MaterialPoints.fill(grid, SOIL, 4)
        on = body.surface("right") if surface == "points" else grid.facets("right")
        load = (-300.0, 0.0)
        if held and surface == "points":
            load = np.tile(load, (len(on), 1))
        elif held:
            load = fem.Function(grid.space)
            load.x.array[:] = np.tile((-300.0, 0.0), grid.nodes)
        run = mpm.Simulation(
            grid,
            body,
            mpm.GeneralizedAlpha(1e-3, 0.5, 0.5),
            [mpm.Fixed(grid.facets("left")), mpm.Traction(on, load)],
        )
        energy = run.record(mpm.Energy())
        run.until(5e-3)
        found.append(np.append(body.velocity.ravel(), energy["work"][-1]))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)
