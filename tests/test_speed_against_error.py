"""Speed against error, on a bar: rows, orders, going on from where it ended, and failures that are
told."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import speed_against_error as study
from speed_against_error_cases import SCENES, Case, cases, measure

SMALL = ["--quick", "--scene", "bar, standing", "--method", "FE", "DM-GC"]


def rows_in(folder):
    return json.loads((folder / "speed_against_error.json").read_text())["rows"]


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Ten and twenty cells, and one tolerance for the points."""
    monkeypatch.setattr(
        study,
        "cases",
        lambda *chosen: [
            case for case in cases(*chosen) if case.cell > 0.03 or case.tolerance == 1e-2
        ],
    )


@pytest.fixture
def done(few, tmp_path):
    return tmp_path, study.main([*SMALL, "--results", str(tmp_path)])


def test_rows_orders_and_figure(done):
    folder, rows = done
    assert [(row["method"], row["steps"], row["tolerance"]) for row in rows] == [
        ("FE", 20, None),
        ("DM-GC", 20, None),
        ("FE", 40, None),
        ("DM-GC", 40, None),
        ("DM-GC", 80, 1e-2),
    ]
    assert all(row["seconds"] > 0 and row["unstable_at_step"] is None for row in rows)
    written = json.loads((folder / "speed_against_error.json").read_text())
    assert written["about"]["dolfinx"] and len(written["rows"]) == len(rows)
    found = {row["method"]: row for row in written["orders"] if row["in"] == "h and Δt"}
    assert min(found["DM-GC"]["error_stress"][-1], found["FE"]["error_stress"][-1]) > 1.85
    back, there = written["distances"]
    assert there["method"] == back["over"] == "DM-GC" and there["error_stress"] == pytest.approx(
        1.0, abs=0.5
    )
    for name in ("seconds", "error_stress", "seconds_at_equal_error_stress"):
        assert there[name] * back[name] == pytest.approx(1.0, rel=1e-5)
    assert (folder / "speed_against_error.png").stat().st_size > 20_000


@pytest.mark.validation
def test_what_is_there_is_not_run_again(done, monkeypatch):
    folder, rows = done
    monkeypatch.setattr(study, "measure", lambda case: pytest.fail(f"ran {case}"))
    again = study.main([*SMALL, "--results", str(folder)])
    assert len(again) == len(rows) and not any(row["failed"] for row in again)


@pytest.mark.validation
def test_failures_and_interrupts_lose_nothing_and_are_run_again(tmp_path, monkeypatch):
    ran, arguments = [], [*SMALL[:-2], "DM-GC", "--results", str(tmp_path)]

    def breaks(case):
        ran.append(case)
        if len(ran) == 1:
            raise MemoryError("made to fail")
        if len(ran) == 3:
            raise KeyboardInterrupt
        return measure(case)

    monkeypatch.setattr(study, "measure", breaks)
    study.main(arguments)
    rows = rows_in(tmp_path)
    assert [row["failed"] for row in rows] == ["MemoryError: made to fail", None]
    monkeypatch.setattr(study, "measure", lambda case: ran.append(case) or measure(case))
    study.main(arguments)
    assert ran[3] == ran[0] and ran[4] == ran[2] and len(ran) == 5
    assert len(rows_in(tmp_path)) == 3 and not any(row["failed"] for row in rows_in(tmp_path))


def test_an_unstable_run_says_at_which_step():
    scene = SCENES["bar, moving"]
    row = measure(
        Case(
            "bar, moving", "DM-GC", scene.cells[2], scene.step(scene.cells[2], 0.5), tolerance=0.01
        )
    )
    assert (
        row["unstable_at_step"] == 1
        and row["error_stress"] is None
        and "stress beyond" in row["reason"]
    )


def test_the_column_is_measured_like_its_demo():
    row = measure(Case("column, fixed, 0.3 kPa", "FE", 0.5, 0.01, per_cell=None))
    assert row["steps"] == 150 and row["error_displacement"] < row["error_stress"] < 0.1


def test_full_settings_hold_the_quick_ones():
    quick, full = (set(cases(SCENES, study.METHODS, quick)) for quick in (True, False))
    assert quick < full and {case.method for case in quick} == set(study.METHODS)
    steps = [SCENES[case.scene].end / case.dt for case in full]
    assert steps == pytest.approx([round(number) for number in steps])
