"""The finite element twin: modes, energy, statics, and the same terms as a point run."""

import dense
import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions


def shaken(grid, **keywords):
    dim = grid.dim
    terms = [
        mpm.Fixed(grid.facets("bottom")),
        mpm.Gravity(lambda t: np.sin(300 * t) * (np.arange(dim) + 1.0)),
        mpm.Traction(grid.facets("top"), lambda t, x: 1e3 * np.sin(200 * t) * x),
        mpm.ViscoelasticBoundary(grid.facets("right"), dense.SOFT, 2.0),
    ]
    return mpm.FiniteElements(grid, dense.SOIL, mpm.Newmark(1e-3), terms, **keywords)


@pytest.mark.parametrize("dim", [2, 3])
def test_energy_is_balanced_in_every_step(dim):
    """Kinetic + strain + stored in springs = work done - absorbed, to round-off: loads start from
    zero."""
    run = shaken(dense.uneven(dim))
    flows = [
        (name, dolfinx_versions.compile_form(form))
        for c in run.contributions
        for name, form in c.energy().items()
    ]
    assert {name for name, _ in flows} == {"work", "absorbed", "stored"}
    inside, total = 0.0, dict.fromkeys(("work", "absorbed", "stored"), 0.0)
    for _ in range(20):
        run.step()
        step = dict.fromkeys(total, 0.0)
        for name, form in flows:
            step[name] += dolfinx_versions.assemble_scalar(form)
        now = sum(run.energy().values())
        assert now - inside == pytest.approx(
            step["work"] - step["absorbed"] - step["stored"],
            abs=1e-9 * max(abs(step["work"]), step["absorbed"]),
        )
        inside = now
        for name in total:
            total[name] += step[name]
    assert total["absorbed"] > 0.01 * abs(total["work"])
    assert total["stored"] > 0.0


@pytest.mark.parametrize("dim", [2, 3])
def test_assembling_again_changes_nothing(dim):
    found = []
    for reassemble in (False, True):
        run = shaken(dense.uneven(dim), reassemble=reassemble)
        run.until(5e-3)
        found.append(run.displacement.x.array)
    np.testing.assert_allclose(found[1], found[0], atol=1e-9 * np.abs(found[0]).max())


def test_a_factored_matrix_is_assembled_once(monkeypatch):
    run = shaken(dense.uneven(2))
    run.step()
    monkeypatch.setattr(run.equilibrium, "assemble_tangent", None)
    monkeypatch.setattr(dolfinx_versions, "compile_form", None)
    run.step()
    assert run.steps == 2


@pytest.mark.parametrize("steps", [1, 3])
def test_a_linear_scene_does_not_mind_its_load_steps(steps):
    grid = dense.uneven(3)
    run = mpm.FiniteElements(
        grid,
        dense.SOIL,
        mpm.QuasiStatic(steps),
        [
            mpm.Fixed(grid.facets("bottom")),
            mpm.Traction(grid.facets("top"), lambda s, x: s * 1e4 * x),
        ],
    )
    run.until(1.0)
    once = mpm.FiniteElements(
        grid,
        dense.SOIL,
        mpm.QuasiStatic(1),
        [mpm.Fixed(grid.facets("bottom")), mpm.Traction(grid.facets("top"), lambda s, x: 1e4 * x)],
    )
    once.until(1.0)
    u = once.displacement.x.array
    assert np.abs(u).max() > 1e-5
    np.testing.assert_allclose(run.displacement.x.array, u, atol=1e-11 * np.abs(u).max())
    assert not hasattr(run.motion, "v")


def test_a_bar_vibrates_with_the_frequency_of_its_mode():
    """Consistent mass and the trapezoidal rule: tan(ω dt/2) = dt/2 ω_h, with ω_h of bilinear
    elements."""
    L, n, dt, rod = 2.0, 8, 2e-3, mpm.LinearElastic(young=1e6, poisson=0.0, density=1000.0)
    grid = mpm.Grid.box((0, 0), (L, 0.5), (n, 1))
    run = mpm.FiniteElements(
        grid,
        rod,
        mpm.Newmark(dt),
        [mpm.Fixed(grid.facets("left"), "x"), mpm.Fixed(grid.facets("bottom"), "y")],
    )
    x = grid.space.tabulate_dof_coordinates()[:, 0]
    k, h, c = np.pi / (2 * L), L / n, rod.p_speed
    run.nodal("velocity")[:, 0] = np.sin(k * x)
    s = np.sin(k * h / 2) ** 2
    ω_h = c / h * np.sqrt(12 * s / (3 - 2 * s))
    ω = 2 / dt * np.arctan(ω_h * dt / 2)
    end = np.argmax(x)
    found = []
    for _ in range(100):
        run.step()
        found.append(run.nodal("displacement")[end, 0])
    t = dt * np.arange(1, 101)
    np.testing.assert_allclose(found, np.sin(ω * t) / ω_h, atol=1e-9 / ω_h)


