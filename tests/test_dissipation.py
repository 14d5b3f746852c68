"""The study of dissipation: its exact answers, and what it writes."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import amplification
import dissipation

from mpm_fenicsx.analytical.column import Column


def test_the_exact_column_under_a_sudden_load_goes_up_in_steps():
    """0, 1, 2, 1, 0 times the load at mid-height of a fixed column, the wave passing there every
    L/c."""
    height, c = 20.0, dissipation.column.soil.p_speed
    column = Column(height, c, 1500.0, lambda t: dissipation.sudden(t, 3.0), 1.0)
    times = np.arange(5) * height / c
    np.testing.assert_allclose(
        column.pressure(height / 2, times), [0.0, 3.0, 6.0, 3.0, 0.0], atol=1e-9
    )


def test_the_block_gains_what_its_matrix_says():
    """DM-GC as in the paper: 0.67 % a step in amplitude (tests/test_amplification.py), in the end;
    arg λ = 0.3518, so that 250 steps are 28 swings of the energy within a period."""
    energy = [
        dissipation.measure_block(amplification.PAPERS, 1.0, steps)["energy_left"]
        for steps in (400, 650)
    ]
    assert np.log(energy[1] / energy[0]) / 250 / 2 == pytest.approx(np.log1p(6.702e-3), rel=0.002)


def test_the_study_writes_its_rows(tmp_path, monkeypatch):
    few = [case for case in dissipation.cases() if case[0]["case"] == "sudden 0.3 kPa, Δt = 4 ms"][
        :3:2
    ]
    monkeypatch.setattr(dissipation, "cases", lambda: few)
    monkeypatch.setattr(dissipation, "END", 0.2)
    rows = dissipation.main(["--results", str(tmp_path)])
    assert json.loads((tmp_path / "dissipation.json").read_text()) == rows
    assert [row["radius"] for row in rows] == [1.0, 0.8]
    assert rows[1]["ringing"] < rows[0]["ringing"]
    assert (tmp_path / "dissipation.png").stat().st_size > 10_000
