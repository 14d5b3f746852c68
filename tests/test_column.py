"""The column demo, held to the exact answer: the figures the README shows."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import column


def measured(base, load, mapping=None, until=None):
    run = (
        column.finite_elements(base, load)
        if mapping is None
        else column.material_points(base, load, mapping)
    )
    return column.measure(run, base, load, until)[0]


def test_fixed_base_at_the_papers_load():
    row = measured("fixed", 300e3, column.DM_GC)
    assert row["error_pressure_mid"] < 0.012
    assert row["error_pressure_base"] < 0.013
    assert row["max_pressure_mid_kpa"] == pytest.approx(410, rel=0.02)
    assert row["max_pressure_base_kpa"] == pytest.approx(600, rel=0.02)
    assert row["max_displacement_mid_m"] == pytest.approx(0.210, rel=0.02)


def test_viscous_base_at_the_papers_load():
    row = measured("viscous", 300e3, column.DM_GC)
    assert row["error_pressure_mid"] < 0.004
    assert row["error_pressure_base"] < 0.007
    assert row["error_displacement_mid"] < 0.002
    assert row["max_pressure_mid_kpa"] == pytest.approx(300, rel=0.02)
    assert row["max_displacement_mid_m"] == pytest.approx(0.395, rel=0.02)
    assert row["energy_left"] < 1e-3


def test_viscoelastic_base_at_the_papers_load():
    row = measured("viscoelastic", 300e3, column.DM_GC)
    assert row["max_pressure_mid_kpa"] == pytest.approx(310, rel=0.02)
    assert row["max_pressure_base_kpa"] == pytest.approx(367, rel=0.02)
    assert row["max_displacement_mid_m"] == pytest.approx(0.338, rel=0.02)


BASES = [pytest.param(b, marks=[pytest.mark.validation] * (b != "viscous")) for b in column.BASES]


@pytest.mark.parametrize("base", BASES)
def test_at_small_strain_it_is_as_good_as_finite_elements(base):
    points, elements = measured(base, 300.0, column.DM_GC), measured(base, 300.0)
    for name in (name for name in column.FIGURES if name.startswith("error")):
        assert points[name] < 2 * elements[name] + 1e-5, name  # 1e-5: the march of the exact column


def test_plain_mpm_loses_the_stress_once_points_cross_cells():
    assert measured("fixed", 300e3, column.MPM, until=1.0)["error_pressure_mid"] > 0.1


def test_an_unstable_run_is_reported_not_hidden():
    run = column.material_points("viscous", 300e3)
    run.step = lambda: (_ for _ in ()).throw(column.RunError("DM-GC, step 1: made to fail"))
    row, _ = column.measure(run, "viscous", 300e3)
    assert (
        row["unstable_at_step"] == 1
        and row["error_pressure_mid"] is None
        and "made to fail" in row["reason"]
    )


def test_the_script_writes_figure_and_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(column, "end", 0.17)
    rows = column.main(["--results", str(tmp_path)])
    assert all(row["steps"] == 170 for row in rows)
    assert json.loads((tmp_path / "column.json").read_text()) == rows
    assert {(row["mapping"], row["load_kpa"]) for row in rows} == {
        ("FE", 300.0),
        ("MPM", 300.0),
        ("GIMP", 300.0),
        ("DM-GC", 300.0),
        ("FE", 0.3),
        ("DM-GC", 0.3),
    }
    assert (tmp_path / "column.png").stat().st_size > 10_000
