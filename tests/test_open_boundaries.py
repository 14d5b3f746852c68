"""The study of open ground: a few of its rows, its packets before they meet anything."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import open_boundaries
import open_boundaries_packets
from open_boundaries_packets import Packet, dispersion, soil_of

from mpm_fenicsx import FiniteElements, Fixed, Grid, Newmark


def test_a_few_rows_are_measured_drawn_and_kept(tmp_path, monkeypatch):
    rows = open_boundaries.main(["--quick", "--results", str(tmp_path)])
    assert (tmp_path / "open_boundaries.png").stat().st_size > 10_000
    assert json.loads((tmp_path / "open_boundaries.json").read_text()) == rows
    lamb = {row["boundary"]: row for row in rows if row["kind"] == "lamb"}
    assert lamb["layer, 3 cells"]["error"] < 0.2 * lamb["dashpots"]["error"]
    assert lamb["dashpots"]["cost"] == [1.0, 1.0, 1.0]
    three = [row for row in rows if row.get("boundary") == "layer, 3 cells" and "energy" in row]
    assert len(three) == 4 and max(max(row["energy"]) for row in three) < 3e-5


@pytest.mark.parametrize("wave", ["P", "S"])
def test_the_grids_own_waves_have_the_speed_and_the_direction_of_the_grounds(wave):
    soil, k = soil_of(0.25), 0.02
    speed = soil.p_speed if wave == "P" else soil.s_speed
    for angle in (0.1, 0.8, 2.5):
        n = np.array([np.cos(angle), np.sin(angle)])
        Ω, d, mass = dispersion(soil, wave, *(k * n))
        assert Ω / k == pytest.approx(speed, rel=1e-4) and mass == pytest.approx(1.0, rel=1e-3)
        assert d @ (n if wave == "P" else [-n[1], n[0]]) == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("wave", ["P", "S"])
def test_a_packet_goes_on_in_the_elements_as_in_the_unbounded_grid(wave, monkeypatch):
    """To the tails that are cut off."""
    for name, cells in (("ALONG", 6.0), ("ACROSS", 6.0), ("CELLS", 8)):
        monkeypatch.setattr(open_boundaries_packets, name, cells)
    packet = Packet(wave, 30.0)
    wide, high = 64, 64
    grid = Grid.box((0, 0), (wide, high), (wide, high))
    fixed = Fixed(grid.facets("left", "right", "bottom", "top"))
    run = FiniteElements(grid, packet.soil, Newmark(packet.dt), [fixed])
    x = grid.space.tabulate_dof_coordinates()[:, :2]
    there = x + packet.start - [24.0, 40.0]
    names = ("displacement", "velocity", "acceleration")
    for name, value in zip(names, packet.at(0, there), strict=True):
        run.nodal(name)[:] = value
    for _ in range(6):
        run.step()
    for name, value in zip(names, packet.at(6, there), strict=True):
        assert np.linalg.norm(run.nodal(name) - value) < 2e-3 * np.linalg.norm(value)
