"""Properties of any grid, points and support domains: completeness, conservation, and no preferred
frame.

Tolerances are round-off times the size of what is summed, and for a step times the condition of its
matrix.
"""

from dataclasses import replace
from itertools import product

import dense
import inside
import numpy as np
import pytest
import ufl
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from strewn import (
    SOIL,
    domains,
    grid_of,
    in_frame,
    lines_of,
    scene,
    size_of,
    strewn,
    strewn_body,
    turned_stress,
)

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.mapping.composite_patches import Composite
from mpm_fenicsx.mapping.projection import AT_POINTS, DOUBLE_MAPPED, Projection
from mpm_fenicsx.mapping.shape_functions import Stencil
from mpm_fenicsx.materials.kinematics import FINITE_STRAIN

WHOLE = [Phase.explicit, Phase.reuse, Phase.generate]
EXACT = mpm.Solver(
    newton=mpm.Newton(tolerance=1e-13), petsc={"ksp_type": "preonly", "pc_type": "lu"}
)
RUBBER = mpm.Hencky(young=20e6, poisson=0.25, density=1500.0)
DIMS = pytest.mark.parametrize("dim", [2, 3], ids=["2D", "3D"])
ALL = (*mpm.MAPPINGS, mpm.DM_GCL)
METHODS = pytest.mark.parametrize("mapping", ALL, ids=str)
LAWS = pytest.mark.parametrize("law", [SOIL, RUBBER], ids=["small strain", "Hencky"])


def few(examples):
    return settings(max_examples=examples, deadline=None, phases=[*WHOLE, Phase.shrink])


def seeds(test):
    """Three whole scenes at random, which cannot be made simpler."""
    return settings(max_examples=3, deadline=None, phases=WHOLE)(
        given(seed=st.integers(0, 10**6))(test)
    )


def placed(grid, x, half):
    stencil = Stencil(grid, len(x), support=half is not None)
    stencil.place(x, half, grid.find(x))
    return stencil


# -- weights ---------------------------------------------------------------------------------------


@DIMS
@few(40)
@given(data=st.data())
def test_weights_are_complete(dim, data):
    """Σ S = 1, Σ ∇S = 0, Σ x_i S = the centre of the domain as it is cut off, Σ x_i ∇S = 1,
    composite patches too."""
    lines = data.draw(lines_of(dim))
    x, half = data.draw(strewn(lines))
    grid, (far, h) = grid_of(lines), size_of(lines)
    node = grid.space.tabulate_dof_coordinates()[:, :dim]
    unity = np.broadcast_to(np.eye(dim), (len(x), dim, dim))
    for extent in (None, half):
        stencil = placed(grid, x, extent)
        (a, b) = domains(lines, x, 0 * x if extent is None else extent)
        assert (stencil.values > -1e-14).all()
        np.testing.assert_allclose(stencil.values.sum(axis=1), 1, rtol=0, atol=1e-14)
        np.testing.assert_allclose(stencil.at_points(node), (a + b) / 2, rtol=0, atol=1e-14 * far)
        np.testing.assert_allclose(stencil.gradients.sum(axis=1), 0, rtol=0, atol=1e-14 / h)
        np.testing.assert_allclose(
            stencil.gradient_at_points(node), unity, rtol=0, atol=1e-13 * far / h
        )
    filled, cell = np.zeros(grid.cells, np.int8), grid.find(x)
    filled[cell] = 1
    composite = Composite(grid)
    composite.place(filled)
    ones = composite.gradient_at_points(x, cell, np.ones_like(node))
    np.testing.assert_allclose(ones, 0, rtol=0, atol=1e-13 / h)
    np.testing.assert_allclose(
        composite.gradient_at_points(x, cell, node), unity, rtol=0, atol=1e-12 * far / h
    )


@DIMS
@few(20)
@given(
    data=st.data(),
    mapping=st.sampled_from([mpm.MPM, mpm.GIMP, mpm.DM_GCL]),
    seed=st.integers(0, 10**6),
)
def test_internal_force_has_no_sum_and_its_virial_is_the_stress(dim, data, mapping, seed):
    """Σ f_i = 0 and Σ f_i ⊗ x_i symmetric, Σ V σ where stress is constant over a domain: no moment
    on a free body."""
    lines = data.draw(lines_of(dim))
    body, (far, h) = strewn_body(data.draw, lines, np.random.default_rng(seed)), size_of(lines)
    run = mpm.Simulation(grid_of(lines), body, mpm.Newmark(1e-3), [], mapping)
    run.prepare(0.0, 1e-3)
    f = run._internal_force().reshape(-1, dim)
    work = body.volume[:, None, None] * tensors.matrix(body.stress, dim)
    scale = np.abs(work).sum()
    np.testing.assert_allclose(f.sum(axis=0), 0, rtol=0, atol=1e-14 * scale / h)
    virial = f.T @ run.grid.space.tabulate_dof_coordinates()[:, :dim]
    wanted = virial.T if mapping.linear else work.sum(axis=0)
    np.testing.assert_allclose(virial, wanted, rtol=0, atol=1e-13 * scale * far / h)


