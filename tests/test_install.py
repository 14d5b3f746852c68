"""An installation that lacks what pip does not bring, and one where nothing can be written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mpm_fenicsx

PACKAGE = Path(mpm_fenicsx.__file__).parent


def python(program, **environment):
    """Run a program in another process that finds this package by its path alone."""
    no = "OMPI_", "PMIX_", "PMI_", "PRTE_", "NUMBA", "XDG"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(no)}
    given = {**kept, "PYTHONPATH": str(PACKAGE.parent), **environment}
    return subprocess.run(
        [sys.executable, "-c", program],
        env=given,
        cwd=given["PYTHONPATH"],
        capture_output=True,
        text=True,
        timeout=300,
    )


@pytest.mark.parametrize("missing", ["mpi4py", "dolfinx", "petsc4py"])
def test_what_is_missing_is_said_with_how_to_install_it(missing):
    done = python(f"import sys; sys.modules[{missing!r}] = None\nimport mpm_fenicsx")
    assert done.returncode == 1
    last = done.stderr[done.stderr.rindex("ImportError") :]
    assert missing in last.splitlines()[0]
    for words in (
        'pip install "mpm_fenicsx[wheel]"',
        "conda install -c conda-forge fenics-dolfinx",
        "apt install",
    ):
        assert words in last


PROGRAM = """
import sys, warnings
warnings.simplefilter("ignore")
import numpy as np
from mpm_fenicsx import Grid, LinearElastic
from mpm_fenicsx.grid import cells
cell = np.zeros(1, np.int32)
bounds = np.zeros((1, 2)), np.ones((1, 2))
cells.walk(np.array([[0.5, 0.5]]), cell, *bounds, np.full((1, 2, 2), -1, np.int32))
assert cell[0] == 0
print("it walks", cells.walk.stats.cache_path)
"""


@pytest.mark.parametrize("caches", ["temporary", "nowhere"])
def test_a_place_where_nothing_can_be_written_is_no_hindrance(tmp_path, caches):
    """A file stands where __pycache__ would be, and the home is no folder: root cannot be kept out
    otherwise."""
    shutil.copytree(PACKAGE, tmp_path / "mpm_fenicsx", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in {source.parent for source in (tmp_path / "mpm_fenicsx").rglob("*.py")}:
        (folder / "__pycache__").write_text("")
    room = tmp_path / "room"
    room.mkdir()
    program = PROGRAM
    if caches == "nowhere":  # not even for temporary files, as far as numba can see
        program = (
            "from numba.core import caching\ncaching.CacheImpl._locator_classes = []\n" + PROGRAM
        )
    done = python(
        program,
        PYTHONPATH=str(tmp_path),
        HOME="/proc/none",
        TMPDIR=str(room),
        PYTHONDONTWRITEBYTECODE="1",
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert "it walks " + (str(room) if caches == "temporary" else "None") in done.stdout
