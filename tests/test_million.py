"""The study of many points says what it ran."""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import million


def test_a_small_one(tmp_path, capsys):
    found = million.main(["--points", "600", "--steps", "1", "--results", str(tmp_path / "a.json")])
    assert found["points"] == found["points_of_ranks"][0] == 512
    assert json.loads((tmp_path / "a.json").read_text()) == found
    assert found["peak_mib_with_snapshots"] >= found["peak_mib"] > 50.0
    # five files of the points, 165 bytes each and more, and five of the grid
    assert found["snapshot_bytes"][".vtu"] > 5 * 512 * 165
    assert found["points_read"] == [512] * 5
    assert "step_s" in capsys.readouterr().out


def test_a_million_is_a_million():
    scene = million.scene_of(1_000_000)
    points = 8 * round(scene.width / scene.cell) ** 2 * round(scene.depth / scene.cell)
    assert points == 1_000_000
    assert scene.step * million.soil.p_speed / scene.cell == 0.5