# -- conservation ----------------------------------------------------------------------------------


@DIMS
@few(20)
@given(data=st.data(), averaged=st.booleans())
def test_projected_moments_are_those_of_the_points(dim, data, averaged):
    """∫ ρ_h x^α = Σ m ⟨x^α⟩, the means over support domains: at the points for all α up to 2 in
    each direction, double-mapped for α = 0."""
    lines = data.draw(lines_of(dim))
    x, half = data.draw(strewn(lines))
    middle = np.array([(line[0] + line[-1]) / 2 for line in lines])
    half = half if averaged else 0 * half
    mass = np.random.default_rng(len(x)).uniform(0.5, 2.0, len(x))
    a, b = (end - middle for end in domains(lines, x, half))
    mean = np.stack((np.ones_like(a), (a + b) / 2, (a * a + a * b + b * b) / 3))
    grid = grid_of(lines)
    found = {}
    for integration in (AT_POINTS, DOUBLE_MAPPED):
        projection = Projection(grid, integration, 1)
        projection.add(placed(grid, x, half if averaged else None), mass[:, None])
        projection.finish()
        V = projection.fields[0].function_space
        load = dense.vector(
            V,
            projection.fields[0] * ufl.TestFunction(V) * grid.dx(metadata={"quadrature_degree": 8}),
        )
        y = V.tabulate_dof_coordinates()[:, :dim] - middle
        powers = product(range(1 + integration.degree), repeat=dim)
        found[integration] = {α: load @ (y**α).prod(axis=1) for α in powers}
    reach = max(np.ptp(line) for line in lines)
    for α, moment in found[AT_POINTS].items():
        exact = mass @ np.prod([mean[k, :, d] for d, k in enumerate(α)], axis=0)
        np.testing.assert_allclose(moment, exact, rtol=0, atol=1e-13 * mass.sum() * reach ** sum(α))
    np.testing.assert_allclose(found[DOUBLE_MAPPED][(0,) * dim], mass.sum(), rtol=1e-13)


@DIMS
@few(20)
@given(
    data=st.data(),
    mapping=st.sampled_from(ALL),
    sweeps=st.integers(0, 2),
    seed=st.integers(0, 10**6),
)
def test_the_deposit_gives_the_grid_the_momentum_of_the_points(dim, data, mapping, sweeps, seed):
    """1ᵀM v = Σ m v, and the same of accelerations, however many sweeps; wherever points lie."""
    lines = data.draw(lines_of(dim))
    body = strewn_body(data.draw, lines, np.random.default_rng(seed))
    mapping = replace(mapping, sweeps=sweeps, hold_cut_cells=False)
    run = mpm.Simulation(grid_of(lines), body, mpm.Newmark(1e-3), [], mapping)
    run.prepare(0.0, 1e-3)
    run.predict()
    for field in ("velocity", "acceleration"):
        values, on_grid = getattr(body, field), inside.times_mass(run, run.nodal(field)).sum(axis=0)
        np.testing.assert_allclose(
            on_grid, body.mass @ values, rtol=0, atol=1e-12 * (body.mass @ np.abs(values)).max()
        )


# -- a step ----------------------------------------------------------------------------------------


def stepped(lines, body, gravity, mapping):
    """A copy of the body after a step at a Courant number of about one half."""
    fresh = mpm.MaterialPoints(
        body.material, body.x, body.half, body.volume, body.stress, body.velocity, body.acceleration
    )
    run = mpm.Simulation(
        grid_of(lines),
        fresh,
        mpm.Newmark(2e-3),
        [mpm.Gravity(tuple(gravity))],
        mapping,
        EXACT,
    )
    run.step()
    return fresh


