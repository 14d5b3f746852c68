"""A quick look shows the numbers that the points have, where they are, with their units."""

import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import matplotlib
import numpy as np
import pytest
from test_output import SOIL, box, fe, mpm, regular
from test_ranks import environment, on_ranks

import mpm_fenicsx
from mpm_fenicsx import MaterialPoints, VonMises, plot
from mpm_fenicsx.common import tensors

matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def no_figure_stays_open():
    import matplotlib.pyplot as plt

    yield
    plt.close("all")


def shown(ax):
    """The one collection of a picture, and its values."""
    (shapes,) = ax.collections
    return shapes, np.ma.filled(shapes.get_array(), np.nan)


def bar_label(ax):
    """What is written beside the colours."""
    return ax.collections[0].colorbar.ax.get_ylabel()


def ends(shapes):
    """Lower and upper corners (n, 2) of what is drawn."""
    corners = np.array([path.vertices[:4] for path in shapes.get_paths()])
    return corners.min(axis=1), corners.max(axis=1)


def moving(dim=2):
    """Strewn points after two steps of falling, as a run."""
    run = mpm(dim)
    run.until(2e-3)
    run.bodies[0].velocity += np.random.default_rng(5).normal(size=run.bodies[0].velocity.shape)
    return run


LOOKS = {
    "stress xx, Pa (tension positive)": ("stress", "xx", lambda b: b.stress[:, 0]),
    "stress zz, Pa (tension positive)": ("stress", "zz", lambda b: b.stress[:, 2]),
    "stress xy, Pa (tension positive)": ("stress", "xy", lambda b: b.stress[:, 3]),
    "mean stress, Pa (tension positive)": ("mean_stress", None, lambda b: tensors.mean(b.stress)),
    "von Mises stress, Pa": ("von_mises", None, lambda b: tensors.von_mises(b.stress)),
    "velocity y, m/s": ("velocity", "y", lambda b: b.velocity[:, 1]),
    "velocity, magnitude, m/s": ("velocity", None, lambda b: np.sqrt((b.velocity**2).sum(axis=1))),
    "density, kg/m³": ("density", None, lambda b: b.mass / b.volume),
    "volume, m³": ("volume", None, lambda b: b.volume),
    "half the support domain x, m": ("half", "x", lambda b: b.half[:, 0]),
    "body": ("body", None, lambda b: np.zeros(len(b))),
}


@pytest.mark.parametrize("label", LOOKS)
def test_the_values_are_those_of_the_points_and_the_label_has_their_unit(label):
    field, component, exact = LOOKS[label]
    run = moving()
    body = run.bodies[0]
    for what in (run, body, [body]):
        ax = plot(what, field, component)
        shapes, values = shown(ax)
        np.testing.assert_allclose(values, exact(body), rtol=1e-15, atol=0)
        lower, upper = ends(shapes)
        np.testing.assert_allclose(lower, body.x - body.half, rtol=0, atol=1e-15)
        np.testing.assert_allclose(upper, body.x + body.half, rtol=0, atol=1e-15)
        assert bar_label(ax) == label
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("x, m", "y, m") and ax.get_aspect() == 1.0
        assert ax.get_title() == ("DM-GC, t = 0.002 s" if what is run else "")


def test_a_picture_keeps_its_numbers_when_the_run_goes_on():
    run = moving()
    before = run.bodies[0].volume.copy()
    ax = plot(run, "volume")
    run.bodies[0].volume *= 2.0
    assert np.array_equal(shown(ax)[1], before)


def test_colours_part_at_zero_where_there_are_both_signs():
    body = mpm().bodies[0]
    for low, high, name, limits in (
        (-3.0, 2.0, "RdBu_r", (-3.0, 3.0)),
        (-2.0, 7.0, "RdBu_r", (-7.0, 7.0)),
        (1.0, 4.0, "viridis", (1.0, 4.0)),
        (-4.0, -1.0, "viridis", (-4.0, -1.0)),
        (-4.0, 1e-3, "viridis", (-4.0, 1e-3)),
        (2.0, 2.0 + 1e-12, "viridis", (1.9, 2.1)),
        (0.0, 0.0, "viridis", (-1.0, 1.0)),
    ):
        body.stress[:, 1] = np.linspace(low, high, len(body))
        shapes, _ = shown(plot(body, "stress", "yy"))
        assert shapes.cmap.name == name
        np.testing.assert_allclose(shapes.get_clim(), limits, rtol=1e-9)


