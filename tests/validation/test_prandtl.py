"""Prandtl's strip collapses at (2 + π) c with B-bar, for every Poisson's ratio, and does not without."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))
import prandtl

pytestmark = pytest.mark.validation


@pytest.mark.parametrize("poisson", prandtl.POISSON)
@pytest.mark.parametrize("method", prandtl.METHODS, ids=str)
def test_the_load_levels_off_at_prandtls(method, poisson):
    row = prandtl.measure(method, poisson, b_bar=True)
    assert row["stopped"] is None
    assert abs(row["error_percent"]) < 3.0
    assert abs(row["growth_percent"]) < 0.1
    assert max(row["curve"]) < 1.03 * prandtl.EXACT


@pytest.mark.parametrize("method, factor", [("FE", 5.0), (prandtl.DM_G, 4.0), (prandtl.DM_GC, 1.2)], ids=str)
def test_without_b_bar_soil_that_keeps_its_volume_locks(method, factor):
    """Also DM-GC, whose composite strain mends the points but not the stiffness."""
    row = prandtl.measure(method, 0.499, b_bar=False)
    assert row["load_over_c"] > factor * prandtl.EXACT
    assert row["growth_percent"] > 1.0


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
