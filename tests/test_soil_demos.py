"""The demos of soils that fail, coarse, and the scenes that they are built of."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import cavity
import column_collapse
import slope_failure
import strip_load

from mpm_fenicsx.scenes.column_collapse import granular, lajeunesse, lube
from mpm_fenicsx.scenes.failing_slope import FACTOR, FailingSlope
from mpm_fenicsx.scenes.strip import Strip, surcharged_strip
from mpm_fenicsx.scenes.wall import Wall


def written(folder, name):
    assert (folder / f"{name}.png").stat().st_size > 10_000
    return json.loads((folder / f"{name}.json").read_text())


def test_the_cavity_is_near_its_answer(tmp_path):
    """With 6 cells a radius; finer ones are in ``validation/test_cavity.py``."""
    rows = cavity.main(["--cells", "6", "--results", str(tmp_path)])
    assert written(tmp_path, "cavity") == rows
    assert len(rows) == 4
    assert max(abs(row["displacement"]) for row in rows) < 0.05
    assert max(abs(row["plastic_radius"]) for row in rows) < 0.02


def test_the_strip_bears_its_capacity(tmp_path, monkeypatch):
    """On coarse cells; finer ones are in ``validation/test_bearing_capacity.py``."""
    rough = {"growth": 1.2, "steps": 12}
    for name, make in strip_load.SCENES.items():
        monkeypatch.setitem(
            strip_load.SCENES, name, lambda φ, ψ, cell, make=make: make(φ, ψ, cell=cell, **rough)
        )
    rows = strip_load.main(["--cell", "0.2", "--results", str(tmp_path)])
    assert written(tmp_path, "strip_load") == rows
    assert all(0.0 < row["error"] < 0.06 for row in rows)


def test_the_slope_stands_and_slides(tmp_path, monkeypatch):
    monkeypatch.setattr(slope_failure, "FACTORS", (1.0, 1.4, 1.5))
    monkeypatch.setattr(slope_failure, "FailingSlope", lambda cell: FailingSlope(cell, steps=5))
    found = slope_failure.main(["--cell", "2", "--end", "0.4", "--results", str(tmp_path)])
    assert written(tmp_path, "slope_failure")["movement"] == found["movement"]
    stands, near, fails = found["movement"]
    assert 0.3 < stands < 0.45 and near < 1.0 < fails
    assert abs(found["energy_not_found"]) < 0.03


def test_grains_begin_to_run_out(tmp_path, monkeypatch):
    """The first 0.2 s of the low column; how far it goes is for validation."""
    monkeypatch.setattr(
        column_collapse, "granular", lambda aspect, cell: granular(aspect, cell=cell, end=0.2)
    )
    (row,) = column_collapse.main(["--aspects", "0.5", "--no-clay", "--results", str(tmp_path)])
    assert written(tmp_path, "column_collapse") == [row]
    assert row["stray_points"] == 0
    assert 0.01 < row["run_out"] < lajeunesse(0.5)


@pytest.mark.validation
@pytest.mark.parametrize("aspect", [0.5, 1.0, 1.5])
def test_grains_of_each_aspect_ratio(aspect):
    column = granular(aspect)
    run = column.material_points()
    run.until(column.end)
    assert column.strays(run) == 0
    assert 0.85 * lajeunesse(aspect) < column.run_out(run) < 1.15 * lube(aspect)


def test_a_strip_that_ends_in_a_cell_has_it_around_its_edge():
    x, _ = np.array([Strip(0.3, cell=0.1).grid().centres.min(axis=0)]).T
    assert x > 0.0
    grid = surcharged_strip(20.0, 20.0, cell=0.1).grid()
    middle = grid.centres[:, 0]
    assert np.abs(middle - 1.0).min() < 1e-12


def test_surcharged_ground_is_at_rest():
    strip = surcharged_strip(20.0, 20.0, cell=0.2, growth=1.3)
    run = strip.finite_elements()
    assert strip.load(run) == pytest.approx(strip.surcharge, rel=1e-12)


@pytest.mark.parametrize("passive", [False, True])
def test_the_wall(passive):
    wall = Wall(passive, cohesion=2e3, cells=2)
    run = wall.finite_elements()
    run.until(1.0)
    assert abs(wall.error(run)) < 1e-12


def test_a_factor_of_safety_needs_a_slope_that_fails():
    slope = FailingSlope(cell=2.5, steps=2)
    assert FACTOR == 1.4
    with pytest.raises(ValueError, match="factors must end where the slope fails"):
        slope.factor_of_safety((1.0,))
