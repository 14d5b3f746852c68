"""The README does what it says, is short, and its links lead somewhere."""

import re

import pages
import pytest

README = pages.HOME / "README.md"
LINKS = sorted(set(re.findall(r"\]\(([^)#]+)[^)]*\)", README.read_text())))


def test_the_scenes_print_what_the_text_says(tmp_path, monkeypatch):
    pages.run(README, tmp_path, monkeypatch)


def test_it_is_short():
    assert len(README.read_bytes()) <= 12_000


@pytest.mark.parametrize("link", [link for link in LINKS if ":" not in link])
def test_a_link_leads_somewhere(link):
    assert (README.parent / link).exists()


@pytest.mark.parametrize("page", ["README.md", "docs/install.md"])
def test_the_apt_line_names_what_the_set_up_asks_for(page):
    asked, text = pages.apt_packages(), (pages.HOME / page).read_text()
    assert len(asked) > 5
    for package in asked:
        assert package in text, package
