"""The study of two bars, a few of its cases."""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import two_bars


def test_ten_cells_are_run_and_drawn(tmp_path):
    rows = two_bars.main(["--quick", "--results", str(tmp_path)])
    assert (tmp_path / "two_bars.png").stat().st_size > 10_000
    assert len(json.loads((tmp_path / "two_bars.json").read_text())) == len(rows) == 2
    for row in rows:
        assert (
            row["middle"] < 0.01
            and row["velocity"] < 0.1
            and row["momentum"] < 1e-12
            and row["pull"] == 0.0
        )
