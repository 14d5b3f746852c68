"""A column of soil on rock as a scene, and the demo of site response."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import site_response

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.soil_column import SoilColumn, Stratum, soil, synthetic_record

ROCK = soil(800.0, 2300.0)
UPPER, LOWER = soil(200.0, 1800.0), soil(400.0, 2000.0)
DAMPING = mpm.RayleighDamping(0.05, (1.0, 6.0))
RECORD = synthetic_record(1.0, peak=1.0, low=1.0, high=5.0)
COLUMN = SoilColumn((Stratum(UPPER, 6.0, DAMPING), Stratum(LOWER, 6.0)), ROCK, RECORD, RECORD.dt)


def error(column, make=SoilColumn.finite_elements):
    run = make(column)
    top = run.record(column.probe())
    run.until(0.5)
    return column.error(top)


def test_the_record_leaves_the_ground_at_rest_and_is_the_same_again():
    record, again = (synthetic_record(4.0, peak=2.5, seed=7) for _ in range(2))
    assert record.peak_acceleration == pytest.approx(2.5, rel=1e-12)
    assert abs(record.velocity[-1]) < 1e-12 * record.peak_velocity
    assert np.array_equal(record.acceleration, again.acceleration)


@pytest.mark.parametrize("wave", ["SV", "P"])
def test_the_surface_moves_as_it_has_to(wave):
    assert error(replace(COLUMN, wave=wave)) < 0.01


def test_points_do_likewise_and_a_layer_below_rock():
    rock = Stratum(ROCK, 1.0)
    on_rock = replace(COLUMN, strata=(*COLUMN.strata, rock), base="layer")
    assert error(on_rock) < 0.01
    assert error(COLUMN, SoilColumn.material_points) < 0.01


def test_an_up_going_wave_is_half_of_the_outcrop():
    up = replace(COLUMN, kind="up-going")
    times = RECORD.time
    assert up.exact(times) == pytest.approx(2.0 * COLUMN.exact(times), abs=1e-12)


def test_strata_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"whole cells of 1 m thick, got 6\.5 m"):
        replace(COLUMN, strata=(Stratum(UPPER, 6.5),))
    with pytest.raises(ValueError, match='base "layer" lies below rock'):
        replace(COLUMN, base="layer")
    with pytest.raises(ValueError, match="have two dampings"):
        replace(COLUMN, strata=(Stratum(UPPER, 6.0, DAMPING), Stratum(UPPER, 6.0)))
    with pytest.raises(ValueError, match="base must be one of dashpots, layer"):
        replace(COLUMN, base="springs")


def test_what_the_demo_shows(tmp_path):
    """By finite elements and with a short record; with points in
    ``validation/test_site_response.py``."""
    found = site_response.main(["--quick", "--results", str(tmp_path)])
    assert json.loads((tmp_path / "site_response.json").read_text()) == found
    for picture in ("site_response", "site_response_yielding"):
        assert (tmp_path / f"{picture}.png").stat().st_size > 10_000
    (linear,) = found["linear"]
    assert linear["error"] < 0.01 and linear["spectrum_error"] < 0.01
    weak, strong = found["hysteretic"]
    assert weak["difference"] < 0.015
    assert weak["least_reduction"] > 0.99
    assert strong["difference"] > 0.2
    assert strong["least_reduction"] < 0.6
    assert strong["equivalent_linear_peak"] > strong["surface_peak"]
    left = [abs(row["displacement_left"]) / row["outcrop_peak"] for row in (weak, strong)]
    assert left[1] > 10.0 * left[0]  # the weak one's has not died away yet
    assert abs(strong["displacement_left"]) > 1e-3
    for row in (linear, weak, strong):
        assert row["energy_not_found"] < 0.005
