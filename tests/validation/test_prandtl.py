"""Prandtl's strip collapses at (2 + π) c with B-bar, for every Poisson's ratio, and does not
without."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))
import prandtl
from methods import NOT_DERIVED, POINTS, STRAINS_APART, over

from mpm_fenicsx import CMPM, GIMP
from mpm_fenicsx.mapping.projection import DOUBLE_MAPPED

DOUBLE = tuple(mapping for mapping in POINTS if mapping.integrate is DOUBLE_MAPPED)
LOCKS = "bilinear cells lock without B-bar"
STOPS = {GIMP: NOT_DERIVED, CMPM: STRAINS_APART}

pytestmark = pytest.mark.validation


@pytest.mark.parametrize("poisson", prandtl.POISSON)
@over(None, *DOUBLE)
def test_the_load_levels_off_at_prandtls(mapping, poisson, record):
    row = prandtl.measure(mapping or "FE", poisson, b_bar=True)
    record(
        f"3 Prandtl, B-bar, ν = {poisson:g}: collapse load",
        mapping,
        abs(row["error_percent"]) / 100,
    )
    assert row["stopped"] is None
    assert abs(row["error_percent"]) < 3.0
    assert abs(row["growth_percent"]) < 0.1
    assert max(row["curve"]) < 1.03 * prandtl.EXACT


@pytest.mark.parametrize("poisson", prandtl.POISSON)
@over(None, *POINTS)
def test_without_b_bar_soil_that_keeps_its_volume_locks(mapping, poisson, record):
    """Also DM-GC, whose composite strain mends the points but not the stiffness."""
    row = prandtl.measure(mapping or "FE", poisson, b_bar=False)
    case = f"3 Prandtl, bilinear, ν = {poisson:g}: collapse load"
    if row["stopped"] and mapping in STOPS:
        record(case, mapping, None, STOPS[mapping])
        assert "Newton does not converge" in row["stopped"]
        return
    record(case, mapping, row["error_percent"] / 100, LOCKS)
    assert row["stopped"] is None
    assert row["error_percent"] > 5.0
    assert row["growth_percent"] > 0.4
    factor = 5.0 if mapping is None else 1.2 if mapping.composite else 4.0
    assert poisson < 0.499 or (
        row["load_over_c"] > factor * prandtl.EXACT and row["growth_percent"] > 1.0
    )


@pytest.mark.parametrize("method", prandtl.METHODS, ids=str)
def test_the_error_falls_with_the_cells_at_the_edge(method):
    """At first order nearly: collapse is read off a strip that ends within a cell."""
    h = prandtl.cell * np.array([4.0, 2.0, 1.0])
    error = [prandtl.measure(method, 0.499, True, size)["error_percent"] for size in h]
    assert min(error) > 0.0  # from above: the strain is compatible
    rate = np.log(error[0] / error[2]) / np.log(4.0)
    assert rate > 0.8


def test_the_soil_is_stiff_enough_for_small_strain():
    """Ten times stiffer soil settles a tenth and collapses at the same load."""
    base = prandtl.measure(prandtl.DM_GC, 0.3, True)
    before = prandtl.young, prandtl.settlement
    prandtl.young, prandtl.settlement = 10 * before[0], before[1] / 10
    try:
        stiff = prandtl.measure(prandtl.DM_GC, 0.3, True)
    finally:
        prandtl.young, prandtl.settlement = before
    assert base["load_over_c"] == pytest.approx(stiff["load_over_c"], rel=5e-3)


def test_table_and_figure_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(prandtl, "steps", 2)
    monkeypatch.setattr(prandtl, "settlement", 1e-5)
    monkeypatch.setattr(prandtl, "cell", 0.2)
    rows = prandtl.main(["--results", str(tmp_path)])
    assert len(rows) > 20
    assert (tmp_path / "prandtl.png").stat().st_size > 1e4
    assert (tmp_path / "prandtl.json").stat().st_size > 1e3
