"""The study of small cuts, a few of its cases."""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import small_cuts
import small_cuts_cases


def test_a_few_cuts_are_measured_and_drawn(tmp_path):
    rows = small_cuts.main(["--quick", "--steps", "0", "--results", str(tmp_path)])
    assert (tmp_path / "small_cuts.png").stat().st_size > 10_000
    assert len(json.loads((tmp_path / "small_cuts.json").read_text())) == len(rows)
    worst = {
        cure: max(
            row["acceleration"]
            for row in rows
            if row["kind"] == "released" and row["cure"] == cure and row["mapping"] == "GIMP"
        )
        for cure in small_cuts.CURES
    }
    assert worst["none"] > 1e3 and worst["ghost penalty"] < 20
    assert not [row for row in rows if row["kind"] == "foundation"]


def test_without_a_cut_the_block_in_tension_is_exact():
    for cure in small_cuts.CURES.values():
        assert small_cuts_cases.statics(0.0, small_cuts.DM_GC, cure) < 1e-10
