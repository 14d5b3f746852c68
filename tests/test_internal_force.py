"""Internal force of points: with stress linear over support domains it is the integral of the parts
that lines cut."""

from dataclasses import replace

import numpy as np
import pytest

from mpm_fenicsx import (
    DM_GCL,
    GIMP,
    MPM,
    Fixed,
    Grid,
    MaterialPoints,
    Newmark,
    QuasiStatic,
    Simulation,
)
from mpm_fenicsx.common import tensors
from mpm_fenicsx.dynamics.motion import Motion
from mpm_fenicsx.mapping.internal_force import ConstantStress, LinearStress
from mpm_fenicsx.mapping.mapped_stress import MappedStress
from mpm_fenicsx.mapping.shape_functions import Stencil


def edges(line, rng):
    """Edges of support domains along a direction: two of them in each cell, most domains lie across
    a grid line."""
    inner = line[:-1, None] + np.diff(line)[:, None] * [0.3, 0.8] * rng.uniform(
        0.9, 1.1, (len(line) - 1, 2)
    )
    return np.concatenate((line[:1], inner.ravel(), line[-1:]))


@pytest.fixture
def scene(grid, hats, soil):
    """Support domains that tile the grid, their stencil, and their edges."""
    rng = np.random.default_rng(5)
    lines = [edges(line, rng) for line in hats.lines]
    x, half = (
        np.stack(np.meshgrid(*parts, indexing="ij"), -1).reshape(-1, grid.dim)
        for parts in ([(a[1:] + a[:-1]) / 2 for a in lines], [np.diff(a) / 2 for a in lines])
    )
    body = MaterialPoints(soil, x, half, (2 * half).prod(axis=1))
    stencil = Stencil(grid, len(body), support=True)
    stencil.place(body.x, body.half, grid.find(body.x))
    return body, stencil, lines


class Field:
    """Random symmetric stress (n, dim, dim), linear in space."""

    def __init__(self, dim, rng):
        self.rest, self.slope = rng.normal(size=(dim, dim)), rng.normal(size=(dim, dim, dim))

    def __call__(self, x):
        σ = self.rest + np.einsum("ijk,nk->nij", self.slope, x)
        return σ + σ.transpose(0, 2, 1)


def rows(σ):
    """As rows of the points."""
    dim = σ.shape[1]
    out = np.zeros((len(σ), tensors.components(dim)))
    for d in range(dim):
        out[:, d] = σ[:, d, d]
    for k, (i, j) in enumerate(tensors.SHEAR[dim]):
        out[:, 3 + k] = σ[:, i, j]
    return out


def force_of(way, body, stencil, stresses=None):
    out = np.zeros((way.grid.nodes, way.grid.dim))
    way.add([body], [stencil], out, stresses)
    return out


def force(way, grid, body, stencil):
    return force_of(way(grid), body, stencil)


def by_hand(hats, lines, field):
    """Σ V_k σ(x_k) ∇N_i(x_k) over the parts that grid lines cut the domains into, x_k their
    centres."""
    dim = len(lines)
    cut = [np.unique(np.concatenate((line, hats.lines[d]))) for d, line in enumerate(lines)]
    x, size = (
        np.stack(np.meshgrid(*parts, indexing="ij"), -1).reshape(-1, dim)
        for parts in ([(a[1:] + a[:-1]) / 2 for a in cut], [np.diff(a) for a in cut])
    )
    pulled = size.prod(axis=1)[:, None, None] * field(x)
    hat = [hats.hat(d, x[:, d]) for d in range(dim)]
    out = np.zeros((len(hats.node), dim))
    for d in range(dim):
        gradient = np.prod(
            [hat[e][1 if e == d else 0][:, hats.place[:, e]] for e in range(dim)], axis=0
        )
        out += np.einsum("nj,ni->ij", pulled[:, :, d], gradient)
    return out


