"""Tables in the documentation are those that the results give."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import tables


@pytest.mark.parametrize("page", tables.pages(), ids=lambda page: page.stem)
def test_a_page_shows_what_results_say(page):
    text = page.read_text()
    assert tables.renewed(text) == text


def test_every_table_has_its_place_and_a_changed_number_is_found():
    text = "".join(page.read_text() for page in tables.pages())
    marks = [found[2] for found in tables.MARK.finditer(text)]
    assert sorted(marks) == sorted(tables.TABLES)
    changed = text.replace("| 24,576 in 2D | ", "| 24,576 in 2D | 1", 1)
    assert changed != text and tables.renewed(changed) == text
