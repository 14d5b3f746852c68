"""The foundation demo on its coarse grid: what boundaries do to the stress under the strip."""

import importlib.util
import json
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import foundation

from mpm_fenicsx.scenes.foundation import (
    Foundation,
    elastic,
    first,
    height,
    load,
    pulses,
    softening,
)

MESHES = foundation.HOME / "meshes"
MAKERS = foundation.METHODS
BACK = first + (2 * height - 0.97) / elastic.p_speed  # s: base's echo at point 2


@pytest.fixture(scope="module")
def runs():
    """Rows and curves of both methods, past the largest stress of the second pulse."""
    scenes = [Foundation(boundary, cell=0.125) for boundary in ("fixed", "viscous")]
    return {
        (method, scene.boundary): foundation.measure(make(scene), scene, until=0.65)[:2]
        for method, make in MAKERS.items()
        for scene in scenes
    }


@pytest.mark.parametrize("method", MAKERS)
def test_fixed_boundaries_bring_the_soil_to_yield_and_dashpots_do_not(runs, method):
    fixed, viscous = (runs[method, boundary][0] for boundary in ("fixed", "viscous"))
    plateau = foundation.plateau / 1e3
    assert (
        0.98 * plateau < fixed["max_deviatoric_kpa"] < 1.002 * plateau
    )  # a mean of samples that do not pass it
    assert fixed["time_of_max_s"] == pytest.approx(0.62, abs=0.011)
    assert fixed["plastic_area_m2"] > 0.2
    assert 14.0 < viscous["max_deviatoric_kpa"] < 14.9 and viscous["plastic_area_m2"] == 0.0


@pytest.mark.parametrize("method", MAKERS)
def test_no_boundary_is_felt_before_its_echo_arrives(runs, method):
    fixed, viscous = (runs[method, boundary][1] for boundary in ("fixed", "viscous"))
    early = fixed[0] < BACK - 0.02  # implicit steps of Courant number 2.7 run ahead a little
    assert np.abs(fixed[2] - viscous[2])[early].max() < 0.005 * fixed[2].max()
    assert BACK < foundation.departure(fixed, viscous) < BACK + 0.06


def test_material_points_agree_with_finite_elements(runs):
    for boundary in ("fixed", "viscous"):
        points, elements = (runs[method, boundary][0] for method in ("DM-GC", "FE"))
        assert points["max_deviatoric_kpa"] == pytest.approx(
            elements["max_deviatoric_kpa"], rel=0.03
        )
        assert points["settlement_m"] == pytest.approx(elements["settlement_m"], rel=0.03)


def test_energy_is_accounted_for(runs):
    for (method, _), (row, _) in runs.items():
        assert row["energy_error"] < (1e-4 if method == "FE" else 0.01)


@pytest.mark.parametrize("cell", foundation.CELLS)
@pytest.mark.parametrize("boundary", ("fixed", "viscous"))
def test_the_scenes_own_grid_is_that_of_the_meshes(boundary, cell):
    scene = Foundation(boundary, cell=cell)
    read, made = foundation.material_points(scene).grid.lattice, scene.grid().lattice
    assert np.array_equal(read.lower, made.lower) and np.array_equal(read.upper, made.upper)


def test_pulses():
    t = np.array([0.0, 0.225, 0.325, 0.425, 0.475, 0.525, 0.625, 0.925])
    assert pulses(t, 26.0) == pytest.approx([0, 0, 26, 0, 0, 0, 26, 26])


def test_meshes_come_out_of_their_script_again():
    spec = importlib.util.spec_from_file_location("foundation_meshes", MESHES / "foundation.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    made = script.meshes()
    assert sorted(made) == sorted(path.name for path in MESHES.glob("foundation*.vtu"))
    for name, mesh in made.items():
        stored = meshio.read(MESHES / name)
        assert np.array_equal(stored.points, mesh.points)
        assert np.array_equal(stored.get_cells_type("quad"), mesh.cells[0].data)


def test_a_run_that_stops_keeps_its_row():
    scene = Foundation("fixed", cell=0.5)
    run = scene.finite_elements()
    run.step = lambda: (_ for _ in ()).throw(foundation.RunError("FE, step 1: made to fail"))
    row = foundation.measure(run, scene)[0]
    assert row["steps"] == 0 and "made to fail" in row["reason"]


def test_the_script_writes_figures_and_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(foundation, "end", 0.01)
    rows = foundation.main(
        ["--quick", "--load", "30", "--softening", "20", "--results", str(tmp_path)]
    )
    assert json.loads((tmp_path / "foundation.json").read_text()) == rows
    assert {(row["method"], row["boundary"]) for row in rows} == {
        (method, boundary) for method in MAKERS for boundary in foundation.BOUNDARIES
    }
    for row in rows:
        assert (row["load_kpa"], row["softening_kpa"], row["cell_m"], row["steps"]) == (
            30.0,
            20.0,
            0.125,
            2,
        )
        assert set(foundation.FIGURES) <= set(row)
    ground = json.loads((tmp_path / "foundation_ground.json").read_text())
    assert [row["ground"] for row in ground] == [*foundation.GROUND, foundation.WIDE]
    assert all(row["steps"] == 2 and row["load_kpa"] == 30.0 for row in ground)
    assert all(
        (tmp_path / name).stat().st_size > 10_000
        for name in ("foundation.png", "foundation_maps.png", "foundation_ground.png")
    )


# -- open ground -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ground(runs):
    """Rows and curves (time, q, settlement) of the demo's open ground, until all runs end."""
    whole = runs["DM-GC", "viscous"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(foundation, "end", 0.65)
        rows, curves = foundation.open_ground(load, softening, 0.125, whole, lambda step: None)
    return {row["ground"]: row for row in rows}, curves


@pytest.mark.validation
def test_points_under_the_strip_alone_do_what_all_points_do(ground):
    rows, curves = ground
    every, few = (curves[name] for name in list(foundation.GROUND)[:2])
    assert np.abs(few[1] - every[1]).max() < 0.005 * every[1].max()
    assert np.abs(few[2] - every[2]).max() < 0.005 * every[2].max()
    assert rows["points in 2 m × 2 m, dashpots"]["energy_error"] < 1e-3


@pytest.mark.validation
def test_a_layer_settles_as_wide_ground_does_and_dashpots_settle_more(ground):
    """A mesh from which nothing comes back; finite elements of this size are 1.6 % off in q."""
    _, curves = ground
    wide = curves[foundation.WIDE]

    def apart(name, what):
        return np.linalg.norm(curves[name][what] - wide[what]) / np.linalg.norm(wide[what])

    _, dashpots, layer = foundation.GROUND
    assert apart(layer, 2) < 0.005 and apart(dashpots, 2) > 0.05
    assert apart(layer, 1) < 0.02 < apart(dashpots, 1)


@pytest.mark.parametrize(
    "given, message",
    [
        ({"boundary": "springs"}, "boundary must be one of fixed, viscous, viscoelastic, layer"),
        ({"boundary": "viscous", "box": (2.1, 2.0)}, "box must be wider than the strip"),
        ({"boundary": "viscous", "box": (6.0, 2.0)}, "box must be wider than the strip"),
    ],
)
def test_what_the_scene_cannot_be_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        Foundation(**given)
