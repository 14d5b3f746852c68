"""Stress of material points, double-mapped onto the grid, as a field and in runs."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import ufl
from dolfinx import fem

import mpm_fenicsx as mpm
from mpm_fenicsx.mapping.internal_force import ConstantStress
from mpm_fenicsx.mapping.mapped_stress import MappedStress
from mpm_fenicsx.scenes import column

GRID = replace(mpm.DM_GC, stress=mpm.DOUBLE_MAPPED)


# -- as a field ------------------------------------------------------------------------------------


def block(dim, mapping=mpm.DM_GC):
    """Soil at rest that fills the lower cells of a grid of 4 × 3 (× 2) cells."""
    cells = (4, 3, 2)[:dim]
    grid = mpm.Grid.box((0,) * dim, cells, cells)
    soil = mpm.LinearElastic(1e6, 0.3, 1000.0)
    body = mpm.MaterialPoints.fill(grid, soil, 4 if dim == 2 else 8, inside=lambda x: x[1] < 2)
    terms = [mpm.Fixed(grid.facets("bottom"), "xyz"[:dim])]
    return mpm.Simulation(grid, body, mpm.QuasiStatic(1), terms, mapping=mapping)


@pytest.mark.parametrize("dim", [2, 3])
def test_uniform_stress_is_met_exactly_and_linear_stress_in_its_mean(dim):
    run = block(dim)
    (body,) = run.bodies
    uniform = np.arange(1.0, mpm.tensors.components(dim) + 1)
    body.stress[:] = uniform
    field = run.stress_field()
    full = field.grid.lattice.upper[:, 1] <= 2
    assert np.array_equal(field.filled[: len(full)], full)
    np.testing.assert_allclose(
        field.values[full], np.broadcast_to(uniform, field.values[full].shape), rtol=1e-14
    )
    assert not field.values[~full].any()
    body.stress[:] = 0.0
    body.stress[:, 1] = body.x[:, 0]
    assert run.stress_field() is field
    centre = 0.5 * (field.grid.lattice.lower + field.grid.lattice.upper)[full]
    np.testing.assert_allclose(field.values[full, :, 1].mean(axis=1), centre[:, 0], rtol=1e-14)
    # points at 1/4 and 3/4: the slope that eq. (7) leaves is (¾ - ¼) · 2 · (¾ - ¼) · ½ = ¼ of it
    corner = field.values[full, :, 1] - centre[:, :1]
    np.testing.assert_allclose(corner[:, 1] - corner[:, 0], 0.25, rtol=1e-13)


def test_between_points_the_field_answers_and_outside_the_material_nothing():
    run = block(2)
    run.bodies[0].stress[:, 0] = 7.0
    field = run.stress_field()
    found = field.at([[0.5, 0.5], [1.3, 1.9], [0.5, 2.5], [9.0, 0.0]])
    np.testing.assert_allclose(found[:2, 0], 7.0, rtol=1e-14)
    assert np.isnan(found[2:]).all()
    with pytest.raises(ValueError, match=r"places must be \(n, 2\)"):
        field.at([1.0, 2.0, 3.0])


def test_the_field_is_a_coefficient_of_forms():
    """∫ σ : ∇w of a uniform stress pulls at the nodes as the points do."""
    run = block(2)
    run.bodies[0].stress[:] = [3.0, -1.0, 0.5, 2.0]
    field = run.stress_field()
    assert isinstance(field.function, fem.Function)
    w = ufl.TestFunction(run.grid.space)
    force = fem.petsc.assemble_vector(fem.form(ufl.inner(field.tensor, ufl.grad(w)) * ufl.dx))
    np.testing.assert_allclose(force.array, run._internal_force(), atol=1e-13)  # of the same points
    mean = fem.assemble_scalar(fem.form(field.function[2] * ufl.dx))
    assert mean == pytest.approx(0.5 * 8.0, rel=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_around_a_place_linear_stress_is_exact_and_does_not_jump_at_grid_lines(dim):
    run = block(dim)
    (body,) = run.bodies
    body.stress[:, 1] = 3.0 * body.x[:, 0] - body.x[:, 1]
    field = run.stress_field()
    rest = (1.0, 1.0)[: dim - 1]
    for x in (1.0, 1.3, 1.5, 2.0 - 1e-9, 2.0, 2.0 + 1e-9, 2.5):
        found = field.around(np.array([x, *rest]))
        assert found[1] == pytest.approx(3.0 * x - 1.0, rel=1e-8)
    assert np.isnan(field.around(np.array([0.5, 2.5, 0.5][:dim]))).all()
    low, high = field.at([[2.0 - 1e-9, *rest], [2.0, *rest]])[:, 1]
    assert high - low > 2.0  # the field itself jumps


def test_integrals_over_cut_cells_go_by_the_fill():
    grid = mpm.Grid.box((0, 0), (2, 5), (4, 10))
    soil = mpm.LinearElastic(1e6, 0.3, 1000.0)
    body = mpm.MaterialPoints.fill(grid, soil, 4, inside=lambda x: x[1] < 3.75)
    body.stress[:, 1] = -1e3
    field = mpm.Simulation(grid, body, mpm.Newmark(1e-3), []).stress_field()
    found = fem.assemble_scalar(fem.form(field.fill * field.function[1] * ufl.dx))
    assert found == pytest.approx(-1e3 * 2.0 * 3.75, rel=1e-12)
    assert field.fill.x.array.max() == pytest.approx(1.0, rel=1e-12)


# -- in a run --------------------------------------------------------------------------------------


def test_in_a_column_both_forces_are_one():
    """∇N is constant along a row of cells: the same sum to round-off, in statics and dynamics."""
    top = {}
    for mapping in (mpm.DM_GC, GRID):
        run = column.material_points("viscous", load=300e3, mapping=mapping)
        run.until(0.2)
        top[mapping] = run.bodies[0].stress[:, 1].copy()
    assert np.abs(top[mpm.DM_GC]).max() > 100e3
    np.testing.assert_allclose(top[GRID], top[mpm.DM_GC], atol=1e-9 * np.abs(top[GRID]).max())


def test_only_who_names_it_pays_and_nonsense_is_refused():
    assert isinstance(block(2).stress, ConstantStress)
    assert isinstance(block(2, GRID).stress, MappedStress)
    with pytest.raises(ValueError, match=r"mapping DM-GCL has it linear over support domains"):
        replace(mpm.DM_GCL, stress=mpm.DOUBLE_MAPPED)
    with pytest.raises(ValueError, match="stress must be"):
        replace(mpm.DM_GC, stress="grid")


# -- of finite elements ----------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_the_field_of_finite_elements_is_their_own_stress(dim):
    """A bent block: ε(u) is bilinear on these cells, and so is the field, everywhere."""
    cells = (3, 2, 2)[:dim]
    grid = mpm.Grid.box((0,) * dim, cells, cells)
    soil = mpm.LinearElastic(1e6, 0.3, 1000.0)
    run = mpm.FiniteElements(
        grid, soil, mpm.QuasiStatic(1), [mpm.Fixed(grid.facets("bottom"), "xyz"[:dim])]
    )
    u = run.motion.nodal(run.displacement)
    u[:] = np.random.default_rng(1).normal(size=u.shape)
    field = run.stress_field()
    # at places anywhere, from hand-made gradients of the nodal values
    x = np.random.default_rng(2).uniform(0, cells, (20, dim))
    node = grid.space.tabulate_dof_coordinates()[:, :dim]
    away = x[:, None, :] - node
    hat, slope = np.maximum(0, 1 - np.abs(away)), np.where(np.abs(away) < 1, -np.sign(away), 0.0)
    gradient = np.stack(
        [
            np.prod([slope[..., e] if e == d else hat[..., e] for e in range(dim)], axis=0) @ u
            for d in range(dim)
        ],
        axis=-1,
    )
    λ, μ = soil.lame
    strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
    trace = np.trace(strain, axis1=1, axis2=2)
    exact = λ * trace[:, None, None] * np.eye(dim) + 2 * μ * strain
    np.testing.assert_allclose(
        mpm.tensors.matrix(field.at(x), dim), exact, rtol=0, atol=1e-12 * np.abs(exact).max()
    )
    if dim == 2:
        np.testing.assert_allclose(field.at(x)[:, 2], λ * trace, atol=1e-12 * np.abs(exact).max())


# -- in probes -------------------------------------------------------------------------------------


def test_a_probe_sees_the_field_where_its_place_has_gone():
    """A free block in flight, its stress linear across it: between points the probe reads the
    mapped field at the place that has moved with the block."""
    grid = mpm.Grid.box((0, 0), (6, 4), (6, 4))
    soil = mpm.LinearElastic(1e3, 0.3, 1000.0)
    body = mpm.MaterialPoints.fill(grid, soil, 4, inside=lambda x: (x[0] < 3) & (x[1] < 3))
    body.velocity = np.tile([2.0, 0.0], (len(body), 1))
    run = mpm.Simulation(grid, body, mpm.Newmark(0.1), [])
    probe = run.record(mpm.Probe("grid_stress", at=(1.4, 1.6)))
    assert not probe.values.any()
    run.until(0.5)
    body.stress[:, 0] = 5.0 * body.x[:, 0]
    probe(run)
    exact = run.stress_field().around(np.array([1.4 + 2.0 * 0.5, 1.6]))
    np.testing.assert_allclose(probe.values[-1], exact, rtol=1e-9)
    assert 5.0 < probe.values[-1, 0] < 15.0


def test_a_probe_of_finite_elements_stays_where_it_is():
    grid = mpm.Grid.box((0, 0), (2, 4), (2, 4))
    soil = mpm.LinearElastic(1e6, 0.25, 1000.0)
    terms = [mpm.Fixed(grid.facets("bottom"), "xy"), mpm.Fixed(grid.facets("left", "right"), "x")]
    terms += [mpm.Gravity((0.0, -10.0))]
    run = mpm.FiniteElements(grid, soil, mpm.QuasiStatic(1), terms)
    probe = run.record(mpm.Probe("grid_stress", at=(0.5, 2.5)))
    run.step()
    # halfway up a cell, σ_yy = ρ g (y - 4) exactly
    np.testing.assert_allclose(probe.values[:, 1], [0.0, -15e3], rtol=1e-9)


# -- in snapshots ----------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_a_snapshot_shows_each_filled_cell_with_corners_of_its_own(dim, tmp_path):
    run = block(dim)
    (body,) = run.bodies
    body.stress[:, 1] = body.x[:, 0] + 10 * body.x[:, 1]
    run.record(mpm.Snapshots(tmp_path / "block", grid_stress=True))
    mesh = meshio.read(tmp_path / "block_stress_000000.vtu")
    field, (cells,) = run.stress_field(), (block.data for block in mesh.cells)
    filled = np.flatnonzero(field.filled)
    assert len(cells) == len(filled) == 4 * 2 * (1 if dim == 2 else 2)
    assert len(np.unique(cells)) == cells.size  # no corner is shared
    # the corner of a VTK cell lies where the field has the value that is written there
    inside = 1e-9 * (mesh.points[cells].mean(axis=1, keepdims=True) - mesh.points[cells])
    found = field.at((mesh.points[cells] + inside)[..., :dim].reshape(-1, dim))
    np.testing.assert_allclose(
        mesh.point_data["stress"][cells].reshape(-1, 6)[:, 1], found[:, 1], rtol=1e-8
    )
    # in VTK's order the corners of a face go round it
    along = np.diff(mesh.points[cells][:, :4], axis=1)
    assert (np.linalg.norm(along, axis=2) == 1.0).all()


def test_bodies_in_contact_have_fields_of_their_own():
    soil = mpm.LinearElastic(1e6, 0.3, 1000.0)
    grid = mpm.Grid.box((0, 0), (2, 4), (2, 4))
    runs = []
    for low in (0, 2):
        inside = lambda x, low=low: (x[1] > low) & (x[1] < low + 2)  # noqa: E731
        body = mpm.MaterialPoints.fill(grid, soil, 4, inside=inside)
        side = mpm.Fixed(grid.facets("bottom" if low == 0 else "top"), "xy")
        run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [side])
        runs.append((run, body.surface("top" if low == 0 else "bottom")))
    meet = mpm.Contact(*runs)
    with pytest.raises(ValueError, match="nodal velocity is of one body"):
        meet.nodal("velocity")
    with pytest.raises(ValueError, match="stress on the grid is of one body"):
        meet.record(mpm.Probe("grid_stress", at=(0.5, 0.5)))
    probe = runs[0][0].record(mpm.Probe("grid_stress", at=(0.5, 0.5)))
    assert probe.values.shape == (1, 4)