def test_linear_stress_is_integrated_part_by_part(grid, hats, scene):
    body, stencil, lines = scene
    assert (stencil.side != 0).any(axis=1).mean() > 0.5
    field = Field(grid.dim, np.random.default_rng(8))
    body.stress = rows(field(body.x))
    exact = by_hand(hats, lines, field)
    found = force(LinearStress, grid, body, stencil)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-11 * np.abs(exact).max())
    constant = force(ConstantStress, grid, body, stencil)
    assert np.abs(constant - exact).max() > 1e-3 * np.abs(exact).max()


def test_uniform_stress_pulls_as_ever(grid, scene):
    body, stencil, _ = scene
    body.stress[:] = rows(Field(grid.dim, np.random.default_rng(2))(np.zeros((1, grid.dim))))
    constant = force(ConstantStress, grid, body, stencil)
    np.testing.assert_allclose(
        force(LinearStress, grid, body, stencil),
        constant,
        rtol=0,
        atol=1e-12 * np.abs(constant).max(),
    )


def test_whatever_the_stress_force_and_moment_vanish(grid, hats, scene):
    """Σ f_i = 0, and Σ f_i ⊗ x_i, the virial, is symmetric."""
    body, stencil, _ = scene
    body.stress = np.random.default_rng(4).normal(size=body.stress.shape)
    found = force(LinearStress, grid, body, stencil)
    virial = found.T @ hats.node
    np.testing.assert_allclose(found.sum(axis=0), 0, atol=1e-11 * np.abs(found).max())
    np.testing.assert_allclose(virial, virial.T, atol=1e-10 * np.abs(virial).max())


def test_where_points_lie_in_a_row_stress_is_taken_as_constant(soil):
    grid = Grid.box((0, 0), (4, 1), (4, 1))
    body = MaterialPoints(
        soil, [[0.9, 0.5], [1.5, 0.5], [2.1, 0.5]], np.full((3, 2), 0.3), np.full(3, 0.36)
    )
    body.stress[:, 0] = [1.0, 5.0, -2.0]
    stencil = Stencil(grid, 3, support=True)
    stencil.place(body.x, body.half, grid.find(body.x))
    np.testing.assert_allclose(
        force(LinearStress, grid, body, stencil),
        force(ConstantStress, grid, body, stencil),
        atol=1e-14,
    )


def test_only_linear_mappings_pay_for_it_and_they_need_support_domains(soil):
    grid = Grid.box((0, 0), (2, 2), (2, 2))
    for mapping, way in ((GIMP, ConstantStress), (DM_GCL, LinearStress)):
        run = Simulation(
            grid,
            MaterialPoints.fill(grid, soil, 4),
            Newmark(1e-3),
            [Fixed(grid.facets("left"))],
            mapping,
        )
        assert type(run.stress) is way
    with pytest.raises(
        ValueError, match="linear stress needs support domains, and mapping MPM has none"
    ):
        replace(MPM, linear=True)


# -- double-mapped ---------------------------------------------------------------------------------


def mapped(grid):
    """Internal force of the double-mapped stress."""
    return MappedStress(Motion(grid, QuasiStatic(1)))