def test_a_viscous_base_takes_a_plane_wave_whole():
    """One row of elements, a smooth pulse: the energy left is the grid's dispersion."""
    grid = mpm.Grid.box((0, 0), (0.5, 20), (1, 80))
    soil = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
    left = {}
    for name, term in (
        ("viscous", mpm.ViscousBoundary(grid.facets("bottom"), soil)),
        ("fixed", mpm.Fixed(grid.facets("bottom"), "y")),
    ):
        run = mpm.FiniteElements(
            grid,
            soil,
            mpm.Newmark(2e-3),
            [
                mpm.Fixed(grid.facets("left", "right"), "x"),
                term,
                mpm.Traction(
                    grid.facets("top"),
                    lambda t: (0.0, -1e3 * np.sin(np.pi * min(t / 0.2, 1.0)) ** 2),
                ),
            ],
        )
        run.until(0.2)
        full = sum(run.energy().values())
        run.until(0.45)
        left[name] = sum(run.energy().values()) / full
    assert left["viscous"] < 1e-5
    assert left["fixed"] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("dim", [2, 3])
def test_surface_points_on_an_edge_serve_a_finite_element_run(dim):
    """They stay where they are at rest, as the elements do: outside the grid there is nothing."""
    found = []
    for points in (False, True):
        grid = dense.uneven(dim)
        on = (
            mpm.MaterialPoints.fill(grid, dense.SOIL, 2**dim).surface("top")
            if points
            else grid.facets("top")
        )
        run = mpm.FiniteElements(
            grid,
            dense.SOIL,
            mpm.Newmark(1e-3),
            [
                mpm.Fixed(grid.facets("bottom")),
                mpm.Traction(on, (1e6,) * dim),
                mpm.ViscousBoundary(on, dense.SOFT),
            ],
        )
        run.until(0.01)
        assert run.nodal("displacement")[:, 1].max() > 0.01
        found.append(run.displacement.x.array)
    np.testing.assert_allclose(found[1], found[0], atol=1e-11 * np.abs(found[0]).max())


# -- going on from another run ---------------------------------------------------------------------


DAMPED = mpm.GeneralizedAlpha(
    0.1, spectral_radius=0.5
)  # a load that starts at once rings on under Newmark
SPRINGY = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)  # r = 20 m: 2G/r = 8e5 Pa/m


def on_springs(grid, *parts, load=500.0):
    """A column between smooth walls on springs on ``parts``, under a load that stays."""
    up, top = grid.dim - 1, grid.facets("top" if grid.dim == 2 else "front")
    walls = [mpm.Fixed(grid.facets("left", "right"), "x")]
    walls += [mpm.Fixed(grid.facets("bottom", "top"), "y")] if up == 2 else []
    return [
        *walls,
        mpm.Traction(top, -load * np.eye(grid.dim)[up]),
        *(mpm.ViscoelasticBoundary(part, SPRINGY, 20.0) for part in parts),
    ]


@pytest.mark.parametrize("surface", ["facets", "points"])
@pytest.mark.parametrize("dim", [2, 3])
def test_springs_go_on_with_what_they_bear(dim, surface):
    """Two halves are the whole, bit for bit; at rest u = p r/2G at the base, now and after."""
    grid = dense.uneven(dim)
    base = "bottom" if dim == 2 else "back"
    fresh = (
        (lambda: grid.facets(base))
        if surface == "facets"
        else (lambda: mpm.MaterialPoints.fill(grid, dense.SOIL, 2**dim).surface(base))
    )
    whole = mpm.FiniteElements(grid, SPRINGY, DAMPED, on_springs(grid, fresh()))
    whole.until(2.0)
    on = fresh()
    first = mpm.FiniteElements(grid, SPRINGY, DAMPED, on_springs(grid, on))
    first.until(1.0)
    again = on if surface == "points" else fresh()
    second = mpm.FiniteElements(grid, SPRINGY, DAMPED, on_springs(grid, again), start=first)
    second.until(1.0)
    for name, value in whole.state().items():
        assert np.array_equal(second.state()[name], value), name
    whole.until(60.0)
    u = whole.nodal("displacement")[:, -1]
    sunk = -500.0 * 20.0 / (2 * SPRINGY.lame[1])  # -6.25e-4 m; without memory it sinks twice
    assert u.max() == pytest.approx(sunk, rel=1e-4)  # it hardly trembles any more
    again = whole.terms[-1].on if surface == "points" else fresh()
    rest = mpm.FiniteElements(grid, SPRINGY, DAMPED, on_springs(grid, again), start=whole)
    energy = rest.record(mpm.Energy())
    rest.until(20.0)
    now = rest.nodal("displacement")[:, -1]
    np.testing.assert_allclose(now, u, atol=1e-4 * abs(sunk))
    assert np.abs(energy.lost).max() < 1e-9 * 500.0 * abs(sunk)


