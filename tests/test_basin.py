"""A basin in three dimensions: where a column is right, and where it fails."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import basin

from mpm_fenicsx.scenes.basin import Basin, Surface, rock, soil

SMALL = Basin(radius=24.0, edge=4.0, width=56.0, cell=(4.0, 2.0), steps=20, periods=2.5)


@pytest.fixture(scope="module")
def shaken():
    run = SMALL.finite_elements()
    watch = run.record(Surface(SMALL))
    run.until(SMALL.end)
    return watch


def test_the_middle_is_level_ground_until_the_edges_are_felt(shaken):
    exact = SMALL.level(SMALL.depth, shaken.times)
    off = np.abs(shaken.at(0.0, 0.0)[:, 0] - exact)
    early = shaken.times < SMALL.arrival()
    assert off[early].max() < 0.03 * np.abs(exact).max()
    assert off.max() > 0.3 * np.abs(exact).max()


def test_the_motion_has_the_symmetry_of_basin_and_wave(shaken):
    """Across the planes x = 0 and z = 0."""
    _, _, along = shaken.on_lattice(shaken.values[-1, :, 0])
    _, _, up = shaken.on_lattice(shaken.values[-1, :, 1])
    _, _, across = shaken.on_lattice(shaken.values[-1, :, 2])
    for field, in_x, in_z in ((along, 1, 1), (up, -1, 1), (across, -1, -1)):
        assert np.abs(field).max() > 1e-4
        assert field[:, ::-1] == pytest.approx(in_x * field, abs=1e-10)
        assert field[::-1] == pytest.approx(in_z * field, abs=1e-10)


def test_rock_without_soil_moves_as_one():
    scene = Basin(filled=False, cell=(8.0, 2.0), width=96.0, steps=20, periods=1.5)
    run = scene.finite_elements()
    watch = run.record(Surface(scene))
    run.until(scene.end)
    exact = scene.level(0.0, watch.times)
    assert np.ptp(watch.values, axis=1).max() < 1e-12
    assert np.abs(watch.values[:, 0, 0] - exact).max() < 0.02 * scene.outcrop


def test_level_layers_resonate_by_the_contrast_of_impedances():
    """Undamped, in steady motion, at the first mode: Z of rock over Z of soil, of the outcrop."""
    scene = Basin(ratio=0.0)
    t = scene.step * np.arange(1600)  # forty periods, of which nothing is left
    level, bare = (scene.level(thickness, t) for thickness in (scene.depth, 0.0))
    whole = [np.abs(np.exp(2j * np.pi * scene.frequency * t) @ v) for v in (level, bare)]
    contrast = rock.density * rock.s_speed / (soil.density * soil.s_speed)
    assert whole[0] / whole[1] == pytest.approx(contrast, rel=2e-3)


def test_a_basin_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="leave a cell or more"):
        Basin(width=80.0)
    with pytest.raises(ValueError, match="width must be made of whole cells of 3 m"):
        Basin(cell=(3.0, 2.0))


@pytest.mark.validation
def test_the_demo_tells_where_a_column_fails(tmp_path):
    middle, edge, beside = basin.main(["--quick", "--results", str(tmp_path)])
    assert middle["off_before_edges"] < 0.03
    assert middle["peak"] > 1.4 * middle["peak_level"]
    assert edge["peak"] < 0.8 * edge["peak_level"] and edge["peak_up"] > 0.3
    assert beside["peak"] == pytest.approx(1.0, abs=0.05)
    for name in ("basin.json", "basin.png"):
        assert (tmp_path / name).stat().st_size > 300
