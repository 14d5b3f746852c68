"""The overloaded strip's study, small; what it finds is held in tests/validation."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import overload


def test_the_load_rises_and_is_held():
    assert overload.held(overload.START) == 0.0
    assert overload.held(overload.START + overload.RISE / 3) == pytest.approx(overload.PRESSURE / 2)
    assert overload.held(9.0) == overload.PRESSURE


def test_rows_and_figure(tmp_path, monkeypatch):
    monkeypatch.setattr(
        overload, "CASES", [case for case in overload.CASES if case[0] in (None, overload.DM_GC)]
    )
    rows = overload.main(["--cell", "0.25", "--until", "0.3", "--results", str(tmp_path)])
    assert json.loads((tmp_path / "overload.json").read_text()) == rows
    assert (tmp_path / "overload.png").stat().st_size > 10_000
    fe, dead, traction = rows
    assert [row["load"] for row in rows] == ["DeadLoad", "DeadLoad", "Traction"]
    assert not any(row["stopped"] for row in rows)
    # elements of this coarse grid lock: 4 % stiffer than points, which the correction damps no more
    # (2 % before)
    np.testing.assert_allclose(
        [dead["settlement_m"][-1], traction["settlement_m"][-1]], fe["settlement_m"][-1], rtol=0.05
    )
    assert traction["area_m2"][-1] == pytest.approx(dead["area_m2"][-1], abs=1e-3)
