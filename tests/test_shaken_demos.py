"""The demos of a dam and a slope in an earthquake, coarse."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mpm_fenicsx as mpm

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import dam_on_rock
import slope_earthquake

from mpm_fenicsx.scenes.dam_on_rock import CONCRETE, DamOnRock
from mpm_fenicsx.scenes.shaken_slope import ShakenSlope, cycles, sliding_block


def written(folder, name):
    assert (folder / f"{name}.png").stat().st_size > 10_000
    return json.loads((folder / f"{name}.json").read_text())


@pytest.mark.validation
def test_a_layer_gives_what_a_larger_box_does(tmp_path):
    """Without the dam the surface moves by the exact answer, within the grid's dispersion."""
    found = dam_on_rock.main(["--quick", "--results", str(tmp_path)])
    assert written(tmp_path, "dam_on_rock") == found
    layer, dashpots = found["rows"]["layer"], found["rows"]["dashpots"]
    assert max(row["surface_without_dam"] for row in (layer, dashpots)) < 0.015
    assert max(layer["crest"], layer["heel"]) < 0.02
    assert min(dashpots["crest"], dashpots["heel"]) > 5 * max(layer["crest"], layer["heel"])
    assert 3.0 < found["crest_peak"] < 4.0


def test_the_dam_is_as_large_as_drawn():
    dam = DamOnRock(cell=5.0)
    grid = dam.grid(dam.height + dam.cell)
    points = mpm.MaterialPoints.fill(grid, CONCRETE, 4, dam.in_dam, cut=True)
    by_hand = dam.base * dam.foot + 0.5 * (dam.base + dam.top) * (dam.height - dam.foot)
    assert points.volume.sum() == pytest.approx(by_hand, rel=5e-3)


def test_a_boundary_that_is_none_is_refused():
    with pytest.raises(ValueError, match="boundary must be"):
        replace(DamOnRock(), boundary="open")


@pytest.mark.validation
def test_the_slope_stands_is_shaken_and_runs_out(tmp_path):
    """Where the clay keeps its strength it moves as far as Newmark's block, within a factor of
    two."""
    found = slope_earthquake.main(["--quick", "--results", str(tmp_path)])
    assert written(tmp_path, "slope_earthquake") == found
    assert found["speed_before"] < 1e-8
    assert found["crest"] > 1.0 and found["run_out"] > 0.5
    assert 0.5 < found["crest_that_keeps"] / found["newmark"] < 2.0
    assert abs(found["energy_not_found"]) < 0.03


def test_a_block_slides_as_far_as_by_hand():
    """A pulse a for T on a block that bears k: v = (a - k) T, and stops after v/k:
    (a - k) T² a/2k."""
    a, k, T, dt = 3.0, 1.0, 0.5, 1e-4
    pulse = np.where(np.arange(30000) * dt < T, -a, 0.0)
    assert sliding_block(pulse, dt, k)[-1] == pytest.approx((a - k) * T**2 * a / (2 * k), rel=1e-3)
    assert not sliding_block(-pulse, dt, k).any()


def test_circles_find_the_height_of_a_vertical_cut():
    """c/γH = 1/3.83 (Taylor 1937)."""
    slope = ShakenSlope(run_per_rise=1e-6)
    strength = slope.density * 9.81 * (slope.crest - slope.foreland) / 3.83
    assert (
        slope.yield_acceleration(1.01 * strength) > 0.0 > slope.yield_acceleration(0.98 * strength)
    )


def test_the_shaking_ends_at_rest():
    record = cycles(1.0, 1.25, 6)
    assert abs(record.velocity[-1]) < 1e-5 * np.abs(record.velocity).max()
    assert abs(record.displacement[-1]) < 1e-3 * np.abs(record.displacement).max()