@METHODS
@DIMS
@seeds
def test_a_step_keeps_the_momentum_of_a_free_body(dim, mapping, seed):
    """The grid's accelerations at its end have no sum, so that Σ m Δv = ½ Δt Σ m a, with a those at
    its start."""
    rng = np.random.default_rng(seed)
    lines, body, _ = scene(dim, (SOIL, RUBBER)[rng.integers(2)], rng, on_lines=True)
    mapping = replace(
        mapping, sweeps=rng.integers(4), transfer=(mpm.trapezoidal, mpm.flip)[rng.integers(2)]
    )
    after = stepped(lines, body, np.zeros(dim), mapping)
    change = body.mass @ (after.velocity - body.velocity - 1e-3 * body.acceleration)
    assert np.abs(after.velocity - body.velocity).max() > 0.01
    np.testing.assert_allclose(
        change, 0, rtol=0, atol=1e-12 * (body.mass @ np.abs(after.velocity)).max()
    )


def compare(found, wanted):
    """Points and what they carry, to the round-off of the step's change."""
    sizes = {
        "x": 1e-2,
        "half": 1e-2,
        "volume": 1e-2,
        "velocity": 1.0,
        "acceleration": 1e3,
        "stress": 1e5,
    }
    for name, size in sizes.items():
        value = getattr(wanted, name)
        np.testing.assert_allclose(
            getattr(found, name), value, rtol=0, err_msg=name, atol=1e-10 * size
        )


@LAWS
@METHODS
@DIMS
@seeds
def test_a_step_elsewhere_and_on_the_move_is_the_same(dim, mapping, law, seed):
    """In x + s, with v + c, a + b and g + b, points go further by Δt c + ½ Δt² b, and nothing else
    knows of it."""
    rng = np.random.default_rng(seed)
    lines, body, g = scene(dim, law, rng, on_lines=True)
    s = rng.integers(-300, 300, dim) / 32.0
    c = 10 * rng.normal(size=dim)
    b = 100 * rng.normal(size=dim)
    Δt = 2e-3
    mapping, one = replace(mapping, sweeps=rng.integers(4)), np.eye(dim)
    there = stepped(
        [line + by for line, by in zip(lines, s, strict=True)],
        in_frame(body, one, s, c, b),
        g + b,
        mapping,
    )
    here = stepped(lines, body, g, mapping)
    compare(there, in_frame(here, one, s + Δt * c + Δt**2 / 2 * b, c + Δt * b, b))


@LAWS
@METHODS
@DIMS
@seeds
def test_a_step_turned_or_mirrored_is_the_step_turned_or_mirrored(dim, mapping, law, seed):
    """By all the symmetries of a square or a cube."""
    rng = np.random.default_rng(seed)
    lines, body, g = scene(dim, law, rng, on_lines=False)
    order, sign = rng.permutation(dim), rng.choice([-1.0, 1.0], dim)
    Q = sign[:, None] * np.eye(dim)[order]
    turned = stepped(
        [np.sort(by * lines[d]) for by, d in zip(sign, order, strict=True)],
        in_frame(body, Q),
        Q @ g,
        mapping,
    )
    compare(turned, in_frame(stepped(lines, body, g, mapping), Q))


# -- the law ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("elastic", [SOIL, RUBBER], ids=["small strain", "Hencky"])
@pytest.mark.parametrize("yields", [False, True], ids=["elastic", "von Mises"])
@DIMS
@few(20)
@given(seed=st.integers(0, 10**6), mirrored=st.booleans())
def test_stress_turns_with_the_frame(dim, yields, elastic, seed, mirrored):
    """After Q F Rᵀ, from R σ Rᵀ, the stress is that of F from σ turned by Q: finite strain is
    objective, whatever Q, and all laws are isotropic, R = Q."""
    rng = np.random.default_rng(seed)
    law = mpm.VonMises(elastic, peak=300e3, residual=100e3, softening=800e3) if yields else elastic
    R, Q = (dense.rotation(rng, dim) for _ in range(2))
    if mirrored:
        R[0], Q[0] = -R[0], -Q[0]
    if law.kinematics is not FINITE_STRAIN:
        Q = R
    n = 8
    F = np.eye(dim) + np.geomspace(1e-4, 0.3, n)[:, None, None] * rng.uniform(
        -0.9, 0.9, (n, dim, dim)
    )
    here = mpm.MaterialPoints(law, np.zeros((n, dim)), np.ones((n, dim)), rng.uniform(0.8, 1.2, n))
    here.stress[:] = 1e5 * rng.normal(size=here.stress.shape)
    there = mpm.MaterialPoints(law, here.x, here.half, here.volume, turned_stress(here.stress, R))
    for body, f in ((here, F), (there, Q @ F @ R.T)):
        law.kinematics.respond(body, f - np.eye(dim))
    np.testing.assert_allclose(
        there.stress, turned_stress(here.stress, Q), rtol=0, atol=1e-12 * law.young
    )
    if yields:
        np.testing.assert_allclose(there.history, here.history, rtol=0, atol=1e-13)
