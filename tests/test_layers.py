"""Bodies of different material on one grid: stress at their interface, and what is doubtful
there."""

import numpy as np
import pytest
from heard import warned

import mpm_fenicsx as mpm

LOAD, YOUNG, H = 500.0, 20e6, 0.25  # Pa, Pa of the softest, m
WITH_DOMAINS = pytest.mark.parametrize(
    "mapping", [mpm.DM_GC, mpm.DM_GCL, mpm.GIMP, mpm.DM_G], ids=str
)
EXACT = mpm.Solver(
    newton=mpm.Newton(tolerance=1e-12), petsc={"ksp_type": "preonly", "pc_type": "cholesky"}
)


def columns(laws, dim=2, width=1.0):
    """A column 2 m high of layers of equal height, the first one lowest, between rollers."""
    up, size = dim - 1, (width, 2 * H)[: dim - 1]
    grid = mpm.Grid.box(
        [0.0] * dim, [*size, 2.0 + H], [*(round(s / H) for s in size), round(2.0 / H) + 1]
    )
    edges = np.round(np.linspace(0.0, 2.0, len(laws) + 1) / H) * H
    bodies = [
        mpm.MaterialPoints.fill(
            grid, law, 2**dim, lambda x, low=low, high=high: (low < x[up]) & (x[up] < high)
        )
        for law, low, high in zip(laws, edges, edges[1:], strict=False)
    ]
    below, above = ("bottom", "top") if dim == 2 else ("back", "front")
    terms = [mpm.Fixed(grid.facets("left", "right"), "x"), mpm.Fixed(grid.facets(below), "xyz"[up])]
    terms += [mpm.Fixed(grid.facets("bottom", "top"), "y")] if dim == 3 else []
    return grid, bodies, terms, bodies[-1].surface(above)


def pressed(laws, mapping, dim=2):
    """Bodies that have come to rest under LOAD on the top of the last."""
    grid, bodies, terms, top = columns(laws, dim)
    load = np.zeros(dim)
    load[-1] = -LOAD
    run = mpm.Simulation(
        grid, bodies, mpm.QuasiStatic(1), [*terms, mpm.Traction(top, load)], mapping, EXACT
    )
    run.until(1.0)
    run.settle(1e-12)
    return bodies


def off(bodies, row):
    """Largest difference of a component of stress from LOAD, of it."""
    return max(np.abs(body.stress[:, row] + LOAD).max() for body in bodies) / LOAD


@WITH_DOMAINS
@pytest.mark.parametrize("contrast", [3.0, 1e4])
def test_layers_bear_the_load_above_them(mapping, contrast):
    """σ = -p in every layer, whatever the moduli: equilibrium alone says so."""
    stiff, soft = (
        mpm.LinearElastic(contrast * YOUNG, 0.25, 2000.0),
        mpm.LinearElastic(YOUNG, 0.25, 1500.0),
    )
    for laws in ([stiff, soft], [soft, stiff, soft], [stiff, soft, stiff, soft, stiff]):
        assert off(pressed(laws, mapping), 1) < 1e-8


@WITH_DOMAINS
@pytest.mark.parametrize("law", [mpm.LinearElastic, mpm.Hencky])
def test_layers_in_space_and_at_finite_strain(mapping, law):
    """The same in 3D, and with Hencky's law, whose Cauchy stress the load is."""
    laws = [law(100.0 * YOUNG, 0.25, 2000.0), law(YOUNG, 0.25, 1500.0)]
    assert (
        off(
            pressed(laws, mapping, dim=3 if law is mpm.LinearElastic else 2),
            -4 if law is mpm.LinearElastic else 1,
        )
        < 1e-8
    )


@WITH_DOMAINS
def test_bodies_side_by_side_under_one_strain(mapping):
    """ν = 0 and loads p_i in proportion to E_i: one strain, σ_i = -p_i, and nothing across the
    interface."""
    soft, stiff = (
        mpm.LinearElastic(YOUNG, 0.0, 1500.0),
        mpm.LinearElastic(100.0 * YOUNG, 0.0, 2000.0),
    )
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0 + H), (4, 5))
    bodies = [
        mpm.MaterialPoints.fill(
            grid, law, 4, lambda x, low=low: (low < x[0]) & (x[0] < low + 0.5) & (x[1] < 1.0)
        )
        for law, low in ((soft, 0.0), (stiff, 0.5))
    ]
    terms = [mpm.Fixed(grid.facets("left", "right"), "x"), mpm.Fixed(grid.facets("bottom"), "y")]
    terms += [
        mpm.Traction(body.surface("top"), (0.0, -5e-6 * body.material.young)) for body in bodies
    ]
    run = mpm.Simulation(grid, bodies, mpm.QuasiStatic(1), terms, mapping, EXACT)
    run.until(1.0)
    run.settle(1e-12)
    for body in bodies:
        p = 5e-6 * body.material.young
        assert np.abs(body.stress[:, 1] + p).max() < 1e-8 * p
        assert np.abs(body.stress[:, 0]).max() < 1e-8 * 5e-4 * YOUNG