def test_several_bodies_are_one_picture_and_what_one_lacks_is_grey():
    grid = box(2)
    law = VonMises(SOIL, peak=10e3, residual=10e3, softening=0.0)
    lower = MaterialPoints.fill(grid, law, 4, inside=lambda x: x[1] < 1.0)
    upper = MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: x[1] > 1.5)
    lower.history[:, 0] = np.linspace(0.0, 0.1, len(lower))
    ax = plot([lower, upper], "plastic_strain")
    shapes, values = shown(ax)
    assert np.array_equal(values[: len(lower)], lower.history[:, 0])
    assert len(values) == len(lower) + len(upper) and np.isnan(values[len(lower) :]).all()
    grey = matplotlib.colors.to_rgba("0.6")
    assert np.allclose(shapes.to_rgba(shapes.get_array())[-1], grey)
    assert bar_label(ax) == "plastic strain"
    _, number = shown(plot((lower, upper), "body"))
    assert np.array_equal(number, np.repeat([0, 1], [len(lower), len(upper)]))


@pytest.mark.parametrize("normal, across", [("x", "zy"), ("y", "xz"), ("z", "xy")])
def test_in_3d_a_plane_cuts_the_support_domains_that_it_meets(normal, across):
    run = moving(3)
    body, axis, axes = run.bodies[0], "xyz".index(normal), ["xyz".index(a) for a in across]
    at = float(body.x[7, axis])
    ax = plot(run, "stress", "yz", plane=(normal, at))
    met = np.abs(body.x[:, axis] - at) < body.half[:, axis]
    shapes, values = shown(ax)
    assert np.array_equal(values, body.stress[met, 4]) and 0 < met.sum() < len(body)
    lower, upper = ends(shapes)
    np.testing.assert_allclose(lower, (body.x - body.half)[met][:, axes], rtol=0, atol=1e-15)
    np.testing.assert_allclose(upper, (body.x + body.half)[met][:, axes], rtol=0, atol=1e-15)
    assert (ax.get_xlabel(), ax.get_ylabel()) == tuple(f"{a}, m" for a in across)
    assert ax.get_title() == f"DM-GC, t = 0.002 s, {normal} = {at:.4g} m"


def test_in_3d_the_cut_is_through_the_middle_unless_told():
    grid = box(3)
    body = MaterialPoints.fill(grid, SOIL, 8, inside=lambda x: x[1] < 1.0)
    body.stress[:, 0] = body.x[:, 2]
    ax = plot(body, "stress", "xx")
    _, values = shown(ax)
    assert len(values) == len(body) / 4  # one layer of the four
    assert np.ptp(values) == 0 and abs(values[0] - 0.5) == 0.125
    assert ax.get_title() == f"z = {values[0]:.4g} m"
    edge = body.x[:, 2].max() + 0.125  # the far face belongs to the last layer
    assert np.allclose(shown(plot(body, "stress", "xx", plane=("z", edge)))[1], edge - 0.125)


@pytest.mark.parametrize("dim", (2, 3))
def test_finite_elements_show_their_cells(dim):
    run = fe(dim)
    run.until(2e-3)
    stress = run.stress(np.arange(run.grid.owned_cells))
    ax = plot(run, "stress", "yy")
    shapes, values = shown(ax)
    assert len(values) == 8  # all in 2D, one of two layers in 3D
    assert np.isin(values, stress[:, 1]).all() and np.ptp(values) > 0
    lower, upper = ends(shapes)
    np.testing.assert_allclose(upper - lower, 0.5, rtol=1e-12)
    _, q = shown(plot(run, "von_mises"))
    assert np.isin(q, tensors.von_mises(stress)).all()
    run.nodal("displacement")[:] = run.grid.space.tabulate_dof_coordinates()[:, :dim]
    _, u = shown(plot(run, "displacement", "y"))
    np.testing.assert_allclose(u, 0.5 * (lower + upper)[:, 1], rtol=1e-12)  # linear: the centre's


@pytest.mark.parametrize("dim", (2, 3))
@pytest.mark.parametrize("make", (mpm, fe), ids=("points", "elements"))
def test_stress_on_the_grid_is_that_at_the_centres_of_filled_cells(make, dim):
    run = make(dim)
    run.until(2e-3)
    stress = run.stress_field()
    plane = {} if dim == 2 else {"plane": ("z", 0.3)}
    for what, field, component, exact in (
        (stress, "stress", "yy", lambda s: s[:, 1]),
        (run, "grid_stress", "yy", lambda s: s[:, 1]),
        (stress, "mean_stress", None, tensors.mean),
        (stress, "von_mises", None, tensors.von_mises),
    ):
        ax = plot(what, field, component, **plane)
        shapes, values = shown(ax)
        lower, upper = ends(shapes)
        centre = 0.5 * (lower + upper)
        if dim == 3:
            centre = np.column_stack((centre, np.full(len(centre), 0.25)))
        there = stress.at(centre)
        np.testing.assert_allclose(values, exact(there), rtol=1e-12, atol=1e-12)
        assert np.isfinite(values).all() and np.ptp(values) > 0
        np.testing.assert_allclose(upper - lower, 0.5, rtol=1e-12)
        where = ", z = 0.3 m" if dim == 3 else ""
        name = "DM-GC" if make is mpm else "FE"
        assert ax.get_title() == (f"{name}, t = 0.002 s{where}" if what is run else where[2:])
    assert bar_label(plot(run, "grid_stress", "xy", **plane)) == (
        "stress on the grid xy, Pa (tension positive)"
    )


