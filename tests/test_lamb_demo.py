"""Lamb's problem as a scene, and the demo of it."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import lamb

from mpm_fenicsx.scenes.lamb import Lamb, Watch, held, ricker

SMALL = Lamb("large", cells=4, wave=8.0, periods=3.0)


def watched(scene, make=Lamb.finite_elements):
    run = make(scene)
    watch = run.record(Watch(scene))
    run.until(scene.end)
    return watch


def test_the_wavelet_leaves_no_impulse_and_the_held_load_stays():
    t = np.linspace(0.0, 3.0, 3001)
    assert abs(ricker(t, 1.0).mean()) < 1e-8 and ricker(1.5, 1.0) == 1.0
    assert abs(ricker(0.0, 1.0)) < 1e-7
    assert held(np.array([0.0, 0.5, 1.0, 7.0]), 1.0) == pytest.approx([0.0, 0.5, 1.0, 1.0])


def test_nothing_comes_back_in_the_large_mesh():
    """P waves that have gone to its edge reach the box after the end: more cells change nothing,
    but for the little that an implicit step carries ahead of them."""
    known = watched(replace(SMALL, around=SMALL.around + 8))
    assert watched(SMALL).error(known) < 1e-4
    assert watched(replace(SMALL, around=SMALL.around - 8)).error(known) > 1e-3


@pytest.mark.parametrize("boundary", ["layer", "viscoelastic"])
def test_half_of_the_box_is_the_whole(boundary):
    whole, half = (
        watched(replace(SMALL, boundary=boundary, around=None, symmetric=half))
        for half in (False, True)
    )
    right = whole.places[:, 0] > -1e-9
    assert np.allclose(whole.places[right], half.places)
    apart = np.abs(whole.values[:, right] - half.values).max()
    assert apart < 1e-9 * np.abs(whole.values).max()


def test_what_the_demo_shows(tmp_path):
    """By finite elements; with points in ``validation/test_open_ground.py``."""
    rows = lamb.main(["--methods", "FE", "--results", str(tmp_path)])
    assert json.loads((tmp_path / "lamb.json").read_text()) == rows
    error = {row["boundary"]: row["error"] for row in rows}
    assert error["large"] is None
    assert error["layer"] < 0.012
    assert min(error["viscous"], error["viscoelastic"]) > 15 * error["layer"]
    assert (tmp_path / "lamb.png").stat().st_size > 10_000


@pytest.mark.parametrize("how", [{"boundary": "open"}, {"dim": 1}])
def test_what_is_no_scene_is_refused(how):
    with pytest.raises(ValueError, match=f"{next(iter(how))} must be"):
        Lamb(**how)
