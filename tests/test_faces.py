"""Faces that grid lines cross: their loads reach the nodes as the integral over the face does."""

import dense
import numpy as np
import pytest
from dense import SOIL

from mpm_fenicsx import Grid, MaterialPoints, Newmark, SurfacePoints
from mpm_fenicsx.terms.boundary_patches import PointPatch


def patch_of(grid, surface):
    patch = PointPatch(surface, dense.bare_scene(grid, Newmark(0.1)))
    patch.prepare(0.0, 0.0)
    return patch


def aside(grid, by, side="top"):
    """The upper (…) edge of a body in the middle of the grid, moved by ``by`` (dim,)."""
    low, high = (0.25, 0.75) if grid.dim == 3 else (0.1, 0.7)
    body = MaterialPoints.fill(
        grid, SOIL, 2**grid.dim, inside=lambda x: ((x > low) & (x < high)).all(axis=0)
    )
    surface = body.surface(side)
    surface.x += by
    return surface


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.0], ids=["along the grid", "tilted", "steep"])
@pytest.mark.parametrize("by", [(0.0, 0.0), (0.07, 0.0), (-0.05, 0.04), (0.08, 0.05)], ids=str)
def test_a_load_reaches_the_nodes_as_its_integral(by, turn):
    """Against an integration line by line that knows nothing of cells."""
    grid, rng = dense.uneven(2), np.random.default_rng(3)
    surface = aside(grid, by)
    F = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) - np.eye(2)
    surface.follow((surface.x - 0.5) @ F.T, np.tile(F, (len(surface), 1, 1)))
    patch, values = patch_of(grid, surface), rng.normal(size=(len(surface), 2))
    exact = dense.over_faces(grid, surface, values)
    np.testing.assert_allclose(patch.faces.weights.T @ values, exact, rtol=0, atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_in_a_uniform_field_it_is_force_and_moment(dim):
    grid = dense.uneven(dim)
    surface = aside(grid, 0.043)
    patch = patch_of(grid, surface)
    weights, nodes = patch.faces.weights, grid.space.tabulate_dof_coordinates()[:, :dim]
    assert len(patch.faces.stencil) > len(surface)
    np.testing.assert_allclose(weights @ nodes, surface.x, rtol=0, atol=1e-13)
    np.testing.assert_allclose(np.asarray(weights.sum(axis=1)).ravel(), 1.0, rtol=0, atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_uniform_stress_is_in_equilibrium_wherever_the_body_is(dim):
    """Σ_p V_p σ ∇S_ip = Σ ∫ N_i σ n dA over all sides, at every node: exact for support domains
    that tile the body."""
    from mpm_fenicsx.mapping.shape_functions import Stencil

    grid = Grid.box((0,) * dim, (1,) * dim, (5,) * dim)
    body = MaterialPoints.fill(
        grid, SOIL, 2**dim, inside=lambda x: ((x > 0.2) & (x < 0.6)).all(axis=0)
    )
    surface = body.surface(*["left", "right", "bottom", "top", "back", "front"][: 2 * dim])
    by = np.array([0.031, 0.017, 0.113])[:dim]
    body.x += by
    surface.x += by
    stencil, inner = Stencil(grid, len(body), support=True), np.zeros((grid.nodes, dim))
    stencil.place(body.x, body.half, grid.find(body.x))
    stress = np.diag([3.0, 2.0, 1.0][:dim])
    stencil.deposit_divergence(body.volume[:, None, None] * stress, inner)
    outer = patch_of(grid, surface).faces.weights.T @ (
        surface.area[:, None] * surface.normal @ stress
    )
    assert np.abs(outer).max() > 1e-3
    np.testing.assert_allclose(outer, inner, rtol=0, atol=1e-15)


def test_a_face_within_a_cell_is_left_alone():
    patch = patch_of(dense.uneven(2), aside(dense.uneven(2), (0.0, 0.0)))
    assert patch.faces.stencil is patch.stencil


def test_a_face_that_rests_on_a_grid_line_or_ends_there_is_not_cut():
    """To a hair: a sliver would bear load where there is no mass."""
    grid = Grid.box((0, 0), (1, 1), (4, 4))
    for hair in (0.0, 1e-16, -1e-16, 1e-12):
        surface = MaterialPoints.fill(
            grid, SOIL, 4, inside=lambda x: (x < 0.5).all(axis=0)
        ).surface("top", "right")
        surface.x += hair
        assert len(patch_of(grid, surface).faces.stencil) == len(surface)


def test_a_face_that_reaches_out_of_the_grid_is_refused():
    """Its Gauss points are inside, three cells apart, and the line between them has been cut."""
    grid, x = Grid.box((0, 0), (1, 1), (4, 1)), 0.5 + np.array([-1.0, 1.0]) * 0.49
    surface = SurfacePoints(
        np.column_stack((x, [0.5, 0.5])), [[0, 1], [0, 1]], np.ones(2), per_face=2
    )
    with pytest.raises(ValueError, match="face of the surface reaches out of the grid at x="):
        patch_of(grid, surface)


def test_points_that_stand_for_themselves_are_not_cut():
    grid, surface = dense.uneven(2), aside(dense.uneven(2), (0.07, 0.0))
    alone = SurfacePoints(surface.x, surface.normal, surface.area)
    assert len(patch_of(grid, alone).faces.stencil) == len(alone)
    np.testing.assert_allclose(
        patch_of(grid, alone).faces.weights.toarray(), dense.hats(grid, alone.x), atol=1e-14
    )


@pytest.mark.parametrize("per_face", [0, 3, 4])
def test_faces_that_make_no_sense_are_refused(per_face):
    with pytest.raises(
        ValueError, match=f"per_face must be 1 or 2, with whole faces, got {per_face} for 2 points"
    ):
        SurfacePoints(np.zeros((2, 2)), [[0, 1], [0, 1]], np.ones(2), per_face=per_face)