def test_stress_on_the_grid_leaves_empty_cells_out():
    run = regular(box(2))
    filled = run.stress_field().filled
    assert len(shown(plot(run, "grid_stress", "yy"))[1]) == filled.sum() < len(filled)


def test_what_is_unknown_is_refused_with_what_there_is(tmp_path):
    run, solid = moving(), moving(3)
    names = (
        "half, volume, stress, velocity, seat, mean_stress, von_mises, density, body, grid_stress"
    )
    for call, words in (
        (lambda: plot(run, "pressure"), f"field must be one of {names}, got 'pressure'"),
        (lambda: plot(run, 3), "field must be one of .*got 3"),
        (
            lambda: plot(run, "stress"),
            "component of stress must be one of xx, yy, zz, xy, got None",
        ),
        (lambda: plot(run, "stress", "yz"), "one of xx, yy, zz, xy, got 'yz'"),
        (lambda: plot(solid, "stress", "zy"), "one of xx, yy, zz, xy, yz, xz, got 'zy'"),
        (lambda: plot(run, "velocity", "z"), "component of velocity must be one of x, y, got 'z'"),
        (lambda: plot(run, "von_mises", "x"), "von_mises has none, got 'x'"),
        (lambda: plot(run, "von_mises", plane=("z", 0.0)), r"plane is for 3D.*\('z', 0.0\)"),
        (lambda: plot(solid, "von_mises", plane=("z", 9.0)), "z = 9 m; the bodies are between"),
        (lambda: plot(solid, "von_mises", plane=("r", 0.0)), "axis of plane .*x, y, z, got 'r'"),
        (lambda: plot(solid, "von_mises", plane=("z", "up")), "place of plane .*'up'"),
        (lambda: plot(solid, "von_mises", plane=2), "plane must be an axis and a place.*2"),
        (lambda: plot(run.grid, "stress"), "plot needs material points.*Grid"),
        (
            lambda: plot(run.stress_field(), "velocity"),
            "field must be one of stress, mean_stress, von_mises, got 'velocity'",
        ),
        (lambda: plot(run, "grid_stress"), "component of grid_stress must be one of xx, yy.*None"),
        (lambda: plot([], "stress"), r"plot needs material points.*\[\]"),
        (lambda: plot([run.bodies[0], solid.bodies[0]], "volume"), "all be in 2D or all in 3D"),
        (lambda: plot(run, "volume", save=tmp_path / ".."), "path must end in a name"),
    ):
        with pytest.raises(ValueError, match=words):
            call()
    assert not list(tmp_path.iterdir())


def test_a_picture_is_saved_and_not_left_open(tmp_path):
    import matplotlib.pyplot as plt

    run = moving()
    ax = plot(run, "velocity", save=tmp_path / "new" / "velocity.png")
    saved = plt.imread(tmp_path / "new" / "velocity.png")
    assert min(saved.shape[:2]) > 300 and not plt.get_fignums() and ax.collections
    _, own = plt.subplots()
    assert plot(run, "velocity", ax=own, save=tmp_path / "velocity.pdf") is own
    assert (tmp_path / "velocity.pdf").stat().st_size and len(plt.get_fignums()) == 1
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"picture not written.*velocity\.png"):
        plot(run, "velocity", save=tmp_path / "file" / "velocity.png")


def test_matplotlib_is_loaded_only_to_draw():
    program = "import sys, mpm_fenicsx; print('matplotlib' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment(), capture_output=True, text=True
    )
    assert done.stdout.split() == ["False"], done.stderr
    assert mpm_fenicsx.plot is plot


def draw_on_ranks(folder):
    """Every rank draws; the first has all points, and all have the error."""
    run = regular(box(2))
    ax = plot(run, "volume", save=Path(folder) / "all.png")
    assert (ax is None) == (MPI.COMM_WORLD.rank > 0)
    if ax is not None:
        _, values = shown(ax)
        assert len(values) == 16 and np.isclose(values.sum(), 1.0)
    ax = plot(run, "grid_stress", "yy")
    assert (ax is None) == (MPI.COMM_WORLD.rank > 0)
    if ax is not None:
        assert len(shown(ax)[1]) == 4
    try:
        plot(run, "pressure")
    except ValueError as error:
        assert "pressure" in str(error)
        print("refused", flush=True)


def test_two_ranks_draw_one_picture(tmp_path):
    assert on_ranks(2, __file__, tmp_path).count("refused") == 2 and (tmp_path / "all.png").exists()


if __name__ == "__main__":
    draw_on_ranks(sys.argv[1])