def test_springs_keep_what_they_bear_however_their_facets_are_named():
    """Two surfaces become one and one becomes two; a part that had none before cannot be told."""
    grid = dense.uneven(2)
    left, right, both = grid.facets("left"), grid.facets("right"), grid.facets("left", "right")
    terms = [mpm.Fixed(grid.facets("bottom"), "y"), mpm.Traction(grid.facets("top"), (1e3, -500.0))]

    def run(*surfaces, **keywords):
        springs = [mpm.ViscoelasticBoundary(on, SPRINGY, 20.0) for on in surfaces]
        return mpm.FiniteElements(grid, SPRINGY, mpm.Newmark(0.01), [*terms, *springs], **keywords)

    whole, first = run(left, right), run(left, right)
    whole.until(0.2)
    first.until(0.1)
    for surfaces in ((both,), (right, left)):
        second = run(*surfaces, start=first)
        second.until(0.1)
        u, expected = (one.displacement.x.array for one in (second, whole))
        np.testing.assert_allclose(u, expected, atol=1e-14)
    half = run(left)
    half.until(0.1)
    with pytest.raises(ValueError, match=r"part of the facets \('left', 'right'\) springs .* own"):
        run(both, start=half)
    new = run(left, right, start=half)  # the right ones start unstressed, and the left ones go on
    kept, fresh = (new.state()[f"surfaces/{n}/total"] for n in (1, 2))
    assert np.array_equal(kept, half.displacement.x.array) and not fresh.any()
    with pytest.warns(UserWarning, match=r"\('right',\) start unstressed, .*\('left',\) is gone"):
        run(right, start=half)
    points = mpm.MaterialPoints.fill(grid, dense.SOIL, 4).surface("left")
    with pytest.warns(UserWarning, match=r"springs on 12 surface points start unstressed"):
        run(points, start=half)
    run(start=half)  # springs may go


def test_what_start_takes_over_and_what_not():
    """Motion goes on; ``Fixed`` moves by what its value changes from 0 on; statics are at rest."""
    grid = dense.uneven(2)
    push = [
        mpm.Fixed(grid.facets("bottom"), value=lambda t: 1e-3 * (3.0 + t)),
        mpm.Traction(grid.facets("top"), (1e3, 0.0)),
    ]
    first = mpm.FiniteElements(grid, dense.SOIL, mpm.Newmark(0.01), push)
    first.until(0.1)
    second = mpm.FiniteElements(grid, dense.SOIL, mpm.Newmark(0.01), push, start=first)
    for name in ("v", "a"):
        now, before = (getattr(run.motion, name).x.array for run in (second, first))
        assert np.array_equal(now, before)
    second.until(0.1)
    base = grid.space.tabulate_dof_coordinates()[:, 1] < 1e-9
    np.testing.assert_allclose(second.nodal("displacement")[base], 2e-4, rtol=1e-9)
    still = [push[1], mpm.Fixed(grid.facets("bottom"))]
    static = mpm.FiniteElements(grid, dense.SOIL, mpm.QuasiStatic(1), still, start=second)
    static.step()
    np.testing.assert_allclose(static.nodal("displacement")[base], 2e-4, rtol=1e-9)
    moving = mpm.FiniteElements(grid, dense.SOIL, mpm.Newmark(0.01), push, start=static)
    assert not moving.nodal("velocity").ravel().any()
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
    points = mpm.Simulation(grid, body, mpm.Newmark(0.01), [])
    with pytest.raises(ValueError, match=r"start must be a finite element run, got .*Simulation"):
        mpm.FiniteElements(grid, dense.SOIL, mpm.Newmark(0.01), push, start=points)


@pytest.mark.parametrize("yields", [False, True], ids=["elastic", "von Mises"])
@pytest.mark.parametrize("dim", [2, 3])
def test_gauss_points_say_where_they_are_and_what_they_bear(dim, yields):
    """u_x = κ x y is among the elements' functions: ε_xx = κ y and γ_xy = κ x at each place."""
    grid, κ = dense.uneven(dim), 1e-4
    law = mpm.VonMises(dense.SOIL, 1e9, 1e9, 0.0) if yields else dense.SOIL
    base = mpm.Fixed(grid.facets("bottom"))
    run = mpm.FiniteElements(grid, law, mpm.QuasiStatic(1), base, b_bar=False)
    run.nodal("increment")[:] = dense.at_nodes(
        grid, lambda x: κ * x[:, :1] * x[:, 1:2] * np.eye(dim)[0]
    ).reshape(-1, dim)
    run.carry()
    x, found = run.gauss_places(), run.gauss_stress()
    assert x.shape == (grid.cells * 2**dim, dim)
    strain = np.zeros_like(found)
    strain[:, 0], strain[:, 3] = κ * x[:, 1], κ * x[:, 0]
    expected = dense.SOIL.update(strain, np.zeros_like(strain))
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())
    cells = found.reshape(grid.cells, 2**dim, -1)
    np.testing.assert_allclose(
        cells.mean(axis=1), run.stress(np.arange(grid.cells)), atol=1e-12 * np.abs(expected).max()
    )
    assert run.gauss_history().shape == (len(x), int(yields)) and not run.gauss_history().any()