def double_mapped_by_hand(hats, body):
    """∫ φσ : ∇N_i dx, cell by cell with Gauss' rule of three points, φσ of eq. (7) from the hats.

    In cell c, node k: Σ_p V_p σ_p / |c| · ⟨N_k⟩_p / m_k, ⟨N_k⟩_p the mean over the support domain
    of N_k cut off at the cell's edges.
    """
    dim = len(hats.lines)
    stress = tensors.matrix(body.stress, dim)
    a, b = hats.box(body.x, body.half)
    ξ, weight = np.polynomial.legendre.leggauss(3)
    ξ, weight = 0.5 * (1 + ξ), 0.5 * weight
    out = np.zeros((len(hats.node), dim))
    for c in np.ndindex(*[len(line) - 1 for line in hats.lines]):
        low = np.array([line[i] for line, i in zip(hats.lines, c, strict=True)])
        h = np.array([line[i + 1] for line, i in zip(hats.lines, c, strict=True)]) - low
        mean = np.empty((len(body.x), dim, 2))  # of N_k over the part of the domain in the cell
        for d in range(dim):
            s, e = (np.clip((edge[:, d] - low[d]) / h[d], 0, 1) for edge in (a, b))
            size = (b[:, d] - a[:, d]) / h[d]
            mean[:, d, 1] = (e**2 - s**2) / 2 / size
            mean[:, d, 0] = (e - s) / size - mean[:, d, 1]
        for k in np.ndindex(*[2] * dim):
            ψ = np.prod([2 * mean[:, d, k[d]] for d in range(dim)], axis=0)
            σ = np.einsum("p,pij->ij", body.volume / h.prod() * ψ, stress)
            for q in np.ndindex(*[3] * dim):
                place = np.array([ξ[i] for i in q])
                hat = [np.array([1 - place[d], place[d]]) for d in range(dim)]
                there = np.prod([hat[d][k[d]] for d in range(dim)])
                measure = h.prod() * np.prod([weight[i] for i in q])
                for node in np.ndindex(*[2] * dim):
                    slope = np.array(
                        [
                            np.prod(
                                [
                                    (2 * node[d] - 1) / h[d] if d == e else hat[d][node[d]]
                                    for d in range(dim)
                                ]
                            )
                            for e in range(dim)
                        ]
                    )
                    i = np.flatnonzero((hats.place == np.add(c, node)).all(axis=1))[0]
                    out[i] += measure * there * σ @ slope
    return out


def test_the_force_is_the_integral_of_the_double_mapped_stress(grid, hats, scene):
    body, stencil, _ = scene
    body.stress = rows(Field(grid.dim, np.random.default_rng(8))(body.x))
    exact, found = double_mapped_by_hand(hats, body), force_of(mapped(grid), body, stencil)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * np.abs(exact).max())
    points = force_of(ConstantStress(grid), body, stencil)
    assert np.abs(points - exact).max() > 1e-3 * np.abs(exact).max()


def test_uniform_stress_double_mapped_pulls_as_at_the_points(grid, scene):
    body, stencil, _ = scene
    body.stress[:] = rows(Field(grid.dim, np.random.default_rng(2))(np.zeros((1, grid.dim))))
    points = force_of(ConstantStress(grid), body, stencil)
    np.testing.assert_allclose(
        force_of(mapped(grid), body, stencil), points, rtol=0, atol=1e-12 * np.abs(points).max()
    )


def test_whatever_the_stress_force_and_moment_vanish_double_mapped_too(grid, hats, scene):
    body, stencil, _ = scene
    body.stress = np.random.default_rng(4).normal(size=body.stress.shape)
    found = force_of(mapped(grid), body, stencil)
    virial = found.T @ hats.node
    np.testing.assert_allclose(found.sum(axis=0), 0, atol=1e-11 * np.abs(found).max())
    np.testing.assert_allclose(virial, virial.T, atol=1e-10 * np.abs(virial).max())


def test_a_stress_that_is_given_takes_the_place_of_the_own_one(grid, scene):
    body, stencil, _ = scene
    body.stress = np.random.default_rng(5).normal(size=body.stress.shape)
    own = force_of(mapped(grid), body, stencil)
    given = tensors.matrix(body.stress, grid.dim)
    body.stress = np.zeros_like(body.stress)
    np.testing.assert_allclose(force_of(mapped(grid), body, stencil, [given]), own, atol=1e-14)
    turn = np.zeros_like(given)
    turn[:, 0, 1], turn[:, 1, 0] = 1.0, -1.0
    skew = force_of(mapped(grid), body, stencil, [given + turn]) - own
    np.testing.assert_allclose(
        skew, force_of(ConstantStress(grid), body, stencil, [turn]), atol=1e-11
    )
