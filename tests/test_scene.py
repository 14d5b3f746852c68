"""What a scene holds: loads in every shape, one patch a surface, surface points that follow the grid."""

import gc
import weakref

import dense
import numpy as np
import pytest

from mpm_fenicsx import (
    DM_GC,
    GIMP,
    MPM,
    Fixed,
    Gravity,
    MaterialPoints,
    Newmark,
    QuasiStatic,
    Simulation,
    SurfacePoints,
    Traction,
    Viscoelastic,
    Viscous,
)
from mpm_fenicsx.loads import as_load


@pytest.fixture
def grid():
    return dense.uneven(2)


@pytest.mark.parametrize(("value", "placed", "expected"), [
    ((1.0, -2.0), False, [1.0, -2.0]),
    (lambda t: (t, -2.0), False, [0.5, -2.0]),
    (lambda t, x: (t, -2.0), True, [0.5, -2.0]),
    (lambda t, x: x + t, True, [[1.5, 2.5], [3.5, 4.5]]),
])
def test_a_load_is_numbers_or_a_function_of_time_or_of_time_and_place(value, placed, expected):
    function, found = as_load("value", value, 2)
    assert found is placed
    np.testing.assert_array_equal(function(0.5, np.array([[1.0, 2.0], [3.0, 4.0]])), expected)


def test_a_load_keeps_the_numbers_it_was_given():
    value = np.array([1.0, 2.0])
    function, _ = as_load("value", value, 2)
    value[:] = 99.0
    np.testing.assert_array_equal(function(0.0, np.zeros((1, 2))), [1.0, 2.0])


def test_terms_on_one_surface_share_its_patch(grid):
    scene = dense.bare_scene(grid, Newmark(0.01))
    body = MaterialPoints.fill(grid, dense.SOIL, 4)
    bottom, top = grid.facets("bottom"), body.surface("top")
    for on in (bottom, top):
        Viscoelastic(on, dense.SOFT, 2.0).bind(scene)
        Traction(on, (1.0, 2.0)).bind(scene)
    assert len(scene.patches) == 2
    scene.prepare(0.0, 0.01)
    before = top.x.copy()
    scene.motion.u.x.array[:] = 1e-3
    scene.carry()
    np.testing.assert_allclose(top.x - before, 1e-3, rtol=1e-12)  # once, not once a term


def test_surface_points_follow_a_linear_motion_as_nanson_says():
    rng = np.random.default_rng(5)
    for dim in (2, 3):
        grid = dense.uneven(dim)
        x = 0.2 + 0.5 * rng.random((7, dim))
        normal = rng.normal(size=(7, dim))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        on = SurfacePoints(x, normal, np.ones(7))
        scene = dense.bare_scene(grid, Newmark(0.01))
        Viscous(on, dense.SOFT).bind(scene)
        scene.prepare(0.0, 0.01)
        H = 0.1 * rng.normal(size=(dim, dim))
        scene.motion.u.x.array[:] = dense.at_nodes(grid, lambda y, H=H: y @ H.T)
        scene.carry()
        F = np.eye(dim) + H
        expected = np.linalg.det(F) * normal @ np.linalg.inv(F)
        np.testing.assert_allclose(on.x, x @ F.T, rtol=1e-12)
        np.testing.assert_allclose(on.area[:, None] * on.normal, expected, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(on.normal, axis=1), 1.0, rtol=1e-12)


def test_a_surface_point_on_a_cell_edge_belongs_to_the_cell_inside(grid):
    at = float(np.unique(grid.space.tabulate_dof_coordinates()[:, 1].round(12))[1])
    for up in (1.0, -1.0):
        scene = dense.bare_scene(grid, Newmark(0.01))
        on = SurfacePoints([[0.1, at]], [[0.0, up]], [1.0])
        scene.patch(on)
        scene.prepare(0.0, 0.01)
        centre = 0.5 * (grid.lattice.lower + grid.lattice.upper)[scene.patch(on)._cell[0]]
        assert (centre[1] < at) == (up > 0)


# -- a scene pays only for what it names ----------------------------------------------------------------------------


def test_a_static_scene_has_no_velocities(grid):
    body = MaterialPoints.fill(grid, dense.SOIL, 4)
    run = Simulation(grid, body, QuasiStatic(2), [Fixed(grid.facets("bottom")), Traction(grid.facets("top"), (0, -1))])
    run.step()
    assert body.velocity is None
    assert body.acceleration is None
    for name in ("v", "a", "velocity", "acceleration"):
        assert not hasattr(run.motion, name)
    assert not hasattr(run, "_deposit")
    assert "kinetic" not in run.energy()


def test_only_springs_make_surfaces_remember(grid):
    body = MaterialPoints.fill(grid, dense.SOIL, 4)
    for make, remembers in ((lambda on: Viscous(on, dense.SOFT), False),
                            (lambda on: Traction(on, (0.0, -1.0)), False),
                            (lambda on: Viscoelastic(on, dense.SOFT, 2.0), True)):
        points, facets = body.surface("bottom"), grid.facets("bottom")
        run = Simulation(grid, MaterialPoints.fill(grid, dense.SOIL, 4), Newmark(1e-3), [make(points), make(facets)])
        assert (points.displacement is not None) is remembers
        on_facets = run.scene.patch(facets)
        assert bool(on_facets.state()) is remembers
        assert ("displacement" in run.scene.patch(points).state()) is remembers


@pytest.mark.parametrize("mapping", [MPM, GIMP, DM_GC], ids=str)
def test_only_composite_mappings_have_patches(grid, mapping):
    run = Simulation(grid, MaterialPoints.fill(grid, dense.SOIL, 4), Newmark(1e-3), [], mapping)
    assert bool(run.composites) is mapping.composite
    assert run.stencils[0].nodes.shape[1] == (9 if mapping.support else 4)


def test_a_scene_without_terms_has_nothing_to_prepare(grid):
    run = Simulation(grid, MaterialPoints.fill(grid, dense.SOIL, 4), Newmark(1e-3), [])
    assert run.scene.patches == {}
    assert run.scene.before == []
    assert run.scene.fixed == []
    assert len(Simulation(grid, run.bodies, Newmark(1e-3), [Gravity((0, -1))]).scene.before) == 1


def test_the_tangent_has_no_dashpots_without_a_dashpot(grid):
    forms = [len(Simulation(grid, MaterialPoints.fill(grid, dense.SOIL, 4), Newmark(1e-3), terms)
                 .contributions) for terms in ([], [Viscous(grid.facets("bottom"), dense.SOFT)])]
    assert forms == [2, 3]


def test_a_load_outlives_the_form_it_was_made_for(grid):
    """A patch goes on writing the load of a term whose form is gone, so it must hold what it writes to."""
    scene = dense.bare_scene(grid, Newmark(0.01))
    loads = []
    for value in ((1.0, 2.0), lambda t, x: x):
        work = Traction(grid.facets("top"), value).bind(scene).work
        mine = [f for f in (*work.coefficients(), *work.constants()) if f not in (scene.motion.u,)]
        loads += [weakref.ref(f) for f in mine if hasattr(f, "value") or f.function_space != grid.space]
        del work, mine
    gc.collect()
    assert len(loads) == 2
    scene.prepare(0.0, 0.01)
    assert all(load() is not None for load in loads)
