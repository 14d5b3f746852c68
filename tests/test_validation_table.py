"""The table of tests/validation: every cell is filled or explained, and rows reach the file from
xdist's workers."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "validation"))
import absent
import table

HOME = Path(__file__).parents[1]
VALIDATION = HOME / "tests" / "validation"

CASES = """
import pytest
pytestmark = pytest.mark.validation

@pytest.mark.parametrize("name", ["DM", "FE"])
def test_one(name, record):
    record("2 second", name, 0.02)
    record("1 first", name, None, "it runs away")
"""
MORE = (
    CASES.replace("2 second", "10 last").replace('["DM", "FE"]', '["GIMP"]')
    + """
    assert not FAIL
"""
)


def row(case, mapping, error=0.01, note=""):
    return {
        "case": case,
        "mapping": mapping,
        "error": error,
        "result": "fails" if note else "pass",
        "note": note,
    }


def test_a_letter_says_why_a_cell_is_a_failure_or_a_dash(monkeypatch):
    monkeypatch.setattr(table, "ABSENT", (("2 second", "DM FE", "not here"), ("2", "MPM", "never")))
    rows = [
        row("1 first", "FE", 2e-7),
        row("1 first", "MPM", 30.0, "lost"),
        row("1 first", "DM", None, "lost"),
        row("2 second", "GIMP"),
        row("3 third", "FE", 0.9973),
    ]
    assert table.markdown(rows).splitlines() == [
        "| case | FE | MPM | GIMP | DM |",
        "|---|---|---|---|---|",
        "| 1 first | 2e-07 | > 1000 % (a) |  | ∞ (a) |",
        "| 2 second | – (b) | – (c) | 1 % | – (b) |",
        "| 3 third | 100 % |  |  |  |",
        "",
        "(a) lost  ",
        "(b) not here  ",
        "(c) never  ",
    ]
    assert ("1 first", "GIMP") in table.blanks(rows) and ("2 second", "MPM") not in table.blanks(
        rows
    )


def test_new_rows_replace_old_ones_of_the_same_case_and_mapping(tmp_path):
    file = tmp_path / "rows.json"
    table.merge([row("10 last", "DM"), row("1 first", "DM-GC"), row("1 first", "MPM")], file)
    merged = table.merge([row("1 first", "DM-GC", 0.5)], file)
    assert (
        merged
        == table.read(file)
        == [row("1 first", "MPM"), row("1 first", "DM-GC", 0.5), row("10 last", "DM")]
    )
    assert table.merge([row("10 last", "DM", 0.5)], file, keep=False) == [row("10 last", "DM", 0.5)]


def test_no_cell_of_the_table_is_blank():
    rows = table.read()
    assert table.blanks(rows) == []
    filled = {(one["case"], one["mapping"]) for one in rows}
    dashes = [
        (one["case"], name)
        for one in rows
        for name in table.ORDER
        if (one["case"], name) not in filled
    ]
    for start, mappings, why in absent.ABSENT:
        for name in mappings.split():
            assert any(
                case.startswith(start) and at == name and table.absent(case, at) == why
                for case, at in dashes
            ), f"nothing is left out by {start!r}, {name}"


def test_the_page_shows_the_rows_of_the_file():
    assert table.shown() == table.markdown(table.read()).rstrip()


def test_the_table_of_a_page_is_renewed_and_the_rest_stays(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# Σ\n\n<details>\n<summary>Rows</summary>\n\nold\n\n</details>\n\nend\n", "utf-8"
    )
    rows = [row("1 first", "MPM", 30.0, "lost"), row("1 first", "FE", 2e-7)]
    table.show(rows, page)
    assert table.shown(page) == table.markdown(rows).rstrip()
    assert page.read_text("utf-8").startswith(
        "# Σ\n\n<details>\n<summary>Rows</summary>\n\n| case |"
    )
    assert page.read_text("utf-8").endswith("(a) lost\n\n</details>\n\nend\n")
    page.write_text("no table\n")
    with pytest.raises(ValueError, match="no <details>"):
        table.show(rows, page)


@pytest.mark.parametrize("processes", [[], ["-n", "2"]], ids=["one process", "xdist"])
def test_a_whole_run_drops_old_rows_unless_it_fails(processes, tmp_path):
    home, file = tmp_path / "tests" / "validation", tmp_path / "results" / "validation.json"
    home.mkdir(parents=True)
    file.parent.mkdir()
    for name in ("conftest.py", "table.py", "absent.py"):
        shutil.copy(VALIDATION / name, home)
    (tmp_path / "dolfinx.py").write_text("__version__ = '0'\n")
    (home / "test_a.py").write_text(CASES)
    (home / "test_b.py").write_text(MORE.replace("FAIL", "False"))
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = validation\n")
    file.write_text(json.dumps([row("3 renamed", "DM"), row("1 first", "DM", 7.0)]))

    def run():
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "tests/validation", "--afresh", *processes],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
        )
        return [
            (one["case"], one["mapping"], one["error"], one["result"]) for one in table.read(file)
        ], done

    firsts = [("1 first", name, None, "fails as stated") for name in ("FE", "GIMP", "DM")]
    seconds = [("2 second", name, 0.02, "pass") for name in ("FE", "DM")]
    last = [("10 last", "GIMP", 0.02, "pass")]
    rows, done = run()
    assert done.returncode == 0 and "| 10 last | " in done.stdout, done.stdout + done.stderr
    assert rows == firsts + seconds + last
    (home / "test_b.py").write_text(MORE.replace("10 last", "11 new").replace("FAIL", "True"))
    rows, done = run()
    assert (
        done.returncode == 1
        and rows[-1] == ("11 new", "GIMP", 0.02, "FAILED")
        and set(last) < set(rows)
    )