@WITH_DOMAINS
def test_layers_at_rest_stay_at_rest_in_dynamics(mapping):
    """Under the load that they have settled under nothing moves."""
    laws = [mpm.LinearElastic(100.0 * YOUNG, 0.25, 2000.0), mpm.LinearElastic(YOUNG, 0.25, 1500.0)]
    grid, bodies, terms, top = columns(laws)
    terms.append(mpm.Traction(top, (0.0, -LOAD)))
    mpm.Simulation(grid, bodies, mpm.QuasiStatic(1), terms, mapping, EXACT).until(1.0)
    mpm.Simulation(grid, bodies, mpm.QuasiStatic(1), terms, mapping, EXACT).settle(1e-12)
    solver = mpm.Solver(petsc={"ksp_type": "cg", "ksp_rtol": 1e-13})
    run = mpm.Simulation(grid, bodies, mpm.Newmark(1e-3), terms, mapping, solver)
    run.until(0.03)
    impedance = laws[1].density * laws[1].p_speed
    assert off(bodies, 1) < 1e-8
    assert max(np.abs(body.velocity).max() for body in bodies) < 1e-8 * LOAD / impedance


@WITH_DOMAINS
def test_a_pulse_goes_on_into_the_stiffer_layer(mapping):
    """d'Alembert: of a pulse p the lower layer has 2 Z₂/(Z₁ + Z₂) p.  Bodies of 64 cells, 20 of
    them in the pulse."""
    upper, lower = (
        mpm.LinearElastic(24e6, 0.0, 1500.0),
        mpm.LinearElastic(9 * 24e6, 0.0, 1500.0),
    )  # c = 126.5, 379.5 m/s
    h, c = 0.05, upper.p_speed
    grid = mpm.Grid.box((0.0, -6.0), (h, 3.25), (1, 185))
    bodies = [
        mpm.MaterialPoints.fill(
            grid, law, 4, lambda x, low=low, high=high: (low < x[1]) & (x[1] < high)
        )
        for law, low, high in ((lower, -6.0, 0.0), (upper, 0.0, 3.0))
    ]
    duration = 1.5 / c

    def pulse(t):
        return 0.0, -LOAD * np.sin(np.pi * t / duration) ** 2 * (t < duration)

    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom"), "y"),
        mpm.Traction(bodies[1].surface("top"), pulse),
    ]
    run = mpm.Simulation(grid, bodies, mpm.Newmark(0.25 * h / c), terms, mapping)
    run.until(3.0 / c + 0.5 * duration + 2.0 / lower.p_speed)
    assert -bodies[0].stress[:, 1].min() == pytest.approx(2 * 3 / (1 + 3) * LOAD, rel=0.01)


@WITH_DOMAINS
def test_layers_bear_their_own_weight(mapping):
    """σ(y) = Σ ρ g Δy above, to 0.1 % of that at the base: means of cells, for strain without a
    composite patch is constant in them."""
    laws = [mpm.LinearElastic(100.0 * YOUNG, 0.25, 2200.0), mpm.LinearElastic(YOUNG, 0.25, 1500.0)]
    grid, bodies, terms, _ = columns(laws)
    terms.append(mpm.Gravity((0.0, -9.81)))
    run = mpm.Simulation(grid, bodies, mpm.QuasiStatic(1), terms, mapping, EXACT)
    row = [np.floor(body.x[:, 1] / H).astype(int) for body in bodies]
    lower, upper = ((np.unique(at) + 0.5) * H for at in row)
    run.until(1.0)
    run.settle(1e-12)
    borne = [
        np.array([body.stress[at == k, 1].mean() for k in np.unique(at)])
        for body, at in zip(bodies, row, strict=True)
    ]
    base = 9.81 * (2200.0 + 1500.0)
    assert np.abs(borne[1] + 9.81 * 1500.0 * (2.0 - upper)).max() < 1e-3 * base
    assert np.abs(borne[0] + 9.81 * (1500.0 + 2200.0 * (1.0 - lower))).max() < 1e-3 * base


@WITH_DOMAINS
@pytest.mark.parametrize("strength", [1.01, 0.99])
def test_a_layer_yields_at_its_load_and_not_before(mapping, strength):
    """Confined, q = (1 - 2ν)/(1 - ν) p, which the cohesion q/√3 just bears or does not."""
    cohesion = strength * (1 - 2 * 0.25) / (1 - 0.25) * LOAD / np.sqrt(3.0)
    soil = mpm.VonMises(
        mpm.LinearElastic(YOUNG, 0.25, 1500.0), peak=cohesion, residual=cohesion, softening=0.0
    )
    bodies = pressed([mpm.LinearElastic(100.0 * YOUNG, 0.25, 2000.0), soil], mapping)
    assert (bodies[1].history.max() > 0.0) == (strength < 1.0)
    assert off(bodies, 1) < 1e-8


# -- what is doubtful ------------------------------------------------------------------------------


def said(laws, edge):
    """What a scene of two bodies that meet at a height, or of one within another, warns of."""
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 2.0), (4, 8))
    bodies = [
        mpm.MaterialPoints.fill(grid, laws[k], 16, lambda x, k=k: edge(x[1]) == k) for k in (0, 1)
    ]
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom"), "y"),
        mpm.Gravity((0.0, -1.0)),
    ]
    run = mpm.Simulation(grid, bodies, mpm.QuasiStatic(1), terms)
    return warned(run.step)


def test_an_interface_inside_a_cell_is_warned_of():
    soft, stiff = (
        mpm.LinearElastic(YOUNG, 0.25, 1500.0),
        mpm.LinearElastic(50 * YOUNG, 0.25, 2000.0),
    )
    assert said((soft, stiff), lambda y: y > 1.0) == []
    assert said((soft, soft), lambda y: y > 1.1) == []
    (inside,) = said((soft, stiff), lambda y: y > 1.1)
    assert "share 4 cells" in inside
    (thin,) = said((soft, stiff), lambda y: (y > 1.0) & (y < 1.1))
    assert "body 1 is thinner than a cell along y at x=[0.125 1.125]" in thin
