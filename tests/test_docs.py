"""Every page of docs/ does what it says: its code runs, prints what is shown, and names what is
there."""

import re
from pathlib import Path

import pages
import pytest

import mpm_fenicsx

DOCS = pages.HOME / "docs"
MADE = "_build", "gallery"  # by sphinx
PAGES = sorted(
    page.relative_to(DOCS).as_posix()
    for page in DOCS.rglob("*.md")
    if page.relative_to(DOCS).parts[0] not in MADE
)


@pytest.mark.parametrize("name", PAGES)
def test_page(name, tmp_path, monkeypatch):
    pages.run(DOCS / name, tmp_path, monkeypatch)


def test_every_public_name_is_in_the_interface_once():
    shown = [
        name
        for page in (DOCS / "api").glob("*.rst")
        for name in re.findall(r"(?:auto\w+|py:data):: (\w+)$", page.read_text(), re.MULTILINE)
    ]
    assert sorted(shown) == sorted(mpm_fenicsx.__all__)


@pytest.mark.parametrize("folder", ["scenes", "analytical"])
def test_every_scene_and_exact_answer_is_there(folder):
    modules = {one.stem for one in (pages.HOME / "mpm_fenicsx" / folder).glob("[a-z]*.py")}
    page = (DOCS / "api" / f"{folder}.rst").read_text()
    assert set(re.findall(rf"automodule:: mpm_fenicsx.{folder}.(\w+)", page)) == modules


# -- the check of pages itself ---------------------------------------------------------------------


def written(folder: Path, text: str, monkeypatch) -> None:
    """Run a page of this text."""
    monkeypatch.setattr(pages, "HOME", folder)
    page = folder / "page.md"
    page.write_text(text)
    (folder / "empty").mkdir()
    pages.run(page, folder / "empty", monkeypatch)


PRINTS = "```python\na = 2\n```\n\nand\n\n```python\nprint(a)\n```\n"


def test_blocks_share_names_and_print_what_follows(tmp_path, monkeypatch):
    written(tmp_path, PRINTS + "\n```text\n2\n```\n", monkeypatch)


@pytest.mark.parametrize("after", ["", "```text\n3\n```\n", "it prints\n\n```text\n2\n```\n"])
def test_a_page_that_shows_something_else_is_found(after, tmp_path, monkeypatch):
    with pytest.raises(AssertionError, match=r"page.md, line 8: it prints\n2"):
        written(tmp_path, PRINTS + after, monkeypatch)


WARNS = "```python\nimport warnings\nwarnings.warn('too thin', stacklevel=1)\n```\n"


def test_a_warning_is_shown_or_found(tmp_path, monkeypatch):
    written(tmp_path, WARNS + "```text\nUserWarning: too thin\n```\n", monkeypatch)
    with pytest.raises(AssertionError, match="UserWarning: too thin"):
        (tmp_path / "empty").rmdir()
        written(tmp_path, WARNS, monkeypatch)


@pytest.mark.parametrize("language", ["bash", "py", "{code-block} python"])
def test_no_block_escapes(language, tmp_path, monkeypatch):
    with pytest.raises(AssertionError, match="run"):
        written(tmp_path, f"```{language}\n1 / 0\n```\n", monkeypatch)


@pytest.mark.parametrize(
    "line",
    [
        'make test DOLFINX=apt ARGS="-k mapping"',
        "sudo apt install make python3-dolfinx python3-scipy",
        'pip install ".[wheel,test]"',
        'python -m pip install "mpm_fenicsx[wheel]"',
        'pip install "ruff>=0.17,<0.18"',
        "conda install -c conda-forge fenics-dolfinx numba pytest",
        "conda create -n soil -c conda-forge python=3.12 fenics-dolfinx",
        "OMP_NUM_THREADS=1 mpiexec -n 2 python -m mpi4py demos/column.py",
        "cc -shared -fPIC -o mine.so demos/extensions/drucker_prager_umat.c -lm",
    ],
)
def test_shell_lines_that_are_right(line, tmp_path):
    assert pages.check(line, tmp_path) == ""


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("make tests", "tests is not asked for"),
        ("sudo apt install python3-fenics", "python3-fenics is not asked for"),
        ('pip install ".[wheels]"', "wheels is not asked for"),
        ("pip install dolfin", "dolfin is in no list"),
        ("conda install -c conda-forge fenics", "fenics is not asked for"),
        ("python demos/columns.py", "there is no demos/columns.py"),
        ("mpiexec -n 2 python -m mpi4py mine.py", "there is no mine.py"),
        ("gfortran -shared -fPIC -o mine.so mine.f", "there is no mine.f"),
        ("rm -rf results", "nobody checks"),
    ],
)
def test_shell_lines_that_are_wrong(line, wrong, tmp_path):
    assert wrong in pages.check(line, tmp_path)
