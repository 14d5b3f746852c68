"""Far fields and layers that hardly go on as the body does are told of when a run is built."""

import warnings

import numpy as np
import pytest
from heard import warned
from open_ground import soil, stiff

import mpm_fenicsx as mpm


def column(points=lambda x: x[1] > 4, far=lambda x: x[1] < 4, terms=(), step=None, pressure=0.0):
    grid = mpm.Grid.box((0.0, 0.0), (2.0, 8.0), (2, 8))
    body = mpm.MaterialPoints.fill(grid, soil, 4, points)
    always = [mpm.FarField(far, soil), mpm.Fixed(grid.facets("left", "right"), "x")]
    base = [mpm.Fixed(grid.facets("bottom"))]
    if pressure:
        terms = [mpm.Traction(grid.facets("top"), (0.0, -pressure))]
    step = step or mpm.Newmark(0.1)
    return mpm.Simulation(grid, body, step, [*always, *base, *terms])


@pytest.mark.parametrize(
    ("points", "far", "message"),
    [
        (lambda x: x[1] > 4.5, lambda x: x[1] < 4, "2 of the 2 cells beside it are partly filled"),
        (lambda x: x[1] > 5, lambda x: x[1] < 4, "no side in common"),
    ],
)
def test_gaps_are_told_of(points, far, message):
    with pytest.warns(UserWarning, match=f"FarField.*{message}"):
        column(points, far)


def test_what_meets_is_not():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        column()


def test_a_dashpot_between_points_and_far_field_is_told_of():
    edge = mpm.SurfacePoints.line((0.0, 4.0), (2.0, 4.0), 0.5)
    assert edge.normal[:, 1] == pytest.approx(-1.0)
    with pytest.warns(UserWarning, match="ViscousBoundary acts on a surface inside the soil"):
        column(terms=[mpm.ViscousBoundary(edge, soil)])


@pytest.mark.parametrize("points", [True, False])
@pytest.mark.parametrize("law", [soil, stiff])
def test_a_layer_of_other_ground_is_told_of(points, law):
    grid = mpm.Grid.box((0.0, 0.0), (16.0, 9.0), (16, 9))
    inside = lambda x: (x[0] > 3) & (x[0] < 13) & (x[1] > 3)  # noqa: E731
    layer = mpm.AbsorbingLayer(("left", "right", "bottom"), law, absorbing=2, elastic=1)
    step = mpm.Newmark(0.1)
    if points:
        body = mpm.MaterialPoints.fill(grid, soil, 4, inside)
        said = warned(lambda: mpm.Simulation(grid, body, step, [layer]))
    else:
        said = warned(lambda: mpm.FiniteElements(grid, soil, step, [layer]))
    told = [words for words in said if "AbsorbingLayer is of impedances" in words]
    assert len(told) == (law is stiff)


@pytest.mark.parametrize("field", ["displacement", "velocity", "stress"])
def test_probes_read_the_far_field(field):
    """Linear in y from the base: a column that is pressed, read at y = 2."""
    M, pressure = soil.lame[0] + 2 * soil.lame[1], 1e-4
    statics = column(step=mpm.QuasiStatic(1), pressure=pressure)
    if field == "velocity":
        with pytest.raises(ValueError, match="velocity"):
            statics.record(mpm.Probe(field, (1.0, 2.0)))
        return
    below = statics.record(mpm.Probe(field, (1.0, 2.0)))
    statics.until(1.0)
    exact = {"displacement": -2.0 * pressure / M, "stress": -pressure}[field]
    assert below.values[-1][1] == pytest.approx(exact, rel=1e-6)


def test_a_probe_of_released_cells_says_so():
    run = column()
    run.record(mpm.Probe("displacement", (1.0, 2.5)))
    run.step()
    run.release(lambda x: x[1] > 2)
    with pytest.raises(ValueError, match="released them"):
        run.step()


def test_a_checkpoint_wants_the_same_release(tmp_path):
    run = column()
    run.step()
    run.release(lambda x: x[1] > 3)
    run.record(mpm.Checkpoint(tmp_path / "state.npz", every=1))
    run.step()
    other = column()
    with pytest.raises(ValueError, match=r"had released 2 cells.*call run.release"):
        other.restart(tmp_path / "state.npz")
    other.release(lambda x: x[1] > 3)
    other.restart(tmp_path / "state.npz")
    assert np.array_equal(other.bodies[1].x, run.bodies[1].x)


@pytest.mark.parametrize("how", [{"fair": "yes"}, {"follows": 1.5}])
def test_flags_are_true_or_false(how):
    with pytest.raises(ValueError, match=f"{next(iter(how))} must be True or False"):
        mpm.FarField(lambda x: x[1] < 4, soil, **how)
